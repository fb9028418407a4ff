//! Single poses: value and exact derivatives in position and direction.
//!
//! A point passes through the network with its three tangents beside it, four rows that share one reading of the
//! weights; what comes out are the coefficients and their derivatives by position, whatever the direction. Each direction
//! asked there then costs two readings of the axes.

use glam::DVec3;

use super::evaluate::dot;
use super::{FactoredEvaluator, INPUTS};
use crate::harmonic::Gradient;
use crate::harmonic::basis::Domain;
use crate::orientation::Orientation;
use crate::siren::tangent::PanelOfPoint;

/// Working memory of a thread that asks for single poses; nothing is allocated once it has its size.
#[derive(Default)]
pub struct PointScratch {
    /// `[rows][neuron]`, rows as long as the widest layer: activations, and their tangents.
    signal: Vec<f32>,
    next: Vec<f32>,
    /// `[rows][axes]`: coefficients, and their derivatives along x, y and z.
    z: Vec<f32>,
    /// h of the direction, `[axes]`.
    along: Vec<f32>,
    functions: Vec<f64>,
    /// The same in f32.
    narrow: Vec<f32>,
    gradients: Vec<DVec3>,
}

/// The field at one point: ask it for any number of directions.
pub struct FactoredPoint<'a> {
    evaluator: &'a FactoredEvaluator<'a>,
    scratch: &'a mut PointScratch,
}

impl FactoredEvaluator<'_> {
    /// The overlap with the tool's tip at a world position, in [0, 1]. `None` outside the box of the voxel centres.
    #[must_use]
    pub fn overlap(
        &self,
        position: DVec3,
        orientation: &Orientation,
        scratch: &mut PointScratch,
    ) -> Option<f32> {
        self.pass::<1>(position, scratch)?;
        Some(self.value(orientation, scratch).clamp(0.0, 1.0))
    }

    /// The overlap, not clipped, with its gradients in position and direction. `None` outside the box of the voxel
    /// centres, and for fields over rotations.
    #[must_use]
    pub fn overlap_with_gradient(
        &self,
        position: DVec3,
        direction: DVec3,
        scratch: &mut PointScratch,
    ) -> Option<Gradient> {
        self.point(position, scratch)?.gradient(direction)
    }

    /// The field at a world position, with its derivatives. `None` outside the box of the voxel centres.
    #[must_use]
    pub fn point<'a>(&'a self, position: DVec3, scratch: &'a mut PointScratch) -> Option<FactoredPoint<'a>> {
        self.pass::<4>(position, scratch)?;
        Some(FactoredPoint { evaluator: self, scratch })
    }

    /// Fills the first `ROWS` rows of `z`: the coefficients, then their derivatives by position.
    fn pass<const ROWS: usize>(&self, position: DVec3, scratch: &mut PointScratch) -> Option<()> {
        let field = &*self.field;
        if !field.grid.is_between_centres(position) {
            return None;
        }
        let stack = self.plan.stack;
        let widest = stack.width.max(stack.outputs).max(INPUTS);
        let PointScratch { signal, next, z, .. } = scratch;
        signal.resize(widest * ROWS, 0.0);
        next.resize(widest * ROWS, 0.0);
        for (axis, &value) in field.input(position).iter().enumerate() {
            for row in 0..ROWS {
                signal[row * widest + axis] =
                    if row == 0 { value } else { f32::from(u8::from(row == axis + 1)) };
            }
        }
        for (index, layer) in self.plan.layers.iter().enumerate() {
            for neurons in self.plan.panels(index) {
                self.arch.dispatch(PanelOfPoint::<ROWS> {
                    panel: &self.panels[self.plan.panel_range(index, &neurons)],
                    biases: &field.parameters[layer.biases + neurons.start..][..neurons.len()],
                    signal: std::array::from_fn(|row| &signal[row * widest..][..layer.inputs]),
                    out: next,
                    widest,
                    first: neurons.start,
                    omega: (index < stack.hidden).then_some(stack.omega),
                });
            }
            std::mem::swap(signal, next);
        }
        let axes = stack.outputs;
        z.resize(4 * axes, 0.0);
        let slope = field.scale * field.inverse_length() as f32;
        for (row, (z, signal)) in z.chunks_exact_mut(axes).zip(signal.chunks_exact(widest)).enumerate() {
            let scale = if row == 0 { field.scale } else { slope };
            z.iter_mut().zip(signal).for_each(|(z, &value)| *z = value * scale);
        }
        Some(())
    }

    /// The value at an orientation of what the first row of `z` holds.
    fn value(&self, orientation: &Orientation, scratch: &mut PointScratch) -> f32 {
        let field = &*self.field;
        let axes = self.plan.stack.outputs;
        let PointScratch { z, along, functions, narrow, .. } = scratch;
        functions.resize(field.basis.len(), 0.0);
        field.basis.values(orientation, functions);
        narrow.clear();
        narrow.extend(functions.iter().map(|&value| value as f32));
        along.resize(axes, 0.0);
        let mean: f64 =
            field.mean.iter().zip(&*functions).map(|(&mean, &value)| f64::from(mean) * value).sum();
        self.arch.dispatch(|| {
            turn(&field.axes, narrow, along);
            mean as f32 + dot(along, &z[..axes])
        })
    }
}

