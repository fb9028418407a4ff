//! The minimum stick-outs of a surface, compared with exact counts.

use anyhow::Result;
use imf_cli::session::Session;
use imf_core::control::Control;
use imf_core::orientation::Orientation;
use imf_core::surface::{
    StickOut, StickOutTool, SurfaceSample, SurfaceTool, shortest_stick_outs, surface_access,
};
use imf_core::tool::Assembly;
use rayon::prelude::*;
use serde::Serialize;

use super::{End, ShopArguments, Surface, clearance, mill, table};
use crate::document::Document;
use crate::measurement::seconds;

#[derive(Serialize)]
pub(super) struct Row {
    scene: String,
    /// The best of all directions for every point.
    best_seconds: f64,
    /// One direction for every point, in the mean of a few.
    one_direction_seconds: f64,
    /// Fraction of the points that are reached at some length, at the length that the tool is set to, and what they
    /// need at most.
    reached: f64,
    reached_as_set: f64,
    largest: f64,
    checks: Checks,
}

/// Results for one point and one direction, by exact counts.
#[derive(Default, Serialize)]
struct Checks {
    answers: usize,
    /// Not free at the result.
    optimistic: usize,
    /// Longer than the shortest by a voxel at least: what is one voxel shorter is a tool too.
    longer: usize,
    /// Of these, free one voxel shorter, of centres and of points of the surface.
    pessimistic: usize,
}

impl Row {
    pub(super) fn new(session: &Session, surface: &Surface, arguments: &ShopArguments) -> Result<Self> {
        session.note("least stick-outs");
        let assembly = mill(End::Ball, 3.0, 20.0, 30.0, [12.0, 40.0]).offset(&clearance())?;
        let tool = StickOutTool::new(&surface.surroundings, &assembly, surface.tolerance)?;
        let (best_seconds, best) = seconds(|| surface.least(&tool, &surface.samples, &surface.directions))?;
        let few = &surface.directions[..surface.directions.len().min(10)];
        let (few_seconds, ()) = seconds(|| {
            few.iter()
                .try_for_each(|&direction| surface.least(&tool, &surface.samples, &[direction]).map(drop))
        })?;
        let share =
            |most: f64| best.iter().filter(|found| found.length() <= most).count() as f64 / best.len() as f64;
        let finite = best.iter().map(StickOut::length).filter(|length| length.is_finite());
        session.note("exact counts");
        Ok(Self {
            scene: surface.name.clone(),
            best_seconds,
            one_direction_seconds: few_seconds / few.len() as f64,
            reached: share(f64::MAX),
            reached_as_set: share(tool.given()),
            largest: finite.fold(0.0, f64::max),
            checks: surface.check(&tool, &assembly, arguments.checks as usize)?,
        })
    }

    pub(super) fn write(&self, document: &mut Document) {
        let Checks { answers, optimistic, longer, pessimistic } = self.checks;
        document.section("Least stick-outs");
        document.paragraph(format!(
            "{}; a ball end mill of 6 mm whose holder of 24 mm slides on a shank of 6 mm.",
            self.scene
        ));
        table(
            document,
            &[
                ("the best of all directions for every point", format!("{:.2} s", self.best_seconds)),
                ("one direction for every point", format!("{:.4} s", self.one_direction_seconds)),
                ("reached at some length", format!("{:.1} % of the points", 100.0 * self.reached)),
                ("reached as the tool is set", format!("{:.1} %", 100.0 * self.reached_as_set)),
                ("needed at most", format!("{:.1} mm", self.largest)),
                ("answers checked", answers.to_string()),
                ("not free at the answer", optimistic.to_string()),
                ("a voxel longer than the shortest", longer.to_string()),
                ("of these free one voxel shorter", pessimistic.to_string()),
            ],
        );
    }
}

impl Surface {
    fn least(
        &self,
        tool: &StickOutTool,
        samples: &[SurfaceSample],
        directions: &[Orientation],
    ) -> Result<Vec<StickOut>> {
        Ok(self.pool.install(|| shortest_stick_outs(tool, samples, directions, Control::quiet()))?)
    }

    /// At random points, the same number in every direction.
    fn check(&self, tool: &StickOutTool, assembly: &Assembly, checks: usize) -> Result<Checks> {
        let each = checks.div_ceil(self.directions.len());
        let pitch = self.solid.grid.pitch;
        let mut all = Checks::default();
        for (index, &direction) in self.directions.iter().enumerate() {
            // Enough that sufficiently many have a result; the samples are in random order.
            let first = index * 8 * each % self.samples.len();
            let samples: Vec<SurfaceSample> =
                self.samples[first..].iter().chain(&self.samples).take(8 * each).copied().collect();
            let found = self.least(tool, &samples, &[direction])?;
            let answers = samples.iter().zip(&found).filter_map(|found| match found {
                (sample, StickOut::Reached { length, tip, .. }) => Some((*length, *tip, *sample)),
                _ => None,
            });
            let answers: Vec<_> = answers.take(each.min(checks - all.answers)).collect();
            let free = |length: f64, tip| {
                let set = assembly.tool().with_stick_out(length)?;
                let set = set.offset(assembly.clearance()).ok()?;
                Some(set.noncutting()?.count_inside(&self.solid, tip, &direction) == 0)
            };
            let verdicts: Vec<_> = self.pool.install(|| {
                let verdict = |&(length, tip, sample): &(f64, _, SurfaceSample)| {
                    let below = length - pitch;
                    let shorter = || {
                        let is_free = free(below, tip) != Some(false);
                        is_free && self.reaches(assembly, below, sample, direction)
                    };
                    (free(length, tip), (below >= tool.shortest()).then(shorter))
                };
                answers.par_iter().map(verdict).collect()
            });
            for (at, below) in verdicts {
                all.answers += 1;
                all.optimistic += usize::from(at != Some(true));
                all.longer += usize::from(below.is_some());
                all.pessimistic += usize::from(below == Some(true));
            }
        }
        Ok(all)
    }

    /// Whether the tool reaches a point as it is set to a length: where no centre is in the way, a point of the surface may be.
    fn reaches(
        &self,
        assembly: &Assembly,
        length: f64,
        sample: SurfaceSample,
        direction: Orientation,
    ) -> bool {
        let set =
            assembly.tool().with_stick_out(length).and_then(|set| set.offset(assembly.clearance()).ok());
        let tool = set.and_then(|set| SurfaceTool::new(&self.surroundings, &set, self.tolerance).ok());
        let reached =
            tool.and_then(|tool| surface_access(&tool, &[sample], &[direction], Control::quiet()).ok());
        reached.is_none_or(|reached| reached.is_free(0, 0))
    }
}
