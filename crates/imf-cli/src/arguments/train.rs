//! The arguments of `imf train`, by the family of fields that is trained, and of `imf finetune`.

use std::path::PathBuf;

use anyhow::Result;
use clap::{Args, Subcommand};
use imf_fields::factored::DistillSettings;
use imf_fields::recipe::schedule::Schedule;
use imf_fields::recipe::{AdamConfig, HeldOutChoice, TrainingLength, TrainingPlan};
use imf_fields::siren::SirenShape;

use super::clearance::ContactArguments;
use super::either::Either;
use super::explicit::ExplicitOptions;
use super::harmonic::HarmonicArguments;
use super::network::{Network, parse_network};
use super::numbers::{parse_count, parse_rate};
use super::quantity::QuantityArguments;
use super::scene::SceneArguments;
use super::settings::{
    FactoredSettings, ScheduleName, Setting, Siren5Settings, parse_setting, read_settings,
};
use crate::exit::WrongArgument;
use crate::job::{REPORT_EVERY, schedule_from};

/// Arguments of `imf train`: without a family those of a factored field.
pub(crate) type TrainArguments = Either<FactoredArguments, TrainFamily>;

/// A family of fields to train.
#[derive(Subcommand)]
pub(crate) enum TrainFamily {
    Factored(Box<FactoredArguments>),
    Harmonic(Box<HarmonicArguments>),
    Siren5(Box<Siren5Arguments>),
}

/// Train a network of about a megabyte for every point and direction (what imf train PART does)
#[derive(Args)]
#[command(
    mut_arg("part", |part| part.value_name("PART or FIELD").help(
        "What it is a field of: an OBJ, STL, PLY or 3MF file, or a built-in part (teapot, bracket, bracket-raw, screw-gear); or a \
         harmonic field to distil, from imf train harmonic: then none of the options of a part"
    )),
    after_help = "Examples:\n  imf train part.stl --unit mm --tool mill.toml --out field\n  imf train teapot --out field --resume\n  \
                  imf train factored changed.safetensors --from field/field.safetensors --steps 100 --out changed\n\n\
                  Fits a harmonic field to exact sections and distils it into a network. Writes field.safetensors, \
                  checkpoint.safetensors (for --resume) and log.jsonl. Ctrl-C writes a checkpoint and stops.\n\n\
                  --set also takes epochs (5, where --steps is left out), batch (1024), seed (0), optimiser (soap or adam), \
                  symmetry (true, or false to leave the part's out of account) and checkpoint_every (60 seconds)."
)]
pub(crate) struct FactoredArguments {
    #[command(flatten)]
    pub(crate) explicit: ExplicitOptions,
    #[command(flatten)]
    pub(crate) scene: SceneArguments,
    #[command(flatten)]
    pub(crate) contact: ContactArguments,
    #[command(flatten)]
    pub(crate) quantity: QuantityArguments,
    #[command(flatten)]
    pub(crate) run: RunArguments,
    #[command(flatten)]
    pub(crate) start: StartArguments,
    /// Highest degree of the harmonics that are distilled: more is finer and costs memory and time by its square; by default 16, and
    /// 5 of whole rotations, where the tool is not symmetric about its axis
    #[arg(long, value_name = "L")]
    pub(crate) degree: Option<usize>,
    /// Save weights in f16: half the file
    #[arg(long)]
    pub(crate) half: bool,
}

/// Train the paper's network on samples of exact sections; its values are overlaps
#[derive(Args)]
#[command(
    mut_arg("part", |part| part.value_name("PART or DATASET").help(
        "What it is a field of: an OBJ, STL, PLY or 3MF file, or a built-in part (teapot, bracket, bracket-raw, screw-gear), \
         whose 231 sections are sampled in the folder dataset; or the folder of a dataset: then none of the options of a part"
    )),
    mut_arg("quantity", |quantity| quantity.help(
        "overlap is all that this network learns, to be said with a part of your own: overlaps hardly see a small cutter beside its \
         holder, and imf train PART learns depths, which decide"
    )),
    after_help = "Examples:\n  imf train siren5 teapot --out paper\n  imf train siren5 teapot-225 --out paper --network 5x128 \
                  --steps 30000\n\n\
                  Writes field.safetensors, checkpoint.safetensors (for --resume), log.jsonl and loss.png. Ctrl-C writes a \
                  checkpoint and stops.\n\n--set also takes seed (0), schedule (cosine: down to a hundredth over all steps; exponential: the \
                  paper's, from 5e-4 and ×0.93 every epoch), loss (l1, l2 or l1-small), precision (f32; bf16, on CPUs with AVX-512 BF16; f16, on \
                  GPUs), weight_decay (1e-6), held_out (16384 poses to watch the error at), held_out_every (steps) and checkpoint_every (60 \
                  seconds)."
)]
pub(crate) struct Siren5Arguments {
    #[command(flatten)]
    pub(crate) explicit: ExplicitOptions,
    #[command(flatten)]
    pub(crate) scene: SceneArguments,
    #[command(flatten)]
    pub(crate) contact: ContactArguments,
    #[command(flatten)]
    pub(crate) quantity: QuantityArguments,
    #[command(flatten)]
    pub(crate) run: RunArguments,
    #[command(flatten)]
    pub(crate) start: StartArguments,
    #[command(flatten)]
    pub(crate) samples: SampleArguments,
}

