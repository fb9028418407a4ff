//! Exact collision measures at single voxels: what sections hold, one value at a time.

use glam::{DMat3, DVec3};

use super::{Pose, SceneField};
use crate::grid::Grid;
use crate::orientation::Orientation;
use crate::section::{Obstacles, SectionError, around, offset_of_query};
use crate::tool::{Tool, ToolError};

/// The collision measure of a tool among obstacles, voxel by voxel: to the bit what the section of the orientation has there, contact
/// and sharp points as in it ([`SectionPlan::with_query`](crate::section::SectionPlan::with_query) of the same).
pub struct VoxelMeasures<'a> {
    scene: SceneField<'a>,
    /// In the tool's frame, in world units.
    sharp_points: Vec<DVec3>,
    /// The obstacles' voxels; those asked for are so many beside them.
    obstacles: Grid,
    offset: [i64; 3],
    grid: Grid,
}

/// A tool in an orientation, which many voxels share.
#[derive(Clone, Debug)]
pub struct Turned {
    orientation: Orientation,
    rotation: DMat3,
    direction: DVec3,
    normaliser: u32,
}

impl<'a> VoxelMeasures<'a> {
    /// Measures at the voxels of `grid`, which lie on the obstacles' voxels.
    ///
    /// # Errors
    /// A grid with other voxels than the obstacles'.
    pub fn new(
        obstacles: impl Into<Obstacles<'a>>,
        grid: &Grid,
        tool: &'a Tool,
    ) -> Result<Self, SectionError> {
        let obstacles = obstacles.into();
        let own = obstacles.solid.grid;
        let offset = offset_of_query(&own, grid)?;
        Ok(Self {
            scene: SceneField::new(obstacles, tool),
            sharp_points: tool.sharp_point_positions(own.pitch),
            obstacles: own,
            offset,
            grid: *grid,
        })
    }

    /// The tool in an orientation.
    ///
    /// # Errors
    /// A tool that holds no voxel centre, or is too large.
    pub fn turned(&self, orientation: &Orientation) -> Result<Turned, ToolError> {
        Ok(Turned {
            orientation: *orientation,
            rotation: orientation.rotation(),
            direction: orientation.direction(),
            normaliser: self.scene.normaliser(orientation)?,
        })
    }

    /// True where the measure is 0: at one of the sharp points nothing overlaps.
    #[must_use]
    pub fn is_free(&self, voxel: usize, turned: &Turned) -> bool {
        self.sharp_points.iter().any(|&point| {
            self.poses(voxel, turned, point)
                .all(|(pose, _)| !self.scene.collides_along(&pose, turned.direction))
        })
    }

    /// The measure, in [0, 1].
    #[must_use]
    pub fn measure(&self, voxel: usize, turned: &Turned) -> f32 {
        let mut least = f32::INFINITY;
        for &point in &self.sharp_points {
            let overlaps = self.poses(voxel, turned, point).map(|(pose, weight)| {
                weight / f64::from(turned.normaliser)
                    * f64::from(self.scene.count_along(&pose, turned.direction))
            });
            least = least.min((overlaps.sum::<f64>() as f32).clamp(0.0, 1.0));
            if least == 0.0 {
                break;
            }
        }
        least
    }

    /// The poses, with the tip on voxel centres, whose overlaps' mean by these weights is that of a sharp point at the voxel.
    fn poses(
        &self,
        voxel: usize,
        turned: &Turned,
        point: DVec3,
    ) -> impl Iterator<Item = (Pose, f64)> + use<> {
        let (Grid { origin, pitch, .. }, orientation) = (self.obstacles, turned.orientation);
        let offset = DVec3::from_array(self.offset.map(|v| v as f64));
        let voxel = self.grid.voxel(voxel).map(|v| v as i64);
        around(offset - turned.rotation * point / pitch).map(move |(corner, weight)| {
            let at = [0, 1, 2].map(|axis| (voxel[axis] + corner[axis]) as f64 + 0.5);
            (Pose { position: origin + DVec3::from_array(at) * pitch, orientation }, weight)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Control;
    use crate::occupancy::Occupancy;
    use crate::orientation::OrientationSet;
    use crate::section::{SectionPlan, Skin, sections};
    use crate::tool::SharpPoints;

    #[test]
    fn every_voxel_is_to_the_bit_what_the_section_has_with_other_sharp_points_and_contact() {
        let grid = Grid { origin: DVec3::new(-3.0, 1.0, 0.25), pitch: 7.0, dims: [8, 7, 9] };
        let every = |step: usize, first: usize| Occupancy {
            grid,
            solid: (0..grid.len()).map(|i| u8::from(i * 7919 % step == first)).collect(),
        };
        let (solid, voxels) = (every(11, 3), every(9, 4));
        // Sticks out of the obstacle's grid on one side.
        let asked = Grid { origin: grid.centre([2, 0, 0]) - 3.5, dims: [9, 5, 9], ..grid };
        let points = SharpPoints::Points(vec![DVec3::new(1.0, 0.0, 3.0), DVec3::new(-4.0, 2.0, 0.5)]);
        let set = OrientationSet::parse("0,0;0,90;33,50;140,100;61,123").unwrap().orientations;
        for (sharp_points, touching) in
            [(SharpPoints::Tip, false), (SharpPoints::Tip, true), (points.clone(), false), (points, true)]
        {
            let tool = Tool { sharp_points, ..Tool::paper() };
            let rest = tool.without_cutter().unwrap();
            let skin = touching.then_some(Skin { voxels: &voxels, rest: &rest });
            let obstacles = Obstacles { solid: &solid, skin };
            let plan = SectionPlan::with_query(obstacles, &asked, &tool).unwrap();
            let measures = VoxelMeasures::new(obstacles, &asked, &tool).unwrap();
            let expected = sections(&plan, &set, Control::quiet()).unwrap();
            let mut free = 0;
            for (orientation, section) in set.iter().zip(&expected) {
                let turned = measures.turned(orientation).unwrap();
                for (voxel, &value) in section.iter().enumerate() {
                    assert_eq!(measures.measure(voxel, &turned), value, "{voxel} {orientation:?}");
                    assert_eq!(measures.is_free(voxel, &turned), value == 0.0, "{voxel} {orientation:?}");
                    free += usize::from(value == 0.0);
                }
            }
            assert!(free > 0 && free < expected.len() * asked.len(), "{free} of all are free");
        }
    }
}
