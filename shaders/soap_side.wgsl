// Purpose: where numbers stand that SOAP keeps of the rows or the columns of a matrix: squares of `stride`, with padding.

/// Where number i of a side stands among its padding.
fn place(side: Side, i: u32) -> u32 {
    return i + select(0u, side.gap, i >= side.split);
}

/// Where the square of a matrix begins.
fn square(side: Side, matrix: u32) -> u32 {
    return matrix * side.stride * side.stride;
}
