//! Statements of coordinate systems: which of them change nothing, and the remark on Creo's.

use super::statement::numbers;

/// Words that change where later coordinates lie.
pub(super) const TRANSFORMS: &str =
    "COPY CUTCOM LCS MODE MSYS ORIGIN PREFUN ROTABL ROTATE ROTHED TMARK TRACUT TRANS";

/// True where a transformation leaves every coordinate as it is.
pub(super) fn changes_nothing(word: &str, rest: &str) -> bool {
    let rest = rest.trim().to_ascii_uppercase();
    let are = |wanted: &[f64]| numbers(&rest).is_ok_and(|values| values == wanted);
    match word {
        "CUTCOM" | "LCS" => rest == "OFF",
        "TRACUT" => rest == "NOMORE",
        "MODE" => rest == "MILL" || rest == "ABSOL",
        "TRANS" | "ORIGIN" => are(&[0.0; 3]),
        // Origin, then the directions of x and y.
        "MSYS" => are(&[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0]),
        _ => false,
    }
}

/// The remark on a comment `CSYS / …`, which moves no coordinate of the file; `None` for the part's own system.
pub(super) fn remark_on(comment: &str) -> Option<String> {
    let (word, rest) = comment.split_once('/')?;
    if !word.trim().eq_ignore_ascii_case("CSYS") {
        return None;
    }
    // The rows of a matrix, each with its part of the origin.
    let stated = match numbers(rest).as_deref() {
        Ok([a, b, c, x, d, e, f, y, g, h, i, z]) => {
            let is_turned = [a, b, c, d, e, f, g, h, i]
                .into_iter()
                .zip([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
                .any(|(value, own)| (value - own).abs() > 1e-9);
            if !is_turned && [x, y, z].into_iter().all(|&v| v == 0.0) {
                return None;
            }
            let turned = if is_turned { " and turned" } else { "" };
            format!("states a coordinate system moved by ({x}, {y}, {z}){turned}")
        }
        _ => "states a coordinate system (CSYS) that is not 12 numbers".into(),
    };
    Some(format!(
        "the file {stated}: its coordinates are taken as they stand, so the part must lie in the system that they are written in"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_coordinate_system_is_told_unless_it_is_the_parts_own() {
        assert_eq!(remark_on(" CSYS / 1.0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, -0.0"), None);
        assert_eq!(remark_on(" CUTTER / 20.0"), None);
        let of = |rest: &str| remark_on(&format!(" CSYS / {rest}")).unwrap();
        assert!(of("1, 0, 0, 100, 0, 1, 0, 0, 0, 0, 1, -2.5").contains("moved by (100, 0, -2.5): its"));
        assert!(of("0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0").contains("moved by (0, 0, 0) and turned"));
        assert!(of("1, 0").contains("not 12 numbers"));
    }
}
