//! Muon's step on the device, beside Adam's: the momentum of the matrices between hidden layers made orthogonal. The
//! definition and its sources are [`imf_train::engine::muon`]'s; what is kept between steps is the momentum alone, in the place of the
//! first moments, so that a training moves between CPU and GPU.
//!
//! ```text
//! gradient, momentum → u, sums of squares → X = u/‖u‖ → STEPS × (A = X·Xᵀ → B = b·A + c·A·A → X = a·X + B·X) → weights
//! ```
//!
//! All matrices pass together, one a slice of every dispatch, in `[rows][columns]` of the widest: a column of zeros more adds
//! nothing to X·Xᵀ and stays zeros. So do rows and columns of padding, whose gradient and momentum are zero. Products are f32
//! whatever the factors of the network's products are.

use imf_core::field::EngineError;
use imf_fields::recipe::MuonConfig;
use imf_train::engine::muon::{LENGTH, STEPS};

use super::Buffers;
use super::matrices::Matrices;
use crate::device::Gpu;
use crate::forward::Network;
use crate::kernel::{Bound, Kernel};
use crate::memory::Plan;
use crate::shader::{MATRIX_GROUPS, Shader};
use crate::uniforms::MatrixPlace;

/// Places of what Muon works with.
pub(super) struct MuonPlaces {
    config: MuonConfig,
    matrices: Matrices,
    /// A [`MatrixPlace`] each.
    table: usize,
    directions: usize,
    turned: usize,
    gram: usize,
    polynomial: usize,
    squares: usize,
}

impl MuonPlaces {
    pub(super) fn plan(plan: &mut Plan, config: MuonConfig, matrices: Matrices) -> Self {
        let Matrices { count, rows, columns } = matrices;
        Self {
            config,
            matrices,
            table: plan.add("places of the matrices", count * size_of::<MatrixPlace>() / 4),
            directions: plan.add("directions of Muon", count * rows * columns),
            turned: plan.add("directions of Muon", count * rows * columns),
            gram: plan.add("products of Muon", count * rows * rows),
            polynomial: plan.add("products of Muon", count * rows * rows),
            squares: plan.add("squares of Muon", count * MATRIX_GROUPS as usize),
        }
    }

    /// What a step writes before it reads it.
    pub(super) fn scratch(&self) -> [usize; 5] {
        [self.directions, self.turned, self.gram, self.polynomial, self.squares]
    }
}

/// The kernels of a step, bound.
#[derive(Debug)]
pub(super) struct MuonStep {
    matrices: Matrices,
    momentum: Bound,
    scale: Bound,
    /// Gram, polynomial and turn of every iteration, which two buffers take turns in.
    iterations: [[Bound; 3]; 2],
    update: Bound,
}

impl MuonStep {
    /// Compiles and binds the kernels; `buffers` are those of the trainer's plan.
    pub(super) fn new(
        gpu: &Gpu,
        network: &Network,
        host: &Buffers,
        places: &MuonPlaces,
        buffers: &[wgpu::Buffer],
    ) -> Result<Self, EngineError> {
        let MuonPlaces { config, matrices, .. } = *places;
        let [table, x, turned, gram, polynomial, squares] =
            [places.table, places.directions, places.turned, places.gram, places.polynomial, places.squares]
                .map(|place| &buffers[place]);
        let length = |inputs: usize| config.rate * LENGTH * (inputs as f32).sqrt();
        let block = matrices.upload(gpu, &network.layout, table, config.momentum, length)?;
        let kernel = |shader| Kernel::new(gpu, shader);
        let products = [Shader::MuonGram, Shader::MuonPolynomial, Shader::MuonTurn];
        let [first, second, third] = products.map(kernel);
        let (first, second, third) = (first?, second?, third?);
        let iteration = |[from, to]: [&wgpu::Buffer; 2]| {
            [
                first.bind(gpu, &[&block, from, gram]),
                second.bind(gpu, &[&block, gram, polynomial]),
                third.bind(gpu, &[&block, polynomial, from, to]),
            ]
        };
        let last = [x, turned][STEPS % 2];
        Ok(Self {
            matrices,
            momentum: kernel(Shader::MuonMomentum)?
                .bind(gpu, &[&block, table, &host.gradient, &host.first_moment, x, squares]),
            scale: kernel(Shader::MuonScale)?.bind(gpu, &[&block, squares, x]),
            iterations: [[x, turned], [turned, x]].map(iteration),
            update: kernel(Shader::MatricesUpdate)?
                .bind(gpu, &[&block, &host.step, table, last, &network.parameters]),
        })
    }

    /// The step by a gradient that is whole.
    pub(super) fn record(&self, pass: &mut wgpu::ComputePass<'_>) {
        let Matrices { count, rows, columns } = self.matrices;
        self.matrices.each(pass, &self.momentum);
        self.matrices.each(pass, &self.scale);
        for [gram, polynomial, turn] in self.iterations.iter().cycle().take(STEPS) {
            gram.product(pass, rows, rows, count);
            polynomial.product(pass, rows, rows, count);
            turn.product(pass, rows, columns, count);
        }
        self.matrices.each(pass, &self.update);
    }
}
