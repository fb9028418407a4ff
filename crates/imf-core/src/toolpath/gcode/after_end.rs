//! What stands behind the end of a program: comments, names and notes, or blocks that a control would carry out.

/// Letters of words that make a block of a line.
const COMMANDS: &str = "GMTXYZABCUVW";

/// True where a line has a word that a control would carry out, whether it is understood or not; numbers of blocks, names of programs
/// and words that only accompany others do not count.
pub(super) fn is_command(line: &str) -> bool {
    let mut rest = separated(line);
    let mut is_first = true;
    while let Some(letter) = rest.chars().next().filter(char::is_ascii_alphabetic) {
        let number = rest[1..].trim_start();
        let length = number_length(number);
        // A line that begins so is not a name; after that only a number is certain to make a word.
        let begins = number.starts_with(|c: char| c.is_ascii_digit() || "+-.#[".contains(c));
        if COMMANDS.contains(letter.to_ascii_uppercase()) && (length > 0 || is_first && begins) {
            return true;
        }
        if length == 0 {
            return false;
        }
        (rest, is_first) = (separated(&number[length..]), is_first && "Nn".contains(letter));
    }
    false
}

/// Without the spaces, comments and signs of optional blocks that it begins with.
fn separated(mut rest: &str) -> &str {
    loop {
        rest = rest.trim_start_matches(|c: char| c == '/' || c.is_whitespace());
        let Some(comment) = rest.strip_prefix('(') else { return rest };
        rest = comment.split_once(')').map_or("", |(_, rest)| rest);
    }
}

/// Bytes of the number, variable or expression that a text begins with; 0 where it begins otherwise.
fn number_length(text: &str) -> usize {
    if text.starts_with('[') {
        return text.find(']').map_or(0, |end| end + 1);
    }
    let of_variable = usize::from(text.starts_with('#'));
    let digits = &text[of_variable..];
    let end = digits.find(|c: char| !(c.is_ascii_digit() || "+-.".contains(c))).unwrap_or(digits.len());
    if digits[..end].parse::<f64>().is_ok() { of_variable + end } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_known_whatever_word_they_begin_with() {
        for line in [
            "G0 X1. Y1.",
            "N10 G1X5.",
            "/N10 M6",
            "x#1",
            "X[1+2]",
            "F500 G1 X60.",
            "(next) G1 X-60.",
            "S500 X60.",
            "H1 G43 Z5.",
            "F#101 X5.",
            "n5 s[1+#2] (so) y3.",
            "N10 /X5.",
            "O2 G0 X1.",
        ] {
            assert!(is_command(line), "{line}");
        }
        for line in [
            "",
            "%",
            "O2",
            "N20",
            "(G1 X5.)",
            "(G1 X5.",
            "; G1 X5.",
            "what stands behind it",
            "GRIPPER 5",
            "S5 A. Smith",
            "PART 2 X5.",
            "F500",
            "Version 2 X5.",
            "2 X5.",
        ] {
            assert!(!is_command(line), "{line}");
        }
    }
}
