//! The `[cutter]` of a tool file.

use serde::Deserialize;
use toml::Spanned;

use super::Reader;
use crate::file_error::Fault;
use crate::tool::Segment;
use crate::tool::profile::top;
use crate::tool::stack::{ball_on_neck, pointed, rounded};

#[derive(Clone, Copy, Deserialize, PartialEq)]
#[serde(rename_all = "lowercase")]
enum CutterShape {
    Flat,
    Ball,
    Bull,
    Tapered,
    Lollipop,
    Drill,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CutterText {
    shape: CutterShape,
    diameter: Spanned<f64>,
    length: Option<Spanned<f64>>,
    corner_radius: Option<Spanned<f64>>,
    half_angle: Option<Spanned<f64>>,
    point_angle: Option<Spanned<f64>>,
    #[serde(default)]
    pub(super) back_cutting: bool,
    plunge_only: Option<bool>,
}

impl CutterText {
    /// Whether it cuts along its axis alone; a drill does, unless it is said not to.
    pub(super) fn plunges_only(&self) -> bool {
        self.plunge_only.unwrap_or(self.shape == CutterShape::Drill)
    }
}

impl Reader<'_> {
    /// Outline of the cutter: a corner arc (half a ball for ball ends), then a cylinder or a cone; of a lollipop a ball down to its
    /// shank, of a drill its point and a cylinder.
    pub(super) fn cutter(&self, cutter: &CutterText, shank: Option<f64>) -> Result<Vec<Segment>, Fault> {
        let radius = self.length("cutter.diameter", &cutter.diameter)? / 2.0;
        let corner = match (&cutter.corner_radius, cutter.shape) {
            (Some(corner), CutterShape::Bull | CutterShape::Tapered) => {
                // A cone may have a sharp corner.
                let is_sharp = cutter.shape == CutterShape::Tapered && *corner.get_ref() == 0.0;
                let value = if is_sharp { 0.0 } else { self.length("cutter.corner_radius", corner)? };
                if value > radius {
                    let what =
                        format!("cutter.corner_radius {value} is larger than the cutter's radius {radius}");
                    return Err(self.wrong(corner, what));
                }
                value
            }
            (Some(corner), _) => {
                let what = "cutter.corner_radius belongs to shape = \"bull\" or \"tapered\"";
                return Err(self.wrong(corner, what));
            }
            (None, CutterShape::Bull) => {
                return Err(self.wrong(&cutter.diameter, "a bull-nose cutter needs cutter.corner_radius"));
            }
            (None, CutterShape::Flat | CutterShape::Lollipop | CutterShape::Drill) => 0.0,
            (None, CutterShape::Ball | CutterShape::Tapered) => radius,
        };
        let half_angle = match (&cutter.half_angle, cutter.shape == CutterShape::Tapered) {
            (Some(angle), true) if *angle.get_ref() > 0.0 && *angle.get_ref() < 80.0 => *angle.get_ref(),
            (Some(angle), true) => {
                let what = "cutter.half_angle of a tapered cutter is more than 0 and less than 80 degrees";
                return Err(self.wrong(angle, what));
            }
            (Some(angle), false) => {
                return Err(self.wrong(angle, "cutter.half_angle belongs to shape = \"tapered\""));
            }
            (None, true) => {
                return Err(self.wrong(&cutter.diameter, "a tapered cutter needs cutter.half_angle"));
            }
            (None, false) => 0.0,
        };
        let point_angle = match (&cutter.point_angle, cutter.shape == CutterShape::Drill) {
            (Some(angle), true) if (1.0..=180.0).contains(angle.get_ref()) => *angle.get_ref(),
            (Some(angle), true) => {
                return Err(self.wrong(angle, "cutter.point_angle is from 1 to 180 degrees"));
            }
            (Some(angle), false) => {
                return Err(self.wrong(angle, "cutter.point_angle belongs to shape = \"drill\""));
            }
            (None, true) => {
                let what = "a drill needs cutter.point_angle, from edge to edge, such as 118";
                return Err(self.wrong(&cutter.diameter, what));
            }
            (None, false) => 180.0,
        };
        if cutter.shape == CutterShape::Lollipop {
            if let Some(length) = &cutter.length {
                let what = "how far a lollipop's ball goes follows from its shank: remove cutter.length";
                return Err(self.wrong(length, what));
            }
            let neck = shank.map(|diameter| diameter / 2.0).filter(|&neck| neck < radius);
            let what = "a lollipop needs a [shank] that is thinner than its ball";
            let neck = neck.ok_or_else(|| self.wrong(&cutter.diameter, what))?;
            return Ok(vec![ball_on_neck(radius, neck)]);
        }
        let what = "a cutter needs cutter.length, from its tip to where its edges end";
        let given = cutter.length.as_ref().ok_or_else(|| self.wrong(&cutter.diameter, what))?;
        let length = self.length("cutter.length", given)?;
        if cutter.shape == CutterShape::Drill {
            let profile = pointed(0.0, radius, 0.5 * point_angle, length);
            let profile = profile.map_err(|what| self.wrong(&cutter.diameter, what))?;
            let point = top(&profile[..1]);
            let what = || format!("cutter.length {length} is shorter than the drill's point ({point})");
            return if point <= length { Ok(profile) } else { Err(self.wrong(given, what())) };
        }
        let what = || format!("cutter.length {length} is shorter than the cutter's rounded end");
        let profile = rounded(radius, corner, half_angle.to_radians(), length);
        profile.ok_or_else(|| self.wrong(given, what()))
    }
}
