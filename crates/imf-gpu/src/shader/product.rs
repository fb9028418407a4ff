//! How matrix products are tiled, and what their factors are.

use super::{REGISTER_GROUP, TILE, TILED_GROUP};

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

    /// Whether dimensions are whole tiles, as matrix units need them.
    #[must_use]
    pub fn is_padded_to_tiles(self) -> bool {
        self.padding() == TILE as usize
    }

    /// Its name for people.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Register => "register",
            Self::Tiled => "tiled",
        }
    }

    /// The product's files in one text.
    pub(super) fn source(self, factors: Factors) -> &'static str {
        macro_rules! files {
            ($($name:literal),+) => {
                concat!($(include_str!(concat!("../../../../shaders/", $name)), "\n"),+)
            };
        }
        match (self, factors) {
            (_, Factors::Fragments(_)) => files!("product.wgsl", "product_cooperative.wgsl"),
            (Self::Register, _) => files!("product.wgsl", "product_register.wgsl"),
            (Self::Tiled, _) => files!("product.wgsl", "product_tiles.wgsl", "product_tiled.wgsl"),
        }
    }
}

/// What the factors of a matrix product are rounded to. Sums are f32 always, and f32 holds the product of two f16 exactly,
/// so [`Factors::Half`] and [`Factors::Fragments`] differ in the order of sums alone.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Factors {
    /// f32.
    #[default]
    Single,
    /// f16.
    Half,
    /// f16, multiplied by the hardware's matrix units; needs dimensions that are whole tiles ([`MatrixKernel::is_padded_to_tiles`]).
    Fragments(Fragment),
}

/// Side of the square fragments that one subgroup multiplies, and how many invocations a subgroup has: two fragments a
/// subgroup are a tile of 64 × 64 for a workgroup of 256.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fragment {
    /// 8 × 8, subgroups of 8 (Mesa's lavapipe).
    Eight,
    /// 16 × 16, subgroups of 32 (NVIDIA).
    Sixteen,
}

impl Fragment {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Eight, Self::Sixteen];

    /// Rows and columns.
    #[must_use]
    pub fn side(self) -> u32 {
        match self {
            Self::Eight => 8,
            Self::Sixteen => 16,
        }
    }

    /// Invocations of a subgroup.
    #[must_use]
    pub fn subgroup(self) -> u32 {
        let subgroups = TILE / self.side() * (TILE / self.side()) / 2;
        TILED_GROUP * TILED_GROUP / subgroups
    }
}

impl Factors {
    /// Its name for people.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Single => "f32",
            Self::Half => "f16",
            Self::Fragments(_) => "f16 by matrix units",
        }
    }

    /// What WGSL has to be told first.
    pub(super) fn enabled(self) -> &'static str {
        match self {
            Self::Single => "",
            Self::Half => "enable f16;\n",
            Self::Fragments(_) => "enable f16;\nenable wgpu_cooperative_matrix;\n",
        }
    }

    /// What the products name.
    pub(super) fn types(self) -> String {
        match self {
            Self::Single => {
                "alias Factors = vec4<f32>;\nfn rounded(v: vec4<f32>) -> vec4<f32> { return v; }\n".to_owned()
            }
            // Not by a conversion and back, which compilers leave out.
            Self::Half => "alias Factors = vec4<f16>;\n\
                           fn rounded(v: vec4<f32>) -> vec4<f32> { return quantizeToF16(v); }\n"
                .to_owned(),
            Self::Fragments(fragment) => {
                let side = fragment.side();
                let alias = |name: &str, scalar: &str, role: &str| {
                    format!("alias {name} = coop_mat{side}x{side}<{scalar}, {role}>;\n")
                };
                format!("const FRAGMENT: u32 = {side}u;\n")
                    + &alias("Left", "f16", "A")
                    + &alias("Right", "f16", "B")
                    + &alias("Sums", "f32", "C")
            }
        }
    }
}
