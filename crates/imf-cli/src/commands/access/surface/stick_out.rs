//! The minimum stick-out with which a tool reaches the surface: results and text.

use std::fmt::Write as _;

use anyhow::Result;
use imf_core::orientation::OrientationSet;
use imf_core::surface::{
    StickOut, StickOutTool, SurfaceSample, SurfaceSamples, Verdict, shortest_stick_outs,
};
use imf_core::tool::Assembly;
use imf_core::unit::LengthUnit;
use serde::Serialize;

use super::SurfaceSettings;
use super::row::left;
use crate::output::length;
use crate::session::Session;

/// Lengths of the table, evenly from the shortest to the largest that is needed.
const STEPS: usize = 6;

pub(super) struct ToolStickOut {
    tool: StickOutTool,
    /// By sample.
    pub(super) found: Vec<StickOut>,
}

impl ToolStickOut {
    pub(super) fn find(
        session: &Session,
        settings: &SurfaceSettings,
        assembly: &Assembly,
        samples: &[SurfaceSample],
        orientations: &OrientationSet,
    ) -> Result<Self> {
        let tool = StickOutTool::new(&settings.environment, assembly, settings.tolerance)?;
        let name = format!("stick-out, {}", tool.name());
        let found = session.staged(&name, "directions", orientations.len() as u64, |control| {
            shortest_stick_outs(&tool, samples, &orientations.orientations, control)
        })?;
        Ok(Self { tool, found })
    }

    /// Minimum stick-out of a sample for files: −1 where none helps.
    pub(super) fn value(&self, sample: usize) -> f32 {
        let length = self.found[sample].length();
        if length.is_finite() { length as f32 } else { -1.0 }
    }

    pub(super) fn row(
        &self,
        samples: &SurfaceSamples,
        orientations: &OrientationSet,
        surface_nearer_by: Option<f64>,
    ) -> StickOutRow {
        let share = |holds: &dyn Fn(&StickOut) -> bool| samples.fraction(|sample| holds(&self.found[sample]));
        let at_most = |most: f64| share(&|found| found.length() <= most);
        let (given, shortest, longest) = (self.tool.given(), self.tool.shortest(), self.tool.longest());
        // The values for this tool, the smallest first.
        let mut needed: Vec<(f64, f64, usize)> = self
            .found
            .iter()
            .enumerate()
            .map(|(index, found)| (found.length(), samples.samples[index].area, index))
            .filter(|(length, ..)| length.is_finite() && *length <= longest)
            .collect();
        needed.sort_by(|a, b| a.0.total_cmp(&b.0));
        let reachable: f64 = needed.iter().map(|(_, area, _)| area).sum();
        let quantile = |fraction: f64| {
            let mut covered = 0.0;
            let first = needed.iter().find(|(_, area, _)| {
                covered += area;
                covered >= fraction * reachable * (1.0 - 1e-12)
            });
            first.map(|(length, ..)| *length)
        };
        let most = needed.last().map(|(length, _, index)| {
            let direction = match self.found[*index] {
                StickOut::Reached { direction, .. } => {
                    orientations.orientations[direction as usize].direction()
                }
                _ => glam::DVec3::ZERO,
            };
            let point = samples.samples[*index].point;
            LongestStickOut { length: *length, point: point.to_array(), direction: direction.to_array() }
        });
        // By how much a triangle's corner lies deeper than its middle, along the direction from which it is reached.
        let deeper = |index: usize| {
            let StickOut::Reached { direction, .. } = self.found[index] else { return 0.0 };
            let axis = orientations.orientations[direction as usize].direction();
            let below = |corner: glam::DVec3| (samples.samples[index].point - corner).dot(axis);
            samples.mesh.corners(index).map(below).into_iter().fold(0.0, f64::max)
        };
        let corners_deeper_by = needed.iter().map(|(.., index)| deeper(*index)).fold(0.0, f64::max);
        let largest = most.as_ref().map_or(shortest, |most| most.length);
        let steps = (0..STEPS).map(|i| shortest + (largest - shortest) * i as f64 / (STEPS - 1) as f64);
        let mut lengths: Vec<f64> = steps.chain([given]).collect();
        lengths.sort_by(f64::total_cmp);
        lengths.dedup_by(|a, b| (*a - *b).abs() < 1e-6);
        let used = needed.iter().rev().map(|(length, ..)| *length).find(|length| *length <= given);
        let of = |verdict: Verdict| share(&|found| found.verdict() == verdict);
        StickOutRow {
            tool: self.tool.name().to_owned(),
            given,
            shortest,
            longest: longest.is_finite().then_some(longest),
            surface_nearer_by,
            corners_deeper_by,
            needed_at_most: lengths.into_iter().map(|length| (length, at_most(length))).collect(),
            needed_for: [0.5, 0.9, 0.99]
                .map(|fraction| (fraction, quantile(fraction).unwrap_or(f64::NAN)))
                .to_vec(),
            largest: most,
            margin: used.map(|used| given - used),
            at_some_length: reachable / samples.area(),
            beyond_the_tool: share(&|found| found.length().is_finite() && found.length() > longest),
            obstructed_at_any_length: of(Verdict::Obstructed),
            gouged: of(Verdict::Gouged),
            not_faced: of(Verdict::NotFaced),
        }
    }
}

