// Purpose: C[row][column] = Σ_k left(row, k)·right(k, column), operands staged in workgroup memory, 64 outputs an invocation.
//
// A workgroup of 8 × 8 invocations computes TILE × TILE = 64 × 64 outputs, z counts slices; one invocation computes 2 × 2 blocks of
// 4 × 4, half a tile apart, so that neighbours read neighbouring words of workgroup memory. Of every four numbers that it reads there
// it makes 16 multiply-adds, twice as many as `product_tiled.wgsl`, in four times the registers. For each TILE_DEPTH = 32 values of k an
// invocation fetches two 4 × 4 blocks of either operand. The sum runs over k in the same order as in the other products.
//
// What is staged, and what of, stand in `product_tiles.wgsl` and `product.wgsl`.

/// From a block of an invocation to its next, in fours.
const APART: u32 = QUADS / 2u;

/// sums + l·rᵀ; column i of the sums is row i of the output.
fn outer(sums: mat4x4<f32>, l: vec4<f32>, r: vec4<f32>) -> mat4x4<f32> {
    return mat4x4<f32>(sums[0] + l.x * r, sums[1] + l.y * r, sums[2] + l.z * r, sums[3] + l.w * r);
}

@compute @workgroup_size(REGISTER_GROUP, REGISTER_GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
    @builtin(local_invocation_index) index: u32,
) {
    let slice = group.z;
    let first_row = group.y * TILE;
    let first_column = group.x * TILE;
    let e = extent(slice);
    // The blocks that this invocation fetches: 16 along the outputs × 4 along k, and those half a stage on.
    let quad = index % QUADS;
    let depth = 4u * (index / QUADS);
    let later = depth + TILE_DEPTH / 2u;

    var c00 = mat4x4<f32>();
    var c01 = mat4x4<f32>();
    var c10 = mat4x4<f32>();
    var c11 = mat4x4<f32>();
    for (var k = e.first; k < e.end; k += TILE_DEPTH) {
        stage_left(depth * QUADS + quad, left(first_row + 4u * quad, k + depth));
        stage_left(later * QUADS + quad, left(first_row + 4u * quad, k + later));
        stage_right(depth * QUADS + quad, right(k + depth, first_column + 4u * quad));
        stage_right(later * QUADS + quad, right(k + later, first_column + 4u * quad));
        workgroupBarrier();
        for (var j = 0u; j < TILE_DEPTH; j += 1u) {
            let at = j * QUADS;
            let l0 = vec4<f32>(lefts[at + local.y]);
            let l1 = vec4<f32>(lefts[at + local.y + APART]);
            let r0 = vec4<f32>(rights[at + local.x]);
            let r1 = vec4<f32>(rights[at + local.x + APART]);
            c00 = outer(c00, l0, r0);
            c01 = outer(c01, l0, r1);
            c10 = outer(c10, l1, r0);
            c11 = outer(c11, l1, r1);
        }
        workgroupBarrier();
    }
    let row = first_row + 4u * local.y;
    let column = first_column + 4u * local.x;
    store_block(slice, row, column, c00);
    store_block(slice, row, column + 4u * APART, c01);
    store_block(slice, row + 4u * APART, column, c10);
    store_block(slice, row + 4u * APART, column + 4u * APART, c11);
}