/// Adapt a trained network (siren5) to another dataset, such as a changed part's
#[derive(Args)]
#[command(after_help = "Example:\n  imf finetune raw/field.safetensors bracket-225 --out adapted\n\n\
                        As imf train siren5 DATASET --from MODEL: by default 1,200 steps from a tenth of a new network's learning rate.")]
pub(crate) struct FinetuneArguments {
    #[command(flatten)]
    pub(crate) explicit: ExplicitOptions,
    /// Model to start from
    pub(crate) model: PathBuf,
    /// Folder of the dataset
    pub(crate) dataset: PathBuf,
    #[command(flatten)]
    pub(crate) run: RunArguments,
    #[command(flatten)]
    pub(crate) samples: SampleArguments,
}

/// How any network is trained.
#[derive(Args)]
pub(crate) struct RunArguments {
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Continue from the checkpoint in the output folder
    #[arg(long)]
    pub(crate) resume: bool,
    /// Steps of the training, instead of passes over all samples
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    steps: Option<u64>,
    /// Highest learning rate; by default 1.5e-3 for a factored field in 1,000 steps, lower in more and mostly in fewer, and for
    /// siren5 one that follows from width and ω; less with --from. With --resume, siren5 goes on with another one
    #[arg(long, value_name = "RATE", value_parser = parse_rate)]
    pub(crate) rate: Option<f32>,
    /// Where it is trained: auto (a discrete or integrated GPU, else the CPU), cpu, gpu, software (software Vulkan), or a
    /// number or part of a name from `imf info`; by default cpu for a factored field, auto for siren5
    #[arg(long, value_name = "DEVICE")]
    pub(crate) device: Option<String>,
    /// Leave out the calibration of the field's decisions (imf calibrate), which takes a few seconds
    #[arg(long)]
    pub(crate) no_calibrate: bool,
    /// Another setting, see below; may be repeated
    #[arg(long, value_name = "KEY=VALUE", value_parser = parse_setting)]
    set: Vec<Setting>,
}

/// What network is trained, from which weights.
#[derive(Args)]
pub(crate) struct StartArguments {
    /// Hidden layers, their width, and the frequency factor ω inside every sine, such as 5x128, 5x128:10 or :10; by default
    /// 3x256:20 for a factored field, the paper's 5x512 for siren5, with an ω of 10 instead of its 30
    #[arg(long, value_name = "LxW:ω", value_parser = parse_network)]
    network: Option<Network>,
    /// Start from the network of another field of the family, such as that of the part before it was changed; it keeps its layers
    #[arg(long, value_name = "FIELD", conflicts_with = "network")]
    pub(crate) from: Option<PathBuf>,
}

/// How siren5 goes through its samples.
#[derive(Args)]
pub(crate) struct SampleArguments {
    /// Passes over all samples, instead of steps; by default 12,000 steps, and 1,200 from another network
    #[arg(long, value_name = "N", conflicts_with = "steps", value_parser = clap::value_parser!(u64).range(1..))]
    epochs: Option<u64>,
    /// Samples in a step
    #[arg(long, default_value_t = 1024, value_name = "N", value_parser = parse_count)]
    batch: usize,
    /// Train together with the other processes that mpirun started, each on its share of every batch, on CPUs; needs a build
    /// with the feature mpi
    #[arg(long)]
    pub(crate) mpi: bool,
}

