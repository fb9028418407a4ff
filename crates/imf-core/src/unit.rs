//! Units of length, and whether a part's size makes sense in one.
//!
//! Everything is computed in the mesh's own unit; the unit itself serves reports, and the check below, which finds
//! the usual mistake: a file in metres or inches taken for millimetres.

use std::fmt;
use std::str::FromStr;

use glam::DVec3;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// The unit in which a mesh, a grid or a tool is given.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum LengthUnit {
    /// Millimetre.
    #[default]
    Mm,
    /// Centimetre.
    Cm,
    /// Metre.
    M,
    /// Inch: 25.4 mm.
    Inch,
}

impl LengthUnit {
    /// Every unit, smallest first but for the inch.
    pub const ALL: [Self; 4] = [Self::Mm, Self::Cm, Self::M, Self::Inch];

    /// The length of one unit in millimetres.
    #[must_use]
    pub fn in_mm(self) -> f64 {
        match self {
            Self::Mm => 1.0,
            Self::Cm => 10.0,
            Self::M => 1000.0,
            Self::Inch => 25.4,
        }
    }
}

impl fmt::Display for LengthUnit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Mm => "mm",
            Self::Cm => "cm",
            Self::M => "m",
            Self::Inch => "inch",
        })
    }
}

/// A name that is not a unit of length.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("`{0}` is not a unit of length; the units are mm, cm, m and inch")]
pub struct UnknownUnit(pub String);

impl FromStr for LengthUnit {
    type Err = UnknownUnit;

    /// Short and long names in either spelling, in any case.
    fn from_str(name: &str) -> Result<Self, Self::Err> {
        match name.trim().to_ascii_lowercase().as_str() {
            "mm" | "millimetre" | "millimetres" | "millimeter" | "millimeters" => Ok(Self::Mm),
            "cm" | "centimetre" | "centimetres" | "centimeter" | "centimeters" => Ok(Self::Cm),
            "m" | "metre" | "metres" | "meter" | "meters" => Ok(Self::M),
            "in" | "inch" | "inches" => Ok(Self::Inch),
            _ => Err(UnknownUnit(name.to_owned())),
        }
    }
}

/// The range of plausible extents of a machined part, in millimetres.
const SANE_EXTENT_MM: (f64, f64) = (0.1, 20_000.0);

/// A part whose size makes no sense in the unit given. Its text says what the size would be in the other units.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub struct ImplausibleSize {
    /// Extents of the part along x, y and z, in `unit`.
    pub extents: DVec3,
    /// The unit that was stated.
    pub unit: LengthUnit,
}

impl fmt::Display for ImplausibleSize {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { extents, unit } = *self;
        if extents == DVec3::ZERO {
            return write!(f, "all corners of the part lie in one point; export it again");
        }
        let [x, y, z] = extents.to_array().map(DisplayLength);
        write!(f, "the part measures {x} × {y} × {z} {unit}, which is outside the range of 0.1 mm to 20 m;")?;
        let others = LengthUnit::ALL.into_iter().filter(|&other| other != unit);
        for (i, other) in others.enumerate() {
            let [x, y, z] = (extents * other.in_mm()).to_array().map(DisplayLength);
            let lead = if i == 0 { " were the file in " } else { ", in " };
            write!(f, "{lead}{other} it would be {x} × {y} × {z} mm")?;
        }
        write!(f, "; state the unit that the file is in, or scale it")
    }
}

/// A length, an area or a volume for people: to four significant digits, without needless zeros.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DisplayLength(pub f64);

impl fmt::Display for DisplayLength {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let magnitude = self.0.abs();
        if magnitude != 0.0 && !(1e-4..1e7).contains(&magnitude) {
            return write!(f, "{:.3e}", self.0);
        }
        let before = if magnitude == 0.0 { 0 } else { magnitude.log10().floor() as i32 };
        let text = format!("{:.*}", (3 - before).max(0) as usize, self.0);
        let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
        f.write_str(text)
    }
}

/// Whether a part of these extents (in `unit`) makes sense: its largest extent should lie between 0.1 mm and 20 m.
/// Gives the reason if not, also for extents that are not finite.
#[must_use]
pub fn unit_check(extents: DVec3, unit: LengthUnit) -> Option<ImplausibleSize> {
    let largest = extents.max_element() * unit.in_mm();
    let sane = extents.is_finite() && largest >= SANE_EXTENT_MM.0 && largest <= SANE_EXTENT_MM.1;
    (!sane).then_some(ImplausibleSize { extents, unit })
}

