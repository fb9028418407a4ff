//! What obstructs the surface: the pose of minimum overlap for each sample, and the contribution of each solid voxel.

use anyhow::Result;
use imf_core::grid::Grid;
use imf_core::surface::{ElementCollision, MinimumOverlap, SurfaceSample, culprits, minimum_overlaps};
use imf_core::tool::{Assembly, ElementKind};

use super::cavities::voxels_around;
use super::{AccessRun, Surface, Verdict};
use crate::session::Session;

/// Maximum number of examined samples; beyond it every second, third, … one represents its neighbours.
const MOST: usize = 5_000;

#[derive(Default)]
pub(super) struct Blame {
    /// By sample: the pose of minimum overlap of its best tool; `None` for those that are reached or were not examined.
    pub(super) nearest: Vec<Option<MinimumOverlap>>,
    /// By voxel: the area that it obstructs.
    pub(super) voxels: Option<(Grid, Vec<f32>)>,
}

impl Blame {
    pub(super) fn find(session: &Session, run: &AccessRun, surface: &Surface) -> Result<Self> {
        let samples = &surface.samples.samples;
        let missed: Vec<usize> = (0..samples.len()).filter(|&s| !surface.is_reached(s)).collect();
        let every = missed.len().div_ceil(MOST).max(1);
        let looked_into: Vec<usize> = missed.into_iter().step_by(every).collect();
        let mut blame = Self { nearest: vec![None; samples.len()], voxels: None };
        if looked_into.is_empty() {
            return Ok(blame);
        }
        session.staged("what is in the way", "samples", 2 * looked_into.len() as u64, |control| {
            for (index, (_, tool)) in surface.tools.iter().enumerate() {
                let own = looked_into.iter().filter(|&&sample| surface.best[sample].1 == index);
                let own: Vec<(usize, Verdict)> =
                    own.map(|&sample| (sample, surface.best[sample].0)).collect();
                let directions = &run.orientations.orientations;
                let found = minimum_overlaps(tool, samples, &own, directions, control)?;
                let poses = own
                    .iter()
                    .zip(&found)
                    .filter_map(|(&(sample, _), at)| Some((every as f64 * samples[sample].area, (*at)?)));
                let poses: Vec<(f64, MinimumOverlap)> = poses.collect();
                own.iter().zip(found).for_each(|(&(sample, _), at)| blame.nearest[sample] = at);
                if let Some((grid, area)) = culprits(tool, &poses, control)? {
                    match &mut blame.voxels {
                        Some((_, sum)) => sum.iter_mut().zip(area).for_each(|(sum, area)| *sum += area),
                        None => blame.voxels = Some((grid, area)),
                    }
                }
            }
            Ok(blame)
        })
    }

    /// The largest area that a voxel at a sample obstructs; NaN where none does.
    pub(super) fn at(&self, sample: &SurfaceSample) -> f32 {
        let Some((grid, area)) = &self.voxels else { return f32::NAN };
        let inside = sample.point - 0.5 * grid.pitch * sample.normal;
        let most = voxels_around(grid, inside).map(|voxel| area[voxel]).fold(0.0, f32::max);
        if most > 0.0 { most } else { f32::NAN }
    }
}

/// What would free a place, by what obstructs it; `quantified` are remedies that were found, in words, `tools` all that were tried.
pub(super) fn remedy(
    verdict: Verdict,
    hits: &[ElementCollision],
    quantified: &[String],
    tools: &[Assembly],
) -> String {
    let any = |is: &dyn Fn(&ElementCollision) -> bool| hits.iter().any(is);
    let other = match verdict {
        Verdict::Reached => "",
        Verdict::NotFaced if tools.iter().all(|tool| tool.tool().plunge_only) => {
            "a mill: these tools machine holes of their own diameter alone"
        }
        Verdict::NotFaced => "a direction from the other side",
        _ if any(&|hit| hit.kind == ElementKind::Cutter && hit.body == 0) => {
            "a smaller cutter, or another direction"
        }
        _ if any(&|hit| hit.body > 0) => "another fixture, or another direction",
        _ if !quantified.is_empty() => "another direction",
        _ if any(&|hit| matches!(hit.kind, ElementKind::Holder(_))) => {
            "a slimmer holder, or another direction"
        }
        _ if any(&|hit| hit.kind == ElementKind::Shank) => "a slimmer shank, or another direction",
        _ => "another direction",
    };
    match quantified {
        [] => other.to_owned(),
        some => format!("{}; or {other}", some.join("; or ")),
    }
}
