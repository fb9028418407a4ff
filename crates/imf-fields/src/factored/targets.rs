//! The targets of g at a voxel: the teacher's coefficients as they are, or in the frame of the voxel's place.

use std::borrow::Cow;

use crate::parallel::*;
use pulp::Arch;

use super::symmetry::{LocalHarmonics, Symmetry};
use super::{FactoredField, FactoredShape};
use crate::harmonic::HarmonicField;
use crate::harmonic::basis::{Basis, Domain};
use crate::siren::ShapeError;
use crate::siren::lanes::dot;
use imf_core::grid::Grid;
use imf_core::section::Quantity;
use imf_core::vectorised::vectorised;

/// A teacher of functions of the direction, by function.
pub(super) struct ByFunction<'a> {
    teacher: &'a HarmonicField,
    /// The function that each axis is, where they are functions in some order.
    order: Option<Vec<usize>>,
    arch: Arch,
}

impl<'a> ByFunction<'a> {
    /// `None` for fields over rotations.
    pub(super) fn of(teacher: &'a HarmonicField) -> Option<Self> {
        let directions = teacher.basis.domain() == Domain::Directions;
        directions.then(|| Self { teacher, order: order(teacher), arch: Arch::new() })
    }

    /// The coefficients of a voxel by function, `μ + U z`, `[K]` into `out`; `scratch` is working memory.
    pub(super) fn read(&self, voxel: usize, scratch: &mut Vec<f32>, out: &mut [f32]) {
        let HarmonicField { components, mean, coefficients, .. } = self.teacher;
        let count = self.teacher.component_count();
        out.copy_from_slice(mean);
        let z = coefficients.read(voxel * count, (voxel + 1) * count, scratch);
        match &self.order {
            Some(order) => order.iter().zip(z).for_each(|(&function, &z)| out[function] += z),
            None => vectorised!(self.arch, {
                for (out, row) in out.iter_mut().zip(components.chunks_exact(count)) {
                    *out += dot(row, z);
                }
            }),
        }
    }
}

/// The function that each axis is, where there are as many of them and each is one.
fn order(teacher: &HarmonicField) -> Option<Vec<usize>> {
    let components = teacher.component_count();
    if components != teacher.basis.len() {
        return None;
    }
    let mut order = vec![usize::MAX; components];
    for (function, row) in teacher.components.chunks_exact(components).enumerate() {
        let mut kept = row.iter().enumerate().filter(|&(_, &value)| value != 0.0);
        match (kept.next(), kept.next()) {
            (Some((axis, &1.0)), None) => order[axis] = function,
            _ => return None,
        }
    }
    (!order.contains(&usize::MAX)).then_some(order)
}

/// Working memory of a thread that reads targets.
#[derive(Default)]
pub struct TargetScratch {
    halves: Vec<f32>,
    world: Vec<f32>,
}

/// The targets of every voxel.
pub struct Targets<'a> {
    teacher: &'a HarmonicField,
    symmetry: Symmetry,
    local: Option<(ByFunction<'a>, LocalHarmonics)>,
    /// The root mean square of the coefficients that are targets, 1 where all are 0: targets are in units of it.
    pub scale: f32,
}

/// Voxels of which the scale is taken at a time: sums of a part are added in the parts' order.
const PART: usize = 4096;

impl<'a> Targets<'a> {
    /// # Errors
    /// A symmetry where the teacher's functions are of rotations.
    pub fn new(teacher: &'a HarmonicField, symmetry: Symmetry) -> Result<Self, ShapeError> {
        let local = if symmetry.is_none() {
            None
        } else {
            let all = ByFunction::of(teacher).ok_or(ShapeError::Symmetry)?;
            Some((all, LocalHarmonics::new(&symmetry, teacher.basis.degree())))
        };
        let mut targets = Self { teacher, symmetry, local, scale: 1.0 };
        targets.scale = targets.root_mean_square();
        Ok(targets)
    }

