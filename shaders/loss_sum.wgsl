// Purpose: a batch's mean loss, summed in fixed order, into the step's slot.
//
// One workgroup. Each invocation adds every LINEAR_GROUP-th row; the first then adds those sums in order.
//   row_losses  [padded_rows]
//   losses      [slots]

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<uniform> step: Step;
@group(0) @binding(2) var<storage, read> row_losses: array<f32>;
@group(0) @binding(3) var<storage, read_write> losses: array<f32>;

var<workgroup> partial: array<f32, LINEAR_GROUP>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(local_invocation_index) index: u32) {
    var sum = 0.0;
    for (var row = index; row < batch.padded_rows; row += LINEAR_GROUP) {
        sum += row_losses[row];
    }
    partial[index] = sum;
    workgroupBarrier();
    if index == 0u {
        var total = 0.0;
        for (var i = 0u; i < LINEAR_GROUP; i += 1u) {
            total += partial[i];
        }
        total *= step.inverse_count;
        if step.first == 0u {
            total += losses[step.slot];
        }
        losses[step.slot] = total;
    }
}
