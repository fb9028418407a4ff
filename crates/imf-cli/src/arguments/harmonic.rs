//! How a field is computed, and what a harmonic field is made by.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use imf_core::section::Quantity;
use imf_fields::harmonic::FitSettings;
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::coefficients::Precision;

/// The families that `imf field` can compute with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum FieldMethod {
    /// Whole numbers of voxels, one orientation after the other
    Exact,
    /// Every orientation at once from a fit to exact sections: approximate, with its error stated
    Harmonic,
}

/// Heading of these options.
const HEADING: &str = "Every direction at once (--method harmonic)";

/// What a field's values are.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum FieldQuantity {
    /// The share of the tool's volume that lies in the part
    Overlap,
    /// How far the tool must be moved to be free, below 0 how far it may be moved, held within 8 pitches: what decides best.
    /// With --save alone
    Depth,
}

/// Options of --method harmonic.
#[derive(Args, Clone)]
pub(crate) struct HarmonicArguments {
    /// How the field is computed
    #[arg(help_heading = HEADING, long, value_enum, default_value = "exact")]
    pub(crate) method: FieldMethod,
    /// What the field's values are
    #[arg(help_heading = HEADING, long, value_enum, default_value = "overlap")]
    pub(crate) quantity: FieldQuantity,
    /// Highest degree of the harmonics: more is finer and costs memory and time by its square; by default 14. For tools that
    /// are not symmetric about their axis by its cube, and by default 8
    #[arg(help_heading = HEADING, long, value_name = "L", requires = "method")]
    pub(crate) degree: Option<usize>,
    /// Choose the lowest degree whose mean squared error, estimated on a sample, is at most this
    #[arg(help_heading = HEADING, long, value_name = "MSE", requires = "method", conflicts_with = "degree", value_parser = parse_target)]
    pub(crate) target_mse: Option<f64>,
    /// Choose the highest degree that the memory limit allows; with --target-mse, look no further than it
    #[arg(help_heading = HEADING, long, requires = "method", conflicts_with = "degree")]
    pub(crate) fill_memory: bool,
    /// Principal axes kept of the harmonics' coefficients; by default 128, and all where the degree is chosen
    #[arg(help_heading = HEADING, long, value_name = "N", requires = "method", value_parser = super::numbers::parse_count)]
    pub(crate) axes: Option<usize>,
    /// Exact sections for each harmonic
    #[arg(help_heading = HEADING, long, default_value_t = DEFAULT_SECTIONS, value_name = "N", requires = "method")]
    pub(crate) sections_per_function: f64,
    /// Keep coefficients in f32, not in f16
    #[arg(help_heading = HEADING, long, requires = "method")]
    pub(crate) single: bool,
    /// With --imf: the least over all orientations, not only over the set: from its best one down the field's gradient
    #[arg(help_heading = HEADING, long, requires = "imf")]
    pub(crate) refine: bool,
    /// Keep the harmonic field in this file, for imf query, imf field and imf info. A field of depth is
    /// refused by imf field, imf eval and imf query --exact
    #[arg(help_heading = HEADING, long, value_name = "FILE", requires = "method")]
    pub(crate) save: Option<PathBuf>,
    /// With --save: leave out measuring what the field's decisions are worth (imf calibrate), which takes a few seconds
    #[arg(help_heading = HEADING, long, requires = "save")]
    pub(crate) no_calibrate: bool,
}

/// Fine enough for a mean squared error of a few millionths.
const DEFAULT_DEGREE: usize = 14;
/// 969 functions of a rotation, where degree 14 has 4,495.
const DEFAULT_DEGREE_OF_ROTATIONS: usize = 8;
/// Measured: beyond a third more sections than functions, a higher degree is the better use of sections.
pub const DEFAULT_SECTIONS: f64 = 1.33;
/// Axes that hold most of a field of degree 14.
const DEFAULT_AXES: usize = 128;

fn parse_target(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(target) if target > 0.0 => Ok(target),
        _ => Err("a mean squared error above 0, such as 1e-5".into()),
    }
}

impl HarmonicArguments {
    /// True where the degree follows from an error or from the memory.
    pub(crate) fn chooses_degree(&self) -> bool {
        self.target_mse.is_some() || self.fill_memory
    }

    /// An option of a fit that was given and is not what it is by default, or of its evaluation.
    pub(crate) fn first_given(&self) -> Option<&'static str> {
        self.first_of_fit().or(self.refine.then_some("--refine"))
    }

    /// An option of a fit that was given and is not what it is by default.
    pub(super) fn first_of_fit(&self) -> Option<&'static str> {
        let given = [
            (self.method == FieldMethod::Harmonic, "--method"),
            (self.save.is_some(), "--save"),
            (self.degree.is_some(), "--degree"),
            (self.target_mse.is_some(), "--target-mse"),
            (self.fill_memory, "--fill-memory"),
            (self.axes.is_some(), "--axes"),
            (self.sections_per_function != DEFAULT_SECTIONS, "--sections-per-function"),
            (self.single, "--single"),
        ];
        given.into_iter().find_map(|(given, option)| given.then_some(option))
    }

    /// The settings of the fit of a field over directions or rotations.
    pub(crate) fn settings(&self, domain: Domain) -> FitSettings {
        FitSettings {
            quantity: match self.quantity {
                FieldQuantity::Overlap => Quantity::Overlap,
                FieldQuantity::Depth => Quantity::Depth,
            },
            degree: self.degree.unwrap_or(match domain {
                Domain::Directions => DEFAULT_DEGREE,
                Domain::Rotations => DEFAULT_DEGREE_OF_ROTATIONS,
            }),
            axes: self.axes.unwrap_or(if self.chooses_degree() { usize::MAX } else { DEFAULT_AXES }),
            sections_per_function: self.sections_per_function,
            precision: if self.single { Precision::F32 } else { Precision::F16 },
            ..FitSettings::default()
        }
    }
}
