// Purpose: C[row][column] = Σ_k left(row, k)·right(k, column), factors rounded to f16, multiplied and summed in f32 by the
// matrix units of the hardware.
//
// A workgroup of 256 invocations computes TILE × TILE = 64 × 64 outputs, z counts slices. Each of its subgroups holds two
// fragments of FRAGMENT × FRAGMENT outputs side by side: 16 × 16 where a subgroup has 32 invocations, 8 × 8 where it has 8
// (`shader.rs`). For each TILE_DEPTH = 32 values of k the operands are fetched as in `product_tiled.wgsl`; each subgroup then
// multiplies its fragments in steps of FRAGMENT. The sums go through workgroup memory to the invocations that store
// them: 24 KiB in all.
//
// The layer's file defines `extent`, `left`, `right` and `store` as `product.wgsl` describes; rows and columns
// are multiples of TILE, the range of k of TILE_DEPTH. The order in which a fragment's products are summed is the
// hardware's, the same in every run.

/// [k][row] and [k][column], k within the stage.
var<workgroup> lefts: array<f16, TILE_DEPTH * TILE>;
var<workgroup> rights: array<f16, TILE_DEPTH * TILE>;
/// [row][column]
var<workgroup> products: array<f32, TILE * TILE>;

@compute @workgroup_size(TILED_GROUP * TILED_GROUP)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_index) index: u32,
    @builtin(subgroup_id) subgroup: u32,
) {
    let slice = group.z;
    let first_row = group.y * TILE;
    let first_column = group.x * TILE;
    let e = extent(slice);
    // The 4 × 4 block that this invocation fetches: 16 along the outputs × 8 along k for each operand.
    let half = TILED_GROUP * TILED_GROUP / 2u;
    let along = 4u * ((index % half) % (TILE / 4u));
    let depth = 4u * ((index % half) / (TILE / 4u));
    // Where the two fragments of this subgroup begin.
    let pairs = TILE / (2u * FRAGMENT);
    let fragment_row = FRAGMENT * (subgroup / pairs);
    let fragment_column = 2u * FRAGMENT * (subgroup % pairs);

    var sums0 = Sums();
    var sums1 = Sums();
    for (var k = e.first; k < e.end; k += TILE_DEPTH) {
        if index < half {
            let fetched = left(first_row + along, k + depth);
            for (var j = 0u; j < 4u; j += 1u) {
                let at = (depth + j) * TILE + along;
                let four = vec4<f16>(fetched[j]);
                lefts[at] = four.x;
                lefts[at + 1u] = four.y;
                lefts[at + 2u] = four.z;
                lefts[at + 3u] = four.w;
            }
        } else {
            let fetched = right(k + depth, first_column + along);
            for (var j = 0u; j < 4u; j += 1u) {
                let at = (depth + j) * TILE + along;
                let four = vec4<f16>(fetched[j]);
                rights[at] = four.x;
                rights[at + 1u] = four.y;
                rights[at + 2u] = four.z;
                rights[at + 3u] = four.w;
            }
        }
        workgroupBarrier();
        for (var j = 0u; j < TILE_DEPTH; j += FRAGMENT) {
            // Columns of the left operand lie side by side, rows of the right one.
            let l = coopLoad<Left>(&lefts[j * TILE + fragment_row], TILE);
            let r0 = coopLoadT<Right>(&rights[j * TILE + fragment_column], TILE);
            let r1 = coopLoadT<Right>(&rights[j * TILE + fragment_column + FRAGMENT], TILE);
            sums0 = coopMultiplyAdd(l, r0, sums0);
            sums1 = coopMultiplyAdd(l, r1, sums1);
        }
        workgroupBarrier();
    }
    coopStoreT(sums0, &products[fragment_row * TILE + fragment_column], TILE);
    coopStoreT(sums1, &products[fragment_row * TILE + fragment_column + FRAGMENT], TILE);
    workgroupBarrier();
    let row = 4u * (index / TILED_GROUP);
    let column = 4u * (index % TILED_GROUP);
    for (var j = 0u; j < 4u; j += 1u) {
        let at = (row + j) * TILE + column;
        let four = vec4<f32>(products[at], products[at + 1u], products[at + 2u], products[at + 3u]);
        store(slice, first_row + row + j, first_column + column, four);
    }
}
