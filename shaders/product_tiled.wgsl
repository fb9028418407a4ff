// Purpose: C[row][column] = Σ_k left(row, k)·right(k, column), operands staged in workgroup memory.
//
// A workgroup of 16 × 16 invocations computes TILE × TILE = 64 × 64 outputs, z counts slices; one invocation computes
// 4 rows × 4 columns. For each TILE_DEPTH = 32 values of k the first half of the workgroup fetches one 4 × 4 block each
// of the left operand, the second half of the right: 16 KiB, what every adapter has. The sum runs over k in the same
// order as in `product_register.wgsl`, so both give the same bits where the compiler contracts both alike.
//
// What is staged, and what of, stand in `product_tiles.wgsl` and `product.wgsl`.

@compute @workgroup_size(TILED_GROUP, TILED_GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
    @builtin(local_invocation_index) index: u32,
) {
    let slice = group.z;
    let first_row = group.y * TILE;
    let first_column = group.x * TILE;
    let e = extent(slice);
    // The block that this invocation fetches: 16 along the outputs × 8 along k for each operand.
    let half = TILED_GROUP * TILED_GROUP / 2u;
    let quad = (index % half) % QUADS;
    let depth = 4u * ((index % half) / QUADS);
    let at = depth * QUADS + quad;

    var sums = mat4x4<f32>();
    for (var k = e.first; k < e.end; k += TILE_DEPTH) {
        if index < half {
            stage_left(at, left(first_row + 4u * quad, k + depth));
        } else {
            stage_right(at, right(k + depth, first_column + 4u * quad));
        }
        workgroupBarrier();
        for (var j = 0u; j < TILE_DEPTH; j += 1u) {
            let l = vec4<f32>(lefts[j * QUADS + local.y]);
            let r = vec4<f32>(rights[j * QUADS + local.x]);
            sums = mat4x4<f32>(sums[0] + l.x * r, sums[1] + l.y * r, sums[2] + l.z * r, sums[3] + l.w * r);
        }
        workgroupBarrier();
    }
    let row = first_row + 4u * local.y;
    let column = first_column + 4u * local.x;
    store_block(slice, row, column, sums);
}
