//! What `imf compress` is asked.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use imf_fields::factored::DistillSettings;
use imf_fields::harmonic::coefficients::Precision;
use imf_fields::recipe::Optimiser;
use imf_fields::recipe::SoapConfig;
use imf_fields::recipe::{Length, TrainingPlan};

/// Teach a harmonic field to a network of about a megabyte that answers every point and direction
#[derive(Args)]
#[command(after_help = "Example:\n  imf field teapot --method harmonic --save \
                        teapot.safetensors\n  imf compress teapot.safetensors --out small\n  imf query \
                        small/field.safetensors poses.csv\n  imf compress changed.safetensors --from \
                        small/field.safetensors --steps 100 --out changed\n\nWrites field.safetensors and teaching.safetensors (for \
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
    /// Start from the network of another field, such as that of the part before it was changed: a hundred steps are enough.
    /// Its width, layers, ω and what it was told of symmetry are taken over
    #[arg(long, value_name = "FIELD", conflicts_with_all = ["width", "layers", "omega", "symmetry"])]
    pub(crate) from: Option<PathBuf>,
    /// Neurons of every hidden layer
    #[arg(long, default_value_t = DistillSettings::default().width, value_name = "N")]
    pub(crate) width: usize,
    /// Hidden layers
    #[arg(long, default_value_t = DistillSettings::default().hidden, value_name = "N")]
    pub(crate) layers: usize,
    /// Frequency factor ω inside every sine
    #[arg(long, default_value_t = DistillSettings::default().omega, value_name = "ω", value_parser = super::numbers::parse_omega)]
    pub(crate) omega: f32,
    /// Leave out measuring what the field's decisions are worth (imf calibrate), which teaching 2.3 million voxels or more ends
    /// with: it takes at most an eighth of its time
    #[arg(long)]
    pub(crate) no_calibrate: bool,
    /// Times that every voxel is seen
    #[arg(long, default_value_t = DistillSettings::EPOCHS, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) epochs: u64,
    /// Steps, instead of epochs
    #[arg(long, value_name = "N", conflicts_with = "epochs", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) steps: Option<u64>,
    /// Voxels of a step
    #[arg(long, default_value_t = DistillSettings::default().plan.batch, value_name = "N", value_parser = super::numbers::parse_count)]
    pub(crate) batch: usize,
    /// Highest learning rate, which falls to 0 by a cosine; by default 1.5e-3 in 1,000 steps, lower in more and in fewer, and
    /// 3e-4 from another field's network
    #[arg(long, value_name = "RATE", value_parser = super::numbers::parse_rate)]
    pub(crate) rate: Option<f32>,
    /// Where it is taught: cpu, auto, gpu, software, a name or an index as `imf info` has them. A checkpoint made on one
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
    /// What moves the weights between hidden layers, all others being left to Adam; by default soap
    #[arg(long, value_enum, value_name = "NAME")]
    optimiser: Option<OptimiserName>,
    /// Keep weights in f16: half the file
    #[arg(long)]
    half: bool,
    /// What the network is told of the part's symmetry: by default auto, which looks for mirror planes and an axis of revolution.
    /// Going on from a checkpoint or another field keeps what that was told; where sections teach it is none
    #[arg(long, value_enum, value_name = "WHAT")]
    symmetry: Option<SymmetryChoice>,
}

/// What a network is told of symmetry.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum SymmetryChoice {
    /// What is found
    Auto,
    /// Nothing
    None,
}

/// Optimisers by their names.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum OptimiserName {
    /// Adam along the axes of each matrix's gradients (SOAP)
    Soap,
    /// Adam
    Adam,
}

impl TeachingArguments {
    /// What the weights are to be moved by, where that was asked.
    pub(crate) fn optimiser(&self) -> Option<Optimiser> {
        self.optimiser.map(|name| match name {
            OptimiserName::Soap => Optimiser::Soap(SoapConfig::default()),
            OptimiserName::Adam => Optimiser::Adam,
        })
    }

    /// True where symmetry was asked for, not only left to the default.
    pub(crate) fn asks_for_symmetry(&self) -> bool {
        self.symmetry == Some(SymmetryChoice::Auto)
    }

    /// What the network is to be told of symmetry.
    pub(crate) fn symmetry(&self) -> SymmetryChoice {
        self.symmetry.unwrap_or(SymmetryChoice::Auto)
    }

    /// How the finished weights are kept.
    pub(crate) fn precision(&self) -> Precision {
        if self.half { Precision::F16 } else { Precision::F32 }
    }
}

impl CompressArguments {
    /// How the network is taught, but for the optimiser.
    pub(crate) fn settings(&self) -> DistillSettings {
        let length = self.steps.map_or(Length::Epochs(self.epochs), Length::Steps);
        let usual = match self.from {
            Some(_) => DistillSettings::of_another(length),
            None => DistillSettings::of_length(length),
        };
        DistillSettings {
            width: self.width,
            hidden: self.layers,
            omega: self.omega,
            plan: TrainingPlan {
                batch: self.batch,
                schedule: self.rate.map_or(usual.plan.schedule, DistillSettings::rates_from),
                seed: self.seed,
                ..usual.plan
            },
            ..usual
        }
    }
}
