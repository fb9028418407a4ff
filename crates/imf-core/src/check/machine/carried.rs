//! What a machine's head carries, as it is tested against everything else.

use std::sync::Arc;

use glam::DQuat;

use super::Pair;
use crate::check::CheckError;
use crate::check::deepest::{DepthElement, Shape};
use crate::check::elements::{Body, Group};
use crate::field::solid::SolidField;
use crate::machine::{Ball, Machine, MachineSolid, SolidShape};
use crate::mesh::Mesh;
use crate::pose::Pose;
use crate::tool::{Element, ElementKind, Segment, Tool, ToolShape};

/// Something that the head carries, as it is tested.
pub(in crate::check) struct HeadBody {
    pub(in crate::check) measured: DepthElement,
    /// Its own outline; of a mesh that of a round bar which holds it, a little larger.
    pub(in crate::check) round: Element,
    pub(in crate::check) ball: Ball,
    /// From its own frame, in which it is a tool, to the machine's with all axes at 0.
    pub(in crate::check) frame: Pose,
}

impl HeadBody {
    pub(in crate::check) fn of_solid(solid: &MachineSolid, clearance: f64) -> Result<Self, CheckError> {
        let (lower, upper) = solid.bounds();
        let ball = Ball {
            centre: 0.5 * (lower + upper),
            radius: 0.5 * (upper - lower).length() + clearance * 3f64.sqrt(),
            level: solid.level,
        };
        let (frame, shape, round) = match &solid.shape {
            SolidShape::Cylinder { base, top, diameter } => {
                let axis = (*top - *base).normalize_or_zero();
                let profile = vec![Segment::cylinder(0.0, base.distance(*top), 0.5 * diameter)];
                let element = Element { kind: ElementKind::Holder(0), profile }.offset(clearance);
                let rotation = Pose::along(*base, axis).rotation;
                let shape = Shape::Revolved(vec![(element.clone(), true)]);
                (Pose::new(*base, rotation), shape, element)
            }
            SolidShape::Box { lower, upper } => {
                // A larger box holds the offset one.
                let mesh = Mesh::cuboid(*lower - clearance, *upper + clearance);
                centred(&solid.name, &mesh)
            }
            SolidShape::Mesh(mesh) if clearance == 0.0 => centred(&solid.name, mesh),
            SolidShape::Mesh(_) => {
                return Err(CheckError::HeadMesh { name: solid.name.clone() });
            }
        };
        let measured = DepthElement { name: solid.name.clone(), clearance, accepted: 0.0, shape };
        Ok(Self { measured, round, ball, frame })
    }

    /// From the world to where the machine's coordinates are with the table's axes at 0; `world` is where the part's frame is in it.
    pub(in crate::check) fn to_machine(machine: &Machine, world: &Pose) -> Pose {
        let to_part = world.inverse();
        Pose { position: to_part.position + machine.part_zero(), ..to_part }
    }

    pub(super) fn against(&self, body: &Arc<Body>) -> Result<Pair, CheckError> {
        let round = SolidField::of_elements(body.voxels.clone(), std::slice::from_ref(&self.round));
        let (field, around) = match &self.measured.shape {
            Shape::Revolved(_) => (round.ok_or_else(|| self.intricate())?, None),
            Shape::Mesh(tool) => (SolidField::of_tool(body.voxels.clone(), tool), round),
        };
        let group = Group { field, elements: vec![self.measured.clone()], body: body.clone() };
        Ok(Pair { group, frame: self.frame, around })
    }

    /// Its outline is too intricate.
    pub(in crate::check) fn intricate(&self) -> CheckError {
        CheckError::Outline(self.measured.name.clone())
    }
}

/// A round bar that holds a mesh tool, a little larger.
pub(super) fn bar_around(tool: &Tool) -> Element {
    let (lower, upper) = tool.mesh().and_then(Mesh::bounds).unwrap_or_default();
    let room = 1e-6 * (upper - lower).length();
    let bar = Segment::cylinder(lower.z - room, upper.z + room, tool.rolling_radius() + room);
    Element { kind: ElementKind::Holder(0), profile: vec![bar] }
}

/// A mesh as a tool whose tip is in the middle of its box.
fn centred(name: &str, mesh: &Mesh) -> (Pose, Shape, Element) {
    let (lower, upper) = mesh.bounds().unwrap_or_default();
    let middle = 0.5 * (lower + upper);
    let mesh = mesh.transformed(&glam::DMat4::from_translation(-middle));
    let tool = Tool { shape: ToolShape::Mesh(mesh), ..Tool::revolved(name, []) };
    let bar = bar_around(&tool);
    (Pose::new(middle, DQuat::IDENTITY), Shape::Mesh(tool), bar)
}
