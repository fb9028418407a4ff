//! Sets of orientations: one grammar, one help and one default for every command.

use std::fmt::Write as _;

use anyhow::Result;
use imf_core::mesh::MachiningDirection;
use imf_core::orientation::OrientationSet;
use imf_core::tool::Tool;

use crate::output::show_measure;

/// What the part suggests that a table for people lists; JSON has it all.
const LISTED: usize = 12;

/// A command's help with the grammar of sets behind it.
pub(crate) fn after(help: &str) -> String {
    format!("{help}\n\n{}", OrientationSet::FORMS)
}

/// The default for some tools around a part.
pub(crate) fn default_for<'a>(tools: impl IntoIterator<Item = &'a Tool>) -> &'static str {
    OrientationSet::usual(tools.into_iter().all(Tool::is_axisymmetric), true)
}

/// A set, and what the part had to do with it.
pub(crate) struct Directions {
    pub(crate) set: OrientationSet,
    /// The part's own directions, where the set's text names them.
    pub(crate) suggested: Vec<MachiningDirection>,
}

impl Directions {
    /// Reads a set for a part that suggests directions in the frame of its set-up.
    pub(crate) fn of_part(spec: &str, part: impl Fn() -> Vec<MachiningDirection>) -> Result<Self> {
        let mut suggested = Vec::new();
        let set = OrientationSet::parse_for(spec, || {
            suggested = part();
            suggested.iter().map(|suggested| suggested.direction).collect()
        })?;
        Ok(Self { set, suggested })
    }
}

/// What the part suggested, a line each, with its unit.
pub(crate) fn suggested_lines(suggested: &[MachiningDirection], unit: &str) -> String {
    let mut text = String::new();
    for MachiningDirection { direction, flat_area, cylinders } in suggested.iter().take(LISTED) {
        // No minus sign before zero.
        let [i, j, k] = direction.to_array().map(|c| if c.abs() < 5e-4 { 0.0 } else { c });
        let face = (*flat_area > 0.0).then(|| format!("flat faces, {} {unit}²", show_measure(*flat_area)));
        let axis = match cylinders {
            0 => None,
            1 => Some("axis of a cylinder".to_owned()),
            many => Some(format!("axis of {many} cylinders")),
        };
        let what: Vec<String> = face.into_iter().chain(axis).collect();
        let _ = writeln!(text, "  ({i:.3}, {j:.3}, {k:.3})  {}", what.join("; "));
    }
    if suggested.len() > LISTED {
        let _ = writeln!(text, "  and {} more", suggested.len() - LISTED);
    }
    text
}
