// Purpose: end of a hidden layer in evaluation: activation sin(ω·(S + b)).
//
// One call takes four columns of one row.
//   activations  [padded_rows][stride], first `outputs` columns of the next layer's signal

@group(0) @binding(4) var<storage, read_write> activations: array<vec4<f32>>;

fn store(slice: u32, row: u32, column: u32, sums: vec4<f32>) {
    activations[(row * layer.stride + column) / 4u] = sine_cosine(layer.omega * (sums + bias(column))).sine;
}
