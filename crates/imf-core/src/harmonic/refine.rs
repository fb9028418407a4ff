//! The least value over the whole sphere of directions: from the best of a set, down the field's own gradient.

use glam::DVec3;
use rayon::prelude::*;

use super::HarmonicField;
use super::basis::Domain;
use super::evaluate::VoxelCoefficients as _;
use crate::control::Control;
use crate::orientation::Orientation;
use crate::section::{Imf, SectionError};
use crate::siren::matrix::{Matrix, multiply};

/// A minimum over all directions.
#[derive(Clone, Debug, PartialEq)]
pub struct Refined {
    /// In [0, 1], nowhere above the minimum that it began with.
    pub value: Vec<f32>,
    /// The direction, from tip to holder, that has it.
    pub direction: Vec<DVec3>,
}

/// Steps downhill from the best of the set.
const STEPS: usize = 24;
/// Steps are halved until the value falls, at most so often.
const HALVINGS: usize = 12;
/// A slope below this, in shares of the tool's volume a radian, is level: the value cannot fall by more over the few
/// degrees to the nearest other direction of a set than the field's own error.
const LEVEL: f64 = 1e-6;
/// Share of the fall that the slope promises which a step must bring (Armijo).
const PROMISED: f64 = 1e-4;

impl HarmonicField {
    /// Lowers the minimum over `orientations`, as [`HarmonicField::minimum`] found it, along the sphere to the bottom of
    /// the valley that each voxel's best orientation lies in. Voxels whose value is 0 stay: nothing is lower. One unit
    /// of progress is one voxel. `None` for fields over rotations and for depths.
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
        if self.basis.domain() != Domain::Directions || !self.quantity.is_overlap() {
            return Ok(None);
        }
        let voxels = self.grid.len();
        assert_eq!(least.value.len(), voxels, "a minimum of this field");
        let directions: Vec<DVec3> = orientations.iter().map(Orientation::direction).collect();
        let mut value = least.value.clone();
        let mut direction: Vec<DVec3> = least.best.iter().map(|&best| directions[best as usize]).collect();
        let first_step = (4.0 * std::f64::consts::PI / orientations.len() as f64).sqrt();
        value
            .par_chunks_mut(Self::BLOCK)
            .zip(direction.par_chunks_mut(Self::BLOCK))
            .enumerate()
            .try_for_each_init(Descent::default, |descent, (block, (value, direction))| {
                if control.is_cancelled() {
                    return Err(SectionError::Cancelled);
                }
                let from = block * Self::BLOCK;
                self.spread(from..from + value.len(), descent);
                for (place, (value, direction)) in value.iter_mut().zip(direction).enumerate() {
                    if *value > 0.0 {
                        let (lowest, at) = descent.down(self, place, *direction, first_step);
                        let lowest = (lowest as f32).clamp(0.0, 1.0);
                        if lowest < *value {
                            (*value, *direction) = (lowest, at);
                        }
                    }
                }
                (control.progress)(value.len() as u64);
                Ok(())
            })?;
        Ok(Some(Refined { value, direction }))
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

/// Working memory of one thread.
#[derive(Default)]
struct Descent {
    coefficients: Vec<f32>,
    /// `[voxel][function]` of a block.
    weights: Vec<f32>,
}

impl Descent {
    /// Value and slope of a block's voxel in a direction.
    fn at(&self, field: &HarmonicField, place: usize, direction: DVec3) -> (f64, DVec3) {
        let count = field.basis.len();
        let weights = &self.weights[place * count..][..count];
        field.basis.sum_with_gradient(direction, |place| f64::from(weights[place]))
    }

