//! The kernels' sources: which files make one shader, and the prelude of constants that Rust and WGSL share.

mod product;

pub use product::{Factors, Fragment, MatrixKernel};

use std::fmt::Write as _;

use imf_fields::factored::ANGLE;
use imf_fields::siren::INPUTS;
use imf_train::engine::soap::EPSILON;

/// Rows and columns of the outputs that one workgroup of a matrix product covers, with any kernel.
pub const TILE: u32 = 64;
/// Workgroup side of the register kernel: 8 × 8 outputs an invocation.
pub const REGISTER_GROUP: u32 = 8;
/// Workgroup side of the tiled kernel: 4 × 4 outputs an invocation.
pub const TILED_GROUP: u32 = 16;
/// Values of k that kernels with tiles stage at a time.
pub const TILE_DEPTH: u32 = 32;
/// Bytes of workgroup memory that products by matrix units take: two stages of f16 and a tile of f32.
pub const FRAGMENTS_MEMORY: u32 = 2 * 2 * TILE * TILE_DEPTH + 4 * TILE * TILE;
/// Invocations of a workgroup of every kernel that is no matrix product.
pub const LINEAR_GROUP: u32 = 64;
/// Inputs that come from the point.
pub const POINT_INPUTS: u32 = 3;
/// Inputs that come from the direction.
pub const DIRECTION_INPUTS: u32 = INPUTS as u32 - POINT_INPUTS;
/// `Step::loss` for the mean absolute error.
pub const LOSS_L1: u32 = 0;
/// `Step::loss` for the mean squared error.
pub const LOSS_L2: u32 = 1;
/// Voxels of a line whose counts one invocation adds up together: four words of bits.
pub const COUNT_PLACES: u32 = 128;
/// Binary digits of such a count, as many as `count_differences.wgsl` writes out: at most 262,143 run ends an orientation.
pub const COUNT_DIGITS: u32 = 18;
/// Workgroups that share what SOAP does element by element with one matrix: a thread takes four vec4 of 256 × 256.
pub const MATRIX_GROUPS: u32 = 64;
/// Invocations that find a panel of reflections: as many as every adapter has in a workgroup.
pub const SOAP_GROUP: u32 = 256;
/// Reflections of a panel, which find each other within one workgroup.
pub const SOAP_PANEL: u32 = 16;
/// `Symmetry::along` where frames turn about no axis.
pub const NO_AXIS: u32 = 3;
/// Decisions of poses as the device writes them.
pub const FREE: u32 = 0;
/// See [`FREE`].
pub const COLLIDING: u32 = 1;
/// See [`FREE`].
pub const UNDECIDED: u32 = 2;
/// Where the sigmoid's argument is clamped.
pub const SIGMOID_LIMIT: f32 = 80.0;

/// Every kernel of the crate; each has one entry point, `main`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shader {
    /// Samples into a layer's signal.
    Inputs,
    /// Points × directions into a layer's signal.
    Poses,
    /// Hidden layer with slopes.
    HiddenTrain,
    /// Hidden layer without slopes.
    HiddenEvaluate,
    /// Output layer before the sigmoid.
    Linear,
    /// Loss and first delta.
    Loss,
    /// The same behind linear outputs.
    LossLinear,
    /// A batch's mean loss.
    LossSum,
    /// Delta of the layer below.
    Backward,
    /// Partial gradients of weights.
    WeightGradient,
    /// Partial gradients of biases.
    BiasGradient,
    /// Sum of the partial gradients.
    Reduce,
    /// Update of the weights.
    Adam,
    /// Matrices between hidden layers out of the parameters' layout.
    SoapGather,
    /// And back.
    SoapScatter,
    /// A product of factors that stand either way.
    SoapProduct,
    /// Moments along the axes.
    SoapMoments,
    /// Means along the axes.
    SoapMeans,
    /// Axes by falling mean.
    SoapOrder,
    /// Some reflections that make them orthonormal.
    SoapPanel,
    /// The same taken to other axes.
    SoapReflect,
    /// Second moments in the new axes' order.
    SoapFollow,
    /// Update of the matrices.
    MatricesUpdate,
    /// Values of the network.
    Outputs,
    /// Running minimum over directions.
    Minimum,
    /// Running minimum over the columns of a product.
    RowMinimum,
    /// The columns of a product one behind the other.
    RowSections,
    /// Coefficients out of the frames of their places.
    LocalFrames,
    /// Poses of the world into samples.
    PoseInputs,
    /// Values of poses, and where the way back begins.
    PoseValues,
    /// Derivatives of poses.
    PoseGradient,
    /// Poses of the world into a factored field's points.
    PosePoints,
    /// Values of poses in a factored field.
    HarmonicValues,
    /// The same with derivatives by the direction.
    HarmonicSlopes,
    /// As [`Self::HarmonicValues`], of fields over rotations.
    RotationValues,
    /// As [`Self::HarmonicSlopes`], of fields over rotations.
    RotationSlopes,
    /// Derivatives of poses in a factored field by the position.
    PoseDescent,
    /// Coefficients of a harmonic field at the points of poses.
    VoxelCoefficients,
    /// Derivatives of poses in a harmonic field by the position.
    VoxelDescent,
    /// Decisions of poses by their values.
    PoseDecisions,
    /// How overlaps change when a tool is stepped.
    CountDifferences,
    /// Overlaps from their differences.
    CountTotals,
    /// Overlaps over a slab, to be read back.
    CountSections,
    /// Least collision measure over orientations.
    CountLeast,
    /// Multiply-adds alone.
    MultiplyAdds,
}

