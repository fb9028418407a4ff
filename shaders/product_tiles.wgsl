// Purpose: tiles of the operands in workgroup memory, for the products that stage them as vectors: 16 KiB, what every adapter has.
//
// They are staged as `Factors` (`shader.rs`): vec4<f32>, or vec4<f16>, half the memory; f32 holds their products exactly. Rows and
// columns of the product are multiples of TILE, the range of k of TILE_DEPTH.

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