    fn root_mean_square(&self) -> f32 {
        let (components, voxels) = (self.teacher.component_count(), self.teacher.grid.len());
        let outputs = self.outputs();
        let parts: Vec<f64> = (0..voxels.div_ceil(PART))
            .into_par_iter()
            .map_init(Vec::new, |scratch, part| {
                let range = part * PART..((part + 1) * PART).min(voxels);
                let square = |z: f32| f64::from(z) * f64::from(z);
                if let Some((all, _)) = &self.local {
                    // A frame's turn changes no length.
                    let mut world = vec![0.0; outputs];
                    return range
                        .map(|voxel| {
                            all.read(voxel, scratch, &mut world);
                            world.iter().map(|&z| square(z)).sum::<f64>()
                        })
                        .sum();
                }
                let z =
                    self.teacher.coefficients.read(range.start * components, range.end * components, scratch);
                z.iter().map(|&z| square(z)).sum()
            })
            .collect();
        let mean = parts.iter().sum::<f64>() / (voxels * outputs) as f64;
        if mean > 0.0 { mean.sqrt() as f32 } else { 1.0 }
    }

    /// Those of a voxel, `[components]` into `out`, in units of the scale.
    pub fn read(&self, voxel: usize, scratch: &mut TargetScratch, out: &mut [f32]) {
        let TargetScratch { halves, world } = scratch;
        match &self.local {
            None => {
                let components = out.len();
                let z = self.teacher.coefficients.read(voxel * components, (voxel + 1) * components, halves);
                out.copy_from_slice(z);
            }
            Some((all, harmonics)) => {
                world.resize(out.len(), 0.0);
                all.read(voxel, halves, world);
                harmonics.in_order(world, out);
                let centre = self.teacher.grid.centre(self.teacher.grid.voxel(voxel));
                harmonics.to_local(&self.symmetry.place(centre), out);
            }
        }
        out.iter_mut().for_each(|target| *target /= self.scale);
    }

    /// Outputs of the network.
    pub fn outputs(&self) -> usize {
        self.symmetry.coefficients(self.teacher.component_count(), self.teacher.basis.len())
    }

    /// U `[K][components]` and μ `[K]` of the network: the teacher's, or every function of a place's frame by itself.
    pub fn functions(&self) -> (Cow<'a, [f32]>, Cow<'a, [f32]>) {
        if self.local.is_none() {
            return (Cow::Borrowed(&self.teacher.components), Cow::Borrowed(&self.teacher.mean));
        }
        let count = self.teacher.basis.len();
        let mut identity = vec![0.0; count * count];
        identity.iter_mut().step_by(count + 1).for_each(|value| *value = 1.0);
        (Cow::Owned(identity), Cow::Owned(vec![0.0; count]))
    }
}

/// The basis in which a network gives coefficients: principal components of a teacher's basis functions, or of exact sections.
pub struct ComponentBasis<'a> {
    /// What values are.
    pub quantity: Quantity,
    /// Where the voxels are.
    pub grid: &'a Grid,
    /// The functions of the orientation, K of them.
    pub basis: &'a Basis,
    /// U: `[K][components]`.
    pub components: Cow<'a, [f32]>,
    /// μ: `[K]`.
    pub mean: Cow<'a, [f32]>,
    /// Root mean square of the coefficients.
    pub scale: f32,
}

impl<'a> ComponentBasis<'a> {
    /// Those of a harmonic field's targets.
    pub fn of(teacher: &'a HarmonicField, targets: &Targets<'a>) -> Self {
        let HarmonicField { quantity, grid, basis, .. } = teacher;
        let (components, mean) = targets.functions();
        Self { quantity: *quantity, grid, basis, components, mean, scale: targets.scale }
    }

    /// The field of a network along them.
    ///
    /// # Errors
    /// As [`FactoredField::new`].
    pub fn field(self, shape: FactoredShape, parameters: Vec<f32>) -> Result<FactoredField, ShapeError> {
        shape.check()?;
        shape.stack().check_parameters(&parameters)?;
        let components = self.components.len() / self.mean.len();
        let expected = FactoredShape { components, ..shape }.parameter_count();
        if expected != parameters.len() {
            return Err(ShapeError::Parameters { expected, found: parameters.len() });
        }
        Ok(self.of_weights(shape, parameters))
    }

    /// As [`Self::field`], of weights known to fit, or without weights.
    pub fn of_weights(self, shape: FactoredShape, parameters: Vec<f32>) -> FactoredField {
        let Self { quantity, grid, basis, components, mean, scale } = self;
        let (basis, components, mean) = (basis.clone(), components.into_owned(), mean.into_owned());
        FactoredField { quantity, grid: *grid, basis, components, mean, shape, parameters, scale }
    }
}
