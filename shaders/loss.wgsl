// Purpose: loss of every sample and the delta that starts the backward pass:
//   y = open(s), for a target t of 0 max(open(s), 0);  Δ = scale · w · ∂loss/∂y · ∂y/∂s / count
//
// One invocation computes every (invocations)-th row. Rows of padding get loss and delta 0, which keeps them out of
// every gradient.
//   sums        s [padded_rows][outputs], column 0
//   targets     [padded_rows], read below `rows`
//   deltas      Δ [padded_rows][outputs], columns past 0 are padding: 0
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
        var delta = 0.0;
        if row < batch.rows {
            let open = open_output(sums[row * layer.outputs]);
            let goal = targets[row];
            // What is below 0 is right for a target of 0, and the error is 0.
            let y = select(output_value(open), open, goal > 0.0);
            let error = y - goal;
            let slope = select(sign(error), 2.0 * error, step.loss == LOSS_L2);
            let weight = select(1.0, 1.0 + SMALL_MORE * exp(-goal / SMALL_BELOW), step.loss == LOSS_L1_SMALL);
            loss = select(abs(error), error * error, step.loss == LOSS_L2);
            delta = weight * slope * open_slope(open) * (step.scale * step.inverse_count);
        }
        row_losses[row] = loss;
        deltas[row * layer.outputs] = delta;
        for (var column = 1u; column < layer.outputs; column += 1u) {
            deltas[row * layer.outputs + column] = 0.0;
        }
    }
}