/// Where most is needed.
#[derive(Debug, Serialize)]
struct LongestStickOut {
    length: f64,
    point: [f64; 3],
    direction: [f64; 3],
}

/// One tool's stick-out in the summary; shares are of the surface's area.
#[derive(Debug, Serialize)]
pub(crate) struct StickOutRow {
    tool: String,
    given: f64,
    /// The holder grips neither flutes nor necks.
    shortest: f64,
    /// The overall length, where the tool states it.
    longest: Option<f64>,
    /// How deep an edge of the holder may stand in a surface between the points by which that is known.
    surface_nearer_by: Option<f64>,
    /// How much deeper a corner of the surface's triangles lies than its middle, which the lengths are for.
    corners_deeper_by: f64,
    /// A length, and the fraction that needs no more.
    needed_at_most: Vec<(f64, f64)>,
    /// A fraction of what the tool reaches at some length, and what that needs at most.
    needed_for: Vec<(f64, f64)>,
    largest: Option<LongestStickOut>,
    /// By how much the given stick-out is more than what is needed by all that needs no more than it.
    margin: Option<f64>,
    at_some_length: f64,
    /// It would take more than the overall length.
    beyond_the_tool: f64,
    obstructed_at_any_length: f64,
    gouged: f64,
    not_faced: f64,
}

impl StickOutRow {
    pub(crate) fn lines(&self, unit: LengthUnit) -> String {
        let enough = |value: f64| length::at_least(value, unit);
        let percent = |share: f64| format!("{:.1} %", 100.0 * share);
        let mut text = length::stick_out(&self.tool, [self.given, self.shortest], self.longest, unit) + "\n";
        if let Some(LongestStickOut { length, point, direction: [i, j, k] }) = self.largest {
            let _ = writeln!(
                text,
                "  all {} that it reaches at some length need {} {unit}: most at ({}) from ({i:.3}, {j:.3}, {k:.3})",
                percent(self.at_some_length),
                enough(length),
                length::place(point, unit)
            );
            let parts = self.needed_for.iter();
            let parts: Vec<String> = parts
                .map(|(fraction, length)| format!("{:.0} % of it {}", 100.0 * fraction, enough(*length)))
                .collect();
            let _ = writeln!(text, "  {} {unit}", parts.join(", "));
        }
        let _ = writeln!(text, "  {:>10}   needs no more, of the surface", format!("length, {unit}"));
        for (length, share) in &self.needed_at_most {
            let note = match self.margin {
                Some(margin) if (length - self.given).abs() < 1e-6 => {
                    format!("   as it is set: {} {unit} to spare", length::at_most(margin, unit))
                }
                None if (length - self.given).abs() < 1e-6 => "   as it is set".into(),
                _ => String::new(),
            };
            let _ = writeln!(text, "  {:>10}   {:>8}{note}", enough(*length), percent(*share));
        }
        text += &left(&[
            ("more than its overall length", self.beyond_the_tool),
            ("in the way at any stick-out", self.obstructed_at_any_length),
            ("the cutter does not fit", self.gouged),
            ("no direction faces it", self.not_faced),
        ]);
        if let Some(nearer) = self.surface_nearer_by {
            let _ = writeln!(
                text,
                "  an edge of the holder may stand so deep in a surface between its points: set {} {unit} more",
                enough(nearer)
            );
        }
        if self.corners_deeper_by > 1e-6 * self.given {
            let _ = writeln!(
                text,
                "  lengths are for the middles of small triangles, whose corners lie up to {} {unit} deeper: that comes on top",
                enough(self.corners_deeper_by)
            );
        }
        text
    }
}
