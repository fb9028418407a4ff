//! The obstacle's symmetry as a prior of a network: mirror planes, and a line that the part is turned about.
//!
//! ```text
//! CMF(x, d) = F(u(x), T(x) d)
//! ```
//! T(x) takes the world's directions into the frame of the place x, and u are the network's inputs there. Across a *mirror
//! plane* the field is its own image: x is folded to one side, and T mirrors directions with it, so that the network learns
//! half the space (Weyl folding). About an *axis* the frame turns with the point: of a body of revolution the
//! field in that frame does not depend on the angle at all, and of a gear it repeats from tooth to tooth; the network is
//! given the angle's cosine and sine beside the position. Both cost no weights.
//!
//! Mirrors are a prior only where obstacle and field are found to be their own images ([`Symmetry::of`]). An axis is never wrong, since
//! any field can be written in turned frames; it helps where the part is nearly one of revolution.
//!
//! The field is as smooth as its network but for two places. Across a mirror plane values and slopes may jump, by about the field's
//! error. On the axis the frame has no direction, and slopes near it would grow without end: within half a voxel they are held. No
//! voxel is near enough to it to teach every angle, so that values err more there, and nothing is decided by them
//! ([`AROUND_AXIS`]).

mod found;
mod local;

use std::ops::Deref;

use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

pub use local::LocalHarmonics;

use imf_core::grid::Grid;

/// The obstacle's symmetry as a prior of a network; none by default.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Symmetry {
    /// Where mirror planes across x, y and z stand, in the scene's unit.
    pub mirrors: [Option<f64>; 3],
    /// What frames turn about.
    pub axis: Option<Axis>,
}

/// A line along an axis of the world.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Axis {
    /// 0, 1 or 2: along x, y or z.
    pub along: usize,
    /// A point of it, in the scene's unit.
    pub through: DVec3,
}

/// Voxels from an axis within which values decide nothing: they err by up to four times as much as elsewhere (measured in
/// docs/lab/factored-fields.md).
pub const AROUND_AXIS: f64 = 2.0;
/// What the angle is given to the network by: its cosine and sine times this, so that it moves the first sines about as much
/// as a position does.
pub const ANGLE: f64 = 0.5;
/// Inputs with an axis; 3 without.
pub(super) const MOST_INPUTS: usize = 5;

/// What a network sees of a position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Inputs {
    values: [f32; MOST_INPUTS],
    count: usize,
}

impl Deref for Inputs {
    type Target = [f32];
    fn deref(&self) -> &[f32] {
        &self.values[..self.count]
    }
}

/// How the frame of a place lies in the world's: what takes the coefficients of harmonics from it to the axes in the order that
/// ends with the one of revolution ([`super::FactoredField::by_function`]).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame {
    /// Cosine and sine of the angle: functions ±m turn by m times this, first.
    pub turn: [f32; 2],
    /// Across which of the axes in that order it is mirrored, after the turn.
    pub mirrored: [bool; 3],
}

/// A position as a network with symmetry sees it.
#[derive(Clone, Copy, Debug)]
pub struct Place {
    /// On the far side of every mirror: where coordinates are larger.
    pub position: DVec3,
    /// −1 along what was mirrored, 1 elsewhere.
    pub signs: DVec3,
    /// The angle about the axis, where there is one.
    pub angle: Option<Angle>,
}

/// The angle about an axis.
#[derive(Clone, Copy, Debug)]
pub struct Angle {
    /// 0, 1 or 2.
    along: usize,
    /// Its cosine.
    pub cosine: f64,
    /// Its sine.
    pub sine: f64,
    /// From the axis; on it the angle is 0.
    pub distance: f64,
}

impl Symmetry {
    /// The same seen from another origin.
    #[cfg(feature = "export")]
    #[must_use]
    pub(crate) fn less(&self, origin: DVec3) -> Self {
        let mirrors = [0, 1, 2].map(|axis| self.mirrors[axis].map(|plane| plane - origin[axis]));
        Self { mirrors, axis: self.axis.map(|axis| Axis { through: axis.through - origin, ..axis }) }
    }

