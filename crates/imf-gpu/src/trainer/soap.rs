//! SOAP's step on the device, beside Adam's: moments of the gradients of the matrices between hidden layers along
//! axes of their own. The definition and its source are [`imf_train::engine::soap`]'s, and so is the state between
//! steps, so that a training can move between CPU and GPU.
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

mod side;
mod update;

use imf_core::field::EngineError;
use imf_fields::recipe::{SoapConfig, TrainingState};
use imf_train::engine::soap::FIRST_UPDATES;

use super::Buffers;
use crate::device::Gpu;
use crate::forward::Network;
use crate::kernel::{Dispatch, Extent, Kernel, uniform};
use crate::layout::PaddedLayout;
use crate::memory::allocate;
use crate::shader::{LINEAR_GROUP, MATRIX_GROUPS, Shader};
use crate::uniforms::{Batch, Between, MatrixPlace, Product};
use side::{Numbers, SideBuffers, SideStep};
use update::UpdateKernels;

/// Goes over the numbers of all matrices.
const EACH: Extent = Extent::Sliced((MATRIX_GROUPS * LINEAR_GROUP) as usize);

/// The kernels of a step, bound.
#[derive(Debug)]
pub(super) struct SoapStep {
    count: usize,
    precondition_every: u64,
    gather: Dispatch,
    /// From the second step on.
    step: Vec<Dispatch>,
    sides: [SideStep; 2],
    /// Turns the moments to the axes of the last update.
    follow: Vec<Dispatch>,
    /// What a step writes before it reads it.
    pub(super) scratch: Vec<wgpu::Buffer>,
}

/// A factor as it stands, or its transpose.
#[derive(Clone, Copy)]
enum Factor<'a> {
    Plain(&'a wgpu::Buffer),
    Transposed(&'a wgpu::Buffer),
}

/// Products of all matrices together.
struct Products<'a> {
    gpu: &'a Gpu,
    kernel: Kernel,
}

