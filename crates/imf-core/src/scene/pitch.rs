//! The default pitch: fine enough for the tool, coarse enough for a result within a minute or so.

use std::fmt;

use glam::DVec3;

use super::resolution::{DISC_OUT, VOXELS_THICK};
use crate::tool::Tool;
use crate::unit::{DisplayLength, LengthUnit};

/// Voxels across the thinnest element of the tool.
const ACROSS_TOOL: f64 = 6.0;
/// Voxels along the part's longest side, and across its shortest, where the tool alone would leave fewer.
const ALONG_PART: f64 = 48.0;
const ACROSS_PART: f64 = 4.0;
/// Voxels along the longest side, and in all, for a first result within a minute or so: 225 directions around a part
/// on 177,000 voxels with its surface took 9 s of one core, and time grows with the voxels.
const MAX_ALONG: f64 = 200.0;
const MAX_VOXELS: f64 = 1e6;
/// How many times as many may be taken rather than have the tool pass between the voxels.
const MORE: f64 = 8.0;

/// A pitch and why it was chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChosenPitch {
    /// Edge of a voxel, in `unit`.
    pub pitch: f64,
    /// The part's unit.
    pub unit: LengthUnit,
    /// Why.
    pub reason: PitchReason,
}

/// What decided about a pitch.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum PitchReason {
    /// Six voxels across the tool's thinnest element, of this diameter.
    Tool(f64),
    /// Six voxels across the ball of this diameter that a tool's slender tip holds within three diameters from its end.
    Tip(f64),
    /// 48 voxels along the part's longest side, of this length.
    Part(f64),
    /// Four voxels across the part's shortest side, of this length.
    Sheet(f64),
    /// The finest that time and memory allow.
    Bounded,
    /// The coarsest at which the tool's thinnest element, of this diameter, is certain to hold a centre.
    Coarsest(f64),
}

impl ChosenPitch {
    /// A pitch for a part of these extents and for tools, all in `unit`; `fits` says whether there is memory for a pitch.
    #[must_use]
    pub fn new(extents: DVec3, unit: LengthUnit, tools: &[Tool], fits: &dyn Fn(f64) -> bool) -> Self {
        let (longest, shortest) = (extents.max_element(), extents.min_element());
        let thinnest = tools.iter().map(|tool| tool.thinnest().1).fold(f64::INFINITY, f64::min);
        let tip = tools.iter().filter_map(Tool::slender_tip).fold(f64::INFINITY, f64::min);
        let mut candidates = vec![
            (thinnest / ACROSS_TOOL, PitchReason::Tool(thinnest)),
            (tip / ACROSS_TOOL, PitchReason::Tip(tip)),
            (longest / ALONG_PART, PitchReason::Part(longest)),
            (shortest / ACROSS_PART, PitchReason::Sheet(shortest)),
        ];
        candidates.retain(|(pitch, _)| *pitch > 0.0 && pitch.is_finite());
        let finest = candidates.into_iter().min_by(|(a, _), (b, _)| a.total_cmp(b));
        // An empty part is refused elsewhere.
        let (wanted, mut reason) = finest.unwrap_or((1.0, PitchReason::Bounded));
        let mut pitch = rounded(wanted, false);
        let voxels = |pitch: f64| (extents / pitch).ceil().max(DVec3::ONE).element_product();
        let is_bounded = |pitch: f64, more: f64| {
            longest / pitch <= MAX_ALONG * more && voxels(pitch) <= MAX_VOXELS * more && fits(pitch)
        };
        while !is_bounded(pitch, 1.0) && longest / pitch > 1.0 {
            pitch = rounded(pitch * 1.05, true);
            reason = PitchReason::Bounded;
        }
        let thinnest = thinnest.min(tip);
        let seen = rounded(thinnest / VOXELS_THICK, false);
        let mut more = 1.0;
        if pitch > seen && is_bounded(seen, MORE) {
            (pitch, reason, more) = (seen, PitchReason::Coarsest(thinnest), MORE);
        }
        let disc =
            tools.iter().filter_map(|tool| tool.thinnest_disc(DISC_OUT * pitch)).map(|(_, thick)| thick);
        let disc = disc.fold(f64::INFINITY, f64::min);
        if disc < pitch && is_bounded(rounded(disc, false), MORE) {
            (pitch, reason, more) = (rounded(disc, false), PitchReason::Coarsest(disc), MORE);
        }
        let dividing = dividing(pitch, extents);
        if is_bounded(dividing, more) {
            pitch = dividing;
        }
        Self { pitch, unit, reason }
    }
}

