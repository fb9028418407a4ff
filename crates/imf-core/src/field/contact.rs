//! The exact field where the cutter may touch: the whole tool against what stays forbidden, shank and holder against the
//! layer that the cutter may enter.

use super::exact::answer;
use super::{ExactField, Field, Pose, QueryError};
use crate::section::Contact;
use crate::tool::Tool;

/// Single poses of a scene with contact, equal to its sections at voxel centres.
pub struct ContactField<'a> {
    forbidden: ExactField<'a>,
    layer: Option<ExactField<'a>>,
}

impl<'a> ContactField<'a> {
    /// Of a tool, and of what of it must stay out of the layer too
    /// ([`SceneRecord::tool_without_cutter`](crate::scene::SceneRecord::tool_without_cutter)).
    #[must_use]
    pub fn new(contact: &'a Contact, tool: &'a Tool, rest: Option<&'a Tool>) -> Self {
        Self {
            forbidden: ExactField::of_tool(&contact.solid, tool),
            layer: rest.map(|rest| ExactField::of_tool(&contact.skin, rest)),
        }
    }

    /// Voxels that count: forbidden ones in the tool, and those of the layer in shank and holder.
    #[must_use]
    pub fn count(&self, pose: &Pose) -> u32 {
        self.forbidden.count(pose) + self.layer.as_ref().map_or(0, |layer| layer.count(pose))
    }
}

impl Field for ContactField<'_> {
    fn query(&mut self, poses: &[Pose], answers: &mut [f32]) -> Result<(), QueryError> {
        let field = &*self;
        answer(
            poses,
            answers,
            |orientation| field.forbidden.normaliser(orientation),
            |pose| field.count(pose),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::control::Control;
    use crate::orientation::OrientationSet;
    use crate::parts::ReferencePart;
    use crate::scene::SceneSpec;
    use crate::section::{SectionPlan, sections};
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
        let mut field = ContactField::new(&contact, &touching.record.tool, rest.as_ref());
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
