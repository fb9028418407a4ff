//! The rows, or the columns, of all matrices: their mean, its axes, and how these are found.

use imf_core::field::EngineError;
use imf_fields::recipe::TrainingState;
use imf_train::engine::soap::state_of;

use super::{Factor, Products};
use crate::device::Gpu;
use crate::kernel::Dispatch;
use crate::layout::PaddedLayout;
use crate::memory::allocate;
use crate::uniforms::Side;

/// What belongs to one side; all but table, order and line are `[matrices][stride][stride]`.
pub(super) struct SideBuffers {
    pub(super) stride: usize,
    /// A [`Side`] each.
    pub(super) table: wgpu::Buffer,
    pub(super) mean: wgpu::Buffer,
    pub(super) axes: wgpu::Buffer,
    /// M·Q, then the vectors of its reflections; after an update the new axes along those before.
    pub(super) turned: wgpu::Buffer,
    pub(super) before: wgpu::Buffer,
    pub(super) reflections: wgpu::Buffer,
    pub(super) order: wgpu::Buffer,
    pub(super) line: wgpu::Buffer,
}

impl SideBuffers {
    /// With means and axes, and an order in which padding stays in place.
    pub(super) fn new(gpu: &Gpu, numbers: &Numbers, count: usize) -> Result<Self, EngineError> {
        let stride = numbers.stride;
        let square = count * stride * stride;
        let sizes = [
            ("sides of the matrices", count * size_of::<Side>() / 4),
            ("means of SOAP", square),
            ("axes of SOAP", square),
            ("SOAP's axes turned", square),
            ("SOAP's axes before", square),
            ("reflections of SOAP's axes", square),
            ("order of SOAP's axes", count * stride),
            ("means along SOAP's axes", count * stride),
        ];
        let [table, mean, axes, turned, before, reflections, order, line] = allocate(gpu, sizes)?;
        gpu.write(&table, &numbers.table);
        gpu.write(&mean, &numbers.mean);
        gpu.write(&axes, &numbers.axes);
        gpu.write(&order, &numbers.table.iter().flat_map(|side| 0..side.stride).collect::<Vec<_>>());
        Ok(Self { stride, table, mean, axes, turned, before, reflections, order, line })
    }

    /// What a step writes before it reads it.
    pub(super) fn scratch(&self) -> [wgpu::Buffer; 4] {
        [&self.turned, &self.before, &self.reflections, &self.line].map(Clone::clone)
    }
}

/// What a step does with one side.
#[derive(Debug)]
pub(super) struct SideStep {
    pub(super) stride: usize,
    mean: wgpu::Buffer,
    axes: wgpu::Buffer,
    /// The first gradient's products, and every other's.
    pub(super) first_mean: Dispatch,
    pub(super) next_mean: Dispatch,
    pub(super) update: Vec<Dispatch>,
    /// The new axes along those before.
    pub(super) change: Dispatch,
}

impl SideStep {
    /// `squares` are the factors of the mean's products, which have `inner` terms; `beta` is the fraction of the mean
    /// that a step leaves.
    pub(super) fn new(
        update: Vec<Dispatch>,
        products: &Products<'_>,
        buffers: &SideBuffers,
        squares: [Factor<'_>; 2],
        inner: usize,
        beta: f32,
    ) -> Result<Self, EngineError> {
        let SideBuffers { stride, mean, axes, turned, before, .. } = buffers;
        let stride = *stride;
        let size = [stride, stride, inner];
        Ok(Self {
            stride,
            mean: mean.clone(),
            axes: axes.clone(),
            first_mean: products.of(size, squares, mean)?,
            next_mean: products.added(size, squares, mean, [beta, 1.0 - beta])?,
            update,
            change: products.of([stride; 3], [Factor::Transposed(axes), Factor::Plain(before)], turned)?,
        })
    }

    /// Means and axes as they stand on the device.
    pub(super) fn read(&self, gpu: &Gpu, count: usize) -> Result<[Vec<f32>; 2], EngineError> {
        let count = count * self.stride * self.stride;
        Ok([gpu.read(&self.mean, count)?, gpu.read(&self.axes, count)?])
    }
}

/// What one side's buffers hold.
pub(super) struct Numbers {
    stride: usize,
    table: Vec<Side>,
    mean: Vec<f32>,
    axes: Vec<f32>,
}

impl Numbers {
    /// Means and axes of a state, of rows and of columns; before the first step no mean, and the weights' own axes.
    pub(super) fn of_state(
        layout: &PaddedLayout,
        strides: [usize; 2],
        state: &TrainingState,
    ) -> Result<[Self; 2], EngineError> {
        let matrices = state_of(&layout.stack, state.step, &state.preconditioners)?;
        let mut numbers = strides.map(|stride| {
            let zeros = vec![0.0; matrices.len() * stride * stride];
            Self { stride, table: Vec::new(), mean: zeros.clone(), axes: zeros }
        });
        for (matrix, (sides, mut kept)) in sides_of(layout, strides).zip(matrices).enumerate() {
            for (numbers, side) in numbers.iter_mut().zip(sides) {
                numbers.table.push(side);
                let Some((mean, others)) = kept.split_at_checked((side.size * side.size) as usize) else {
                    let diagonal = pairs(&side, matrix).filter(|[here, across]| here == across);
                    diagonal.for_each(|[here, _]| numbers.axes[here] = 1.0);
                    continue;
                };
                let (axes, others) = others.split_at(mean.len());
                kept = others;
                for ([here, across], (&mean, &axis)) in pairs(&side, matrix).zip(mean.iter().zip(axes)) {
                    numbers.mean[here] = mean;
                    numbers.axes[across] = axis;
                }
            }
        }
        Ok(numbers)
    }

    /// State, from rows and columns that were [read](SideStep::read).
    pub(super) fn to_state(
        layout: &PaddedLayout,
        strides: [usize; 2],
        read: &[[Vec<f32>; 2]; 2],
    ) -> Vec<f32> {
        let mut kept = Vec::new();
        for (matrix, sides) in sides_of(layout, strides).enumerate() {
            for ([mean, axes], side) in read.iter().zip(sides) {
                kept.extend(pairs(&side, matrix).map(|[here, _]| mean[here]));
                kept.extend(pairs(&side, matrix).map(|[_, across]| axes[across]));
            }
        }
        kept
    }
}

/// Rows and columns of every matrix.
fn sides_of(layout: &PaddedLayout, [rows, columns]: [usize; 2]) -> impl Iterator<Item = [Side; 2]> {
    layout.between().iter().zip(layout.learnt_between()).map(move |(padded, learnt)| {
        let neurons = learnt.outputs as u32;
        // Behind a skip the network's inputs stand after the padded activations.
        let gap = padded.outputs as u32 - neurons;
        [
            Side { size: neurons, split: neurons, gap, stride: rows as u32 },
            Side { size: learnt.inputs as u32, split: neurons, gap, stride: columns as u32 },
        ]
    })
}

/// Of the numbers of a square one after the other, those of a row side by side, where each stands on the device, and where its
/// mirror image does.
fn pairs(side: &Side, matrix: usize) -> impl Iterator<Item = [usize; 2]> {
    let Side { size, split, gap, stride } = *side;
    let place = move |i: u32| (if i < split { i } else { i + gap }) as usize;
    let stride = stride as usize;
    let first = matrix * stride * stride;
    let at = move |row: u32, column: u32| first + place(row) * stride + place(column);
    (0..size).flat_map(move |row| (0..size).map(move |column| [at(row, column), at(column, row)]))
}
