//! What a trainer allocates, and how a batch is cut into slices of rows.

use crate::device::GpuLimits;
use crate::forward::rows_per_pass;
use crate::layout::PaddedLayout;
use crate::memory::Plan;
use crate::submit::PASSES_AT_ONCE;
use crate::uniforms::{Batch, Step};

/// Rows that one partial gradient sums: four slices of the paper's batch of 1024 give a GPU four times the workgroups
/// in the weight gradients.
const SLICE_ROWS: usize = 256;
/// Partial gradients at most: each costs the memory of all parameters.
const MAX_SLICES: usize = 8;
/// Elements of several batches that go up together, at most: 16 MiB.
const MOST_UPLOADED: usize = 1 << 22;
/// Steps whose losses wait on the device before they are read.
pub(super) const LOSS_SLOTS: usize = 4096;

/// What a trainer allocates beside its optimiser of the matrices, last every layer's signals and every layer's deltas; how many
/// rows one pass holds, and how many partial gradients there are.
pub(super) fn plan(layout: &PaddedLayout, limits: GpuLimits, max_batch: usize) -> (Plan, usize, usize) {
    let (inputs, outputs) = (layout.stack.inputs, layout.stack.outputs);
    let rows = rows_per_pass(layout, limits, max_batch);
    let binding = limits.binding() as usize;
    let max_slices = (binding / (4 * layout.parameters)).clamp(1, MAX_SLICES);
    // A smaller batch may have more slices than the largest one, never more than this.
    let slices = rows.div_ceil(SLICE_ROWS).min(max_slices);
    // The host's data of one part of a batch, and of as many as go in one submission while that is little.
    let one = rows * (inputs + outputs) + (size_of::<Batch>() + size_of::<Step>()) / 4;
    let upload = (PASSES_AT_ONCE * one).min(MOST_UPLOADED.min(binding / 4)).max(one);
    let mut plan = Plan::default();
    for (name, elements) in [
        ("parameters", layout.parameters),
        ("first moments", layout.parameters),
        ("second moments", layout.parameters),
        ("gradient", layout.parameters),
        ("partial gradients", slices * layout.parameters),
        ("upload of the batches", upload),
        ("samples", rows * inputs),
        ("targets", rows * outputs),
        ("losses of the rows", rows),
        ("losses of the steps", LOSS_SLOTS),
        ("results", rows * layout.layers.last().map_or(0, |layer| layer.outputs)),
    ] {
        plan.add(name, elements);
    }
    plan.add_layers(layout, rows);
    (plan, rows, max_slices)
}

/// Rows of one partial gradient, and how many of them `padded_rows` make.
pub(super) fn slice(padded_rows: usize, max_slices: usize) -> (usize, usize) {
    let rows = padded_rows.div_ceil(max_slices).next_multiple_of(SLICE_ROWS);
    (rows, padded_rows.div_ceil(rows))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slices_cover_the_rows_and_never_outnumber_the_buffer() {
        for max_slices in 1..=MAX_SLICES {
            for rows in (8..5000).step_by(8) {
                let (slice_rows, slices) = slice(rows, max_slices);
                assert!(slice_rows * slices >= rows && slice_rows * (slices - 1) < rows);
                assert!(slices <= max_slices && slices <= rows.div_ceil(SLICE_ROWS));
            }
        }
    }
}
