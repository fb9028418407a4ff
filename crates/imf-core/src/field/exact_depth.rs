//! The exact signed penetration depth at any pose: what [`DepthPlan`](crate::section::DepthPlan) gives at voxel centres, by its definition.

use std::sync::LazyLock;

use glam::DVec3;

use super::{ExactField, FieldError, check_lengths};
use crate::parallel;
use crate::pose::Pose;
use crate::section::DEPTH_CAP;

/// Moves by whole voxels with their squared lengths, nearer than the farthest depth, the shortest first.
static MOVES: LazyLock<Vec<(DVec3, f64)>> = LazyLock::new(|| {
    let cap = DEPTH_CAP as i32;
    let one = || -cap..=cap;
    let all = one()
        .flat_map(|x| one().flat_map(move |y| one().map(move |z| DVec3::new(x.into(), y.into(), z.into()))));
    let limit = f64::from(cap * cap);
    let mut moves: Vec<_> = all
        .map(|by| (by, by.length_squared()))
        .filter(|&(_, squared)| squared > 0.0 && squared < limit)
        .collect();
    moves.sort_by(|a, b| a.1.total_cmp(&b.1));
    moves
});

/// Poses that a thread evaluates at a time.
const CHUNK: usize = 16;

impl ExactField {
    /// The signed penetration depth in the grid's unit: the shortest move by whole voxels after which the tool no longer collides,
    /// or does, less half a pitch; below 0 where it is free. Within 7.5 pitches, as all depths ([`Quantity::bounds`](crate::section::Quantity::bounds)). NaN for an invalid pose.
    #[must_use]
    pub fn depth(&self, pose: &Pose) -> f64 {
        if !pose.is_valid() {
            return f64::NAN;
        }
        let (own, pitch) = (self.collides(pose), self.obstacle().grid().pitch);
        let other = |by: DVec3| self.collides(&Pose { position: pose.position + by * pitch, ..*pose }) != own;
        let nearest =
            MOVES.iter().find(|&&(by, _)| other(by)).map_or(DEPTH_CAP as f64, |&(_, squared)| squared.sqrt());
        (nearest - 0.5) * pitch * if own { 1.0 } else { -1.0 }
    }

    /// [`ExactField::depth`] of many poses, on all threads of the current pool.
    ///
    /// # Errors
    /// Lengths that differ.
    pub fn depths(&self, poses: &[Pose], depths: &mut [f32]) -> Result<(), FieldError> {
        check_lengths(poses.len(), depths.len())?;
        parallel::try_for_each_chunk(depths, CHUNK, |index, depths| {
            depths
                .iter_mut()
                .zip(&poses[index * CHUNK..])
                .for_each(|(depth, pose)| *depth = self.depth(pose) as f32);
            Ok(())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orientation::Orientation;
    use crate::parts::ReferencePart;
    use crate::scene::SceneSpec;
    use crate::section::{DepthPlan, DepthScratch, SectionPlan, ToolPoints};
    use crate::tool::{Clearance, Tool};

    #[test]
    fn at_voxel_centres_depths_of_sections_are_those_of_trying_every_position_around() {
        let (mesh, tool) = (ReferencePart::Bracket.mesh(), Tool::paper());
        let spec = SceneSpec::of_reference(ReferencePart::Bracket, &mesh, [11, 35, 21], &tool);
        let room = Clearance { holder: 2.0, shank: 2.0, cutter: 2.0 };
        let bare = spec.scene().unwrap();
        let grid = bare.record.grid;
        let turns = [Orientation::default(), Orientation::new(25.0, 55.0), Orientation::new(200.0, 120.0)];
        let scenes = [bare.clone().with_clearance(&room).unwrap(), bare];
        for (scene, orientation) in scenes.iter().flat_map(|scene| turns.map(|turn| (scene, turn))) {
            let exact = ExactField::new(scene, &scene.record.tool).unwrap();
            let plan = DepthPlan::of(&SectionPlan::of_scene(scene, ToolPoints::Tip).unwrap()).unwrap();
            let mut section = vec![0.0; grid.len()];
            plan.depths(&orientation, &mut DepthScratch::default(), &mut section).unwrap();
            let places: Vec<usize> = (0..grid.len()).step_by(61).collect();
            let pose = |&place: &usize| Pose::oriented(grid.centre(grid.voxel(place)), &orientation);
            let poses: Vec<Pose> = places.iter().map(pose).collect();
            let mut depths = vec![0.0; poses.len()];
            exact.depths(&poses, &mut depths).unwrap();
            for (&place, depth) in places.iter().zip(&depths) {
                assert!((section[place] - depth).abs() < 1e-5, "{place}: {} {depth}", section[place]);
            }
            let above = depths.iter().filter(|depth| **depth > 0.0).count();
            assert!(above > 10 && above + 10 < depths.len(), "{above} of {}", depths.len());
        }
        let exact = ExactField::new(&scenes[0], &scenes[0].record.tool).unwrap();
        let nowhere = Pose { position: DVec3::NAN, ..Pose::along(DVec3::ZERO, DVec3::Z) };
        assert!(exact.depth(&nowhere).is_nan());
    }
}
