// Purpose: what every way to a matrix product C[row][column] = Σ_k left(row, k)·right(k, column) shares.
//
// The layer's file defines the operands:
//   extent(slice)                     rows, columns and range of k, all multiples of the padding; asked first, so that it may
//                                     keep the slice for the others
//   left(row, k)                      4 × 4 block, column j holds rows row..row+3 at k + j
//   right(k, column)                  4 × 4 block, column j holds columns column..column+3 at k + j
//   store(slice, row, column, sums)   takes columns column..column+3 of one row

struct Extent {
    rows: u32,
    columns: u32,
    first: u32,
    end: u32,
}

/// Column i of the sums is row i of the output.
fn store_block(slice: u32, row: u32, column: u32, sums: mat4x4<f32>) {
    store(slice, row, column, sums[0]);
    store(slice, row + 1u, column, sums[1]);
    store(slice, row + 2u, column, sums[2]);
    store(slice, row + 3u, column, sums[3]);
}
