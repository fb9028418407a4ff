//! A checker that follows a changed obstacle, beside one of the obstacle made anew.

use anyhow::{Context as _, Result, ensure};
use imf_core::field::Decision;
use imf_core::glam::DVec3;
use imf_core::obstacle::Obstacle;
use imf_core::parts::ReferencePart;
use imf_core::pose::Pose;
use imf_core::tool::{Clearance, Tool};
use imf_core::world::{Checker, ObstacleId, World};
use rand::{RngExt as _, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

use super::{BATCH, random_poses};
use crate::candidates::reference_scene;
use crate::measurement::{ROUNDS, seconds};

/// Times of a part at one resolution; each to the end of a first batch.
#[derive(Serialize)]
pub(super) struct ChangeRow {
    pub(super) voxels: usize,
    pub(super) solid: usize,
    /// Voxels of a change, in the median.
    pub(super) changed: usize,
    /// The first change of all, which computes what later ones reuse.
    pub(super) first: f64,
    pub(super) median: f64,
    pub(super) longest: f64,
    /// World and checker of the voxels made anew, the minimum of several.
    pub(super) anew: f64,
}

/// Balls that are taken away and put back.
const BALLS: usize = 25;
/// Of the solid voxels a ball has this part.
const PART: f64 = 1e-3;

pub(super) fn measure(part: ReferencePart) -> Result<Vec<ChangeRow>> {
    [1.0, 2.0].into_iter().map(|scale| at(part, scale)).collect()
}

fn at(part: ReferencePart, scale: f64) -> Result<ChangeRow> {
    let scene = reference_scene(part, scale)?;
    let grid = scene.record.grid;
    let poses = random_poses(&grid, BATCH, 0)?;
    let solid: Vec<usize> = (0..grid.len()).filter(|&index| scene.obstacle.solid[index] == 1).collect();
    let mut random = ChaCha8Rng::seed_from_u64(0);
    let radius = (PART * solid.len() as f64 * 0.75 / std::f64::consts::PI).cbrt() * grid.pitch;
    let mut balls: Vec<Vec<usize>> = Vec::new();
    for _ in 0..BALLS {
        let middle = grid.centre(grid.voxel(solid[random.random_range(0..solid.len())]));
        let within = |index: &&usize| grid.centre(grid.voxel(**index)).distance(middle) <= radius;
        balls.push(solid.iter().filter(within).copied().collect());
    }
    let made = || -> Result<(World, ObstacleId, Checker)> {
        let mut world = World::builder().unit(scene.record.unit).allow_coarse(true).build()?;
        let copy = Obstacle::from(&scene);
        let id = world.add_voxels("part", copy, Pose::along(DVec3::ZERO, DVec3::Z))?;
        let checker = world.checker(&Tool::paper(), &Clearance::default())?;
        Ok((world, id, checker))
    };
    let classify = |checker: &Checker| -> Result<Vec<Decision>> {
        let mut decisions = vec![Decision::Undecided; poses.len()];
        checker.classify(&poses, &mut decisions)?;
        Ok(decisions)
    };
    let mut anew = f64::INFINITY;
    for _ in 0..ROUNDS {
        let (time, _) = seconds(|| classify(&made()?.2))?;
        anew = anew.min(time);
    }
    let (mut world, id, checker) = made()?;
    let before = classify(&checker)?;
    let mut checkers = [checker];
    let mut times = Vec::new();
    for ball in &balls {
        for (solid, empty) in [(&[][..], &ball[..]), (&ball[..], &[][..])] {
            let (time, _) = seconds(|| {
                world.change(id, solid, empty, &mut checkers)?;
                classify(&checkers[0])
            })?;
            times.push(time);
        }
    }
    ensure!(classify(&checkers[0])? == before, "what was taken away and put back answers differently");
    let first = times.remove(0);
    times.sort_by(f64::total_cmp);
    balls.sort_by_key(Vec::len);
    Ok(ChangeRow {
        voxels: grid.len(),
        solid: solid.len(),
        changed: balls[BALLS / 2].len(),
        first,
        median: times[times.len() / 2],
        longest: *times.last().context("no change was measured")?,
        anew,
    })
}