impl Shader {
    /// All kernels.
    pub const ALL: [Self; 45] = [
        Self::Inputs,
        Self::Poses,
        Self::HiddenTrain,
        Self::HiddenEvaluate,
        Self::Linear,
        Self::Loss,
        Self::LossLinear,
        Self::LossSum,
        Self::Backward,
        Self::WeightGradient,
        Self::BiasGradient,
        Self::Reduce,
        Self::Adam,
        Self::SoapGather,
        Self::SoapScatter,
        Self::SoapProduct,
        Self::SoapMoments,
        Self::SoapMeans,
        Self::SoapOrder,
        Self::SoapPanel,
        Self::SoapReflect,
        Self::SoapFollow,
        Self::MatricesUpdate,
        Self::Outputs,
        Self::Minimum,
        Self::RowMinimum,
        Self::RowSections,
        Self::LocalFrames,
        Self::PoseInputs,
        Self::PoseValues,
        Self::PoseGradient,
        Self::PosePoints,
        Self::HarmonicValues,
        Self::HarmonicSlopes,
        Self::RotationValues,
        Self::RotationSlopes,
        Self::PoseDescent,
        Self::VoxelCoefficients,
        Self::VoxelDescent,
        Self::PoseDecisions,
        Self::CountDifferences,
        Self::CountTotals,
        Self::CountSections,
        Self::CountLeast,
        Self::MultiplyAdds,
    ];

    /// Whether it is a matrix product.
    #[must_use]
    pub fn is_product(self) -> bool {
        matches!(
            self,
            Self::HiddenTrain
                | Self::HiddenEvaluate
                | Self::Linear
                | Self::Backward
                | Self::WeightGradient
                | Self::SoapProduct
        )
    }

    /// Whether every loop counts up to a bound in constant steps, so that nobody has to see to its end: products, and what they are
    /// measured against.
    #[must_use]
    pub fn has_counting_loops(self) -> bool {
        self.is_product() || self == Self::MultiplyAdds
    }

