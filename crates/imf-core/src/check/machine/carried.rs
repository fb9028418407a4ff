//! What a machine's head carries, as it is tested against everything else.

use std::sync::Arc;

use glam::DQuat;

use super::Pair;
use crate::check::CheckError;
use crate::check::elements::{Body, DepthElement, Group, Shape};
use crate::field::solid::{SolidField, SolidVoxels};
use crate::machine::{Ball, Machine, MachineSolid, SolidShape};
use crate::mesh::Mesh;
use crate::pose::Pose;
use crate::tool::{Element, ElementKind, Segment, SharpPoints, Tool, ToolShape};

/// Something that the head carries, as it is tested.
pub(in crate::check) struct HeadBody {
    pub(in crate::check) name: String,
    pub(in crate::check) ball: Ball,
    /// From its own frame, in which it is a tool, to the machine's with all axes at 0.
    pub(in crate::check) frame: Pose,
    pub(in crate::check) shape: HeadShape,
    pub(in crate::check) clearance: f64,
}

pub(in crate::check) enum HeadShape {
    /// By its elements.
    Round(Vec<Element>),
    Mesh(Tool),
}

impl HeadBody {
    pub(in crate::check) fn of_solid(solid: &MachineSolid, clearance: f64) -> Result<Self, CheckError> {
        let (lower, upper) = solid.bounds();
        let ball = Ball {
            centre: 0.5 * (lower + upper),
            radius: 0.5 * (upper - lower).length() + clearance * 3f64.sqrt(),
            level: solid.level,
        };
        let (frame, shape) = match &solid.shape {
            SolidShape::Cylinder { base, top, diameter } => {
                let axis = (*top - *base).normalize_or_zero();
                let profile = vec![Segment::cylinder(0.0, base.distance(*top), 0.5 * diameter)];
                let element = Element { kind: ElementKind::Holder(0), profile }.offset(clearance);
                let rotation = Pose::along(*base, axis).rotation;
                (Pose::new(*base, rotation), HeadShape::Round(vec![element]))
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
        Ok(Self { name: solid.name.clone(), ball, frame, shape, clearance })
    }

    /// From the world to where the machine's coordinates are with the table's axes at 0; `world` is where the part's frame is in it.
    pub(in crate::check) fn to_machine(machine: &Machine, world: &Pose) -> Pose {
        let to_part = world.inverse();
        Pose { position: to_part.position + machine.part_zero(), ..to_part }
    }

    pub(super) fn against(&self, body: &Arc<Body>, voxels: &SolidVoxels) -> Result<Pair, CheckError> {
        let voxels = voxels.clone();
        let (field, shape, around) = match &self.shape {
            HeadShape::Round(elements) => {
                let field = SolidField::of_elements(voxels, elements);
                let field = field.ok_or_else(|| CheckError::Outline(self.name.clone()))?;
                (field, Shape::Revolved(elements.iter().map(|e| (e.clone(), true)).collect()), None)
            }
            HeadShape::Mesh(tool) => {
                let around = SolidField::of_elements(voxels.clone(), &[bar_around(tool)]);
                (SolidField::of_tool(voxels, tool), Shape::Mesh(tool.clone()), around)
            }
        };
        let elements = vec![DepthElement { name: self.name.clone(), clearance: self.clearance, shape }];
        let group = Group { field, elements, body: body.clone() };
        Ok(Pair { group, frame: self.frame, around })
    }
}

/// A mesh as a tool whose tip is in the middle of its box.
fn centred(name: &str, mesh: &Mesh) -> (Pose, HeadShape) {
    let (lower, upper) = mesh.bounds().unwrap_or_default();
    let middle = 0.5 * (lower + upper);
    let mesh = mesh.transformed(&glam::DMat4::from_translation(-middle));
    let unit = crate::unit::LengthUnit::default();
    let tool = Tool {
        name: name.to_owned(),
        unit,
        shape: ToolShape::Mesh(mesh),
        sharp_points: SharpPoints::Tip,
        overall_length: None,
        back_cutting: false,
    };
    (Pose::new(middle, DQuat::IDENTITY), HeadShape::Mesh(tool))
}

/// A round bar that holds a mesh tool, a little larger.
pub(in crate::check) fn bar_around(tool: &Tool) -> Element {
    let ToolShape::Mesh(mesh) = &tool.shape else {
        return Element { kind: ElementKind::Holder(0), profile: Vec::new() };
    };
    let (lower, upper) = mesh.bounds().unwrap_or_default();
    let room = 1e-6 * (upper - lower).length();
    let bar = Segment::cylinder(lower.z - room, upper.z + room, tool.rolling_radius() + room);
    Element { kind: ElementKind::Holder(0), profile: vec![bar] }
}