/// A warning is given for a part shorter than the tool is thick, or longer than this many times that: a cutter of a
/// thousandth of the part would need a path of years.
const MAX_PROPORTION: f64 = 1000.0;

/// A part and a tool whose sizes make no sense together. Its text says what the part would measure in other units.
#[derive(Clone, Copy, Debug, Error, PartialEq)]
pub struct ImplausibleProportion {
    /// Longest side of the part, in `unit`.
    pub longest: f64,
    /// Diameter of the tool's thinnest element, in `unit`.
    pub thickness: f64,
    /// The part's unit.
    pub unit: LengthUnit,
}

impl fmt::Display for ImplausibleProportion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { longest, thickness, unit } = *self;
        let (long, thick) = (DisplayLength(longest), DisplayLength(thickness));
        write!(
            f,
            "the part's longest side is {long} {unit}, and the tool is at least {thick} {unit} thick;"
        )?;
        let others = LengthUnit::ALL.into_iter().filter(|&other| other != unit);
        for (i, other) in others.enumerate() {
            let lead = if i == 0 { " were the part in " } else { ", in " };
            let (long, in_unit) = (DisplayLength(longest * other.in_mm() / unit.in_mm()), unit);
            write!(f, "{lead}{other} its side would be {long} {in_unit}")?;
        }
        Ok(())
    }
}

/// Whether a part's longest side and the diameter of a tool's thinnest element (both in `unit`) make sense together. Gives the reason if not.
#[must_use]
pub(crate) fn proportion_check(
    longest: f64,
    thickness: f64,
    unit: LengthUnit,
) -> Option<ImplausibleProportion> {
    let sane = longest >= thickness && longest <= MAX_PROPORTION * thickness;
    (!sane).then_some(ImplausibleProportion { longest, thickness, unit })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_and_written_alike() {
        for unit in LengthUnit::ALL {
            assert_eq!(unit.to_string().parse(), Ok(unit));
            assert_eq!(serde_json::to_string(&unit).unwrap(), format!("\"{unit}\""));
        }
        assert_eq!("Inches".parse(), Ok(LengthUnit::Inch));
        assert!("furlong".parse::<LengthUnit>().unwrap_err().to_string().contains("furlong"));
    }

    #[test]
    fn a_part_in_metres_taken_for_millimetres_is_noticed() {
        let extents = DVec3::new(0.0762, 0.05, 0.0123456);
        assert_eq!(unit_check(extents, LengthUnit::M), None);
        let text = unit_check(extents, LengthUnit::Mm).unwrap().to_string();
        assert!(text.contains("in m it would be 76.2 × 50 × 12.35 mm"), "{text}");
        assert!(text.contains("in inch it would be 1.935 × 1.27 × 0.3136 mm"), "{text}");
        assert!(unit_check(DVec3::splat(21.0), LengthUnit::M).is_some());
        assert!(unit_check(DVec3::splat(19.0), LengthUnit::M).is_none());
        assert!(unit_check(DVec3::splat(f64::NAN), LengthUnit::Mm).is_some());
        assert!(unit_check(DVec3::ZERO, LengthUnit::Mm).unwrap().to_string().contains("one point"));
    }

    #[test]
    fn a_part_smaller_than_the_tool_is_thick_is_told() {
        let check = |longest| proportion_check(longest, 10.0, LengthUnit::Mm);
        assert!(check(10.0).is_none() && check(10_000.0).is_none());
        assert!(check(9.9).is_some() && check(10_001.0).is_some());
        let text = check(1.0).unwrap().to_string();
        assert!(
            text.contains("1 mm")
                && text.contains("10 mm thick")
                && text.contains("in inch its side would be 25.4 mm")
        );
    }

    #[test]
    fn lengths_are_short() {
        let shown = [0.0, 100.0, 12345.6, 0.00123456, 1e-9, 99.996].map(|v| DisplayLength(v).to_string());
        assert_eq!(shown, ["0", "100", "12346", "0.001235", "1.000e-9", "100"]);
    }
}