impl Products<'_> {
    /// `to ← kept·to + share·left·right`, of `[rows, columns, inner]`.
    fn added(
        &self,
        [rows, columns, inner]: [usize; 3],
        factors: [Factor<'_>; 2],
        to: &wgpu::Buffer,
        [kept, share]: [f32; 2],
    ) -> Result<Dispatch, EngineError> {
        let [(left, left_transposed), (right, right_transposed)] = factors.map(|factor| match factor {
            Factor::Plain(buffer) => (buffer, 0),
            Factor::Transposed(buffer) => (buffer, 1),
        });
        let extent = Extent::SlicedProduct(rows, columns);
        let [rows, columns, inner] = [rows, columns, inner].map(|n| n as u32);
        let block = Product { rows, columns, inner, left_transposed, right_transposed, kept, share };
        let block = uniform(self.gpu, "product of SOAP", &block)?;
        Ok(self.kernel.bind(extent, &[&block, left, right, to]))
    }

    /// `to ← left·right`.
    fn of(
        &self,
        size: [usize; 3],
        factors: [Factor<'_>; 2],
        to: &wgpu::Buffer,
    ) -> Result<Dispatch, EngineError> {
        self.added(size, factors, to, [0.0, 1.0])
    }
}

impl SoapStep {
    /// Compiles and binds the kernels, allocates their buffers and uploads means and axes; none where there is one hidden layer.
    pub(super) fn new(
        gpu: &Gpu,
        network: &Network,
        host: &Buffers,
        config: SoapConfig,
        state: &TrainingState,
    ) -> Result<Option<Self>, EngineError> {
        let layout = &network.layout;
        let between = layout.between();
        let Some(columns) = between.iter().map(|layer| layer.inputs).max() else { return Ok(None) };
        let (count, rows) = (between.len(), between[0].outputs);
        let [table, gradient, half, along] = allocate(
            gpu,
            [
                ("places of the matrices", count * size_of::<MatrixPlace>() / 4),
                ("gradients of the matrices", count * rows * columns),
                ("half a product of SOAP", count * rows * columns),
                ("gradients along SOAP's axes", count * rows * columns),
            ],
        )?;
        let place = |layer: &crate::layout::PaddedLayer| MatrixPlace {
            weights: layer.weights as u32,
            columns: layer.inputs as u32,
            length: config.rate,
        };
        gpu.write(&table, &between.iter().map(place).collect::<Vec<_>>());
        let beta = config.beta;
        let block = Between { rows: rows as u32, columns: columns as u32, beta, one_minus_beta: 1.0 - beta };
        let block = uniform(gpu, "matrices", &block)?;
        let numbers = Numbers::of_state(layout, [rows, columns], state)?;
        let [left, right] = numbers.map(|numbers| SideBuffers::new(gpu, &numbers, count));
        let (left, right) = (left?, right?);

        let kernel = |shader| Kernel::new(gpu, shader);
        let (gather, scatter) = (kernel(Shader::SoapGather)?, kernel(Shader::SoapScatter)?);
        let each =
            |kernel: &Kernel, buffers: &[&wgpu::Buffer]| kernel.bind(EACH, &[&[&block], buffers].concat());
        let products = Products { gpu, kernel: kernel(Shader::SoapProduct)? };
        // `along ← left·(middle·right)`, by way of `half`.
        let turned = |left: Factor<'_>, middle: &wgpu::Buffer, right: Factor<'_>| {
            Ok::<_, EngineError>([
                products.of([rows, columns, columns], [Factor::Plain(middle), right], &half)?,
                products.of([rows, columns, rows], [left, Factor::Plain(&half)], &along)?,
            ])
        };
        let (step, parameters) = (&host.step, &network.parameters);
        let (first_moment, second_moment) = (&host.first_moment, &host.second_moment);
        let mut steps = Vec::new();
        steps.extend(turned(Factor::Transposed(&left.axes), &gradient, Factor::Plain(&right.axes))?);
        let moments = [step, &table, &along, first_moment, second_moment];
        steps.push(each(&kernel(Shader::SoapMoments)?, &moments));
        steps.extend(turned(Factor::Plain(&left.axes), &along, Factor::Transposed(&right.axes))?);
        steps.push(each(&kernel(Shader::MatricesUpdate)?, &[step, &table, &along, parameters]));

        let mut follow = vec![each(&gather, &[&table, first_moment, &along])];
        follow.extend(turned(Factor::Plain(&left.turned), &along, Factor::Transposed(&right.turned))?);
        follow.push(each(&scatter, &[&table, &along, first_moment]));
        let orders = [&table, &left.order, &right.order, second_moment, &half];
        follow.push(each(&kernel(Shader::SoapFollow)?, &orders));
        follow.push(each(&scatter, &[&table, &half, second_moment]));

        let updates = UpdateKernels::new(gpu)?;
        let (plain, transposed) = (Factor::Plain(&gradient), Factor::Transposed(&gradient));
        let side = |buffers: &SideBuffers, squares, inner| {
            let update = updates.update(gpu, &products, buffers)?;
            SideStep::new(update, &products, buffers, squares, inner, beta)
        };
        let sides = [side(&left, [plain, transposed], columns)?, side(&right, [transposed, plain], rows)?];
        let scratch = [&left, &right].into_iter().flat_map(SideBuffers::scratch);
        Ok(Some(Self {
            count,
            precondition_every: config.precondition_every,
            gather: each(&gather, &[&table, &host.gradient, &gradient]),
            step: steps,
            sides,
            follow,
            scratch: scratch.chain([gradient.clone(), half.clone(), along.clone()]).collect(),
        }))
    }

    /// Step number `step`, counted from 1, by a gradient that is whole.
    pub(super) fn record(&self, pass: &mut wgpu::ComputePass<'_>, step: u64) {
        let batch = Batch { slices: self.count as u32, ..Batch::default() };
        let mut record = |dispatches: &[Dispatch]| {
            dispatches.iter().for_each(|dispatch| dispatch.record(pass, batch));
        };
        record(std::slice::from_ref(&self.gather));
        if step == 1 {
            for side in &self.sides {
                record(std::slice::from_ref(&side.first_mean));
                (0..FIRST_UPDATES).for_each(|_| record(&side.update));
            }
            return;
        }
        record(&self.step);
        self.sides.iter().for_each(|side| record(std::slice::from_ref(&side.next_mean)));
        if (step - 1).is_multiple_of(self.precondition_every) {
            for side in &self.sides {
                record(&side.update);
                record(std::slice::from_ref(&side.change));
            }
            record(&self.follow);
        }
    }

    /// Means and axes, as a state has them.
    pub(super) fn kept(&self, gpu: &Gpu, layout: &PaddedLayout) -> Result<Vec<f32>, EngineError> {
        let [rows, columns] = self.sides.each_ref().map(|side| side.read(gpu, self.count));
        let strides = self.sides.each_ref().map(|side| side.stride);
        Ok(Numbers::to_state(layout, strides, &[rows?, columns?]))
    }
}
