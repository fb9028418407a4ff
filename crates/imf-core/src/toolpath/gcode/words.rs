//! The text of programs: what is one, by its name or first line, and the words of each line, a letter and a number.
//!
//! Available parsers (the crate `gcode`) hold numbers in 24 bits, which is a hundredth of a millimetre at a metre in
//! tenths of inches, and skip what they do not know; here every character is read, or refused.

/// Names of files that are programs, by their ends.
const ENDS: [&str; 12] = ["nc", "gcode", "ngc", "tap", "mpf", "cnc", "eia", "ptp", "iso", "min", "spf", "h"];
/// With which Heidenhain's own programs begin.
pub(super) const KLARTEXT: &str = "BEGIN PGM";

/// True where a file's name or first word says that it is a program.
pub(in crate::toolpath) fn is_program(text: &str, name: &str) -> bool {
    let end = name.rsplit_once('.').map(|(_, end)| end.to_ascii_lowercase());
    let mut lines = text.lines().map(str::trim);
    let first = lines.find(|line| !line.is_empty() && !line.starts_with([';', '#'])).unwrap_or_default();
    end.is_some_and(|end| ENDS.contains(&end.as_str()))
        || first.starts_with(['%', '('])
        || is_address(first)
        || is_name(first)
        || first.contains(KLARTEXT)
}

/// What a program may be called by in a line of its own: `<TOP>`, or Okuma's `$TOP.MIN%`.
fn is_name(line: &str) -> bool {
    line.starts_with('<') && line.ends_with('>') || line.starts_with('$') && line.ends_with('%')
}

/// A letter and a number, as machines read them.
fn is_address(line: &str) -> bool {
    let mut letters = line.split_whitespace().next().unwrap_or_default().chars();
    let letter = letters.next().is_some_and(|c| c.is_ascii_alphabetic() || c == ':');
    let is_next = |c: char| c.is_ascii_alphabetic() || matches!(c, '(' | '/');
    let number = letters.as_str().split(is_next).next().unwrap_or_default();
    letter && number.parse::<f64>().is_ok()
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Word<'a> {
    /// In upper case; `:`, which may stand for O and N.
    pub(super) letter: char,
    pub(super) value: f64,
    /// The number as written.
    pub(super) text: &'a str,
}

/// Whether a line is the sign that stands before and behind a program.
pub(super) fn is_sign(line: &str) -> bool {
    line.trim_start().starts_with('%')
}

/// The words of one line; none of a line that only separates or comments.
pub(super) fn words(line: &str) -> Result<Vec<Word<'_>>, String> {
    let mut rest = line.trim();
    let mut found = Vec::new();
    if let Some(name) = rest.strip_prefix('%') {
        // A name or a number may follow; words would not be run.
        let runs = |word: &Word<'_>| "GMTXYZABC".contains(word.letter);
        if words(name).is_ok_and(|words| words.iter().any(runs)) {
            return Err(
                "words stand behind '%', where a control skips them: give them a line of their own".into()
            );
        }
        return Ok(found);
    }
    if is_name(rest) {
        return Ok(found);
    }
    if rest.starts_with('/') {
        return Err(
            "the line is skipped or not by a switch of the machine ('/'): take it out, or the '/' alone"
                .into(),
        );
    }
    while let Some(first) = rest.chars().next() {
        match first {
            ';' => break,
            '(' => {
                let end = rest.find(')').ok_or("a comment has no end: ')' is missing")?;
                rest = &rest[end + 1..];
            }
            letter if letter.is_ascii_alphabetic() || letter == ':' => {
                let number = rest[1..].trim_start();
                let end = number.find(|c: char| !(c.is_ascii_digit() || matches!(c, '.' | '+' | '-')));
                let text = &number[..end.unwrap_or(number.len())];
                let value = text.parse::<f64>().map_err(|_| {
                    let word: String = rest.chars().take_while(|c| !c.is_whitespace()).take(24).collect();
                    format!(
                        "'{word}' is not understood: words are a letter and a number (no variables, expressions or names); let the \
                         CAM program write plain motions"
                    )
                })?;
                found.push(Word { letter: letter.to_ascii_uppercase(), value, text });
                rest = &number[text.len()..];
            }
            other => {
                return Err(format!(
                    "'{other}' is not understood and might move the machine: take it out if it does not"
                ));
            }
        }
        rest = rest.trim_start();
    }
    Ok(found)
}

/// True where a line ends in a word, which may be the beginning of a longer one.
pub(super) fn ends_in_word(line: &str) -> bool {
    words(line).is_ok_and(|words| words.last().is_some_and(|last| line.trim_end().ends_with(last.text)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_read_and_comments_are_not() {
        let read = |line: &str| -> Vec<(char, f64)> {
            words(line).unwrap().into_iter().map(|word| (word.letter, word.value)).collect()
        };
        assert_eq!(
            read("N10 g1X1.5Y-.25 (to, X9) Z+3. ; X7"),
            [('N', 10.0), ('G', 1.0), ('X', 1.5), ('Y', -0.25), ('Z', 3.0)]
        );
        assert_eq!(read("G43.4 H 1"), [('G', 43.4), ('H', 1.0)]);
        assert_eq!((read("%"), read("(X1)"), read("  ")), (vec![], vec![], vec![]));
        for (line, said) in [
            ("G1 X#101", "'X#101'"),
            ("G1 X[1+2]", "'X[1+2]'"),
            ("MSG(\"X\")", "'MSG"),
            ("#1=3", "'#'"),
            ("/G1 X1", "'/'"),
            ("G1 (X1", "')' is missing"),
            ("G1 X1.2.3", "'X1.2.3'"),
        ] {
            let error = words(line).unwrap_err();
            assert!(error.contains(said), "{line}: {error}");
        }
    }
}