impl FactoredArguments {
    /// How the network is trained but for its symmetry, with the settings that were given.
    pub(crate) fn settings(&self) -> Result<(DistillSettings, FactoredSettings)> {
        let set: FactoredSettings = read_settings(&self.run.set)?;
        if self.run.steps.is_some() && set.epochs.is_some() {
            return Err(WrongArgument(
                "--steps and --set epochs= both say how long: give one of them".into(),
            )
            .into());
        }
        let epochs = set.epochs.unwrap_or(DistillSettings::EPOCHS);
        let length = self.run.steps.map_or(TrainingLength::Epochs(epochs), TrainingLength::Steps);
        let seed = set.seed.unwrap_or(0);
        let usual = match self.start.from {
            Some(_) => DistillSettings::of_another(length),
            None => DistillSettings::of_length(length),
        };
        let Network { layers, omega } = self.start.network.unwrap_or_default();
        let (hidden, width) = layers.unwrap_or((usual.hidden, usual.width));
        let plan = TrainingPlan {
            batch: set.batch.unwrap_or(usual.plan.batch),
            schedule: self.run.rate.map_or(usual.plan.schedule, DistillSettings::rates_from),
            seed,
            ..usual.plan
        };
        let settings = DistillSettings { width, hidden, omega: omega.unwrap_or(usual.omega), plan, ..usual };
        settings.check().map_err(|error| WrongArgument(error.to_string()))?;
        Ok((settings, set))
    }
}

impl StartArguments {
    /// The shape of siren5.
    pub(crate) fn shape(&self) -> SirenShape {
        let usual = SirenShape::default();
        let Network { layers, omega } = self.network.unwrap_or_default();
        let (hidden, width) = layers.unwrap_or((usual.hidden, usual.width));
        SirenShape { width, hidden, omega: omega.unwrap_or(usual.omega), ..usual }
    }
}

/// How siren5 is trained, and what of it was given.
pub(crate) struct Siren5Training<'a> {
    pub(crate) explicit: &'a ExplicitOptions,
    pub(crate) run: &'a RunArguments,
    pub(crate) set: Siren5Settings,
    pub(crate) plan: TrainingPlan,
}

impl<'a> Siren5Training<'a> {
    /// From random weights, or from those of another network.
    pub(crate) fn new(
        explicit: &'a ExplicitOptions,
        run: &'a RunArguments,
        samples: &SampleArguments,
        shape: &SirenShape,
        from_another: bool,
    ) -> Result<Self> {
        let set: Siren5Settings = read_settings(&run.set)?;
        let usual = if from_another { TrainingPlan::fine_tuning(shape) } else { TrainingPlan::siren5(shape) };
        let schedule = match set.schedule {
            Some(ScheduleName::Exponential) => Schedule::default(),
            None | Some(ScheduleName::Cosine) => usual.schedule,
        };
        let schedule = run.rate.map_or(schedule, |rate| schedule_from(&schedule, rate));
        let adam = usual.adam;
        let plan = TrainingPlan {
            length: samples
                .epochs
                .map(TrainingLength::Epochs)
                .or(run.steps.map(TrainingLength::Steps))
                .unwrap_or(usual.length),
            batch: samples.batch,
            schedule,
            adam: AdamConfig { weight_decay: set.weight_decay.unwrap_or(adam.weight_decay), ..adam },
            loss: set.loss.unwrap_or_default(),
            precision: set.precision.unwrap_or_default(),
            seed: set.seed.unwrap_or(0),
            report_every: REPORT_EVERY,
        };
        plan.check().map_err(|error| WrongArgument(error.to_string()))?;
        if set.held_out_every == Some(0) {
            return Err(WrongArgument("--set held_out_every=0: give at least 1".into()).into());
        }
        Ok(Self { explicit, run, set, plan })
    }

    /// Poses to watch the error at.
    pub(crate) fn held_out(&self) -> usize {
        self.set.held_out.unwrap_or(HeldOutChoice::default().poses)
    }

    /// The first of these options and settings that was given and says something else than the training that is resumed.
    pub(crate) fn first_other(&self, differs: &[(&str, bool)]) -> Option<String> {
        let is_set = |key: &str| self.run.set.iter().any(|(name, _)| name == key);
        differs.iter().filter(|(_, differs)| *differs).find_map(|&(name, _)| match name {
            name if self.explicit.has(name) => Some(format!("--{name}")),
            name if is_set(name) => Some(format!("--set {name}")),
            _ => None,
        })
    }
}
