// Purpose: gradient of a layer's biases, ∂b[o] = Σ_rows Δ[row][o], as one partial sum for each slice of rows.
//
// One invocation computes four biases of slice y, rows in ascending order.
//   deltas    Δ [padded_rows][outputs]
//   partials  [slices][parameters], the layer's place in the padded layout

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<uniform> layer: Layer;
@group(0) @binding(2) var<storage, read> deltas: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> partials: array<vec4<f32>>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let quads = layer.outputs / 4u;
    if id.x >= quads {
        return;
    }
    let slice = id.y;
    let first = slice * batch.slice_rows;
    let end = min(first + batch.slice_rows, batch.padded_rows);
    var sum = vec4<f32>();
    for (var row = first; row < end; row += 1u) {
        sum += deltas[row * quads + id.x];
    }
    partials[(slice * layer.parameters + layer.biases) / 4u + id.x] = sum;
}
