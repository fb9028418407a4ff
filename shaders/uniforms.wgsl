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
    /// The network's inputs.
    inputs: u32,
}

/// One training step.
struct Step {
    /// 1 / samples of the whole batch.
    inverse_count: f32,
    /// A power of two near the samples: deltas are so many times larger than they are, so that f16 holds them, and the
    /// gradient is divided by it again. Exact in f32.
    scale: f32,
    /// Values learnt of a sample, padding left out.
    learnt: u32,
    /// `LOSS_L1`, `LOSS_L2` or `LOSS_L1_SMALL`.
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
    /// The same for SOAP's moments, which begin with the second step.
    matrix_correction: f32,
    epsilon: f32,
    weight_decay: f32,
}

/// Parameters from `first` to before `end`, in vec4.
struct Span {
    first: u32,
    end: u32,
}

/// The matrices between hidden layers, where another optimiser than Adam steps them; kept beside each other.
struct Between {
    /// Neurons of a layer.
    rows: u32,
    /// Inputs of the layer that has most.
    columns: u32,
    /// Share of momentum and moments that a step leaves.
    beta: f32,
    one_minus_beta: f32,
}

/// One of them among the parameters; an element of a storage buffer.
struct MatrixPlace {
    weights: u32,
    columns: u32,
    /// A step's length over the learning rate.
    length: f32,
}

/// A product of SOAP's for every matrix, C ← kept·C + share·A·B. `rows`, `columns` and `inner` are the product's,
/// whichever way its factors are stored.
struct Product {
    rows: u32,
    columns: u32,
    inner: u32,
    /// 1 where A is stored as [inner][rows].
    left_transposed: u32,
    /// 1 where B is stored as [columns][inner].
    right_transposed: u32,
    kept: f32,
    share: f32,
}

/// Some reflections of a QR decomposition.
struct Panel {
    first: u32,
    end: u32,
    /// The first axis that they are taken to.
    behind: u32,
    /// 1 where the last comes first.
    backwards: u32,
}

/// The rows or the columns of a matrix, which SOAP finds axes of; an element of a storage buffer.
struct Side {
    /// Without padding.
    size: u32,
    /// Those from here on stand so many further: padding lies between.
    split: u32,
    gap: u32,
    /// With padding, of the widest matrix.
    stride: u32,
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

/// The box of a field in the world; the fourth numbers are idle.
struct World {
    /// Centres of the first and of the last voxel.
    low: vec4<f32>,
    high: vec4<f32>,
    /// Corner and edges of the grid.
    origin: vec4<f32>,
    size: vec4<f32>,
}

/// The weights that the network's inputs meet: in the first layer, and in the one behind the skip, where there is one.
struct Descent {
    first_weights: u32,
    /// Weights from a neuron to the next.
    first_stride: u32,
    neurons: u32,
    skip_weights: u32,
    skip_stride: u32,
    /// 0 without a skip.
    skip_neurons: u32,
}

/// The symmetry of the obstacle by which a factored field is reduced.
struct Symmetry {
    /// Where mirror planes across x, y and z stand: below all positions where there is none.
    plane_x: f32,
    plane_y: f32,
    plane_z: f32,
    /// A point of the axis.
    through_x: f32,
    through_y: f32,
    through_z: f32,
    /// 0, 1 or 2: the axis is along x, y or z. `NO_AXIS` where there is none.
    along: u32,
    /// Nearer to the axis than this slopes do not grow.
    blunt: f32,
}

/// The frame of a place, for coefficients; an element of a storage buffer.
struct PlaceFrame {
    /// Of the angle that it is turned by.
    cosine: f32,
    sine: f32,
    /// Bits 0, 1 and 2: mirrored across the first, second and third of the axes in the order that ends with the one of revolution.
    mirrored: u32,
}

/// Work that is done over and over.
struct Turns {
    count: u32,
    factor: f32,
    summand: f32,
}

/// The functions of a direction in a factored field.
struct Harmonics {
    degree: u32,
    /// Functions, padding among them.
    stride: u32,
}

/// The voxels of a harmonic field.
struct Lattice {
    nx: u32,
    ny: u32,
    nz: u32,
    /// Coefficients of a voxel, a multiple of 4.
    stride: u32,
    /// Coefficients of a row, padding among them.
    columns: u32,
    pitch: f32,
}

/// What a field's calibration decides by; beyond all values where it decides nothing. Around an axis nothing is decided, in single precision.
struct Thresholds {
    free_up_to: f32,
    colliding_from: f32,
    /// Along which axis of the world it lies: 0, 1 or 2.
    along: u32,
    /// Where, along the axis behind that, and the one behind that.
    first: f32,
    second: f32,
    /// How far from it nothing is decided; −1 without an axis.
    around: f32,
}

/// Jobs that count overlaps: one job is one orientation over one slab of the query box. Bits are the obstacle's.
struct Counting {
    /// Planes of the obstacle along x.
    planes: u32,
    /// Bits before voxel (0, 0, 0), from a plane (along x) to the next, and from a line (along y) to the next.
    lead_bits: u32,
    plane_bits: u32,
    line_bits: u32,
    jobs: u32,
    /// Workgroups that the largest job's differences take.
    groups: u32,
    /// Lines along its axis that the largest job sums up.
    lines: u32,
    /// The slab: its first voxel in the obstacle's grid, and its voxels along x, y, z.
    lower_x: i32,
    lower_y: i32,
    lower_z: i32,
    nx: u32,
    ny: u32,
    nz: u32,
}

/// A tool in one orientation, to be stepped through the obstacle along one axis.
struct Job {
    /// 0 for x, 1 for y, 2 for z.
    axis: u32,
    /// 1 where a difference leads to the next voxel, 0 where it leads back from it.
    upwards: u32,
    /// The box where differences are taken: its first voxel in the obstacle's grid, and its voxels along x, y, z.
    lower_x: i32,
    lower_y: i32,
    lower_z: i32,
    nx: u32,
    ny: u32,
    nz: u32,
    /// Where its differences begin.
    differences: u32,
    /// What a step covers: offset of its first plane along x, planes, and where their starts begin.
    covered_first: i32,
    covered_planes: u32,
    covered_starts: u32,
    /// What a step uncovers, likewise.
    uncovered_first: i32,
    uncovered_planes: u32,
    uncovered_starts: u32,
    /// Where the values of its counts begin.
    shares: u32,
    /// The orientation's index in the whole list.
    orientation: u32,
}