/// h = Uᵀb: `rows` are `[function][axis]`. Columns are taken in pieces whose sums stay in registers.
#[inline(always)]
fn turn(rows: &[f32], functions: &[f32], along: &mut [f32]) {
    let axes = along.len();
    let mut first = 0;
    while first < axes {
        first += match axes - first {
            64.. => columns::<64>(rows, functions, along, first),
            16.. => columns::<16>(rows, functions, along, first),
            _ => columns::<1>(rows, functions, along, first),
        };
    }
}

/// Some columns of [`turn`]; how many.
#[inline(always)]
fn columns<const COUNT: usize>(rows: &[f32], functions: &[f32], along: &mut [f32], first: usize) -> usize {
    let mut sums = [0.0f32; COUNT];
    for (row, &function) in rows.chunks_exact(along.len()).zip(functions) {
        for (sum, &value) in sums.iter_mut().zip(&row[first..first + COUNT]) {
            *sum += function * value;
        }
    }
    along[first..first + COUNT].copy_from_slice(&sums);
    COUNT
}

impl FactoredPoint<'_> {
    /// The overlap in an orientation, in [0, 1].
    #[must_use]
    pub fn overlap(&mut self, orientation: &Orientation) -> f32 {
        self.evaluator.value(orientation, self.scratch).clamp(0.0, 1.0)
    }

    /// The overlap, not clipped, with its gradients; `None` for fields over rotations, or a direction of no length.
    #[must_use]
    pub fn gradient(&mut self, direction: DVec3) -> Option<Gradient> {
        let field = &*self.evaluator.field;
        if field.basis.domain() != Domain::Directions {
            return None;
        }
        let direction = direction.try_normalize()?;
        let axes = self.evaluator.plan.stack.outputs;
        let PointScratch { z, along, functions, gradients, .. } = &mut *self.scratch;
        functions.resize(field.basis.len(), 0.0);
        gradients.resize(field.basis.len(), DVec3::ZERO);
        field.basis.gradients_of_direction(direction, functions, gradients);
        along.clear();
        along.resize(axes, 0.0);
        let rows = field.axes.chunks_exact(axes).zip(&field.mean);
        let (z, slopes) = z.split_at(axes);
        let (value, turn) = self.evaluator.arch.dispatch(|| {
            let (mut value, mut turn) = (0.0, DVec3::ZERO);
            for ((row, &mean), (&function, &gradient)) in rows.zip(functions.iter().zip(&*gradients)) {
                let weight = f64::from(mean + dot(row, z));
                value += weight * function;
                turn += weight * gradient;
                let function = function as f32;
                along.iter_mut().zip(row).for_each(|(along, &axis)| *along += function * axis);
            }
            (value, turn)
        });
        let mut position = [0.0; INPUTS];
        for (slope, row) in position.iter_mut().zip(slopes.chunks_exact(axes)) {
            *slope = f64::from(dot(row, along));
        }
        Some(Gradient { value: value as f32, position: position.into(), direction: turn })
    }
}
