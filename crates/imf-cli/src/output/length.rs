//! Lengths that somebody sets a tool by: with as many decimals as tenths of a millimetre need in their unit, and never rounded to the
//! wrong side.

use imf_core::unit::LengthUnit;

pub(crate) fn nearest(value: f64, unit: LengthUnit) -> String {
    format!("{value:.*}", decimals(unit))
}

pub(crate) fn at_least(value: f64, unit: LengthUnit) -> String {
    nearest(rounded_up(value, unit), unit)
}

/// Up to the last decimal that is shown, but for a thousandth of it, which is rounding.
pub(crate) fn rounded_up(value: f64, unit: LengthUnit) -> f64 {
    let scale = 10_f64.powi(decimals(unit) as i32);
    (value * scale - 1e-3).ceil() / scale
}

pub(crate) fn at_most(value: f64, unit: LengthUnit) -> String {
    let scale = 10_f64.powi(decimals(unit) as i32);
    nearest((value * scale + 1e-3).floor() / scale, unit)
}

/// With `more` decimals in addition, as for a tolerance.
pub(crate) fn finer(value: f64, unit: LengthUnit, more: usize) -> String {
    format!("{value:.*}", decimals(unit) + more)
}

pub(crate) fn place(point: [f64; 3], unit: LengthUnit) -> String {
    point.map(|value| nearest(value, unit)).join(", ")
}

/// A tool's stick-out: what it is set to, the shortest, and the longest where that is known. All are rounded up, as the length is that a
/// path or a surface needs, so that they compare as the lengths do.
pub(crate) fn stick_out(
    tool: &str,
    [given, shortest]: [f64; 2],
    longest: Option<f64>,
    unit: LengthUnit,
) -> String {
    let [given, shortest] = [given, shortest].map(|value| at_least(value, unit));
    let longest = longest.map(|longest| format!(", overall length {}", at_least(longest, unit)));
    let longest = longest.unwrap_or_default();
    format!("stick-out of {tool} (set to {given} {unit}, shortest {shortest}{longest})")
}

/// States how much nearer the surface lies than the voxels that shank and holder avoided.
pub(crate) fn surface_nearer(nearer: f64, conservative: bool, unit: LengthUnit) -> String {
    let more = at_least(nearer, unit);
    match conservative {
        false => format!(
            "the surface lies up to a voxel nearer than its centres: set {more} {unit} more, or ask with --conservative and a clearance"
        ),
        true => format!(
            "the surface lies up to half a voxel's diagonal nearer than its centres: set {more} {unit} more, or give holder and shank that \
             clearance"
        ),
    }
}

fn decimals(unit: LengthUnit) -> usize {
    (unit.in_mm() / 0.1).log10().ceil() as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_have_tenths_of_a_millimetre_and_are_enough() {
        for (unit, expected) in [
            (LengthUnit::Mm, ["42.0", "42.1", "42.0"]),
            (LengthUnit::Cm, ["42.01", "42.02", "42.01"]),
            (LengthUnit::Inch, ["42.012", "42.013", "42.012"]),
            (LengthUnit::M, ["42.0123", "42.0124", "42.0123"]),
        ] {
            let value = 42.012_34;
            assert_eq!([nearest(value, unit), at_least(value, unit), at_most(value, unit)], expected);
        }
        let shown = stick_out("mill", [0.551_18; 2], Some(3.937_01), LengthUnit::Inch);
        assert!(shown.ends_with("(set to 0.552 inch, shortest 0.552, overall length 3.938)"), "{shown}");
        // What is a tenth but for rounding stays one.
        assert_eq!(at_least(0.1 + 0.2, LengthUnit::Mm), "0.3");
        assert_eq!(at_most(0.3 - 1e-12, LengthUnit::Mm), "0.3");
    }
}
