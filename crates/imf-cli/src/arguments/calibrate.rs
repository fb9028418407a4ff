//! What `imf calibrate` is asked.

use std::path::PathBuf;

use clap::Args;
use imf_fields::calibration::Goals;
use imf_fields::field::calibrate::CalibrationSettings;

/// Measure what a field's decisions are worth, choose its thresholds for free and colliding, and keep both in its file
#[derive(Args)]
#[command(
    after_help = "Example:\n  imf train harmonic bracket --clearance 2 --clearance-cutter 2 --quantity depth \
                  --no-calibrate --out bracket.safetensors\n  imf calibrate bracket.safetensors\n  imf calibrate \
                  bracket.safetensors --verify --seed 1\n\nA colliding pose is one of the tool as it is, a clear pose one \
                  where the tool grown by its clearance is free: what lies between may be answered either way."
)]
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
