//! Muon's step on the device, beside Adam's: the momentum of the matrices between hidden layers made orthogonal. The
//! definition and its sources are [`imf_core::siren::muon`]'s; what is kept between steps is the momentum alone, in the place of the
//! first moments, so that a training moves between CPU and GPU.
//!
//! ```text
//! gradient, momentum → u, sums of squares → X = u/‖u‖ → STEPS × (A = X·Xᵀ → B = b·A + c·A·A → X = a·X + B·X) → weights
//! ```
//!
//! All matrices pass together, one a slice of every dispatch, in `[rows][columns]` of the widest: a column of zeros more adds
//! nothing to X·Xᵀ and stays zeros. So do rows and columns of padding, whose gradient and momentum are zero. Products are f32
//! whatever the factors of the network's products are.

use imf_core::siren::muon::{LENGTH, MuonConfig, STEPS};
use imf_core::training::EngineError;

use super::plan::MuonPlaces;
use crate::device::Gpu;
use crate::forward::Network;
use crate::kernel::{Bound, Kernel, uniform};
use crate::layout::PaddedLayout;
use crate::shader::{LINEAR_GROUP, MUON_GROUPS, Shader};
use crate::uniforms::{Muon, MuonMatrix};

/// How many matrices lie between hidden layers, and what they fit in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Matrices {
    pub(super) count: usize,
    pub(super) rows: usize,
    pub(super) columns: usize,
}

impl Matrices {
    /// Those of a network; none where there is one hidden layer.
    pub(super) fn of(layout: &PaddedLayout) -> Option<Self> {
        let between = layout.between();
        let rows = between.first()?.outputs;
        let columns = between.iter().map(|layer| layer.inputs).max()?;
        Some(Self { count: between.len(), rows, columns })
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
    /// Compiles and binds the kernels; `step` is the trainer's uniform block, `buffers` are those of the trainer's plan.
    pub(super) fn new(
        gpu: &Gpu,
        network: &Network,
        config: MuonConfig,
        matrices: Matrices,
        places: &MuonPlaces,
        buffers: &[wgpu::Buffer],
        [step, gradient, first_moment]: [&wgpu::Buffer; 3],
    ) -> Result<Self, EngineError> {
        let block = Muon {
            rows: matrices.rows as u32,
            columns: matrices.columns as u32,
            momentum: config.momentum,
            one_minus_momentum: 1.0 - config.momentum,
        };
        let block = uniform(gpu, "Muon", &block)?;
        let table: Vec<MuonMatrix> = network
            .layout
            .between()
            .iter()
            .zip(network.layout.learnt_between())
            .map(|(layer, learnt)| MuonMatrix {
                weights: layer.weights as u32,
                columns: layer.inputs as u32,
                length: config.rate * LENGTH * (learnt as f32).sqrt(),
            })
            .collect();
        let [table_at, x, turned, gram, polynomial, squares] =
            [places.table, places.directions, places.turned, places.gram, places.polynomial, places.squares]
                .map(|place| &buffers[place]);
        gpu.queue().write_buffer(table_at, 0, bytemuck::cast_slice(&table));
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
                .bind(gpu, &[&block, table_at, gradient, first_moment, x, squares]),
            scale: kernel(Shader::MuonScale)?.bind(gpu, &[&block, squares, x]),
            iterations: [[x, turned], [turned, x]].map(iteration),
            update: kernel(Shader::MuonUpdate)?
                .bind(gpu, &[&block, step, table_at, last, &network.parameters]),
        })
    }

    /// The step by a gradient that is whole.
    pub(super) fn record(&self, pass: &mut wgpu::ComputePass<'_>) {
        let Matrices { count, rows, columns } = self.matrices;
        let each = (MUON_GROUPS * LINEAR_GROUP) as usize;
        self.momentum.sliced(pass, each, count);
        self.scale.sliced(pass, each, count);
        for [gram, polynomial, turn] in self.iterations.iter().cycle().take(STEPS) {
            gram.product(pass, rows, rows, count);
            polynomial.product(pass, rows, rows, count);
            turn.product(pass, rows, columns, count);
        }
        self.update.sliced(pass, each, count);
    }
}
