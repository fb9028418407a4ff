// Purpose: third product of a Newton-Schulz step of Muon, X' = a·X + B·X, nearer to orthonormal rows than X.
//
// One invocation computes a block of X' [rows][columns] of matrix z; see the product's file.
//   polynomial  B [matrices][rows][rows]
//   directions  X [matrices][rows][columns]
//   turned      X', likewise

@group(0) @binding(0) var<uniform> between: Between;
@group(0) @binding(1) var<storage, read> polynomial: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> directions: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> turned: array<vec4<f32>>;

/// The matrix of this invocation.
var<private> matrix: u32;

fn extent(slice: u32) -> Extent {
    matrix = slice;
    return Extent(between.rows, between.columns, 0u, between.rows);
}

/// B[row][k]
fn left(row: u32, k: u32) -> mat4x4<f32> {
    let at = ((matrix * between.rows + row) * between.rows + k) / 4u;
    let next = between.rows / 4u;
    return transpose(mat4x4<f32>(
        polynomial[at], polynomial[at + next], polynomial[at + 2u * next], polynomial[at + 3u * next],
    ));
}

/// X[k][column]
fn right(k: u32, column: u32) -> mat4x4<f32> {
    let at = ((matrix * between.rows + k) * between.columns + column) / 4u;
    let next = between.columns / 4u;
    return mat4x4<f32>(directions[at], directions[at + next], directions[at + 2u * next], directions[at + 3u * next]);
}

fn store(slice: u32, row: u32, column: u32, sums: vec4<f32>) {
    let at = ((slice * between.rows + row) * between.columns + column) / 4u;
    turned[at] = MUON_A * directions[at] + sums;
}
