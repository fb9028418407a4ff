//! A file's text as statements: continuations joined, comments taken out except those in which Creo states coordinate systems.

/// Words that only text follows, whatever stands in it.
pub(super) const TEXT: &str = "INSERT PARTNO PPRINT REMARK TPRINT";

/// Comments in which Creo writes what is not a word of APT.
const STATING: &str = "$$->";

/// A statement, and the line that it begins on.
#[derive(Debug, PartialEq)]
pub(super) struct Statement {
    pub(super) line: usize,
    pub(super) text: String,
    /// What follows `$$->`, in place of a statement.
    pub(super) is_comment: bool,
}

pub(super) fn statements(text: &str) -> Vec<Statement> {
    let mut found: Vec<Statement> = Vec::new();
    let mut open = false;
    for (index, line) in text.lines().enumerate() {
        let line = line.trim();
        // A comment goes on in numbers alone: its `$` may be the end of a text, and a word begins a statement.
        let joins = open && !(found.last().is_some_and(|last| last.is_comment) && begins_with_word(line));
        let stated = line.strip_prefix(STATING).filter(|_| !joins);
        let is_text = !joins && is_of(TEXT, &first_word(line));
        let content = match stated {
            Some(comment) => comment,
            None if is_text => line,
            None => line.split("$$").next().unwrap_or_default(),
        };
        let content = content.trim();
        // What follows the sign is a comment.
        let sign = content
            .find('$')
            .filter(|&at| !is_text && !content[at + 1..].starts_with(|c: char| !c.is_whitespace()));
        let (content, continues) = sign.map_or((content, false), |at| (&content[..at], true));
        match found.last_mut().filter(|_| joins) {
            Some(last) => last.text.push_str(content),
            None if content.is_empty() && !continues => {}
            None => found.push(Statement {
                line: index + 1,
                text: content.to_owned(),
                is_comment: stated.is_some(),
            }),
        }
        open = continues;
    }
    found
}

/// The word that a statement begins with, in upper case.
pub(super) fn first_word(statement: &str) -> String {
    let word = statement.split('/').next().unwrap_or_default();
    word.split_whitespace().next().unwrap_or_default().to_ascii_uppercase()
}

fn begins_with_word(line: &str) -> bool {
    line.starts_with(|c: char| c.is_ascii_alphabetic() || c == '$')
}

/// True where a word is one of a list.
pub(super) fn is_of(list: &str, word: &str) -> bool {
    list.split_ascii_whitespace().any(|known| known == word)
}

pub(super) fn numbers(text: &str) -> Result<Vec<f64>, String> {
    text.split(',')
        .map(str::trim)
        .map(|field| field.parse().map_err(|_| format!("'{field}' is not a number")))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(text: &str) -> Vec<(usize, String)> {
        statements(text).into_iter().map(|Statement { line, text, .. }| (line, text)).collect()
    }

    #[test]
    fn statements_go_on_and_texts_do_not() {
        let line = |number: usize, text: &str| (number, text.to_owned());
        for text in ["GOTO/1,$\n2,$ $$ and\n3\nFINI\n", "GOTO/1,$ x\n2,$ and y\n3\nFINI\n"] {
            assert_eq!(of(text), [line(1, "GOTO/1,2,3"), line(4, "FINI")]);
        }
        for word in ["PARTNO", "PPRINT", "REMARK", "TPRINT", "INSERT", "pprint"] {
            let text = format!("{word} COST IN US$\nGOTO/0,0,0\n");
            assert_eq!(of(&text), [line(1, &format!("{word} COST IN US$")), line(2, "GOTO/0,0,0")]);
        }
        // Within a statement such a word does not count.
        assert_eq!(of("SELECT/$\nINSERT,$\n3\n"), [line(1, "SELECT/INSERT,3")]);
    }

    #[test]
    fn a_comment_goes_on_in_numbers_alone() {
        let creo = "$$-> CSYS / 1, 0,  $\n  0, 0,  $\n  5\nRAPID\n";
        assert_eq!(of(creo), [(1, "CSYS / 1, 0,  0, 0,  5".to_owned()), (4, "RAPID".to_owned())]);
        assert!(statements(creo)[0].is_comment);
        for text in ["$$-> COST / US$\nGOTO/1,2,3\n", "$$ in US$\nGOTO/1,2,3\n"] {
            assert_eq!(of(text).last(), Some(&(2, "GOTO/1,2,3".to_owned())), "{text}");
        }
        assert_eq!(of("$$-> COST / US$\n$$-> NEXT / 1\n").len(), 2);
    }
}
