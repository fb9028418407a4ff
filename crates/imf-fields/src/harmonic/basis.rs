//! The functions of an orientation that a harmonic field is a sum of, scaled to mean square 1 over all orientations.
//!
//! Spherical harmonics of the tool's direction for tools of revolution, and the rotation matrices of the harmonics for
//! all others. The mean square of a field's error over every orientation is the sum of its coefficients' squared errors.

use std::f64::consts::PI;

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

use super::rotations::{self, RotationBasis};
use super::sphere::{self, SphereBasis};
use crate::parallel::*;
use imf_core::orientation::{Orientation, OrientationSet, OrientationSetError};
use imf_core::tool::Tool;

/// Images of a direction under half turns about x, y and z, itself included: directions are fitted in fours.
pub(super) const IMAGES: usize = 4;

/// Which functions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Domain {
    /// Of the tool's direction, on S²: √4π Y_lm.
    Directions,
    /// Of the tool's rotation, on SO(3): √(2l+1) M^l_mn.
    Rotations,
}

impl Domain {
    /// What a field of the tool's tip depends on beside the point; `bare` is the tool without clearance.
    #[must_use]
    pub fn of_tool(bare: &Tool) -> Self {
        if bare.with_tip_only().is_axisymmetric() { Self::Directions } else { Self::Rotations }
    }
}

/// How a tool stands, as functions read it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Facing {
    /// The direction from tip to holder, of any length but 0: all that matters of a tool of revolution.
    Direction(DVec3),
    /// The rotation from the tool's frame to the world, of length 1.
    Rotation(DQuat),
}

impl From<DVec3> for Facing {
    fn from(direction: DVec3) -> Self {
        Self::Direction(direction)
    }
}

impl From<DQuat> for Facing {
    fn from(rotation: DQuat) -> Self {
        Self::Rotation(rotation)
    }
}

/// Functions up to a degree.
#[derive(Clone, Debug, PartialEq)]
pub enum Basis {
    /// Of [`Domain::Directions`].
    Directions(SphereBasis),
    /// Of [`Domain::Rotations`].
    Rotations(RotationBasis),
}

impl Basis {
    /// Functions of degrees 0 to `degree`.
    #[must_use]
    pub fn new(domain: Domain, degree: usize) -> Self {
        match domain {
            Domain::Directions => Self::Directions(SphereBasis::new(degree)),
            Domain::Rotations => Self::Rotations(RotationBasis::new(degree)),
        }
    }

    /// Number of functions of a domain up to a degree.
    pub const fn count(domain: Domain, degree: usize) -> usize {
        match domain {
            Domain::Directions => sphere::function_count(degree),
            Domain::Rotations => rotations::function_count(degree),
        }
    }

    /// Number of functions of one degree.
    pub(super) const fn count_of_degree(domain: Domain, degree: usize) -> usize {
        match domain {
            Domain::Directions => 2 * degree + 1,
            Domain::Rotations => (2 * degree + 1) * (2 * degree + 1),
        }
    }

    /// Where the functions live.
    pub fn domain(&self) -> Domain {
        match self {
            Self::Directions(_) => Domain::Directions,
            Self::Rotations(_) => Domain::Rotations,
        }
    }

    /// Highest degree.
    pub fn degree(&self) -> usize {
        match self {
            Self::Directions(sphere) => sphere.degree(),
            Self::Rotations(rotations) => rotations.degree(),
        }
    }

    /// Number of functions.
    pub fn len(&self) -> usize {
        Self::count(self.domain(), self.degree())
    }

    /// Never: degree 0 already is one function.
    pub fn is_empty(&self) -> bool {
        false
    }

    /// All functions at an orientation.
    ///
    /// # Panics
    /// If `values` has not the length [`Basis::len`].
    pub fn values(&self, orientation: &Orientation, values: &mut [f64]) {
        match self {
            Self::Directions(_) => self.values_of_direction(orientation.direction(), values),
            Self::Rotations(rotations) => rotations.values(orientation.quaternion(), values),
        }
    }

    /// B: all functions at some orientations, `[orientation][function]`.
    #[must_use]
    pub fn values_at(&self, orientations: &[Orientation]) -> Vec<f32> {
        let mut all = vec![0.0f32; orientations.len() * self.len()];
        all.par_chunks_mut(self.len()).zip(orientations).for_each_init(
            || vec![0.0; self.len()],
            |row, (out, orientation)| {
                self.values(orientation, row);
                out.iter_mut().zip(row).for_each(|(out, &mut v)| *out = v as f32);
            },
        );
        all
    }

    /// All functions of a direction; of [`Domain::Directions`] alone.
    ///
    /// # Panics
    /// If `values` has not the length [`Basis::len`], or the functions are of rotations.
    pub fn values_of_direction(&self, direction: DVec3, values: &mut [f64]) {
        self.sphere().values(direction, values);
        let scale = (4.0 * PI).sqrt();
        values.iter_mut().for_each(|v| *v *= scale);
    }

