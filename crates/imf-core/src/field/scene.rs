//! The exact field of a scene as its sections have it: the whole tool against what is forbidden, and where the cutter may
//! touch, shank and holder against the layer that it may enter.

use super::exact::answer;
use super::{ExactField, Field, Pose, QueryError};
use crate::orientation::Orientation;
use crate::section::{Obstacles, Skin};
use crate::tool::{Tool, ToolError};

/// Single poses of a scene, equal to its sections at voxel centres, with contact or without.
pub struct SceneField<'a> {
    forbidden: ExactField<'a>,
    layer: Option<ExactField<'a>>,
}

impl<'a> SceneField<'a> {
    /// Of a tool among obstacles ([`Contact::obstacles`](crate::section::Contact::obstacles) of a scene with contact).
    #[must_use]
    pub fn new(obstacles: impl Into<Obstacles<'a>>, tool: &'a Tool) -> Self {
        let Obstacles { solid, skin } = obstacles.into();
        Self {
            forbidden: ExactField::of_tool(solid, tool),
            layer: skin.map(|Skin { voxels, rest }| ExactField::of_tool(voxels, rest)),
        }
    }

    /// Voxels that count: forbidden ones in the tool, and those of the layer in shank and holder.
    #[must_use]
    pub fn count(&self, pose: &Pose) -> u32 {
        self.bodies().map(|body| body.count(pose)).sum()
    }

    /// The whole tool's own count in an orientation.
    pub(super) fn normaliser(&self, orientation: &Orientation) -> Result<u32, ToolError> {
        self.forbidden.normaliser(orientation)
    }

    fn bodies(&self) -> impl Iterator<Item = &ExactField<'a>> {
        [Some(&self.forbidden), self.layer.as_ref()].into_iter().flatten()
    }
}

impl Field for SceneField<'_> {
    fn query(&mut self, poses: &[Pose], answers: &mut [f32]) -> Result<(), QueryError> {
        let field = &*self;
        answer(poses, answers, |orientation| field.normaliser(orientation), |pose| field.count(pose))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Control;
    use crate::orientation::OrientationSet;
    use crate::parts::ReferencePart;
    use crate::scene::SceneSpec;
    use crate::section::{Contact, SectionPlan, sections};
    use crate::tool::Clearance;

    #[test]
    fn poses_at_voxel_centres_are_the_sections_with_contact() {
        let mesh = ReferencePart::Bracket.mesh();
        let tool = Tool::paper();
        let spec = SceneSpec {
            margin: 1,
            ..SceneSpec::of_reference(ReferencePart::Bracket, &mesh, [9, 27, 16], &tool)
        };
        let clearance = Clearance { holder: 2.0, shank: 1.0, cutter: 0.0 };
        let scene = spec.scene().unwrap().with_clearance(&clearance).unwrap();
        let bodies = spec.bodies(&scene.record.grid).unwrap();
        let touching = scene.clone().with_contact(&bodies, 2.0 * scene.record.grid.pitch);
        let set = OrientationSet::parse("fibonacci:5").unwrap().orientations;
        let plan = SectionPlan::of_scene(&touching).unwrap();
        let found = sections(&plan, &set, Control::quiet()).unwrap();
        let (contact, rest) =
            (Contact::of_scene(&touching).unwrap(), touching.record.tool_without_cutter().unwrap());
        let mut field = SceneField::new(contact.obstacles(rest.as_ref()), &touching.record.tool);
        let grid = scene.record.grid;
        for (orientation, section) in set.iter().zip(&found) {
            let pose = |i: usize| Pose { position: grid.centre(grid.voxel(i)), orientation: *orientation };
            let poses: Vec<Pose> = (0..grid.len()).map(pose).collect();
            let mut answers = vec![f32::NAN; poses.len()];
            field.query(&poses, &mut answers).unwrap();
            assert_eq!(&answers, section);
        }
        // Contact takes something away, and not everything.
        let without = sections(&SectionPlan::of_scene(&scene).unwrap(), &set, Control::quiet()).unwrap();
        let sum = |all: &[Vec<f32>]| all.iter().flatten().sum::<f32>();
        assert!(sum(&found) < sum(&without) && sum(&found) > 0.0);
    }
}
