//! The kernels' sources: which files make one shader, and the prelude of constants that Rust and WGSL share.

#[cfg(test)]
mod tests;

use std::fmt::Write as _;

use imf_train::engine::soap::EPSILON;

macro_rules! shared {
    ($($(#[$doc:meta])* $name:ident: $type:ident = $value:expr;)+) => {
        $($(#[$doc])* pub(crate) const $name: $type = $value;)+

        /// The constants as WGSL.
        fn prelude() -> String {
            let mut text = String::from("// Generated from the constants of `shader.rs`.\n");
            $(let _ = writeln!(text, "const {}: {} = {:?};", stringify!($name), stringify!($type), $name);)+
            text
        }
    };
}

shared! {
    /// Rows and columns of the outputs that one workgroup of a matrix product covers, with any kernel.
    TILE: u32 = 64;
    /// Workgroup side of the register kernel: 8 × 8 outputs an invocation.
    REGISTER_GROUP: u32 = 8;
    /// Workgroup side of the tiled kernel: 4 × 4 outputs an invocation.
    TILED_GROUP: u32 = 16;
    /// Values of k that the tiled kernel stages at a time.
    TILE_DEPTH: u32 = 32;
    /// Invocations of a workgroup of every kernel that is not a matrix product.
    LINEAR_GROUP: u32 = 64;
    /// Inputs that come from the point.
    POINT_INPUTS: u32 = 3;
    /// Inputs that come from the direction.
    DIRECTION_INPUTS: u32 = INPUTS - POINT_INPUTS;
    /// `Step::loss` for the mean absolute error.
    LOSS_L1: u32 = 0;
    /// `Step::loss` for the mean squared error.
    LOSS_L2: u32 = 1;
    /// `Step::loss` for the mean absolute error with small targets counted more.
    LOSS_L1_SMALL: u32 = 2;
    /// Voxels of a line whose counts one invocation adds up together: four words of bits.
    COUNT_PLACES: u32 = 128;
    /// Binary digits of such a count, as many as `count_differences.wgsl` writes out: at most 262,143 run-length differences an orientation.
    COUNT_DIGITS: u32 = 18;
    /// Workgroups that share what SOAP does element by element with one matrix: a thread takes four vec4 of 256 × 256.
    MATRIX_GROUPS: u32 = 64;
    /// Invocations that find a panel of reflections: as many as every adapter has in a workgroup.
    SOAP_GROUP: u32 = 256;
    /// Reflections of a panel, which find each other within one workgroup.
    SOAP_PANEL: u32 = 16;
    /// `Symmetry::along` where frames turn about no axis.
    NO_AXIS: u32 = 3;
    /// Decisions of poses as the device writes them.
    FREE: u32 = 0;
    /// See [`FREE`].
    COLLIDING: u32 = 1;
    /// See [`FREE`].
    UNDECIDED: u32 = 2;
    /// Where the sigmoid's argument is clamped.
    SIGMOID_LIMIT: f32 = 80.0;
    /// How far the sigmoid reaches below 0.
    STRETCH: f32 = imf_fields::siren::output::STRETCH as f32;
    /// What small targets count more.
    SMALL_MORE: f32 = imf_fields::recipe::Loss::SMALL_MORE as f32;
    /// See [`SMALL_MORE`].
    SMALL_BELOW: f32 = imf_fields::recipe::Loss::SMALL_BELOW as f32;
    /// Inputs of the paper's network.
    INPUTS: u32 = imf_fields::siren::INPUTS as u32;
    /// Added to the root of SOAP's second moments.
    SOAP_EPSILON: f32 = EPSILON;
    /// See [`imf_fields::factored::ANGLE`].
    ANGLE: f32 = imf_fields::factored::ANGLE as f32;
}

/// How a matrix product is tiled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MatrixKernel {
    /// 8 × 8 outputs an invocation, operands straight from storage: software devices.
    Register,
    /// 64 × 64 tiles in workgroup memory, 4 × 4 outputs an invocation: hardware.
    Tiled,
}

impl MatrixKernel {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Register, Self::Tiled];

    /// What every dimension of a layer and a batch is rounded up to.
    #[must_use]
    pub fn padding(self) -> usize {
        match self {
            Self::Register => (TILE / REGISTER_GROUP) as usize,
            Self::Tiled => TILE as usize,
        }
    }

    /// Its name for people.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Register => "register",
            Self::Tiled => "tiled",
        }
    }
}

