//! The exact field at single poses: the twin that every other family is held against.

use rayon::prelude::*;

use super::{Field, Pose, QueryError, check_lengths};
use crate::scene::Scene;
use crate::tool::RotatedTool;

/// Counts the obstacle's voxel centres in the analytic tool at any pose, divided by the tool's own count in that
/// orientation with its tip on a voxel centre. Equal to the section at voxel centres.
pub struct ExactField<'a> {
    scene: &'a Scene,
}

impl<'a> ExactField<'a> {
    /// The exact field of a scene.
    #[must_use]
    pub fn new(scene: &'a Scene) -> Self {
        Self { scene }
    }
}

impl Field for ExactField<'_> {
    fn query(&mut self, poses: &[Pose], answers: &mut [f32]) -> Result<(), QueryError> {
        check_lengths(poses, answers)?;
        let (tool, obstacle) = (&self.scene.record.tool, &self.scene.obstacle);
        poses.par_iter().zip(answers).try_for_each(|(pose, answer)| {
            let whole = RotatedTool::new(tool, &pose.orientation, obstacle.grid.pitch)?.count;
            let inside = tool.count_inside(obstacle, pose.position, &pose.orientation);
            // Off the grid more centres may fall into the tool than on it.
            *answer = (f64::from(inside) / f64::from(whole)).min(1.0) as f32;
            Ok(())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Control;
    use crate::orientation::OrientationSet;
    use crate::parts::ReferencePart;
    use crate::scene::{Around, Resolution, SceneSpec};
    use crate::section::{SectionPlan, sections};
    use crate::tool::Tool;
    use crate::unit::LengthUnit;

    #[test]
    fn at_voxel_centres_it_is_the_section() {
        let mesh = ReferencePart::Bracket.mesh();
        let spec = SceneSpec {
            part: "bracket",
            mesh: &mesh,
            unit: LengthUnit::Mm,
            transform: glam::DMat4::IDENTITY,
            resolution: Resolution::Dims([10, 30, 18]),
            margin: 0,
            conservative: false,
            tool: &Tool::paper(),
            fixtures: &[],
            around: Around::Part,
        };
        let scene = spec.scene().unwrap();
        let plan = SectionPlan::new(&scene.obstacle, &scene.record.tool).unwrap();
        let orientations = OrientationSet::parse("0,0;90,90;0,180;37,61;200,100").unwrap().orientations;
        let exact = sections(&plan, &orientations, Control::quiet()).unwrap();
        let grid = scene.record.grid;
        for (orientation, section) in orientations.iter().zip(&exact) {
            let voxels: Vec<usize> = (0..grid.len()).step_by(17).collect();
            let poses: Vec<Pose> = voxels
                .iter()
                .map(|&v| Pose { position: grid.centre(grid.voxel(v)), orientation: *orientation })
                .collect();
            let mut answers = vec![f32::NAN; poses.len()];
            ExactField::new(&scene).query(&poses, &mut answers).unwrap();
            for (answer, &voxel) in answers.iter().zip(&voxels) {
                assert_eq!(*answer, section[voxel], "{orientation:?} {:?}", grid.voxel(voxel));
            }
        }
    }
}
