//! SOAP's step on the device, beside Adam's: moments of the gradients of the matrices between hidden layers along axes of
//! their own. The definition and its source are [`imf_train::engine::soap`]'s, and so is what is kept between steps, so that a
//! training moves between CPU and GPU.
//!
//! ```text
//! gradient → G → G' = Qₗᵀ·G·Qᵣ → moments, step along the axes → Qₗ·step·Qᵣᵀ → weights
//!            G → means Mₗ of G·Gᵀ, Mᵣ of Gᵀ·G
//! every few steps, of rows and of columns: M·Q → its axes by falling mean, orthonormal → Q;  moments follow
//! ```
//!
//! All matrices pass together, one a slice of every dispatch, in `[rows][columns]` of the widest, in zeros. Unlike the CPU's,
//! axes stand in columns here, so that the invocations of a workgroup, one an axis, read side by side. Products are f32
//! whatever the factors of the network's products are.

mod look;
mod products;
mod side;

use imf_core::field::EngineError;
use imf_fields::recipe::SoapConfig;
use imf_fields::recipe::TrainingState;
use imf_train::engine::soap::FIRST_LOOKS;

use super::Buffers;
use super::matrices::Matrices;
use crate::device::Gpu;
use crate::forward::Network;
use crate::kernel::{Bound, Kernel};
use crate::layout::PaddedLayout;
use crate::memory::Plan;
use crate::shader::Shader;
use crate::uniforms::MatrixPlace;
use look::{Look, LookKernels};
use products::{BoundProduct, Factor, Products};
use side::{Numbers, SidePlaces, SideStep};

/// Places of what SOAP works with.
pub(super) struct SoapPlaces {
    config: SoapConfig,
    matrices: Matrices,
    /// A [`MatrixPlace`] each.
    table: usize,
    gradient: usize,
    half: usize,
    along: usize,
    sides: [SidePlaces; 2],
}

impl SoapPlaces {
    pub(super) fn plan(plan: &mut Plan, config: SoapConfig, matrices: Matrices) -> Self {
        let Matrices { count, rows, columns } = matrices;
        let [gradient, half, along] =
            ["gradients along SOAP's axes"; 3].map(|name| plan.add(name, count * rows * columns));
        let table = plan.add("places of the matrices", count * size_of::<MatrixPlace>() / 4);
        let sides = [rows, columns].map(|stride| SidePlaces::plan(plan, count, stride));
        Self { config, matrices, table, gradient, half, along, sides }
    }

    /// What a step writes before it reads it.
    pub(super) fn scratch(&self) -> Vec<usize> {
        let of_sides = self.sides.iter().flat_map(SidePlaces::scratch);
        [self.gradient, self.half, self.along].into_iter().chain(of_sides).collect()
    }
}

/// The kernels of a step, bound.
#[derive(Debug)]
pub(super) struct SoapStep {
    matrices: Matrices,
    look_every: u64,
    gather: Bound,
    turn: [BoundProduct; 2],
    moments: Bound,
    turn_back: [BoundProduct; 2],
    update: Bound,
    sides: [SideStep; 2],
    follow: Follow,
}

/// How moments come to the axes of the last look.
#[derive(Debug)]
struct Follow {
    first_moment: Bound,
    turn: [BoundProduct; 2],
    first_moment_back: Bound,
    second_moment: Bound,
    second_moment_back: Bound,
}

