// Purpose: puts the samples' inputs into a layer's signal, zeros in all padding: the first layer's whole signal, or the
// columns behind the activations where the network concatenates its input again.
//
// One invocation computes every (invocations)-th row.
//   samples  [rows][inputs]
//   signal   [padded_rows][stride], written at columns offset..offset + columns

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<uniform> placement: Placement;
@group(0) @binding(2) var<storage, read> samples: array<f32>;
@group(0) @binding(3) var<storage, read_write> signal: array<f32>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var row = id.x; row < batch.padded_rows; row += groups.x * LINEAR_GROUP) {
        let at = row * placement.stride + placement.offset;
        for (var column = 0u; column < placement.columns; column += 1u) {
            var value = 0.0;
            if row < batch.rows && column < placement.inputs {
                value = samples[row * placement.inputs + column];
            }
            signal[at + column] = value;
        }
    }
}
