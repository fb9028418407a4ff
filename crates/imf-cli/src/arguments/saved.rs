//! The arguments of the commands about a field in a file: `imf calibrate`, `imf eval`, `imf query`, `imf export`.

use std::path::PathBuf;

use clap::Args;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_fields::calibration::Goals;
use imf_fields::field::calibrate::CalibrationSettings;

use super::FieldDeviceArguments;
use super::numbers::parse_value;

/// Choose a field's thresholds for free and colliding, measure the error rates of its decisions, and save both in its file
#[derive(Args)]
#[command(after_help = "Example:\n  imf train harmonic part.obj --tool mill.toml \
                  --no-calibrate --out part.safetensors\n  imf calibrate part.safetensors\n  imf calibrate \
                  part.safetensors --verify --seed 1\n\nA colliding pose is one of the tool as it is, a clear pose one \
                  where the tool offset by its clearance is free: what lies between may be answered either way.")]
pub(crate) struct CalibrateArguments {
    /// Field: a model, a harmonic or a factored field
    pub(crate) field: PathBuf,
    /// Random poses to choose thresholds by, and as many others to judge them by
    #[arg(long, default_value_t = CalibrationSettings::default().uniform, value_name = "N")]
    pub(crate) poses: usize,
    /// Poses within a pitch of contact, judged apart
    #[arg(long, default_value_t = CalibrationSettings::default().boundary, value_name = "N")]
    pub(crate) boundary: usize,
    /// Seed of the poses
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
    /// Most of the colliding poses that may be called free
    #[arg(long, default_value_t = Goals::default().false_free, value_name = "RATE")]
    pub(crate) false_free: f64,
    /// Most of the clear poses that may be called colliding
    #[arg(long, default_value_t = Goals::default().false_colliding, value_name = "RATE")]
    pub(crate) false_colliding: f64,
    /// How sure both should be
    #[arg(long, default_value_t = Goals::default().confidence, value_name = "SHARE")]
    pub(crate) confidence: f64,
    /// Write the field with its calibration to this file, not over itself
    #[arg(long, value_name = "FILE", conflicts_with = "verify")]
    pub(crate) out: Option<PathBuf>,
    /// Judge the thresholds that the field has on fresh poses (choose another --seed), and write nothing
    #[arg(long)]
    pub(crate) verify: bool,
}

impl CalibrateArguments {
    pub(crate) fn settings(&self) -> CalibrationSettings {
        CalibrationSettings {
            uniform: self.poses,
            boundary: self.boundary,
            seed: self.seed,
            goals: Goals {
                false_free: self.false_free,
                false_colliding: self.false_colliding,
                confidence: self.confidence,
            },
            ..CalibrationSettings::default()
        }
    }
}

/// Compare a model, or a harmonic or factored field, with the exact field
#[derive(Args)]
#[command(after_help = super::orientations::after(
    "Examples:\n  imf eval model/field.safetensors\n  imf eval model/field.safetensors \
     --random 256 --imf grid:25 --out report"
))]
pub(crate) struct EvalArguments {
    /// Model or field to evaluate
    pub(crate) model: PathBuf,
    /// Section that training saw, θ,φ
    #[arg(long, default_value = "0,0", value_name = "θ,φ", allow_hyphen_values = true, value_parser = parse_pair)]
    pub(crate) in_sample: Orientation,
    /// Section that training did not see, θ,φ
    #[arg(long, default_value = "12,6", value_name = "θ,φ", allow_hyphen_values = true, value_parser = parse_pair)]
    pub(crate) out_of_sample: Orientation,
    /// Number of random orientations
    #[arg(long, default_value_t = 64, value_name = "N")]
    pub(crate) random: usize,
    /// Set of directions of the IMF, see below; a model's training set by default, 225 spread evenly for other fields
    #[arg(long, value_name = "SET", allow_hyphen_values = true)]
    pub(crate) imf: Option<String>,
    /// Value above which a pose is called colliding, instead of the calibrated one; a field that was never calibrated is, for the
    /// report
    #[arg(long, value_name = "τ", value_parser = parse_value)]
    pub(crate) threshold: Option<f64>,
    /// Seed of the random orientations
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Also write report.json, report.md and pictures to this folder
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) device: FieldDeviceArguments,
}

/// Evaluate the poses of a CSV file: how much does the tool overlap the part when its tip is here, or how deep is it
#[derive(Args)]
#[command(after_help = "Example:\n  imf query model/field.safetensors poses.csv --out results.csv\n\n\
                        The first line names the columns: x,y,z,i,j,k (tool axis from tip to holder) or \
                        x,y,z,theta,phi (degrees), or x,y,z alone (a tool along +z); a column roll (degrees) turns the tool about its own axis. Other columns \
                        are kept. Results add the column depth of a field of depth: how far the tool must be moved to be free, below \
                        0 how far it may be moved, in the scene's unit, known to about a pitch and clamped within 7.5 pitches; of a field of overlaps (imf info says which) the \
                        column overlap instead, from 0 to 1; with --exact also depth_exact or overlap_exact. With --sharp they are called \
                        depth_sharp or overlap_sharp. The column decision says free, colliding or undecided, by the field's calibration; \
                        the column outside says true where the pose lies outside the box of the voxel centres: it is \
                        answered as the nearest point inside, without guarantee, and undecided. --exact counts everywhere.")]
pub(crate) struct QueryArguments {
    /// Trained model, or a harmonic or factored field
    pub(crate) model: PathBuf,
    /// CSV file of poses in the world's frame, or - for standard input
    pub(crate) poses: PathBuf,
    /// CSV file of results; standard output by default
    #[arg(long, value_name = "FILE")]
    pub(crate) out: Option<PathBuf>,
    /// Also count the exact overlap, or the exact depth: of the tool with the field's clearance, as the field's own values are (imf info
    /// says it)
    #[arg(long)]
    pub(crate) exact: bool,
    /// The minimum over the tool's sharp points k, each read or counted at x − R k itself: not the CMF of sections, which
    /// takes the mean of the voxels around
    #[arg(long)]
    pub(crate) sharp: bool,
    #[command(flatten)]
    pub(crate) device: FieldDeviceArguments,
}

/// Write a field for other programs: as an ONNX graph, its inputs in the scene's units
#[derive(Args)]
#[command(
    after_help = "Example:\n  imf export model/field.safetensors --out model.onnx\n\nInputs: position [poses, 3] of the \
                  tool's tip less the corner imf.origin of the graph's metadata, in the scene's unit, and direction [poses, 3] of the tool's axis from tip to holder; the paper's network takes \
                  angles [poses, 2] instead, (theta, phi) in degrees. Output: overlap [poses], or depth [poses] of a field of depth, in the scene's unit. What the field is of stands in \
                  the graph's metadata. A harmonic field of a tool without symmetry has no such form."
)]
pub(crate) struct ExportArguments {
    /// Field: a model, a harmonic or a factored field
    pub(crate) field: PathBuf,
    /// File to write, ending in .onnx
    #[arg(long, value_name = "FILE")]
    pub(crate) out: PathBuf,
}

fn parse_pair(text: &str) -> Result<Orientation, String> {
    match OrientationSet::parse(text).map_err(|error| error.to_string())?.orientations.as_slice() {
        [one] => Ok(*one),
        _ => Err("one pair θ,φ".into()),
    }
}
