//! The arguments of `imf train harmonic`.

use std::path::PathBuf;

use clap::Args;
use imf_core::section::Quantity;
use imf_fields::harmonic::FitSettings;
use imf_fields::harmonic::basis::Domain;

use super::clearance::ContactArguments;
use super::explicit::ExplicitOptions;
use super::quantity::QuantityArguments;
use super::scene::SceneArguments;

/// Fit a field of every direction to exact sections, in seconds: approximate, with its error stated
#[derive(Args)]
#[command(after_help = "Examples:\n  imf train harmonic teapot --out teapot.safetensors\n  \
                  imf train harmonic part.obj --tool mill.toml --out part.safetensors\n\n\
                  The file is for imf query, imf field, imf calibrate, imf export and imf train factored.")]
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

impl HarmonicArguments {
    /// The settings of the fit of a field over directions or rotations.
    pub(crate) fn settings(&self, domain: Domain, quantity: Quantity) -> FitSettings {
        let usual = FitSettings::for_domain(domain);
        FitSettings {
            quantity,
            degree: self.degree.unwrap_or(usual.degree),
            components: self.components.unwrap_or(usual.components),
            ..usual
        }
    }
}
