//! A program's lines as words: a letter and a number each, comments taken out.
//!
//! Parsers at hand (the crate `gcode`) keep numbers of 24 bits, which is a hundredth of a millimetre at a metre in tenths of inches, and
//! pass over what they do not know; here every character is read, or refused.

/// A word.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Word<'a> {
    /// In upper case.
    pub(super) letter: char,
    pub(super) value: f64,
    /// The number as written.
    pub(super) text: &'a str,
}

/// True where a line has a word that a control would carry out, whether it is understood or not; numbers of blocks and names of programs
/// are none.
pub(super) fn is_command(line: &str) -> bool {
    let line = line.trim_start_matches('\u{feff}').trim_start();
    let line = line.trim_start_matches('/').trim_start();
    let numbered =
        line.strip_prefix(['N', 'n']).map(|rest| rest.trim_start_matches(|c: char| c.is_ascii_digit()));
    let rest = numbered.unwrap_or(line).trim_start();
    let mut letters = rest.chars();
    let first = letters.next().is_some_and(|letter| "GMTXYZABCUVW".contains(letter.to_ascii_uppercase()));
    let number = letters.find(|c| !c.is_whitespace());
    first && number.is_some_and(|c| c.is_ascii_digit() || "+-.#[".contains(c))
}

/// The words of one line; none of a line that only separates or comments.
pub(super) fn words(line: &str) -> Result<Vec<Word<'_>>, String> {
    let mut rest = line.trim_start_matches('\u{feff}').trim();
    let mut found = Vec::new();
    if rest.starts_with('%') {
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
            letter if letter.is_ascii_alphabetic() => {
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