    /// True where there is none.
    pub fn is_none(&self) -> bool {
        *self == Self::default()
    }

    /// Inputs of the network.
    pub fn inputs(&self) -> usize {
        if self.axis.is_some() { MOST_INPUTS } else { super::INPUTS }
    }

    /// Coefficients per point of a field with `components` components and `functions` basis functions: the components, or
    /// every function by itself where there is symmetry.
    pub(super) fn coefficients(&self, components: usize, functions: usize) -> usize {
        if self.is_none() { components } else { functions }
    }

    /// What is wrong with it, if anything.
    pub fn fault(&self) -> Option<String> {
        if self.mirrors.iter().flatten().any(|plane| !plane.is_finite()) {
            return Some("a mirror plane stands nowhere".to_owned());
        }
        self.axis.and_then(|Axis { along, through }| {
            (along > 2 || !through.is_finite())
                .then(|| format!("its axis is along {along} through {through}, which is not an axis"))
        })
    }

    /// True where planes and axis cross a grid or pass by it closely.
    pub(super) fn is_within(&self, grid: &Grid) -> bool {
        let (low, high) = (grid.origin - grid.size(), grid.origin + 2.0 * grid.size());
        let is_near = |axis: usize, value: f64| (low[axis]..high[axis]).contains(&value);
        let mirrors = self.mirrors.iter().enumerate();
        mirrors.into_iter().all(|(axis, plane)| plane.is_none_or(|plane| is_near(axis, plane)))
            && self.axis.is_none_or(|line| (0..3).all(|axis| is_near(axis, line.through[axis])))
    }

    /// A position in the frame of its place.
    pub fn place(&self, position: DVec3) -> Place {
        let (mut folded, mut signs) = (position, DVec3::ONE);
        for (axis, plane) in self.mirrors.iter().enumerate() {
            if let Some(plane) = plane.filter(|&plane| position[axis] < plane) {
                folded[axis] = 2.0 * plane - position[axis];
                signs[axis] = -1.0;
            }
        }
        let angle = self.axis.map(|Axis { along, through }| {
            let [x, y, _] = Axis::order(along).map(|axis| folded[axis] - through[axis]);
            let distance = x.hypot(y);
            let (cosine, sine) = if distance > 0.0 { (x / distance, y / distance) } else { (1.0, 0.0) };
            Angle { along, cosine, sine, distance }
        });
        Place { position: folded, signs, angle }
    }

    /// The frame of a place.
    pub fn frame_of(&self, place: &Place) -> Frame {
        let order = Axis::order(self.axis.map_or(2, |axis| axis.along));
        Frame {
            turn: place.angle.map_or([1.0, 0.0], |angle| [angle.cosine as f32, angle.sine as f32]),
            mirrored: order.map(|axis| place.signs[axis] < 0.0),
        }
    }

    /// What the network over a grid sees of a place: the grid's middle is 0, its longest edge is [−1, 1]; then the angle.
    pub fn inputs_at(&self, grid: &Grid, place: &Place) -> Inputs {
        let size = grid.size();
        let position = (place.position - grid.origin - 0.5 * size) * (2.0 / size.max_element());
        let [x, y, z] = position.as_vec3().to_array();
        let [cosine, sine] = place.angle.map_or([0.0; 2], |a| [ANGLE * a.cosine, ANGLE * a.sine]);
        Inputs { values: [x, y, z, cosine as f32, sine as f32], count: self.inputs() }
    }
}