macro_rules! shaders {
    ($($name:ident: $($file:literal)+;)+) => {
        /// Every kernel of the crate, each with one entry point, `main`. The last file of each opens with its purpose.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub(crate) enum Shader {
            $($name),+
        }

        impl Shader {
            #[cfg(test)]
            pub(crate) const ALL: &[Self] = &[$(Self::$name),+];

            /// The files behind the prelude, the uniform blocks and, of a matrix product, the product.
            fn files(self) -> &'static [&'static str] {
                match self {
                    $(Self::$name => &[$(include_str!(concat!("../../../shaders/", $file, ".wgsl"))),+]),+
                }
            }
        }
    };
}

shaders! {
    // The network: inputs, layers, values.
    Inputs: "inputs";
    Poses: "poses";
    HiddenTrain: "sine" "forward" "hidden_train";
    HiddenEvaluate: "sine" "forward" "hidden_evaluate";
    Linear: "forward" "linear";
    Outputs: "sigmoid" "outputs";
    Minimum: "minimum";
    // Its training.
    Loss: "sigmoid" "loss";
    LossLinear: "loss_linear";
    LossSum: "loss_sum";
    Backward: "backward";
    WeightGradient: "weight_gradient";
    BiasGradient: "bias_gradient";
    Reduce: "reduce";
    Adam: "adam";
    SoapGather: "soap_gather";
    SoapScatter: "soap_scatter";
    SoapProduct: "soap_product";
    SoapMoments: "soap_moments";
    SoapMeans: "soap_side" "soap_means";
    SoapOrder: "soap_side" "soap_order";
    SoapPanel: "soap_side" "soap_panel";
    SoapReflect: "soap_side" "soap_reflect";
    SoapFollow: "soap_follow";
    MatricesUpdate: "matrices_update";
    // Coefficients multiplied with orientations.
    RowMinimum: "row_minimum";
    RowSections: "row_sections";
    LocalFrames: "local_frames";
    // Poses of the world.
    PoseInputs: "pose_world" "pose_inputs";
    PoseValues: "sigmoid" "pose_world" "pose_values";
    PoseGradient: "sine" "pose_world" "pose_gradient";
    PosePoints: "pose_world" "place" "pose_points";
    HarmonicValues: "pose_world" "place" "harmonic_sums" "harmonics" "harmonic_values";
    HarmonicSlopes: "pose_world" "place" "harmonic_sums" "harmonics" "turns" "harmonic_slopes";
    RotationValues: "pose_world" "place" "harmonic_sums" "rotations" "harmonic_values";
    RotationSlopes: "pose_world" "place" "harmonic_sums" "rotations" "turns" "harmonic_slopes";
    PoseDescent: "pose_world" "place" "pose_descent";
    VoxelCoefficients: "pose_world" "voxel_cell" "voxel_coefficients";
    VoxelDescent: "pose_world" "voxel_cell" "voxel_descent";
    PoseDecisions: "pose_world" "pose_decisions";
    // Exact sections.
    CountDifferences: "count_differences";
    CountTotals: "count_totals";
    CountSections: "count_overlap" "count_sections";
    CountMinimum: "count_overlap" "count_minimum";
    // What products are measured against.
    MultiplyAdds: "multiply_adds";
}

impl Shader {
    /// Whether it is a matrix product.
    pub(crate) fn is_product(self) -> bool {
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
    pub(crate) fn has_counting_loops(self) -> bool {
        self.is_product() || self == Self::MultiplyAdds
    }

    /// The whole WGSL text. Factors of a matrix product are rounded to f16 if `half`; sums are f32 always.
    pub(crate) fn source(self, matrix: MatrixKernel, half: bool) -> String {
        let product = match matrix {
            MatrixKernel::Register => include_str!("../../../shaders/product_register.wgsl"),
            MatrixKernel::Tiled => include_str!("../../../shaders/product_tiled.wgsl"),
        };
        // Not rounded by a conversion and back, which compilers leave out.
        let (enabled, scalar, rounded) =
            if half { ("enable f16;\n", "f16", "quantizeToF16(v)") } else { ("", "f32", "v") };
        let factors = format!(
            "alias Factors = vec4<{scalar}>;\nfn rounded(v: vec4<f32>) -> vec4<f32> {{ return {rounded}; }}\n"
        );
        let (prelude, blocks) = (prelude(), include_str!("../../../shaders/uniforms.wgsl"));
        let mut parts = vec![&*prelude, blocks];
        if self.is_product() {
            let shared = include_str!("../../../shaders/product.wgsl");
            parts = vec![enabled, &prelude, &factors, blocks, shared, product];
        }
        parts.extend(self.files());
        parts.join("\n")
    }
}
