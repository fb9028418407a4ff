//! Exact yes and no for a scene: the tool against what it must not touch, contact allowed for.

use super::Pose;
use super::exact::{count, normaliser, touches};
use crate::field::ExactField;
use crate::scene::Scene;
use crate::section::Contact;
use crate::tool::{Clearance, ClearanceError, ElementKind, Tool, ToolError};

/// The scene's tool, without or with a clearance, against the scene's voxels.
pub struct Guard {
    /// The whole tool against what is forbidden; where there is contact, shank and holder against the layer that the
    /// cutter may enter.
    pub bodies: Vec<ExactField<'static>>,
}

impl Guard {
    /// The true tool grown by `clearance`, against a scene's voxels.
    pub fn new(scene: &Scene, clearance: &Clearance) -> Result<Self, ClearanceError> {
        let bare = scene.record.bare_tool();
        let tool = bare.inflated(clearance)?;
        let Some(contact) = Contact::of_scene(scene) else {
            return Ok(Self { bodies: vec![ExactField::owned(scene.obstacle.clone(), tool)] });
        };
        let rest = bare.without_cutter().map(|rest: Tool| rest.inflated(clearance)).transpose()?;
        let mut bodies = vec![ExactField::owned(contact.solid, tool)];
        bodies.extend(rest.map(|rest| ExactField::owned(contact.skin, rest)));
        Ok(Self { bodies })
    }

    /// The elements of the tool; none of a mesh.
    pub fn elements(&self) -> impl Iterator<Item = ElementKind> {
        self.bodies.iter().take(1).flat_map(ExactField::elements)
    }

    /// Largest distance of any of the tool's points from its tip, in world units.
    pub(super) fn reach(&self) -> f64 {
        self.bodies.iter().map(ExactField::reach).fold(0.0, f64::max)
    }

    /// The overlap of the tool, in [0, 1]; 1 of what is no pose.
    pub fn overlap(&self, pose: &Pose) -> Result<f64, ToolError> {
        let mut inside = 0;
        for body in &self.bodies {
            let Some(count) = count(body, pose) else { return Ok(1.0) };
            inside += count;
        }
        if inside == 0 {
            return Ok(0.0);
        }
        Ok((f64::from(inside) / f64::from(normaliser(&self.bodies[0], pose)?)).min(1.0))
    }

    /// True where the tool collides, and of what is no pose.
    #[inline]
    pub fn touches(&self, pose: &Pose) -> bool {
        self.bodies.iter().any(|body| touches(body, pose))
    }
}