    /// [`Basis::values_of_direction`] of any number of directions, `[direction][function]`; `scratch` is working memory.
    pub(crate) fn values_of_directions(
        &self,
        directions: &[DVec3],
        values: &mut [f32],
        scratch: &mut Vec<f32>,
    ) {
        self.sphere().values_of_all(directions, (4.0 * PI).sqrt(), values, scratch);
    }

    /// The sum of all functions of a direction, each by the weight that `weight` says of its place, with its gradient along
    /// the sphere.
    ///
    /// # Panics
    /// If the functions are of rotations.
    #[inline]
    pub fn sum_with_gradient(&self, direction: DVec3, weight: impl Fn(usize) -> f64) -> (f64, DVec3) {
        let [(sum, gradient)] = self.sphere().sums_with_gradients(&[direction], |place| [weight(place)]);
        let scale = (4.0 * PI).sqrt();
        (sum * scale, gradient * scale)
    }

    /// The same of any number of directions, by `weights [direction][function]`; `scratch` is working memory.
    pub(crate) fn sums_with_gradients(
        &self,
        directions: &[DVec3],
        weights: &[f32],
        scratch: &mut Vec<f32>,
        mut take: impl FnMut(usize, (f64, DVec3)),
    ) {
        let scale = (4.0 * PI).sqrt();
        let scaled = |index, (sum, gradient): (f64, DVec3)| take(index, (sum * scale, gradient * scale));
        self.sphere().sums_of_all(directions, weights, scratch, scaled);
    }

    /// All functions at what [`Basis::facing`] gave.
    pub(crate) fn values_facing(&self, facing: Facing, values: &mut [f64]) {
        match (self, facing) {
            (Self::Directions(_), Facing::Direction(direction)) => {
                self.values_of_direction(direction, values);
            }
            (Self::Rotations(rotations), Facing::Rotation(rotation)) => rotations.values(rotation, values),
            _ => panic!("functions of directions and of rotations are told apart by Basis::facing"),
        }
    }

    /// What these functions read of how a tool stands: its direction, or its rotation. `None` for a direction alone where functions
    /// are of rotations, and for what has no length.
    pub fn facing(&self, facing: impl Into<Facing>) -> Option<Facing> {
        let facing = match (self, facing.into()) {
            (Self::Directions(_), Facing::Direction(direction)) => {
                Facing::Direction(direction.try_normalize()?)
            }
            (Self::Directions(_), Facing::Rotation(rotation)) => {
                Facing::Direction((rotation * DVec3::Z).try_normalize()?)
            }
            (Self::Rotations(_), Facing::Rotation(rotation)) => {
                let length = rotation.length();
                (length > 0.0 && length.is_finite()).then(|| Facing::Rotation(rotation / length))?
            }
            (Self::Rotations(_), Facing::Direction(_)) => return None,
        };
        Some(facing)
    }

    fn sphere(&self) -> &SphereBasis {
        let Self::Directions(sphere) = self else { panic!("a direction alone is not a rotation") };
        sphere
    }

    /// `count` orientations spread evenly over the domain.
    ///
    /// # Errors
    /// A count that no set can have.
    pub fn even_set(&self, count: usize) -> Result<OrientationSet, OrientationSetError> {
        OrientationSet::parse(&match self.domain() {
            Domain::Directions => format!("fibonacci:{count}"),
            Domain::Rotations => format!("so3:{count}"),
        })
    }

    /// The `count` orientations to which a field of `count` sections is fitted: directions come in fours.
    ///
    /// # Errors
    /// A count that no set can have.
    #[cfg(feature = "fit")]
    pub fn fitted_set(&self, count: usize) -> Result<Vec<Orientation>, OrientationSetError> {
        if self.domain() == Domain::Rotations || !count.is_multiple_of(IMAGES) {
            return Ok(self.even_set(count)?.orientations);
        }
        let directions = super::fit::quadrature::directions_in_fours(count / IMAGES).into_iter();
        Ok(directions.filter_map(Orientation::from_direction).collect())
    }

    /// Nearly `count` sections, as many as a set of this domain can have; no fewer than `least`.
    pub(super) fn fitted_count(domain: Domain, count: usize, least: usize) -> usize {
        match domain {
            Domain::Rotations => count.max(least),
            Domain::Directions => {
                let below = count / IMAGES * IMAGES;
                if below < least { least.next_multiple_of(IMAGES) } else { below }
            }
        }
    }

    /// `count` orientations at random, of a seed, for a judgement that owes nothing to the even set.
    ///
    /// # Errors
    /// A count that no set can have.
    pub fn random_set(&self, count: usize, seed: u64) -> Result<OrientationSet, OrientationSetError> {
        let mut set = OrientationSet::parse(&format!("random:{count}:{seed}"))?;
        if self.domain() == Domain::Rotations {
            // θ of another random set is uniform: the roll.
            let rolls = OrientationSet::parse(&format!("random:{count}:{}", seed ^ 0x5EED_0F20_1105))?;
            for (orientation, roll) in set.orientations.iter_mut().zip(rolls.orientations) {
                orientation.roll = roll.theta;
            }
            set.spec = format!("random rotations {count}:{seed}");
        }
        Ok(set)
    }
}
