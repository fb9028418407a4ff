//! The arguments of `imf train harmonic`.

use std::path::PathBuf;

use clap::Args;
use imf_core::section::Quantity;
use imf_fields::harmonic::FitSettings;
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::coefficients::Precision;

use super::clearance::ContactArguments;
use super::explicit::ExplicitOptions;
use super::quantity::QuantityArguments;
use super::scene::SceneArguments;

/// Fit a field of every direction to exact sections, in seconds: approximate, with its error stated
#[derive(Args)]
#[command(after_help = "Examples:\n  imf train harmonic teapot --out teapot.safetensors\n  \
                  imf train harmonic part.obj --tool mill.toml --out part.safetensors\n\n\
                  The file is for imf query, imf field, imf check and imf train factored.")]
pub(crate) struct HarmonicArguments {
    #[command(flatten)]
    pub(crate) explicit: ExplicitOptions,
    #[command(flatten)]
    pub(crate) scene: SceneArguments,
    #[command(flatten)]
    pub(crate) contact: ContactArguments,
    /// File to write
    #[arg(long, value_name = "FILE")]
    pub(crate) out: PathBuf,
    #[command(flatten)]
    pub(crate) quantity: QuantityArguments,
    /// Highest degree of the harmonics: more is finer and costs memory and time by its square; by default 14. For tools that
    /// are not symmetric about their axis by its cube, and by default 8
    #[arg(long, value_name = "L")]
    degree: Option<usize>,
    /// Principal components that are saved of the harmonics' coefficients; by default 128
    #[arg(long, value_name = "N", value_parser = super::numbers::parse_count)]
    components: Option<usize>,
    /// Leave out the calibration of the field's decisions (imf calibrate), which takes a few seconds
    #[arg(long)]
    pub(crate) no_calibrate: bool,
}

/// Fine enough for a mean squared error of a few millionths.
const DEFAULT_DEGREE: usize = 14;
/// 969 functions of a rotation, where degree 14 has 4,495.
const DEFAULT_DEGREE_OF_ROTATIONS: usize = 8;
/// Exact sections for each basis function. Measured: beyond a third more sections than functions, a higher degree is the
/// better use of sections.
pub const DEFAULT_SECTIONS: f64 = 1.33;
/// Components that hold most of a field of degree 14.
const DEFAULT_COMPONENTS: usize = 128;

impl HarmonicArguments {
    /// The settings of the fit of a field over directions or rotations.
    pub(crate) fn settings(&self, domain: Domain, quantity: Quantity) -> FitSettings {
        FitSettings {
            quantity,
            degree: self.degree.unwrap_or(match domain {
                Domain::Directions => DEFAULT_DEGREE,
                Domain::Rotations => DEFAULT_DEGREE_OF_ROTATIONS,
            }),
            axes: self.components.unwrap_or(DEFAULT_COMPONENTS),
            sections_per_function: DEFAULT_SECTIONS,
            precision: Precision::F16,
            ..FitSettings::default()
        }
    }
}
