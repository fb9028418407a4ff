//! Single poses, decided as those of a path are.

use super::elements::Elements;
use super::{CheckBodies, CheckError, CheckSettings, Collision, Hit};
use crate::pose::Pose;
use crate::tool::Tool;

/// A tool against a part and what holds it at any pose: what [`check_toolpath`](super::check_toolpath) finds there. A machine is not looked
/// at.
///
/// # Example
/// A ball of 10 mm over a block, 1 mm too deep:
/// ```
/// use imf_core::check::{CheckBodies, CheckSettings, PoseChecker};
/// use imf_core::glam::DVec3;
/// use imf_core::grid::Grid;
/// use imf_core::occupancy::Occupancy;
/// use imf_core::pose::Pose;
/// use imf_core::tool::Tool;
/// use imf_core::unit::LengthUnit;
///
/// let grid = Grid { origin: DVec3::splat(-10.0), pitch: 0.5, dims: [40; 3] };
/// let solid = (0..grid.len()).map(|voxel| u8::from(grid.voxel(voxel)[2] < 20)).collect();
/// let part = Occupancy { grid, solid };
/// let settings = CheckSettings::of_pitch(0.5, LengthUnit::Mm);
/// let checker = PoseChecker::new(CheckBodies::of_part(&part), &Tool::paper(), &settings)?;
/// assert!(checker.collisions(&Pose::along(DVec3::ZERO, DVec3::Z))?.is_empty());
/// let hit = &checker.collisions(&Pose::along(DVec3::new(0.0, 0.0, -1.0), DVec3::Z))?[0];
/// assert!(hit.element == "cutter" && (hit.depth - 1.0).abs() < 0.25);
/// # Ok::<(), imf_core::check::CheckError>(())
/// ```
pub struct PoseChecker(Elements);

impl PoseChecker {
    /// For many poses. All lengths, the tool's too, are in one unit.
    ///
    /// # Errors
    /// Settings, voxels or a tool that make no sense; a cutter of which the contact leaves nothing that voxels show.
    pub fn new(bodies: CheckBodies<'_>, tool: &Tool, settings: &CheckSettings) -> Result<Self, CheckError> {
        settings.check()?;
        bodies.check()?;
        tool.check()?;
        let Hit { bodies, cut, .. } = Hit::new(bodies, settings);
        Ok(Self(Elements::new(&bodies, &cut, tool, settings)?))
    }

    /// What collides at a pose in the world, each element with each body once; nothing where the tool is free.
    ///
    /// # Errors
    /// An invalid pose.
    pub fn collisions(&self, pose: &Pose) -> Result<Vec<Collision>, CheckError> {
        if !pose.position.is_finite() || pose.axis().is_none() {
            return Err(CheckError::Pose);
        }
        Ok(self.0.at(pose))
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::super::tests::{check_text, pose_lines};
    use super::*;
    use crate::grid::Grid;
    use crate::mesh::Mesh;
    use crate::section::test_shapes::orientations;
    use crate::unit::LengthUnit;
    use crate::voxelize::voxelize;

    #[test]
    fn a_pose_is_decided_as_on_a_path_and_one_that_is_none_is_refused() {
        let mesh = Mesh::cuboid(DVec3::splat(-8.0), DVec3::new(8.0, 8.0, 3.0));
        let (low, high) = mesh.bounds().unwrap();
        let part = voxelize(&mesh, &Grid::with_pitch(low, high, 1.0, 2).unwrap(), false);
        let bodies = CheckBodies { surfaces: &[&mesh], ..CheckBodies::of_part(&part) };
        let (tool, settings) = (Tool::paper(), CheckSettings::of_pitch(1.0, LengthUnit::Mm));
        let checker = PoseChecker::new(bodies, &tool, &settings).unwrap();
        let (mut hits, mut free) = (0, 0);
        for (index, orientation) in orientations("random:60:4").iter().enumerate() {
            let place = |step: f64| (index as f64 * step).fract() * 24.0 - 12.0;
            let (tip, axis) = (DVec3::new(place(0.618), place(0.755), place(0.57)), orientation.direction());
            let report = check_text(bodies, &tool, &pose_lines(&[(tip, axis)]), &settings).unwrap();
            let expected = report.colliding.first().map_or(&[][..], |line| &line.collisions);
            let found = checker.collisions(&Pose::along(tip, axis)).unwrap();
            // A path's numbers are text.
            assert_eq!(found.len(), expected.len());
            for (found, expected) in found.iter().zip(expected) {
                assert_eq!((&found.element, found.voxels), (&expected.element, expected.voxels));
                assert!((found.depth - expected.depth).abs() < 1e-9, "{found:?} {expected:?}");
            }
            hits += usize::from(!found.is_empty());
            free += usize::from(found.is_empty());
        }
        assert!(hits > 10 && free > 10, "{hits} {free}");
        for bad in [Pose::along(DVec3::NAN, DVec3::Z), Pose::along(DVec3::ZERO, DVec3::ZERO)] {
            assert!(matches!(checker.collisions(&bad), Err(CheckError::Pose)));
        }
    }
}