    /// Steps of steepest descent, each as long as the last two slopes tell (Barzilai and Borwein) and halved until the value
    /// falls; the first as long as the way to the set's next direction.
    fn down(&mut self, field: &HarmonicField, place: usize, start: DVec3, first: f64) -> (f64, DVec3) {
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
                let next = (at - slope * (length / steepness)).normalize();
                let (lower, next_slope) = self.at(field, place, next);
                if lower <= value - PROMISED * length * steepness {
                    found = Some((next, lower, next_slope));
                    break;
                }
                length *= 0.5;
            }
            let Some((next, lower, next_slope)) = found else { break };
            let (moved, change) = (next - at, next_slope - slope);
            let bend = moved.dot(change);
            rate = if bend > 0.0 { moved.length_squared() / bend } else { 2.0 * length / steepness };
            (at, value, slope) = (next, lower, next_slope);
        }
        (value, at)
    }
}

#[cfg(test)]
mod tests {
    use super::super::{FitSettings, HarmonicAnswers, fit};
    use super::*;
    use crate::field::WholeField as _;
    use crate::grid::Grid;
    use crate::occupancy::Occupancy;
    use crate::orientation::OrientationSet;
    use crate::section::SectionPlan;
    use crate::tool::Tool;

    fn field(domain: Domain, degree: usize) -> HarmonicField {
        let grid = Grid { origin: DVec3::ZERO, pitch: 8.0, dims: [8, 9, 7] };
        let solid = (0..grid.len()).map(|i| u8::from(i % 7 < 3 || i % 11 == 2)).collect();
        let plan = SectionPlan::new(&Occupancy { grid, solid }, &Tool::paper()).unwrap();
        let settings = FitSettings { degree, axes: 40, ..FitSettings::default() };
        fit(&plan, domain, &settings, Control::quiet()).unwrap()
    }

    #[test]
    fn the_minimum_over_the_sphere_is_nowhere_above_the_sets_and_is_the_fields_value_there() {
        let field = field(Domain::Directions, 8);
        let set = OrientationSet::parse("fibonacci:50").unwrap().orientations;
        let least = field.minimum(&field.heads(&set));
        let refined = field.refined(&least, &set, Control::quiet()).unwrap().unwrap();
        let (mut lower, mut gained) = (0, 0.0f64);
        for voxel in 0..field.grid.len() {
            let (value, before) = (refined.value[voxel], least.value[voxel]);
            assert!(value <= before, "voxel {voxel}: {value} above {before}");
            lower += usize::from(value < before);
            gained += f64::from(before - value);
            let direction = refined.direction[voxel];
            assert!((direction.length() - 1.0).abs() < 1e-12);
            let mut scratch = super::super::PointScratch::default();
            let position = field.grid.centre(field.grid.voxel(voxel));
            let pose = field.overlap_with_gradient(position, direction, &mut scratch).unwrap();
            // The same sum in another order.
            assert!(
                (pose.value.clamp(0.0, 1.0) - value).abs() < 2e-6,
                "voxel {voxel}: {} {value}",
                pose.value
            );
            // At a bottom the slope is level, within what the steps left.
            let level = pose.direction.length() < 1e-3;
            assert!(value == 0.0 || level, "voxel {voxel}: slope {}", pose.direction.length());
        }
        assert!(lower > field.grid.len() / 4, "{lower} voxels became lower");
        // 2,000 other directions find lower valleys of voxels whose best of 50 lay in another one; in sum they hold less
        // than descending gained.
        let many = OrientationSet::parse("fibonacci:2000").unwrap().orientations;
        let dense = HarmonicAnswers(&field).least_over(&many, Control::quiet()).unwrap();
        let missed = refined.value.iter().zip(&dense.value).map(|(&r, &d)| f64::from((r - d).max(0.0)));
        let missed: f64 = missed.sum();
        assert!(missed < gained, "other valleys hold {missed}, descending gained {gained}");
    }

    #[test]
    fn fields_over_rotations_are_not_refined() {
        let field = field(Domain::Rotations, 2);
        let set = OrientationSet::parse("so3:20").unwrap().orientations;
        let least = field.minimum(&field.heads(&set));
        assert_eq!(field.refined(&least, &set, Control::quiet()).unwrap(), None);
    }
}
