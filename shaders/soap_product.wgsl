// Purpose: a product of SOAP's, C ← kept·C + share·A·B.
//
// One invocation computes a block of C of matrix z; see the product's file.
//   left     A [matrices][rows][inner], or [matrices][inner][rows]
//   right    B [matrices][inner][columns], or [matrices][columns][inner]
//   results  C [matrices][rows][columns]; where `kept` is 0, what stands there is not read

@group(0) @binding(0) var<uniform> product: Product;
@group(0) @binding(1) var<storage, read> lefts_stored: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> rights_stored: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> results: array<vec4<f32>>;

/// Where this invocation's matrices begin, in vec4.
var<private> first_left: u32;
var<private> first_right: u32;

fn extent(slice: u32) -> Extent {
    first_left = slice * product.rows * product.inner / 4u;
    first_right = slice * product.inner * product.columns / 4u;
    return Extent(product.rows, product.columns, 0u, product.inner);
}

/// A[row][k]
fn left(row: u32, k: u32) -> mat4x4<f32> {
    if product.left_transposed == 1u {
        let next = product.rows / 4u;
        let at = first_left + k * next + row / 4u;
        return mat4x4<f32>(
            lefts_stored[at], lefts_stored[at + next], lefts_stored[at + 2u * next], lefts_stored[at + 3u * next],
        );
    }
    let next = product.inner / 4u;
    let at = first_left + row * next + k / 4u;
    return transpose(mat4x4<f32>(
        lefts_stored[at], lefts_stored[at + next], lefts_stored[at + 2u * next], lefts_stored[at + 3u * next],
    ));
}

/// B[k][column]
fn right(k: u32, column: u32) -> mat4x4<f32> {
    if product.right_transposed == 1u {
        let next = product.inner / 4u;
        let at = first_right + column * next + k / 4u;
        return transpose(mat4x4<f32>(
            rights_stored[at], rights_stored[at + next], rights_stored[at + 2u * next], rights_stored[at + 3u * next],
        ));
    }
    let next = product.columns / 4u;
    let at = first_right + k * next + column / 4u;
    return mat4x4<f32>(
        rights_stored[at], rights_stored[at + next], rights_stored[at + 2u * next], rights_stored[at + 3u * next],
    );
}

fn store(slice: u32, row: u32, column: u32, sums: vec4<f32>) {
    let at = ((slice * product.rows + row) * product.columns + column) / 4u;
    var result = product.share * sums;
    if product.kept != 0.0 {
        result += product.kept * results[at];
    }
    results[at] = result;
}
