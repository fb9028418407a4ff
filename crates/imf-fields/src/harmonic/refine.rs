//! The least value over all directions, or over all rotations: from the best of a set, down the field's own gradient.

use std::f64::consts::PI;

use crate::parallel::*;
use glam::{DMat3, DQuat, DVec3};
use pulp::Arch;

use super::HarmonicField;
use super::basis::{Basis, Facing};
use super::evaluate::VoxelCoefficients as _;
use super::rotations::sum_with_turns;
use crate::siren::matrix::{Matrix, multiply};
use imf_core::control::Control;
use imf_core::orientation::Orientation;
use imf_core::section::{Imf, SectionError};
use imf_core::vectorised::vectorised;

/// A minimum over all orientations.
#[derive(Clone, Debug, PartialEq)]
pub struct Refined {
    /// In [0, 1], nowhere above the minimum that it began with.
    pub value: Vec<f32>,
    /// The orientation that has it.
    pub orientation: Vec<Orientation>,
}

/// Steps downhill from the best of the set.
const STEPS: usize = 24;
/// Steps are halved until the value falls, at most so often.
const HALVINGS: usize = 12;
/// A slope below this, in shares of the tool's volume a radian, is level: the value cannot fall by more over the few
/// degrees to the nearest other direction of a set than the field's own error.
const LEVEL: f64 = 1e-6;
/// Share of the fall that the slope guarantees which a step must bring (Armijo).
const PROMISED: f64 = 1e-4;

impl HarmonicField {
    /// Lowers the minimum over `orientations`, as [`HarmonicField::minimum`] found it, along the sphere, or along the
    /// rotations, to the bottom of the valley that each voxel's best orientation lies in. Voxels whose value is 0 stay:
    /// nothing is lower. One unit of progress is one voxel. `None` for depths.
    ///
    /// # Errors
    /// Cancellation.
    ///
    /// # Panics
    /// If `least` is not of this field's voxels and of `orientations`.
    pub fn refined(
        &self,
        least: &Imf,
        orientations: &[Orientation],
        control: Control<'_>,
    ) -> Result<Option<Refined>, SectionError> {
        if !self.quantity.is_overlap() {
            return Ok(None);
        }
        let voxels = self.grid.len();
        assert_eq!(least.value.len(), voxels, "a minimum of this field");
        let mut value = least.value.clone();
        let mut orientation: Vec<Orientation> =
            least.best.iter().map(|&best| orientations[best as usize]).collect();
        // From one of the set to the next: of a sphere's area, or of the rotations' volume.
        let count = orientations.len() as f64;
        let first_step = match &self.basis {
            Basis::Directions(_) => (4.0 * PI / count).sqrt(),
            Basis::Rotations(_) => (8.0 * PI * PI / count).cbrt(),
        };
        value
            .par_chunks_mut(Self::BLOCK)
            .zip(orientation.par_chunks_mut(Self::BLOCK))
            .enumerate()
            .try_for_each_init(Descent::default, |descent, (block, (value, orientation))| {
                if control.is_cancelled() {
                    return Err(SectionError::Cancelled);
                }
                let from = block * Self::BLOCK;
                self.spread(from..from + value.len(), descent);
                for (place, (value, orientation)) in value.iter_mut().zip(orientation).enumerate() {
                    if *value > 0.0 {
                        let start = self.basis.facing_at(orientation);
                        let (lowest, at) = descent.down(self, place, start, first_step);
                        let lowest = (lowest as f32).clamp(0.0, 1.0);
                        if lowest < *value {
                            (*value, *orientation) = (lowest, oriented(at, orientation));
                        }
                    }
                }
                (control.progress)(value.len() as u64);
                Ok(())
            })?;
        Ok(Some(Refined { value, orientation }))
    }

    /// The weights of all functions at some voxels: `μ + U z`.
    fn spread(&self, voxels: std::ops::Range<usize>, descent: &mut Descent) {
        let (axes, functions, rows) = (self.axis_count(), self.basis.len(), voxels.len());
        let Descent { coefficients, weights, .. } = descent;
        let z = self.read(voxels, coefficients);
        weights.resize(rows * functions, 0.0);
        weights.chunks_exact_mut(functions).for_each(|row| row.copy_from_slice(&self.mean));
        let along = Matrix::row_major(&self.axes, functions, axes, axes).transposed();
        multiply(weights, functions, Matrix::row_major(z, rows, axes, axes), along, true);
    }
}

/// A step along the sphere, or a turn about an axis of the world by its length.
fn moved(facing: Facing, by: DVec3) -> Facing {
    match facing {
        Facing::Direction(direction) => Facing::Direction((direction + by).normalize()),
        Facing::Rotation(rotation) => Facing::Rotation((DQuat::from_scaled_axis(by) * rotation).normalize()),
    }
}

/// The orientation that was reached; a direction of a length has one.
fn oriented(facing: Facing, start: &Orientation) -> Orientation {
    match facing {
        Facing::Direction(direction) => Orientation::from_direction(direction).unwrap_or(*start),
        Facing::Rotation(rotation) => Orientation::from_rotation(&DMat3::from_quat(rotation)),
    }
}

/// Working memory of one thread.
#[derive(Default)]
struct Descent {
    /// The functions of a rotation.
    functions: Vec<f64>,
    coefficients: Vec<f32>,
    /// `[voxel][function]` of a block.
    weights: Vec<f32>,
}

