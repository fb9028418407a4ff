//! Numbers, tables and texts as results show them.

use imf_core::tool::ElementKind;

/// A number with four decimals, or four digits where it is small (down to a tenth of a micrometre in metres), and without idle zeros: a
/// length in any unit.
pub fn short(value: f64) -> String {
    let digits = 3.0 - value.abs().log10().floor();
    let text = format!("{value:.*}", digits.clamp(4.0, 7.0) as usize);
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" { "0".into() } else { text.into() }
}

/// A text as a field of a CSV file, whatever stands in it.
pub(crate) fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('"', "\"\""))
}

/// The beginning of a text of any length, such as a set of directions that lists them all.
pub(crate) fn shortened(text: &str) -> String {
    const MOST: usize = 100;
    match text.char_indices().nth(MOST) {
        Some((end, _)) => format!("{}…", &text[..end]),
        None => text.to_owned(),
    }
}

/// An area or a volume: one decimal, and three digits at least, so that a small part has some in inches.
pub(crate) fn show_measure(value: f64) -> String {
    if value == 0.0 || !value.is_finite() || value.abs() >= 10.0 {
        return format!("{value:.1}");
    }
    let decimals = (2 - value.abs().log10().floor() as i32).clamp(1, 12) as usize;
    format!("{value:.decimals$}")
}

/// An element as a name of files and arrays: `cutter`, `shank`, `holder_1`.
pub(crate) fn element_name(kind: ElementKind) -> String {
    kind.to_string().replace(' ', "_")
}

/// The number that is written with the same digits as this f32: 0.1 and not 0.10000000149.
pub(crate) fn same_digits(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::from(value))
}

/// Names and values, a line each, the values below each other.
pub(crate) fn aligned(lines: &[(&str, String)]) -> String {
    let width = lines.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0);
    lines.iter().map(|(name, value)| format!("{name:<width$}  {value}\n")).collect()
}

/// Rows as text in columns, as wide as they need to be. The first row is the head; columns of numbers stand right.
pub fn table(head: &[&str], rows: &[Vec<String>]) -> String {
    let width = |text: &str| text.chars().count();
    let widths: Vec<usize> = (0..head.len())
        .map(|column| rows.iter().map(|row| width(&row[column])).max().unwrap_or(0).max(width(head[column])))
        .collect();
    let numeric: Vec<bool> = (0..head.len())
        .map(|column| rows.iter().all(|row| row[column].starts_with(|c: char| c.is_ascii_digit())))
        .collect();
    let line = |cells: Vec<&str>| {
        let cells = cells.iter().enumerate().map(|(column, cell)| {
            let padding = " ".repeat(widths[column] - width(cell));
            if numeric[column] { format!("{padding}{cell}") } else { format!("{cell}{padding}") }
        });
        cells.collect::<Vec<_>>().join("  ").trim_end().to_owned() + "\n"
    };
    let head = line(head.to_vec());
    rows.iter().fold(head, |text, row| text + &line(row.iter().map(String::as_str).collect()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_measures_keep_their_digits() {
        let shown = [0.0, 79_934.04, 54.0, 5.4, 0.003_281_25, 2e-13].map(show_measure);
        assert_eq!(shown, ["0.0", "79934.0", "54.0", "5.40", "0.00328", "0.000000000000"]);
    }

    #[test]
    fn numbers_are_short() {
        let shown = [0.0, -1e-15, 58.0, 100.0, 0.12345, -2.5, 0.000_351_26, 3.94e-5].map(short);
        assert_eq!(shown, ["0", "0", "58", "100", "0.1235", "-2.5", "0.0003513", "0.0000394"]);
        assert_eq!((same_digits(0.1), same_digits(1.0), same_digits(3e-9)), (0.1, 1.0, 3e-9));
    }

    #[test]
    fn numbers_stand_right_and_words_left() {
        let rows = [vec!["teapot".into(), "9".into()], vec!["é".into(), "1024".into()]];
        assert_eq!(table(&["part", "n"], &rows), "part       n\nteapot     9\né       1024\n");
    }
}
