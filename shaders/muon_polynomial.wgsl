// Purpose: second product of a Newton-Schulz step of Muon, B = b·A + c·A·A.
//
// One invocation computes a block of B [rows][rows] of matrix z; see the product's file.
//   gram        A [matrices][rows][rows]
//   polynomial  B, likewise

@group(0) @binding(0) var<uniform> between: Between;
@group(0) @binding(1) var<storage, read> gram: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> polynomial: array<vec4<f32>>;

/// Where this invocation's matrix begins.
var<private> first: u32;

fn extent(slice: u32) -> Extent {
    first = slice * between.rows * between.rows;
    return Extent(between.rows, between.rows, 0u, between.rows);
}

/// A[row][k]
fn left(row: u32, k: u32) -> mat4x4<f32> {
    return transpose(right(row, k));
}

/// A[k][column]
fn right(k: u32, column: u32) -> mat4x4<f32> {
    let at = (first + k * between.rows + column) / 4u;
    let next = between.rows / 4u;
    return mat4x4<f32>(gram[at], gram[at + next], gram[at + 2u * next], gram[at + 3u * next]);
}

fn store(slice: u32, row: u32, column: u32, sums: vec4<f32>) {
    let at = ((slice * between.rows + row) * between.rows + column) / 4u;
    polynomial[at] = MUON_B * gram[at] + MUON_C * sums;
}