impl SoapStep {
    /// Compiles and binds the kernels and uploads means and axes; `buffers` are those of the trainer's plan.
    pub(super) fn new(
        gpu: &Gpu,
        network: &Network,
        host: &Buffers,
        places: &SoapPlaces,
        buffers: &[wgpu::Buffer],
        state: &TrainingState,
    ) -> Result<Self, EngineError> {
        let SoapPlaces { config, matrices, .. } = *places;
        let Matrices { count, rows, columns } = matrices;
        let [table, gradient, half, along] =
            [places.table, places.gradient, places.half, places.along].map(|place| &buffers[place]);
        let block = matrices.upload(gpu, &network.layout, table, config.kept, |_| config.rate)?;
        for (side, numbers) in
            places.sides.iter().zip(Numbers::of_state(&network.layout, [rows, columns], state)?)
        {
            side.write(gpu, buffers, &numbers);
        }
        let kernel = |shader| Kernel::new(gpu, shader);
        let (gather, scatter) = (kernel(Shader::SoapGather)?, kernel(Shader::SoapScatter)?);
        let looks = LookKernels::new(gpu)?;
        let products = Products::new(gpu, count)?;
        let between = |left: Factor<'_>, middle: &wgpu::Buffer, right: Factor<'_>| {
            products.between([rows, columns], [left, Factor::Plain(middle), right], half, along)
        };
        let side = |side: usize, squares: [Factor<'_>; 2], inner: usize| {
            let own = &places.sides[side];
            let look = Look::new(gpu, &looks, &products, own, buffers, count)?;
            SideStep::new(look, &products, own, buffers, (squares, inner), config.kept)
        };
        let of_sides =
            |place: fn(&SidePlaces) -> usize| places.sides.each_ref().map(|side| &buffers[place(side)]);
        let [left, right] = of_sides(|side| side.axes);
        let [left_change, right_change] = of_sides(|side| side.turned);
        let [rows_order, columns_order] = of_sides(|side| side.order);
        let [first_moment, second_moment] = [&host.first_moment, &host.second_moment];
        let (plain, transposed) = (Factor::Plain(gradient), Factor::Transposed(gradient));
        Ok(Self {
            matrices,
            look_every: config.look_every,
            gather: gather.bind(gpu, &[&block, table, &host.gradient, gradient]),
            turn: between(Factor::Transposed(left), gradient, Factor::Plain(right))?,
            moments: kernel(Shader::SoapMoments)?
                .bind(gpu, &[&block, &host.step, table, along, first_moment, second_moment]),
            turn_back: between(Factor::Plain(left), along, Factor::Transposed(right))?,
            update: kernel(Shader::MatricesUpdate)?
                .bind(gpu, &[&block, &host.step, table, along, &network.parameters]),
            sides: [side(0, [plain, transposed], columns)?, side(1, [transposed, plain], rows)?],
            follow: Follow {
                first_moment: gather.bind(gpu, &[&block, table, first_moment, along]),
                turn: between(Factor::Plain(left_change), along, Factor::Transposed(right_change))?,
                first_moment_back: scatter.bind(gpu, &[&block, table, along, first_moment]),
                second_moment: kernel(Shader::SoapFollow)?
                    .bind(gpu, &[&block, table, rows_order, columns_order, second_moment, half]),
                second_moment_back: scatter.bind(gpu, &[&block, table, half, second_moment]),
            },
        })
    }

    /// Step number `step`, counted from 1, by a gradient that is whole.
    pub(super) fn record(&self, pass: &mut wgpu::ComputePass<'_>, step: u64) {
        let matrices = &self.matrices;
        matrices.each(pass, &self.gather);
        if step == 1 {
            for side in &self.sides {
                side.first_mean.record(pass);
                (0..FIRST_LOOKS).for_each(|_| side.look.record(pass));
            }
            return;
        }
        self.turn.iter().for_each(|product| product.record(pass));
        matrices.each(pass, &self.moments);
        self.turn_back.iter().for_each(|product| product.record(pass));
        matrices.each(pass, &self.update);
        self.sides.iter().for_each(|side| side.next_mean.record(pass));
        if (step - 1).is_multiple_of(self.look_every) {
            for side in &self.sides {
                side.look.record(pass);
                side.change.record(pass);
            }
            let follow = &self.follow;
            matrices.each(pass, &follow.first_moment);
            follow.turn.iter().for_each(|product| product.record(pass));
            for kernel in [&follow.first_moment_back, &follow.second_moment, &follow.second_moment_back] {
                matrices.each(pass, kernel);
            }
        }
    }

    /// Means and axes, as a state has them.
    pub(super) fn kept(&self, gpu: &Gpu, layout: &PaddedLayout) -> Result<Vec<f32>, EngineError> {
        let [rows, columns] = self.sides.each_ref().map(|side| side.read(gpu, self.matrices.count));
        let strides = self.sides.each_ref().map(|side| side.stride);
        Ok(Numbers::to_state(layout, strides, &[rows?, columns?]))
    }
}
