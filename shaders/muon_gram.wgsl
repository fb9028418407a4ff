// Purpose: first product of a Newton-Schulz step of Muon, A = X·Xᵀ.
//
// One invocation computes a block of A [rows][rows] of matrix z; see the product's file.
//   directions  X [matrices][rows][columns]
//   gram        A [matrices][rows][rows]

@group(0) @binding(0) var<uniform> between: Between;
@group(0) @binding(1) var<storage, read> directions: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> gram: array<vec4<f32>>;

/// Where this invocation's matrix begins.
var<private> first: u32;

fn extent(slice: u32) -> Extent {
    first = slice * between.rows * between.columns;
    return Extent(between.rows, between.rows, 0u, between.columns);
}

/// X[row][k]
fn left(row: u32, k: u32) -> mat4x4<f32> {
    let at = (first + row * between.columns + k) / 4u;
    let next = between.columns / 4u;
    return transpose(mat4x4<f32>(
        directions[at], directions[at + next], directions[at + 2u * next], directions[at + 3u * next],
    ));
}

/// X[column][k]
fn right(k: u32, column: u32) -> mat4x4<f32> {
    return left(column, k);
}

fn store(slice: u32, row: u32, column: u32, sums: vec4<f32>) {
    gram[((slice * between.rows + row) * between.rows + column) / 4u] = sums;
}
