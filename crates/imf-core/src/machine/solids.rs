//! What else a machine can be hit at: spindle head, table and what lies between, as simple solids or meshes.

use glam::{DQuat, DVec2, DVec3};

use super::Side;
use crate::control::{Cancelled, Control};
use crate::grid::Grid;
use crate::mesh::Mesh;
use crate::occupancy::Occupancy;
use crate::parts::shell::{Axis, Shell, circle};
use crate::pose::Pose;
use crate::voxelize::{VoxelizeResult, voxelize_with, winding_number};

/// A rigid body of the machine.
#[derive(Clone, Debug, PartialEq)]
pub struct MachineSolid {
    /// Name for people.
    pub name: String,
    /// Table or head.
    pub side: Side,
    /// Rotary axes of that side that carry it, from the machine's frame outwards.
    pub level: usize,
    /// Where it is with all axes at 0, in machine coordinates.
    pub shape: SolidShape,
}

/// The shape of a body.
#[derive(Clone, Debug, PartialEq)]
pub enum SolidShape {
    /// A round bar between the middles of its ends.
    Cylinder {
        /// One end.
        base: DVec3,
        /// The other.
        top: DVec3,
        /// Diameter.
        diameter: f64,
    },
    /// A box along the machine's axes.
    Box {
        /// Smallest corner.
        lower: DVec3,
        /// Largest corner.
        upper: DVec3,
    },
    /// A closed mesh.
    Mesh(Mesh),
}

/// Sides of a bar's surface.
const SIDES: usize = 48;
/// Voxels of one body; a larger one has coarser voxels.
const MAX_VOXELS: f64 = 8e6;

impl MachineSolid {
    pub(super) fn scaled(&self, factor: f64) -> Self {
        let shape = match &self.shape {
            SolidShape::Cylinder { base, top, diameter } => {
                SolidShape::Cylinder { base: *base * factor, top: *top * factor, diameter: diameter * factor }
            }
            SolidShape::Box { lower, upper } => {
                SolidShape::Box { lower: *lower * factor, upper: *upper * factor }
            }
            SolidShape::Mesh(mesh) => {
                SolidShape::Mesh(mesh.transformed(&glam::DMat4::from_scale(DVec3::splat(factor))))
            }
        };
        Self { shape, ..self.clone() }
    }

    /// Lower and upper corner of the box around it.
    #[must_use]
    pub fn bounds(&self) -> (DVec3, DVec3) {
        match &self.shape {
            SolidShape::Cylinder { base, top, diameter } => {
                let axis = (*top - *base).normalize_or_zero();
                let spread = (1.0 - axis * axis).max(DVec3::ZERO).map(f64::sqrt) * (0.5 * diameter);
                (base.min(*top) - spread, base.max(*top) + spread)
            }
            SolidShape::Box { lower, upper } => (*lower, *upper),
            SolidShape::Mesh(mesh) => mesh.bounds().unwrap_or_default(),
        }
    }

    /// Its voxels where it is with all axes at 0, of a pitch or, where these would be more than 8 million, a larger one: those whose
    /// centres lie in it.
    ///
    /// # Errors
    /// The caller's [`Control`] asked to stop.
    pub fn voxels(&self, pitch: f64, control: Control<'_>) -> Result<VoxelizeResult, Cancelled> {
        let (lower, upper) = self.bounds();
        let cells = ((upper - lower) / pitch + 2.0).to_array().into_iter().product::<f64>();
        let pitch = pitch * (cells / MAX_VOXELS).cbrt().max(1.0);
        let dims = ((upper - lower) / pitch).map(f64::ceil).to_array().map(|n| (n as usize).max(1));
        let span = DVec3::from_array(dims.map(|n| n as f64)) * pitch;
        let grid = Grid { origin: 0.5 * (lower + upper) - 0.5 * span, pitch, dims };
        if let SolidShape::Mesh(mesh) = &self.shape {
            return voxelize_with(mesh, &grid, false, control);
        }
        let solid = Occupancy::of(grid, |voxel| self.contains(grid.centre(voxel)));
        Ok(VoxelizeResult { solid, undecided: 0.0 })
    }

    /// True of a point that is in it where it is with all axes at 0.
    #[must_use]
    pub fn contains(&self, point: DVec3) -> bool {
        match &self.shape {
            SolidShape::Cylinder { base, top, diameter } => {
                let (length, axis) = (base.distance(*top), (*top - *base).normalize_or_zero());
                let height = axis.dot(point - *base);
                let radius = (point - *base - axis * height).length();
                (0.0..=length).contains(&height) && radius <= 0.5 * diameter
            }
            SolidShape::Box { lower, upper } => point.cmpge(*lower).all() && point.cmple(*upper).all(),
            SolidShape::Mesh(mesh) => winding_number(mesh, point).abs() > 0.5,
        }
    }

    /// Its surface where it is with all axes at 0; a bar by 48 sides.
    #[must_use]
    pub fn surface(&self) -> Mesh {
        match &self.shape {
            SolidShape::Cylinder { base, top, diameter } => {
                let (length, axis) = (base.distance(*top), (*top - *base).normalize_or(DVec3::Z));
                let place = Pose::new(*base, DQuat::from_rotation_arc(DVec3::Z, axis));
                let rim = circle(DVec2::ZERO, 0.5 * diameter, SIDES);
                let mut shell = Shell::default();
                shell.prism(Axis::Z, &rim, [0.0, length]);
                let mut mesh = shell.into_mesh();
                mesh.vertices.iter_mut().for_each(|vertex| *vertex = place.of_point(*vertex));
                mesh
            }
            SolidShape::Box { lower, upper } => Mesh::cuboid(*lower, *upper),
            SolidShape::Mesh(mesh) => mesh.clone(),
        }
    }
}
