//! The cutter's end in a tool file: flat, ball, bull or tapered.

use serde::Deserialize;
use toml::Spanned;

use super::{Reader, ToolFileError};
use crate::tool::Segment;

#[derive(Clone, Copy, Deserialize, PartialEq)]
#[serde(rename_all = "lowercase")]
enum CutterShape {
    Flat,
    Ball,
    Bull,
    Tapered,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CutterText {
    shape: CutterShape,
    diameter: Spanned<f64>,
    pub(super) length: Spanned<f64>,
    corner_radius: Option<Spanned<f64>>,
    half_angle: Option<Spanned<f64>>,
}

impl Reader<'_> {
    /// Outline of the cutter: a corner arc (the whole ball for ball ends), then a cylinder or a cone.
    pub(super) fn cutter(&self, cutter: &CutterText) -> Result<Vec<Segment>, ToolFileError> {
        let radius = self.length("cutter.diameter", &cutter.diameter)? / 2.0;
        let length = self.length("cutter.length", &cutter.length)?;
        let tapered = cutter.shape == CutterShape::Tapered;
        let corner = match (&cutter.corner_radius, cutter.shape) {
            (Some(corner), CutterShape::Bull | CutterShape::Tapered) => {
                let value = self.length("cutter.corner_radius", corner)?;
                if value > radius {
                    let what =
                        format!("cutter.corner_radius {value} is larger than the cutter's radius {radius}");
                    return Err(self.at(self.line(corner.span().start), what));
                }
                value
            }
            (Some(corner), _) => {
                let what = "cutter.corner_radius belongs to shape = \"bull\" or \"tapered\"";
                return Err(self.at(self.line(corner.span().start), what.into()));
            }
            (None, CutterShape::Bull) => {
                let line = self.line(cutter.diameter.span().start);
                return Err(self.at(line, "a bull-nose cutter needs cutter.corner_radius".into()));
            }
            (None, CutterShape::Flat) => 0.0,
            (None, CutterShape::Ball | CutterShape::Tapered) => radius,
        };
        let half_angle = match &cutter.half_angle {
            Some(angle) if tapered && *angle.get_ref() > 0.0 && *angle.get_ref() < 80.0 => {
                angle.get_ref().to_radians()
            }
            Some(angle) => {
                let what =
                    "cutter.half_angle belongs to shape = \"tapered\" and lies between 0 and 80 degrees";
                return Err(self.at(self.line(angle.span().start), what.into()));
            }
            None if tapered => {
                let line = self.line(cutter.diameter.span().start);
                return Err(self.at(line, "a tapered cutter needs cutter.half_angle".into()));
            }
            None => 0.0,
        };
        rounded(radius, corner, half_angle, length).ok_or_else(|| {
            let what = format!("cutter.length {length} is shorter than the cutter's rounded end");
            self.at(self.line(cutter.length.span().start), what)
        })
    }
}

/// Outline of a cutter whose end has a radius and a corner of another (all of it for ball ends), and whose flank is a cylinder or
/// a cone of a half angle in radians; `None` where the length ends within the corner.
pub(in crate::tool) fn rounded(
    radius: f64,
    corner: f64,
    half_angle: f64,
    length: f64,
) -> Option<Vec<Segment>> {
    // The arc ends where it is tangent to the flank.
    let arc_top = corner * (1.0 - half_angle.sin());
    if length <= arc_top {
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
    let radius_to = flank + (length - arc_top) * half_angle.tan();
    profile.push(Segment::Line { from: arc_top, to: length, radius_from: flank, radius_to });
    Some(profile)
}