/// A pitch of two digits, up to a tenth smaller, that divides all sides of the part or two of them, so that its faces
/// lie between the centres of voxels and not on them: a block of 40 mm in voxels of 0.83 is 0.8 mm too long, in
/// voxels of 0.8 it has its true length.
fn dividing(pitch: f64, extents: DVec3) -> f64 {
    let divides = |pitch: f64| {
        let whole = |side: &&f64| (**side / pitch - (**side / pitch).round()).abs() < 1e-4;
        extents.to_array().iter().filter(whole).count()
    };
    let step = 10f64.powi(pitch.log10().floor() as i32 - 1);
    let smaller = (0..10).map(|steps| rounded((pitch - f64::from(steps) * step) * (1.0 + 1e-9), false));
    let smaller = smaller.filter(|smaller| *smaller >= 0.9 * pitch * (1.0 - 1e-9));
    // Of those that do as well the largest, which comes first.
    let best = smaller.rev().max_by_key(|smaller| divides(*smaller));
    best.filter(|best| divides(*best) > 1).unwrap_or(pitch)
}

/// To two digits, so that it can be typed again.
fn rounded(pitch: f64, up: bool) -> f64 {
    let step = 10f64.powi(pitch.log10().floor() as i32 - 1);
    // What is two digits up to rounding stays.
    let steps = pitch / step;
    let whole = if up { (steps - 1e-9).ceil() } else { (steps + 1e-9).floor() };
    // The number that is printed so.
    format!("{:.1e}", whole * step).parse().unwrap_or(whole * step)
}

impl fmt::Display for ChosenPitch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { pitch, unit, reason } = self;
        write!(f, "a pitch of {} {unit} was chosen, ", DisplayLength(*pitch))?;
        match reason {
            PitchReason::Tool(across) => {
                write!(f, "a sixth of the tool's thinnest element ({} {unit})", DisplayLength(*across))
            }
            PitchReason::Tip(across) => write!(
                f,
                "a sixth of the largest ball that the tool's slender tip holds near its end ({} {unit})",
                DisplayLength(*across)
            ),
            PitchReason::Part(along) => {
                write!(f, "a 48th of the part's longest side ({} {unit})", DisplayLength(*along))
            }
            PitchReason::Sheet(across) => {
                write!(f, "a quarter of the part's shortest side ({} {unit})", DisplayLength(*across))
            }
            PitchReason::Bounded => {
                f.write_str("the finest that stays within a million voxels, 200 a side, and the memory")
            }
            PitchReason::Coarsest(across) => write!(
                f,
                "the coarsest that is sure to see the tool's thinnest element ({} {unit}); it may take minutes",
                DisplayLength(*across)
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_pitch_follows_from_tool_and_part_within_its_bounds() {
        // A tenth as large, so many times.
        let shrunk = |tool: Tool, _| Tool { unit: LengthUnit::Mm, ..tool.in_unit(LengthUnit::Cm) };
        let chosen = |extents: [f64; 3], times: usize| {
            let scaled = (0..times).fold(Tool::paper(), shrunk);
            let chosen = ChosenPitch::new(DVec3::from_array(extents), LengthUnit::Mm, &[scaled], &|_| true);
            (chosen.pitch, chosen.reason)
        };
        // The cutter is 10 mm thick.
        assert_eq!(chosen([151.0, 101.0, 97.0], 0), (1.6, PitchReason::Tool(10.0)));
        // A tenth smaller it divides two of the sides.
        assert_eq!(chosen([150.0, 100.0, 90.0], 0), (1.5, PitchReason::Tool(10.0)));
        assert_eq!(chosen([40.0, 40.0, 20.0], 0), (0.8, PitchReason::Part(40.0)));
        assert_eq!(chosen([60.0, 60.0, 20.0], 0), (1.2, PitchReason::Part(60.0)));
        assert_eq!(chosen([150.0, 90.0, 3.0], 0), (0.75, PitchReason::Sheet(3.0)));
        assert_eq!(chosen([640.0, 10.0, 10.0], 0), (3.3, PitchReason::Bounded));
        let (pitch, reason) = chosen([400.0, 400.0, 400.0], 0);
        assert!(reason == PitchReason::Bounded && (400.0 / pitch).ceil().powi(3) <= MAX_VOXELS);
        // A cutter of 1 mm would pass between voxels of 2 mm.
        assert_eq!(chosen([400.0, 20.0, 20.0], 1), (0.7, PitchReason::Coarsest(1.0)));
        // Nothing within reason sees a cutter of 0.1 mm there: the scene refuses it.
        assert!(chosen([400.0, 20.0, 20.0], 2).0 > 0.1);
    }

    #[test]
    fn memory_bounds_the_pitch_and_a_part_without_a_tool_has_one() {
        let extents = DVec3::new(96.0, 30.0, 40.0);
        let alone = ChosenPitch::new(extents, LengthUnit::Mm, &[], &|_| true);
        assert_eq!((alone.pitch, alone.reason), (2.0, PitchReason::Part(96.0)));
        assert!(alone.to_string().contains("2 mm"), "{alone}");
        let little = ChosenPitch::new(extents, LengthUnit::Mm, &[], &|pitch| pitch > 3.0);
        assert!(little.pitch > 3.0 && little.pitch < 3.4 && little.reason == PitchReason::Bounded);
    }
}
