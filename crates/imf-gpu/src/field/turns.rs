//! From a point's coefficients to values at any direction or rotation d: what factored and harmonic fields have in common.
//! Coefficients z give every function its weight, w = s·U z + μ; the value is the sum of the functions b(d) by their weights, and so
//! are its derivatives by d. By the coefficients it changes as s·Uᵀ b(d), where the way back to the point begins. In a
//! symmetry-reduced field the functions are of the direction in the frame of the point's place; derivatives are by the world's.
//!
//! Both products are the shader of a linear layer; the scale s is in their weights.

use std::f64::consts::{PI, SQRT_2};

use imf_core::field::EngineError;
use imf_fields::factored::Symmetry;
use imf_fields::harmonic::basis::Basis;
use imf_fields::harmonic::rotations::Step;
use imf_fields::harmonic::sphere::SphereBasis;

use super::passes::{CallKernel, Frame, Slot, own};
use crate::kernel::{Dispatch, Extent, Kernel, uniform};
use crate::memory::allocate;
use crate::shader::Shader;
use crate::uniforms::{self, Harmonics, Layer};

/// The functions of a field, its axes and its mean.
#[derive(Clone, Copy)]
pub(super) struct Functions<'a> {
    pub(super) basis: &'a Basis,
    /// U: `[K][components]`.
    pub(super) components: &'a [f32],
    /// μ: `[K]`.
    pub(super) mean: &'a [f32],
    pub(super) scale: f32,
    /// What places' frames are by.
    pub(super) symmetry: Symmetry,
    /// Nearer to its axis than this slopes do not grow.
    pub(super) blunt: f64,
}

impl Functions<'_> {
    /// Functions of a row on the device, padding among them.
    pub(super) fn columns(&self, padding: usize) -> usize {
        self.basis.len().next_multiple_of(padding)
    }
}

/// Rows of coefficients on the device, and what their slopes are to be written to: both `[rows][components]`, padding among them.
pub(super) struct Coefficients<'a> {
    pub(super) batch: &'a wgpu::Buffer,
    pub(super) rows: usize,
    pub(super) components: usize,
    pub(super) values: &'a wgpu::Buffer,
    pub(super) slopes: &'a wgpu::Buffer,
}

pub(super) struct Turns {
    /// From coefficients to weights of the functions, and from functions to slopes by the coefficients.
    pub(super) weigh: Dispatch,
    pub(super) seed: Dispatch,
    pub(super) values: CallKernel,
    /// Values with derivatives by how the tool stands, and with the functions.
    pub(super) slopes: CallKernel,
    /// [`uniforms::Symmetry`]
    pub(super) symmetry: wgpu::Buffer,
}

impl Turns {
    pub(super) fn new(
        frame: &Frame,
        functions: Functions<'_>,
        at: &Coefficients<'_>,
    ) -> Result<Self, EngineError> {
        let Frame { gpu, world, sweep } = frame;
        let columns = functions.columns(gpu.matrix_kernel().padding());
        let table = recurrence(functions.basis);
        let (values_of, slopes_of) = match functions.basis {
            Basis::Directions(_) => (Shader::HarmonicValues, Shader::HarmonicSlopes),
            Basis::Rotations(_) => (Shader::RotationValues, Shader::RotationSlopes),
        };
        let (mixing, [weigh, seed]) = mixing(functions, columns, at.components);
        let sizes = [
            // See `harmonics.wgsl` and `rotations.wgsl`.
            ("recurrence", 4 * table.len()),
            ("components", mixing.len()),
            ("weights of functions", at.rows * columns),
            ("functions", at.rows * columns),
        ];
        let [steps, components, weights, values] = allocate(gpu, sizes)?;
        gpu.write(&steps, &table);
        gpu.write(&components, &mixing);
        let (weigh, seed) = (uniform(gpu, "weights", &weigh)?, uniform(gpu, "seed", &seed)?);
        let linear = Kernel::new(gpu, Shader::Linear)?;
        let harmonics = Harmonics { degree: functions.basis.degree() as u32, stride: columns as u32 };
        let harmonics = uniform(gpu, "harmonics", &harmonics)?;
        let symmetry = uniforms::Symmetry::new(&functions.symmetry, functions.blunt);
        let symmetry = uniform(gpu, "symmetry", &symmetry)?;
        let mut slots: Vec<Slot> =
            [at.batch, world, sweep, &symmetry, &harmonics].map(own).into_iter().collect();
        slots.extend([Slot::Poses, own(&steps), own(&weights), Slot::Values]);
        let with_slopes = [&slots[..], &[Slot::Gradients, own(&values)]].concat();
        let (forth, back) = (Extent::Product(columns), Extent::Product(at.components));
        Ok(Self {
            weigh: linear.bind(forth, &[at.batch, &weigh, &components, at.values, &weights]),
            seed: linear.bind(back, &[at.batch, &seed, &components, &values, at.slopes]),
            values: CallKernel::new(gpu, values_of, Extent::Rows(1), slots)?,
            slopes: CallKernel::new(gpu, slopes_of, Extent::Rows(1), with_slopes)?,
            symmetry,
        })
    }
}

/// The recurrence's constants as `harmonics.wgsl` or `rotations.wgsl` reads them, of functions of mean square 1.
fn recurrence(basis: &Basis) -> Vec<[f32; 4]> {
    match basis {
        Basis::Directions(sphere) => of_directions(sphere),
        Basis::Rotations(rotations) => {
            rotations.steps().iter().map(|&Step { a, b, e }| [a as f32, b as f32, e as f32, 0.0]).collect()
        }
    }
}

fn of_directions(sphere: &SphereBasis) -> Vec<[f32; 4]> {
    let degree = sphere.degree();
    let mut table = Vec::with_capacity((degree + 1) * (degree + 2) / 2);
    for l in 0..=degree {
        for m in 0..=l {
            let (a, e) = if l > m {
                sphere.step(l, m)
            } else {
                let both = if m > 0 { SQRT_2 } else { 1.0 };
                ((4.0 * PI).sqrt() * both * sphere.sectoral(m), 0.0)
            };
            table.push([a as f32, 0.0, e as f32, 0.0]);
        }
    }
    table
}

/// The axes as the weights of two linear layers, and these: from `components` coefficients to `columns` functions, and back.
///
/// ```text
/// | s·U [columns][components] | μ [columns] | s·Uᵀ [components][columns] | 0 [components] |
/// ```
fn mixing(functions: Functions<'_>, columns: usize, components: usize) -> (Vec<f32>, [Layer; 2]) {
    let Functions { basis, components: kept, mean, scale, .. } = functions;
    let second = columns * (components + 1);
    let mut all = vec![0.0; second + components * (columns + 1)];
    for (function, row) in kept.chunks_exact(kept.len() / basis.len()).enumerate() {
        for (axis, &value) in row.iter().enumerate() {
            all[function * components + axis] = value * scale;
            all[second + axis * columns + function] = value * scale;
        }
    }
    all[columns * components..][..mean.len()].copy_from_slice(mean);
    let layer = |inputs: usize, outputs: usize, weights: usize| Layer {
        inputs: inputs as u32,
        outputs: outputs as u32,
        weights: weights as u32,
        biases: (weights + inputs * outputs) as u32,
        ..Layer::default()
    };
    (all, [layer(components, columns, 0), layer(columns, components, second)])
}
