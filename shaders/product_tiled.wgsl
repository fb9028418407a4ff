// Purpose: C[row][column] = Σ_k left(row, k)·right(k, column), operands staged in workgroup memory.
//
// A workgroup of 16 × 16 invocations computes TILE × TILE = 64 × 64 outputs, z counts slices; one invocation computes
// 4 rows × 4 columns. For each TILE_DEPTH = 32 values of k the first half of the workgroup fetches one 4 × 4 block each
// of the left operand, the second half of the right: 16 KiB, what every adapter has. The sum runs over k in the same
// order as in `product_register.wgsl`, so both give the same bits where the compiler contracts both alike.
//
// Operands (`product.wgsl`) are staged as `Factors` (`shader.rs`): vec4<f32>, or vec4<f16>, half the memory; f32 holds their
// products exactly. Rows and columns of the product are multiples of TILE, the range of k of TILE_DEPTH.

const QUADS: u32 = TILE / 4u;

// [k][row / 4] and [k][column / 4], k within the stage.
var<workgroup> lefts: array<Factors, TILE_DEPTH * QUADS>;
var<workgroup> rights: array<Factors, TILE_DEPTH * QUADS>;

/// A 4 × 4 block of the operand, column j at k + j; `at` is its first k's place.
fn stage_left(at: u32, fetched: mat4x4<f32>) {
    lefts[at] = Factors(fetched[0]);
    lefts[at + QUADS] = Factors(fetched[1]);
    lefts[at + 2u * QUADS] = Factors(fetched[2]);
    lefts[at + 3u * QUADS] = Factors(fetched[3]);
}

fn stage_right(at: u32, fetched: mat4x4<f32>) {
    rights[at] = Factors(fetched[0]);
    rights[at + QUADS] = Factors(fetched[1]);
    rights[at + 2u * QUADS] = Factors(fetched[2]);
    rights[at + 3u * QUADS] = Factors(fetched[3]);
}

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
