//! Cutter, shank and holder as files give them, stacked to elements, and the outlines that cutters have.

use super::{ElementKind, Segment, Tool};
use crate::unit::LengthUnit;

/// The parts of a tool from the tip upwards, heights from the tip.
pub(super) struct Stack {
    /// Ends where its edges end.
    pub(super) cutter: Vec<Segment>,
    /// Goes on where the cutter ends.
    pub(super) shank: Vec<Segment>,
    /// Height of the holder's face, or of the tool's end where there is no holder: what reaches higher is not seen.
    pub(super) face: f64,
    /// Height, lower and upper diameter of every part of the holder, from the face upwards.
    pub(super) holder: Vec<[f64; 3]>,
}

impl Stack {
    /// The tool of these parts, sharp at its tip.
    pub(super) fn tool(self, name: impl Into<String>, unit: LengthUnit) -> Tool {
        let below = |profile: Vec<Segment>| -> Vec<Segment> {
            profile.iter().filter_map(|segment| segment.below(self.face)).collect()
        };
        let mut elements = vec![(ElementKind::Cutter, below(self.cutter))];
        let shank = below(self.shank);
        if !shank.is_empty() {
            elements.push((ElementKind::Shank, shank));
        }
        let mut from = self.face;
        for (index, [height, lower, upper]) in self.holder.into_iter().enumerate() {
            let profile = vec![line(from, from + height, lower / 2.0, upper / 2.0)];
            elements.push((ElementKind::Holder(index), profile));
            from += height;
        }
        Tool { unit, ..Tool::revolved(name, elements) }
    }
}

/// By how much files round the diameter of a tapered ball off, of itself.
pub(super) const ROUNDED_DIGITS: f64 = 0.01;

pub(super) fn line(from: f64, to: f64, radius_from: f64, radius_to: f64) -> Segment {
    Segment::Line { from, to, radius_from, radius_to }
}

/// A flank that is a cylinder, or a cone of a half angle in degrees, with a corner of some radius below that touches flank and end;
/// `radius` is the flank's at the height of the tip, as in APT.
pub(super) fn end_mill(
    radius: f64,
    corner: f64,
    half_angle: f64,
    length: f64,
) -> Result<Vec<Segment>, String> {
    if !(0.0..80.0).contains(&half_angle) {
        return Err(format!("its taper of {half_angle} degrees a side is not between 0 and 80"));
    }
    let angle = half_angle.to_radians();
    let flat_end = radius - corner * (1.0 - angle.sin()) / angle.cos();
    if flat_end < -ROUNDED_DIGITS * radius {
        return Err(format!("its corner radius {corner} is larger than its radius {radius} has room for"));
    }
    rounded(flat_end.max(0.0) + corner, corner, angle, length)
        .ok_or_else(|| format!("its cutting length {length} is shorter than its rounded end"))
}

/// A cone from a tip, flat where `tip_radius` is not 0, to `radius`, and a cylinder above it up to `length`.
pub(super) fn pointed(
    tip_radius: f64,
    radius: f64,
    half_angle: f64,
    length: f64,
) -> Result<Vec<Segment>, String> {
    if !(half_angle > 0.0 && half_angle <= 90.0) {
        return Err(format!("its point's half angle of {half_angle} degrees is not between 0 and 90"));
    }
    if tip_radius >= radius {
        return Err(format!("its tip's radius {tip_radius} is not below its radius {radius}"));
    }
    let mut profile = Vec::new();
    let mut point = 0.0;
    // A drill of 180 degrees is flat.
    if half_angle < 90.0 {
        point = (radius - tip_radius) / half_angle.to_radians().tan();
        profile.push(line(0.0, point, tip_radius, radius));
    }
    if length > point {
        profile.push(line(point, length, radius, radius));
    }
    Ok(profile)
}

/// A ball that stands on the tip, down to a neck of another radius, which is smaller.
pub(super) fn ball_on_neck(radius: f64, neck: f64) -> Segment {
    let to = radius + (radius * radius - neck * neck).sqrt();
    Segment::Arc { from: 0.0, to, centre_height: radius, centre_radius: 0.0, arc_radius: radius }
}

/// Outline of a cutter whose end has a radius and a corner of another (all of it for ball ends), and whose flank is a cylinder or
/// a cone of a half angle in radians; `None` where the length ends within the corner.
pub(super) fn rounded(radius: f64, corner: f64, half_angle: f64, length: f64) -> Option<Vec<Segment>> {
    // The arc ends where it is tangent to the flank.
    let arc_top = corner * (1.0 - half_angle.sin());
    let is_all_arc = corner > 0.0 && (length - arc_top).abs() <= 1e-9 * arc_top;
    if length <= arc_top && !is_all_arc {
        return None;
    }
    let flank = radius - corner + corner * half_angle.cos();
    let mut profile = Vec::new();
    if corner > 0.0 {
        profile.push(Segment::Arc {
            from: 0.0,
            to: arc_top,
            centre_height: corner,
            centre_radius: radius - corner,
            arc_radius: corner,
        });
    }
    if !is_all_arc {
        let radius_to = flank + (length - arc_top) * half_angle.tan();
        profile.push(Segment::Line { from: arc_top, to: length, radius_from: flank, radius_to });
    }
    Some(profile)
}
