// Purpose: gradient of a layer's weights, ∂W[o][i] = Σ_rows Δ[row][o]·X[row][i], as one partial sum for each slice of
// rows; `reduce.wgsl` adds the slices.
//
// One invocation computes a block of ∂W [outputs][inputs] of slice z; see the product's file.
//   deltas    Δ [padded_rows][outputs]
//   signal    X [padded_rows][inputs]
//   partials  [slices][parameters], the layer's place in the padded layout

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<uniform> layer: Layer;
@group(0) @binding(2) var<storage, read> deltas: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> signal: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> partials: array<vec4<f32>>;

fn extent(slice: u32) -> Extent {
    let first = slice * batch.slice_rows;
    return Extent(layer.outputs, layer.inputs, first, min(first + batch.slice_rows, batch.padded_rows));
}

/// Δ[k][row]
fn left(row: u32, k: u32) -> mat4x4<f32> {
    let at = (k * layer.outputs + row) / 4u;
    let next = layer.outputs / 4u;
    return mat4x4<f32>(deltas[at], deltas[at + next], deltas[at + 2u * next], deltas[at + 3u * next]);
}

/// X[k][column]
fn right(k: u32, column: u32) -> mat4x4<f32> {
    let at = (k * layer.inputs + column) / 4u;
    let next = layer.inputs / 4u;
    return mat4x4<f32>(signal[at], signal[at + next], signal[at + 2u * next], signal[at + 3u * next]);
}

fn store(slice: u32, row: u32, column: u32, sums: vec4<f32>) {
    partials[(slice * layer.parameters + layer.weights + row * layer.inputs + column) / 4u] = sums;
}
