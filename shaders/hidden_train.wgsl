// Purpose: end of a hidden layer in training: activation sin(ω·(S + b)), and its slope ω·cos(ω·(S + b)) for the
// backward pass.
//
// One call takes four columns of one row.
//   activations  [padded_rows][stride], first `outputs` columns of the next layer's signal
//   slopes       [padded_rows][outputs]

@group(0) @binding(4) var<storage, read_write> activations: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> slopes: array<vec4<f32>>;

fn store(slice: u32, row: u32, column: u32, sums: vec4<f32>) {
    let wave = sine_cosine(layer.omega * (sums + bias(column)));
    activations[(row * layer.stride + column) / 4u] = wave.sine;
    slopes[(row * layer.outputs + column) / 4u] = layer.omega * wave.cosine;
}