impl Descent {
    /// Value and slope of a block's voxel in a direction or rotation.
    fn at(&mut self, field: &HarmonicField, place: usize, facing: Facing) -> (f64, DVec3) {
        let Self { functions, weights, .. } = self;
        let basis = &field.basis;
        let weights = &weights[place * basis.len()..][..basis.len()];
        match facing {
            Facing::Direction(direction) => {
                basis.sum_with_gradient(direction, |place| f64::from(weights[place]))
            }
            Facing::Rotation(_) => {
                functions.resize(basis.len(), 0.0);
                basis.values_facing(facing, functions);
                let degree = basis.degree();
                vectorised!(Arch::new(), sum_with_turns(degree, &functions[..], weights))
            }
        }
    }

    /// Steps of steepest descent, each as long as the last two slopes tell (Barzilai and Borwein) and halved until the value
    /// falls; the first as long as the way to the set's next direction.
    fn down(&mut self, field: &HarmonicField, place: usize, start: Facing, first: f64) -> (f64, Facing) {
        let mut at = start;
        let (mut value, mut slope) = self.at(field, place, at);
        let mut rate = first / slope.length().max(LEVEL);
        for _ in 0..STEPS {
            let steepness = slope.length();
            // Below 0 the value is clipped: nothing is gained there.
            if steepness < LEVEL || value <= 0.0 {
                break;
            }
            // Never further than a set's spacing, so that the valley stays the same.
            let mut length = (rate * steepness).min(first);
            let mut found = None;
            for _ in 0..HALVINGS {
                let step = slope * (-length / steepness);
                let next = moved(at, step);
                let (lower, next_slope) = self.at(field, place, next);
                if lower <= value - PROMISED * length * steepness {
                    found = Some((next, step, lower, next_slope));
                    break;
                }
                length *= 0.5;
            }
            let Some((next, step, lower, next_slope)) = found else { break };
            let bend = step.dot(next_slope - slope);
            rate = if bend > 0.0 { step.length_squared() / bend } else { 2.0 * length / steepness };
            (at, value, slope) = (next, lower, next_slope);
        }
        (value, at)
    }
}

#[cfg(test)]
mod tests {
    use super::super::basis::Domain;
    use super::super::{FitSettings, fit, minimum_over};
    use super::*;
    use imf_core::grid::Grid;
    use imf_core::occupancy::Occupancy;
    use imf_core::orientation::OrientationSet;
    use imf_core::section::SectionPlan;
    use imf_core::section::ToolPoints;
    use imf_core::tool::Tool;

    fn field(domain: Domain, degree: usize) -> HarmonicField {
        let grid = Grid { origin: DVec3::ZERO, pitch: 8.0, dims: [8, 9, 7] };
        let solid = (0..grid.len()).map(|i| u8::from(i % 7 < 3 || i % 11 == 2)).collect();
        let plan =
            SectionPlan::new(&Occupancy { grid, solid }, Tool::paper(), ToolPoints::SharpPoints).unwrap();
        let settings = FitSettings { degree, axes: 40, ..FitSettings::default() };
        fit(&plan, domain, &settings, Control::quiet()).unwrap()
    }

    /// Refines from one set, and holds the result against the field's values there, its slopes, and the minimum over a larger set.
    fn check(domain: Domain, degree: usize, from: &str, larger: &str, level: f64) {
        let field = field(domain, degree);
        let set = OrientationSet::parse(from).unwrap().orientations;
        let least = field.minimum(&field.direction_weights(&set));
        let refined = field.refined(&least, &set, Control::quiet()).unwrap().unwrap();
        let (mut lower, mut gained, mut steep) = (0, 0.0f64, 0);
        for voxel in 0..field.grid.len() {
            let (value, before) = (refined.value[voxel], least.value[voxel]);
            assert!(value <= before, "voxel {voxel}: {value} above {before}");
            lower += usize::from(value < before);
            gained += f64::from(before - value);
            let facing = field.basis.facing_at(&refined.orientation[voxel]);
            let mut scratch = super::super::PointScratch::default();
            let position = field.grid.centre(field.grid.voxel(voxel));
            let pose = field.overlap_with_gradient(position, facing, &mut scratch).unwrap();
            // The same sum in another order.
            assert!(
                (pose.value.clamp(0.0, 1.0) - value).abs() < 2e-6,
                "voxel {voxel}: {} {value}",
                pose.value
            );
            steep += usize::from(value > 0.0 && pose.rotation.length() > level);
        }
        // At a bottom the slope is level, within what the steps left.
        assert!(steep <= field.grid.len() / 50, "{steep} voxels are not at a bottom");
        assert!(lower > field.grid.len() / 4, "{lower} voxels became lower");
        // Many other orientations find lower valleys of voxels whose best of the set lay in another one; in sum they hold less
        // than descending gained.
        let many = OrientationSet::parse(larger).unwrap().orientations;
        let dense = minimum_over(&field, &many, Control::quiet()).unwrap();
        let missed = refined.value.iter().zip(&dense.value).map(|(&r, &d)| f64::from((r - d).max(0.0)));
        let missed: f64 = missed.sum();
        assert!(missed < gained, "other valleys hold {missed}, descending gained {gained}");
    }

    #[test]
    fn the_minimum_over_the_sphere_is_nowhere_above_the_sets_and_is_the_fields_value_there() {
        check(Domain::Directions, 8, "fibonacci:50", "fibonacci:2000", 1e-3);
    }

    #[test]
    fn so_is_the_minimum_over_all_rotations() {
        check(Domain::Rotations, 3, "so3:6", "so3:5000", 1e-3);
    }
}
