// Purpose: end of the output layer: S + b; the output is made of it by `loss.wgsl` or `outputs.wgsl`.
//
// One call takes four columns of one row.
//   results  [padded_rows][outputs]; column 0 is the network's, the others are padding

@group(0) @binding(4) var<storage, read_write> results: array<vec4<f32>>;

fn store(slice: u32, row: u32, column: u32, sums: vec4<f32>) {
    results[(row * layer.outputs + column) / 4u] = sums + bias(column);
}
