// Purpose: delta of the layer below, Δ' = (Δ·W) ∘ ω·cos(ω·s'), where Δ = ∂loss/∂(W·a + b).
//
// One invocation computes a block of Δ' [padded_rows][upstream]; see the product's file.
//   parameters  whole network, padded layout, as vec4
//   deltas      Δ [padded_rows][outputs] of this layer
//   below       [padded_rows][upstream]: holds the slopes ω·cos(ω·s') of the layer below, becomes its Δ'

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<uniform> layer: Layer;
@group(0) @binding(2) var<storage, read> parameters: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> deltas: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> below: array<vec4<f32>>;

fn extent(slice: u32) -> Extent {
    return Extent(batch.padded_rows, layer.upstream, 0u, layer.outputs);
}

/// Δ[row][k]
fn left(row: u32, k: u32) -> mat4x4<f32> {
    let at = (row * layer.outputs + k) / 4u;
    let next = layer.outputs / 4u;
    return transpose(mat4x4<f32>(deltas[at], deltas[at + next], deltas[at + 2u * next], deltas[at + 3u * next]));
}

/// W[k][column]
fn right(k: u32, column: u32) -> mat4x4<f32> {
    let at = (layer.weights + k * layer.inputs + column) / 4u;
    let next = layer.inputs / 4u;
    return mat4x4<f32>(
        parameters[at], parameters[at + next], parameters[at + 2u * next], parameters[at + 3u * next],
    );
}

fn store(slice: u32, row: u32, column: u32, sums: vec4<f32>) {
    let at = (row * layer.upstream + column) / 4u;
    below[at] = sums * below[at];
}