    /// The whole WGSL text: prelude, uniform blocks, then the kernel's files.
    #[must_use]
    pub fn source(self, matrix: MatrixKernel, factors: Factors) -> String {
        let product = matrix.source(factors);
        let sine = sine_source();
        let sigmoid = include_str!("../../../shaders/sigmoid.wgsl");
        let forward = include_str!("../../../shaders/forward.wgsl");
        let world = include_str!("../../../shaders/pose_world.wgsl");
        let place = include_str!("../../../shaders/place.wgsl");
        let cell = include_str!("../../../shaders/voxel_cell.wgsl");
        let harmonics = include_str!("../../../shaders/harmonics.wgsl");
        let rotations = include_str!("../../../shaders/rotations.wgsl");
        let turns = include_str!("../../../shaders/turns.wgsl");
        let values = include_str!("../../../shaders/harmonic_values.wgsl");
        let slopes = include_str!("../../../shaders/harmonic_slopes.wgsl");
        let side = include_str!("../../../shaders/soap_side.wgsl");
        let overlap = include_str!("../../../shaders/count_overlap.wgsl");
        let parts: &[&str] = match self {
            Self::Inputs => &[include_str!("../../../shaders/inputs.wgsl")],
            Self::Poses => &[include_str!("../../../shaders/poses.wgsl")],
            Self::HiddenTrain => {
                &[sine, product, forward, include_str!("../../../shaders/hidden_train.wgsl")]
            }
            Self::HiddenEvaluate => {
                &[sine, product, forward, include_str!("../../../shaders/hidden_evaluate.wgsl")]
            }
            Self::Linear => &[product, forward, include_str!("../../../shaders/linear.wgsl")],
            Self::Loss => &[sigmoid, include_str!("../../../shaders/loss.wgsl")],
            Self::LossLinear => &[include_str!("../../../shaders/loss_linear.wgsl")],
            Self::LossSum => &[include_str!("../../../shaders/loss_sum.wgsl")],
            Self::Backward => &[product, include_str!("../../../shaders/backward.wgsl")],
            Self::WeightGradient => &[product, include_str!("../../../shaders/weight_gradient.wgsl")],
            Self::BiasGradient => &[include_str!("../../../shaders/bias_gradient.wgsl")],
            Self::Reduce => &[include_str!("../../../shaders/reduce.wgsl")],
            Self::Adam => &[include_str!("../../../shaders/adam.wgsl")],
            Self::SoapGather => &[include_str!("../../../shaders/soap_gather.wgsl")],
            Self::SoapScatter => &[include_str!("../../../shaders/soap_scatter.wgsl")],
            Self::SoapProduct => &[product, include_str!("../../../shaders/soap_product.wgsl")],
            Self::SoapMoments => &[include_str!("../../../shaders/soap_moments.wgsl")],
            Self::SoapMeans => &[side, include_str!("../../../shaders/soap_means.wgsl")],
            Self::SoapOrder => &[side, include_str!("../../../shaders/soap_order.wgsl")],
            Self::SoapPanel => &[side, include_str!("../../../shaders/soap_panel.wgsl")],
            Self::SoapReflect => &[side, include_str!("../../../shaders/soap_reflect.wgsl")],
            Self::SoapFollow => &[include_str!("../../../shaders/soap_follow.wgsl")],
            Self::MatricesUpdate => &[include_str!("../../../shaders/matrices_update.wgsl")],
            Self::Outputs => &[sigmoid, include_str!("../../../shaders/outputs.wgsl")],
            Self::Minimum => &[include_str!("../../../shaders/minimum.wgsl")],
            Self::RowMinimum => &[include_str!("../../../shaders/row_minimum.wgsl")],
            Self::RowSections => &[include_str!("../../../shaders/row_sections.wgsl")],
            Self::LocalFrames => &[include_str!("../../../shaders/local_frames.wgsl")],
            Self::PoseInputs => &[world, include_str!("../../../shaders/pose_inputs.wgsl")],
            Self::PoseValues => &[sigmoid, world, include_str!("../../../shaders/pose_values.wgsl")],
            Self::PoseGradient => &[sine, world, include_str!("../../../shaders/pose_gradient.wgsl")],
            Self::PosePoints => &[world, place, include_str!("../../../shaders/pose_points.wgsl")],
            Self::HarmonicValues => &[world, place, harmonics, values],
            Self::HarmonicSlopes => &[world, place, harmonics, turns, slopes],
            Self::RotationValues => &[world, place, rotations, values],
            Self::RotationSlopes => &[world, place, rotations, turns, slopes],
            Self::PoseDescent => &[world, place, include_str!("../../../shaders/pose_descent.wgsl")],
            Self::VoxelCoefficients => {
                &[world, cell, include_str!("../../../shaders/voxel_coefficients.wgsl")]
            }
            Self::VoxelDescent => &[world, cell, include_str!("../../../shaders/voxel_descent.wgsl")],
            Self::PoseDecisions => &[world, include_str!("../../../shaders/pose_decisions.wgsl")],
            Self::CountDifferences => &[include_str!("../../../shaders/count_differences.wgsl")],
            Self::CountTotals => &[include_str!("../../../shaders/count_totals.wgsl")],
            Self::CountSections => &[overlap, include_str!("../../../shaders/count_sections.wgsl")],
            Self::CountLeast => &[overlap, include_str!("../../../shaders/count_least.wgsl")],
            Self::MultiplyAdds => &[include_str!("../../../shaders/multiply_adds.wgsl")],
        };
        let mut source = String::new();
        if self.is_product() {
            source.push_str(factors.enabled());
        }
        source.push_str(&prelude());
        if self.is_product() {
            source.push_str(&factors.types());
        }
        source.push_str(include_str!("../../../shaders/uniforms.wgsl"));
        for part in parts {
            source.push('\n');
            source.push_str(part);
        }
        source
    }
}

/// The WGSL text of `sine_cosine`, to be tested alone.
#[must_use]
pub fn sine_source() -> &'static str {
    include_str!("../../../shaders/sine.wgsl")
}

/// The constants above as WGSL.
fn prelude() -> String {
    let mut text = String::from("// Generated from the constants of `shader.rs`.\n");
    for (name, value) in [
        ("TILE", TILE),
        ("REGISTER_GROUP", REGISTER_GROUP),
        ("TILED_GROUP", TILED_GROUP),
        ("TILE_DEPTH", TILE_DEPTH),
        ("LINEAR_GROUP", LINEAR_GROUP),
        ("INPUTS", INPUTS as u32),
        ("POINT_INPUTS", POINT_INPUTS),
        ("DIRECTION_INPUTS", DIRECTION_INPUTS),
        ("LOSS_L1", LOSS_L1),
        ("LOSS_L2", LOSS_L2),
        ("COUNT_PLACES", COUNT_PLACES),
        ("COUNT_DIGITS", COUNT_DIGITS),
        ("MATRIX_GROUPS", MATRIX_GROUPS),
        ("SOAP_GROUP", SOAP_GROUP),
        ("SOAP_PANEL", SOAP_PANEL),
        ("FREE", FREE),
        ("COLLIDING", COLLIDING),
        ("UNDECIDED", UNDECIDED),
        ("NO_AXIS", NO_AXIS),
    ] {
        let _ = writeln!(text, "const {name}: u32 = {value}u;");
    }
    for (name, value) in
        [("SIGMOID_LIMIT", SIGMOID_LIMIT), ("SOAP_EPSILON", EPSILON), ("ANGLE", ANGLE as f32)]
    {
        let _ = writeln!(text, "const {name}: f32 = {value:?};");
    }
    text
}