impl std::fmt::Display for Symmetry {
    /// Such as `mirrored across x and y, turned about z`.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        const NAMES: [&str; 3] = ["x", "y", "z"];
        let across: Vec<&str> =
            NAMES.iter().zip(self.mirrors).filter_map(|(name, plane)| plane.map(|_| *name)).collect();
        match (across.is_empty(), self.axis) {
            (true, None) => write!(f, "no symmetry"),
            (false, None) => write!(f, "mirrored across {}", across.join(" and ")),
            (true, Some(axis)) => write!(f, "turned about {}", NAMES[axis.along]),
            (false, Some(axis)) => {
                write!(f, "mirrored across {}, turned about {}", across.join(" and "), NAMES[axis.along])
            }
        }
    }
}

impl Axis {
    /// How far a position is from the line.
    pub fn distance(&self, position: DVec3) -> f64 {
        let [x, y, _] = Self::order(self.along).map(|axis| position[axis] - self.through[axis]);
        x.hypot(y)
    }

    /// The world's axes in an order that ends with this one, right-handed.
    pub(crate) const fn order(along: usize) -> [usize; 3] {
        [(along + 1) % 3, (along + 2) % 3, along]
    }

    /// What takes the world's directions to those in that order.
    pub(super) fn permutation(along: usize) -> DMat3 {
        DMat3::from_cols_array_2d(&Self::order(along).map(|axis| DVec3::AXES[axis].to_array())).transpose()
    }
}

impl Place {
    /// T d: a direction of the world in the place's frame.
    pub fn to_local(self, direction: DVec3) -> DVec3 {
        let mirrored = direction * self.signs;
        let Some(Angle { along, cosine, sine, .. }) = self.angle else { return mirrored };
        let [x, y, z] = Axis::order(along).map(|axis| mirrored[axis]);
        DVec3::new(cosine * x + sine * y, cosine * y - sine * x, z)
    }

    /// Tᵀ v: back into the world.
    pub fn to_world(self, local: DVec3) -> DVec3 {
        let Some(Angle { along, cosine, sine, .. }) = self.angle else { return local * self.signs };
        let turned = [cosine * local.x - sine * local.y, sine * local.x + cosine * local.y, local.z];
        let mut world = DVec3::ZERO;
        for (axis, value) in Axis::order(along).into_iter().zip(turned) {
            world[axis] = value;
        }
        world * self.signs
    }

    /// What the network's inputs behind the position change by a step along each axis at the folded position: `[axis][cosine,
    /// sine]`, for a unit of length; nearer to the axis than `blunt` less.
    pub(crate) fn angle_slopes(self, blunt: f64) -> [[f64; 2]; 3] {
        let by_angle = self.angle_gradient(blunt);
        let Some(Angle { cosine, sine, .. }) = self.angle else { return [[0.0; 2]; 3] };
        by_angle.to_array().map(|slope| [-ANGLE * sine * slope, ANGLE * cosine * slope])
    }

    /// The angle's derivative by the folded position, 0 without an axis. It grows towards the axis, and an error of the network with
    /// it: nearer than `blunt` it is made to fall to 0 again.
    fn angle_gradient(self, blunt: f64) -> DVec3 {
        let mut gradient = DVec3::ZERO;
        if let Some(Angle { along, cosine, sine, distance }) = self.angle {
            let [x, y, _] = Axis::order(along);
            let per_length = if distance < blunt { distance / (blunt * blunt) } else { 1.0 / distance };
            gradient[x] = -sine * per_length;
            gradient[y] = cosine * per_length;
        }
        gradient
    }

    /// A value's slopes in the world, from those by the folded position in a frame that is held, and by the local direction
    /// at `local`: as the frame turns by an angle, a direction of the world turns back by it.
    pub(crate) fn slopes_in_world(
        self,
        local: DVec3,
        position: DVec3,
        direction: DVec3,
        blunt: f64,
    ) -> [DVec3; 2] {
        let by_angle = -DVec3::Z.cross(local).dot(direction);
        let position = position + by_angle * self.angle_gradient(blunt);
        [position * self.signs, self.to_world(direction)]
    }
}
