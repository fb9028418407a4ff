// Purpose: values of the network, y = max(open(s), 0).
//
// One invocation computes every (invocations)-th row.
//   sums     s [padded_rows][outputs], column 0
//   outputs  written at base..base + rows

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<uniform> layer: Layer;
@group(0) @binding(2) var<uniform> sweep: Sweep;
@group(0) @binding(3) var<storage, read> sums: array<f32>;
@group(0) @binding(4) var<storage, read_write> outputs: array<f32>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var row = id.x; row < batch.rows; row += groups.x * LINEAR_GROUP) {
        outputs[sweep.base + row] = output_value(open_output(sums[row * layer.outputs]));
    }
}
