//! What `imf compress` is asked.

use std::path::PathBuf;

use clap::Args;
use imf_core::factored::{Optimiser, TeachSettings};
use imf_core::harmonic::coefficients::Precision;
use imf_core::siren::muon::MuonConfig;
use imf_core::training::run::{Length, TrainingPlan};
use imf_core::training::schedule::Schedule;

/// What is taught where nothing else is asked; `imf bench paper` takes the same.
const WIDTH: usize = 256;
const LAYERS: usize = 3;
const OMEGA: f32 = 20.0;
const BATCH: usize = 1024;
pub(super) const RATE: f32 = 1.5e-3;
/// Times that every voxel is seen.
pub(super) const EPOCHS: u64 = 5;
/// Steps in which the rate rises; a solved last layer needs few.
const WARMUP: u64 = 10;

/// Teach a harmonic field to a network of about a megabyte that answers every point and direction
#[derive(Args)]
#[command(after_help = "Example:\n  imf field teapot --method harmonic --save \
                        teapot.safetensors\n  imf compress teapot.safetensors --out small\n  imf query \
                        small/field.safetensors poses.csv\n  imf compress changed.safetensors --from \
                        small/field.safetensors --epochs 1 --out changed\n\nWrites field.safetensors and teaching.safetensors (for \
                        --resume). Ctrl-C writes a checkpoint and stops.")]
pub(crate) struct CompressArguments {
    /// Harmonic field, from imf field --method harmonic --save
    pub(crate) field: PathBuf,
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Continue from the checkpoint in the output folder
    #[arg(long)]
    pub(crate) resume: bool,
    /// Start from the network of another field, such as that of the part before it was changed: fewer epochs are enough.
    /// Its width, layers and ω are taken over
    #[arg(long, value_name = "FIELD", conflicts_with_all = ["width", "layers", "omega"])]
    pub(crate) from: Option<PathBuf>,
    /// Neurons of every hidden layer
    #[arg(long, default_value_t = WIDTH, value_name = "N")]
    pub(crate) width: usize,
    /// Hidden layers
    #[arg(long, default_value_t = LAYERS, value_name = "N")]
    pub(crate) layers: usize,
    /// Frequency factor ω inside every sine
    #[arg(long, default_value_t = OMEGA, value_name = "ω")]
    pub(crate) omega: f32,
    /// Leave out measuring what the field's decisions are worth (imf calibrate), which teaching 2.3 million voxels or more ends
    /// with: it takes at most an eighth of its time
    #[arg(long)]
    pub(crate) no_calibrate: bool,
    /// Times that every voxel is seen
    #[arg(long, default_value_t = EPOCHS, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) epochs: u64,
    /// Steps, instead of epochs
    #[arg(long, value_name = "N", conflicts_with = "epochs", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) steps: Option<u64>,
    /// Voxels of a step
    #[arg(long, default_value_t = BATCH, value_name = "N")]
    pub(crate) batch: usize,
    /// Learning rate at the beginning; it falls to 0 by a cosine
    #[arg(long, default_value_t = RATE, value_name = "RATE")]
    pub(crate) rate: f32,
    /// Where it is taught: cpu, auto, gpu, software, a name or an index as `imf devices` has them. A checkpoint made on one
    /// is resumed on any
    #[arg(long, default_value = "cpu", value_name = "DEVICE")]
    pub(crate) device: String,
    /// Seed of the weights and of the order of voxels
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
    #[command(flatten)]
    pub(crate) teaching: TeachingArguments,
    /// Seconds between checkpoints
    #[arg(long, default_value_t = 60.0, value_name = "SECONDS", value_parser = super::parse_seconds)]
    pub(crate) checkpoint_every: f64,
}

/// How a network is taught and kept; shared by compress and train.
#[derive(Args)]
pub(crate) struct TeachingArguments {
    /// Adam for every weight, not orthogonalised momentum (Muon) for the matrices between hidden layers
    #[arg(long)]
    adam: bool,
    /// Keep weights in f16: half the file
    #[arg(long)]
    half: bool,
}

impl TeachingArguments {
    /// What the weights are moved by.
    pub(crate) fn optimiser(&self) -> Optimiser {
        if self.adam { Optimiser::Adam } else { Optimiser::Muon(MuonConfig::default()) }
    }

    /// How the finished weights are kept.
    pub(crate) fn precision(&self) -> Precision {
        if self.half { Precision::F16 } else { Precision::F32 }
    }
}

/// The rates of a teaching, from its first.
pub(crate) fn falling_from(initial: f32) -> Schedule {
    Schedule::Cosine { initial, last: 0.0, warmup: WARMUP }
}

/// How a network is taught where nothing is asked but the length.
pub(crate) fn teaching(length: Length) -> TeachSettings {
    let defaults = TeachSettings::default();
    TeachSettings {
        width: WIDTH,
        hidden: LAYERS,
        omega: OMEGA,
        plan: TrainingPlan { length, batch: BATCH, schedule: falling_from(RATE), ..defaults.plan },
        optimiser: Optimiser::Muon(MuonConfig::default()),
        ..defaults
    }
}

impl CompressArguments {
    /// How the network is taught.
    pub(crate) fn settings(&self) -> TeachSettings {
        let defaults = teaching(self.steps.map_or(Length::Epochs(self.epochs), Length::Steps));
        TeachSettings {
            width: self.width,
            hidden: self.layers,
            omega: self.omega,
            plan: TrainingPlan {
                batch: self.batch,
                schedule: falling_from(self.rate),
                seed: self.seed,
                ..defaults.plan
            },
            optimiser: self.teaching.optimiser(),
            ..defaults
        }
    }
}
