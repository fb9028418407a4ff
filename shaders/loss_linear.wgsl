// Purpose: loss of every sample behind linear outputs, summed over the outputs, and the delta that starts the backward pass:
//   Δ = scale · ∂loss/∂s / count
//
// One invocation computes every (invocations)-th row. Rows of padding get loss and delta 0, which keeps them out of
// every gradient; so do outputs of padding, whose weights and targets are none.
//   sums        s [padded_rows][outputs]
//   targets     [rows][targets of a row], as many as the network has outputs without padding
//   deltas      Δ [padded_rows][outputs]
//   row_losses  [padded_rows]

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<uniform> layer: Layer;
@group(0) @binding(2) var<uniform> step: Step;
@group(0) @binding(3) var<storage, read> sums: array<f32>;
@group(0) @binding(4) var<storage, read> targets: array<f32>;
@group(0) @binding(5) var<storage, read_write> deltas: array<f32>;
@group(0) @binding(6) var<storage, read_write> row_losses: array<f32>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var row = id.x; row < batch.padded_rows; row += groups.x * LINEAR_GROUP) {
        var loss = 0.0;
        for (var column = 0u; column < layer.outputs; column += 1u) {
            let at = row * layer.outputs + column;
            var delta = 0.0;
            if row < batch.rows && column < step.learnt {
                let error = sums[at] - targets[row * step.learnt + column];
                let slope = select(sign(error), 2.0 * error, step.loss == LOSS_L2);
                loss += select(abs(error), error * error, step.loss == LOSS_L2);
                delta = slope * (step.scale * step.inverse_count);
            }
            deltas[at] = delta;
        }
        row_losses[row] = loss;
    }
}
