// Purpose: the product of a dense layer's forward pass, S = X·Wᵀ. What becomes of S + b stands in the file that follows
// (`hidden_train`, `hidden_evaluate` or `linear`).
//
// One invocation computes a block of S [padded_rows][outputs]; see the product's file.
//   parameters  whole network, padded layout, as vec4
//   signal      X [padded_rows][inputs], as vec4

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<uniform> layer: Layer;
@group(0) @binding(2) var<storage, read> parameters: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> signal: array<vec4<f32>>;

fn extent(slice: u32) -> Extent {
    return Extent(batch.padded_rows, layer.outputs, 0u, layer.inputs);
}

/// X[row][k]
fn left(row: u32, k: u32) -> mat4x4<f32> {
    let at = (row * layer.inputs + k) / 4u;
    let next = layer.inputs / 4u;
    return transpose(mat4x4<f32>(signal[at], signal[at + next], signal[at + 2u * next], signal[at + 3u * next]));
}

/// W[column][k]
fn right(k: u32, column: u32) -> mat4x4<f32> {
    let at = (layer.weights + column * layer.inputs + k) / 4u;
    let next = layer.inputs / 4u;
    return transpose(mat4x4<f32>(
        parameters[at], parameters[at + next], parameters[at + 2u * next], parameters[at + 3u * next],
    ));
}

/// b[column]
fn bias(column: u32) -> vec4<f32> {
    return parameters[(layer.biases + column) / 4u];
}
