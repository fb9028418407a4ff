// Purpose: the uniform blocks that every kernel shares. Their twins in Rust stand in `uniforms.rs`; a test compares
// size and offsets. Lengths are in elements (f32), not in bytes; padded sizes are multiples of the matrix kernel's
// padding, and padding holds zeros (`layout.rs` says why that alters nothing).

/// The rows at hand, one row a sample.
struct Batch {
    /// Samples.
    rows: u32,
    /// Samples rounded up to the padding.
    padded_rows: u32,
    /// Rows that one partial gradient sums.
    slice_rows: u32,
    /// Partial gradients.
    slices: u32,
}

/// One dense layer in the padded layout: `W [outputs][inputs]` at `weights`, `b [outputs]` at `biases`.
struct Layer {
    inputs: u32,
    outputs: u32,
    weights: u32,
    biases: u32,
    /// Columns of one row of the array that receives the layer's result.
    stride: u32,
    /// Leading inputs that come from the layer before, thus carry a delta backwards.
    upstream: u32,
    /// Parameters of the whole network, padding included.
    parameters: u32,
    /// Frequency factor ω.
    omega: f32,
}

/// Where a block of network inputs goes in each row of a layer's signal.
struct Placement {
    stride: u32,
    offset: u32,
    /// Columns of the block: the network's inputs, then zeros.
    columns: u32,
}

/// One training step.
struct Step {
    /// 1 / samples of the whole batch.
    inverse_count: f32,
    /// `LOSS_L1` or `LOSS_L2`.
    loss: u32,
    /// Where the step's mean loss goes.
    slot: u32,
    /// 1 for the first part of a batch, 0 where a part adds to the sums of the parts before it.
    first: u32,
    learning_rate: f32,
    beta1: f32,
    one_minus_beta1: f32,
    beta2: f32,
    one_minus_beta2: f32,
    /// 1 / (1 − β₁ᵗ), 1 / (1 − β₂ᵗ).
    correction1: f32,
    correction2: f32,
    epsilon: f32,
    weight_decay: f32,
}

/// One part of an evaluation: rows of poses, or points × directions.
struct Sweep {
    /// First output of this part.
    base: u32,
    points: u32,
    directions: u32,
    /// Index of this part's first direction in the whole list.
    first_direction: u32,
}
