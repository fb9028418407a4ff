//! The command line: what can be said, with an example for each command.

pub(crate) mod access;
pub(crate) mod calibrate;
pub(crate) mod check;
pub(crate) mod clearance;
pub(crate) mod compress;
pub(crate) mod export;
pub(crate) mod families;
pub(crate) mod fixture;
pub(crate) mod harmonic;
pub(crate) mod paper;
pub(crate) mod query_bench;
pub(crate) mod regime;
pub(crate) mod scene;
pub(crate) mod transform;

use std::path::PathBuf;

use clap::{ArgMatches, Args, FromArgMatches, Parser, Subcommand, ValueEnum};
use imf_core::dataset::Share;
use imf_core::training::schedule::RateRule;
use imf_core::training::{Loss, Precision};

use scene::SceneArguments;

/// Tells where, and from which directions, a tool can reach a part without collision.
#[derive(Parser)]
#[command(
    name = "imf",
    version,
    after_help = "Exit codes: 0 done; 1 failed, one message says why; 2 wrong arguments; 3 imf check found a \
                  collision; 130 stopped by Ctrl-C, \
                  finished work kept.\n\nStart with: imf demo"
)]
pub(crate) struct Cli {
    #[command(flatten)]
    pub(crate) global: GlobalArguments,
    #[command(subcommand)]
    pub(crate) command: Command,
}

/// Heading of the options that every command has.
const EVERYWHERE: &str = "Options of every command";

/// Options of every command.
#[derive(Args)]
pub(crate) struct GlobalArguments {
    /// Threads to compute with; all cores by default
    #[arg(long, global = true, help_heading = EVERYWHERE, value_name = "N")]
    pub(crate) threads: Option<usize>,
    /// Memory to stay within, such as 2GiB; four fifths of what is free by default
    #[arg(long, global = true, help_heading = EVERYWHERE, value_name = "SIZE", value_parser = crate::session::parse_size)]
    pub(crate) memory: Option<u64>,
    /// Answers as JSON on standard output
    #[arg(long, global = true, help_heading = EVERYWHERE)]
    pub(crate) json: bool,
    /// No progress and no remarks, only results and errors
    #[arg(short, long, global = true, help_heading = EVERYWHERE, conflicts_with = "verbose")]
    pub(crate) quiet: bool,
    /// Also say how it is computed: transform sizes, devices, limits
    #[arg(short, long, global = true, help_heading = EVERYWHERE)]
    pub(crate) verbose: bool,
}

impl Command {
    /// True where it takes part in a training of several processes.
    pub(crate) fn joins_ranks(&self) -> bool {
        match self {
            Self::Train(arguments) => arguments.plan.mpi,
            Self::Finetune(arguments) => arguments.plan.mpi,
            _ => false,
        }
    }
}

#[derive(Subcommand)]
pub(crate) enum Command {
    Demo(DemoArguments),
    Parts(PartsArguments),
    Voxelize(VoxelizeArguments),
    Field(FieldArguments),
    Access(access::AccessArguments),
    /// Sample exact sections into a dataset for training; continues one that was interrupted
    #[command(
        args_conflicts_with_subcommands = true,
        subcommand_negates_reqs = true,
        after_help = "Examples:\n  imf dataset teapot --orientations grid:15 --out teapot-225\n  \
                      imf dataset teapot --orientations grid:15 --out share-3 --shard 3/8\n  \
                      imf dataset merge teapot-225 share-1 share-2 share-3"
    )]
    Dataset(DatasetArguments),
    Train(TrainArguments),
    Finetune(FinetuneArguments),
    Compress(compress::CompressArguments),
    Calibrate(calibrate::CalibrateArguments),
    Regime(regime::RegimeArguments),
    Eval(EvalArguments),
    Query(QueryArguments),
    Export(export::ExportArguments),
    Check(check::CheckArguments),
    Bench(BenchArguments),
    Info(InfoArguments),
    /// List the devices that can train and evaluate
    #[command(after_help = "Example:\n  imf devices")]
    Devices,
}

/// Measure speed, beside what one would write oneself
#[derive(Args)]
pub(crate) struct BenchArguments {
    #[command(subcommand)]
    pub(crate) bench: Bench,
}

#[derive(Subcommand)]
pub(crate) enum Bench {
    Exact(ExactBenchArguments),
    Families(families::FamiliesBenchArguments),
    Paper(paper::PaperBenchArguments),
    Query(query_bench::QueryBenchArguments),
    Train(TrainBenchArguments),
}

/// Training steps against the matrix products' own peak and against PyTorch, by turns in one run
#[derive(Args)]
#[command(after_help = "Example:\n  imf bench train --python venv/bin/python --out bench-train\n\n\
                        Writes train.json and train.md. About half a minute without PyTorch.")]
pub(crate) struct TrainBenchArguments {
    /// Folder to write to
    #[arg(long, default_value = "imf-bench", value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Samples in a step; several with commas
    #[arg(long, value_delimiter = ',', default_value = "1024,8192", value_name = "N")]
    pub(crate) batch: Vec<usize>,
    /// Neurons of every hidden layer
    #[arg(long, default_value_t = 512, value_name = "N")]
    pub(crate) width: usize,
    /// What products of layers are computed in, PyTorch's too (bf16 and f16: by its autocast)
    #[arg(long, value_enum, default_value = "f32")]
    pub(crate) precision: PrecisionKind,
    /// Python with PyTorch
    #[arg(long, default_value = "python3", value_name = "COMMAND")]
    pub(crate) python: String,
    #[command(flatten)]
    pub(crate) device: DeviceArguments,
}

/// Exact sections against scipy and rustfft, and how their cost grows
#[derive(Args)]
#[command(after_help = "Example:\n  imf bench exact --out bench-exact\n\n\
                        Writes exact.json, exact.md and how time and memory grow as pictures. About a minute without --full.")]
pub(crate) struct ExactBenchArguments {
    /// Folder to write to
    #[arg(long, default_value = "imf-bench", value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// All sizes up to 384³, all 225 sections of the rivals, 10,000 orientations
    #[arg(long)]
    pub(crate) full: bool,
    /// Python with numpy and scipy
    #[arg(long, default_value = "python3", value_name = "COMMAND")]
    pub(crate) python: String,
    /// Measure this device too: gpu, software (software Vulkan), or a number or part of a name from `imf devices`
    #[arg(long, default_value = "cpu", value_name = "DEVICE")]
    pub(crate) device: String,
}

/// Where networks are trained and evaluated.
#[derive(Args, Clone)]
pub(crate) struct DeviceArguments {
    /// auto (a discrete or integrated GPU, else the CPU), cpu, gpu, software (software Vulkan), or a number or part of
    /// a name from `imf devices`
    #[arg(long, default_value = "auto", value_name = "DEVICE")]
    pub(crate) device: String,
}

/// The whole pipeline on the Utah teapot: voxels, exact sections, training, evaluation, pictures
#[derive(Args)]
#[command(after_help = "Example:\n  imf demo --out teapot-demo")]
pub(crate) struct DemoArguments {
    /// Folder for the model, the report and the pictures
    #[arg(long, default_value = "imf-demo", value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Seed of sampling, starting weights and order
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
    /// What is made: a harmonic field and the network of a megabyte that is taught it, or the paper's network
    #[arg(long, value_enum, default_value = "factored")]
    pub(crate) family: DemoFamily,
    /// Training steps; by default 1,000 for the factored field, 30,000 for siren5
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) steps: Option<u64>,
    #[command(flatten)]
    pub(crate) device: DeviceArguments,
}

/// The families that a demo can make.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum DemoFamily {
    /// A harmonic field of every direction, then the network of a megabyte that is taught it
    Factored,
    /// The paper's network, trained on samples of exact sections
    Siren5,
}

/// Write the built-in reference parts as OBJ
#[derive(Args)]
#[command(after_help = "Example:\n  imf parts parts-folder\n  imf parts parts-folder --only bracket")]
pub(crate) struct PartsArguments {
    /// Folder to write to
    pub(crate) folder: PathBuf,
    /// Only this part: teapot, bracket, bracket-raw or screw-gear
    #[arg(long, value_name = "PART")]
    pub(crate) only: Option<String>,
}

/// Turn a part into solid voxels
#[derive(Args)]
#[command(after_help = "Example:\n  imf voxelize bracket.stl --unit mm --pitch 0.5 --out voxels\n\n\
                        Writes voxels/solid.npy, voxels/solid.vti (ParaView) and voxels/slices.png.")]
pub(crate) struct VoxelizeArguments {
    #[command(flatten)]
    pub(crate) scene: SceneArguments,
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
}

/// Compute the field: how much the tool hits at every point, for each direction or at the best of them
#[derive(Args)]
#[command(after_help = "Examples:\n  imf field teapot --orientations '0,0;12,6' --out sections\n  \
                        imf field part.obj --tool mill.toml --orientations fibonacci:225 --imf --out imf\n  \
                        imf field teapot --orientations fibonacci:10000 --imf --method harmonic --confirm --out imf\n  \
                        imf field bracket --clearance 2 --clearance-cutter 2 --method harmonic --quantity depth --save \
                        bracket.safetensors\n\n\
                        Writes .npy, .vti (ParaView) and .png slices. Values are exact for voxel centres.")]
pub(crate) struct FieldArguments {
    #[command(flatten)]
    pub(crate) scene: SceneArguments,
    /// grid:N, fibonacci:N, random:N:SEED, cone:X,Y,Z:HALF_ANGLE:N, so3:N, pairs θ,φ;θ,φ or a CSV file
    #[arg(
        long,
        value_name = "SET",
        allow_hyphen_values = true,
        requires = "out",
        required_unless_present = "save"
    )]
    pub(crate) orientations: Option<String>,
    /// The inaccessibility measure (least over the orientations) with its best orientation, not every section
    #[arg(long)]
    pub(crate) imf: bool,
    /// Also the measures of cutter, shank and each holder segment by themselves
    #[arg(long)]
    pub(crate) elements: bool,
    #[command(flatten)]
    pub(crate) contact: clearance::ContactArguments,
    /// Compare this many voxels of every section with direct sums, and say so
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub(crate) check: usize,
    /// Where sections are counted: cpu, gpu, auto, software (software Vulkan), or a number or part of a name from
    /// `imf devices`. All give the same values; a CPU, which takes a few milliseconds a section at most, is the default
    #[arg(long, default_value = "cpu", value_name = "DEVICE")]
    pub(crate) device: String,
    #[command(flatten)]
    pub(crate) harmonic: harmonic::HarmonicArguments,
    /// Folder to write to
    #[arg(long, value_name = "DIR", requires = "orientations", required_unless_present = "save")]
    pub(crate) out: Option<PathBuf>,
}

/// A dataset is made, or what was made of it is joined or finished.
pub(crate) enum DatasetArguments {
    Make(Box<DatasetMakeArguments>),
    Act(DatasetAction),
}

// By hand: an optional group of arguments that holds another group is never seen as present by the derived code.
impl FromArgMatches for DatasetArguments {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        if matches.subcommand_name().is_some() {
            return DatasetAction::from_arg_matches(matches).map(Self::Act);
        }
        DatasetMakeArguments::from_arg_matches(matches).map(|make| Self::Make(Box::new(make)))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}

impl Args for DatasetArguments {
    fn augment_args(command: clap::Command) -> clap::Command {
        DatasetAction::augment_subcommands(DatasetMakeArguments::augment_args(command))
    }

    fn augment_args_for_update(command: clap::Command) -> clap::Command {
        Self::augment_args(command)
    }
}

#[derive(Subcommand)]
pub(crate) enum DatasetAction {
    Merge(DatasetMergeArguments),
    Finish(DatasetFinishArguments),
}

/// Join shares of a dataset that were made apart, after checking that they belong together and are whole
#[derive(Args)]
#[command(
    after_help = "Examples:\n  imf dataset merge teapot-225 share-1 share-2\n  imf dataset merge together\n\n\
                        What is missing is listed, and the exit code is 1 then."
)]
pub(crate) struct DatasetMergeArguments {
    /// Folder of the joined dataset; it may hold shares itself
    pub(crate) out: PathBuf,
    /// Folders of shares
    pub(crate) folders: Vec<PathBuf>,
}

/// Make what is missing of a dataset from what its folder says of itself; the part's mesh is not needed
#[derive(Args)]
#[command(after_help = "Example:\n  imf dataset finish teapot-225")]
pub(crate) struct DatasetFinishArguments {
    /// Folder of the dataset
    pub(crate) folder: PathBuf,
    /// Only share I of N
    #[arg(long, value_name = "I/N")]
    pub(crate) shard: Option<Share>,
}

/// Which sections to sample, how, and which of them here.
#[derive(Args)]
pub(crate) struct DatasetMakeArguments {
    #[command(flatten)]
    pub(crate) scene: SceneArguments,
    #[command(flatten)]
    pub(crate) contact: clearance::ContactArguments,
    /// grid:N, fibonacci:N, random:N:SEED, cone:X,Y,Z:HALF_ANGLE:N, pairs θ,φ;θ,φ or a CSV file
    #[arg(long, value_name = "SET", allow_hyphen_values = true)]
    pub(crate) orientations: String,
    /// Share of every section's voxels to sample
    #[arg(long, default_value_t = 0.35)]
    pub(crate) density: f64,
    /// Share of the samples to draw where the tool collides
    #[arg(long, default_value_t = 0.75)]
    pub(crate) positive_share: f64,
    /// Share of the samples to draw at the boundary between free and colliding; --positive-share divides the rest
    #[arg(long, default_value_t = 0.0)]
    pub(crate) boundary_share: f64,
    /// How far from the boundary still counts as at it
    #[arg(long, default_value_t = 1, value_name = "VOXELS")]
    pub(crate) boundary_width: usize,
    /// Seed of the sampling
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
    /// Make only share I of N, on this machine or another; `imf dataset merge` joins them
    #[arg(long, value_name = "I/N")]
    pub(crate) shard: Option<Share>,
    /// Samples in one file, at most
    #[arg(long, default_value_t = 4_000_000, value_name = "N", value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) shard_samples: u64,
    /// Folder of the dataset
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
}

/// How long and how fast to train; shared by train and finetune.
#[derive(Args, Clone)]
pub(crate) struct PlanArguments {
    /// Passes over the dataset
    #[arg(long, value_name = "N", conflicts_with = "steps")]
    pub(crate) epochs: Option<u64>,
    /// Steps, instead of epochs
    #[arg(long, value_name = "N")]
    pub(crate) steps: Option<u64>,
    /// Samples in a step
    #[arg(long, default_value_t = 1024, value_name = "N")]
    pub(crate) batch: usize,
    /// Highest learning rate; with --resume, the rate to go on from
    #[arg(long, value_name = "RATE")]
    pub(crate) rate: Option<f32>,
    /// How the rate follows the batch, from 1024 on; sqrt and linear begin with a rise of 100 steps
    #[arg(long, value_enum, default_value = "constant")]
    pub(crate) rate_rule: RuleKind,
    /// exponential: ×0.93 every epoch (the paper's); cosine: down to a hundredth over all steps
    #[arg(long, value_enum, default_value = "exponential")]
    pub(crate) schedule: ScheduleKind,
    /// What a step minimises
    #[arg(long, value_enum, default_value = "l1")]
    pub(crate) loss: LossKind,
    /// What products of layers are computed in, sums being f32: f32; bf16 (factors rounded to bfloat16), faster on CPUs with
    /// AVX-512 BF16; or f16 (factors rounded to f16) on GPUs, by their matrix units where they have them; a resumed
    /// training keeps its own
    #[arg(long, value_enum, default_value = "f32")]
    pub(crate) precision: PrecisionKind,
    /// Coupled L2 of Adam
    #[arg(long, default_value_t = 1e-6, value_name = "W")]
    pub(crate) weight_decay: f32,
    /// Seed of starting weights and order
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
    /// Seconds between checkpoints
    #[arg(long, default_value_t = 60.0, value_name = "SECONDS", value_parser = parse_seconds)]
    pub(crate) checkpoint_every: f64,
    /// Poses at random orientations that training never sees, to watch the error at; 0 for none
    #[arg(long, default_value_t = 16_384, value_name = "N")]
    pub(crate) held_out: usize,
    /// Steps between two looks at that error; about a hundredth of all steps, at least 500, by default
    #[arg(long, value_name = "STEPS")]
    pub(crate) held_out_every: Option<u64>,
    /// Also write loss, rate, held-out error and speed to this file, a JSON object a line; --resume goes on with it
    #[arg(long, value_name = "FILE")]
    pub(crate) log: Option<PathBuf>,
    /// Also write event files for TensorBoard, to the folder tensorboard in the output folder
    #[arg(long)]
    pub(crate) tensorboard: bool,
    /// Train together with the other processes that mpirun started, each on its share of every batch, on CPUs; needs a build
    /// with the feature mpi
    #[arg(long)]
    pub(crate) mpi: bool,
}

fn parse_seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(seconds) if seconds >= 0.0 => Ok(seconds),
        _ => Err(format!("'{text}' is no number of seconds")),
    }
}

#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum ScheduleKind {
    Exponential,
    Cosine,
}

#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum RuleKind {
    /// The same rate for every batch
    Constant,
    /// Rate × √(batch / 1024)
    Sqrt,
    /// Rate × batch / 1024
    Linear,
}

impl From<RuleKind> for RateRule {
    fn from(kind: RuleKind) -> Self {
        match kind {
            RuleKind::Constant => Self::Constant,
            RuleKind::Sqrt => Self::Sqrt,
            RuleKind::Linear => Self::Linear,
        }
    }
}

#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum PrecisionKind {
    F32,
    Bf16,
    F16,
}

impl From<PrecisionKind> for Precision {
    fn from(kind: PrecisionKind) -> Self {
        match kind {
            PrecisionKind::F32 => Self::F32,
            PrecisionKind::Bf16 => Self::Bf16,
            PrecisionKind::F16 => Self::F16,
        }
    }
}

#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum LossKind {
    L1,
    L2,
}

impl From<LossKind> for Loss {
    fn from(kind: LossKind) -> Self {
        match kind {
            LossKind::L1 => Self::L1,
            LossKind::L2 => Self::L2,
        }
    }
}

/// Train the paper's network (siren5) on a dataset
#[derive(Args)]
#[command(
    after_help = "Examples:\n  imf train teapot-225 --out model\n  imf train teapot-225 --out model --width 128 \
                        --epochs 10 --rate 3e-4 --schedule cosine\n  imf train teapot-225 --out model --resume\n\n\
                        Writes model.safetensors, checkpoint.safetensors (for --resume) and loss.png. Ctrl-C writes a \
                        checkpoint and stops. The defaults are the paper's: 5×512, 50 epochs."
)]
pub(crate) struct TrainArguments {
    /// Folder of the dataset
    pub(crate) dataset: PathBuf,
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Continue from the checkpoint in the output folder
    #[arg(long)]
    pub(crate) resume: bool,
    /// Neurons of every hidden layer
    #[arg(long, default_value_t = 512, value_name = "N")]
    pub(crate) width: usize,
    /// Hidden layers
    #[arg(long, default_value_t = 5, value_name = "N")]
    pub(crate) layers: usize,
    /// Frequency factor ω inside every sine; the paper's is 30, and 10 often does better between orientations
    #[arg(long, default_value_t = 30.0, value_name = "ω")]
    pub(crate) omega: f32,
    /// Leave out measuring what the model's decisions are worth (imf calibrate), which a training of 2.3 million samples or
    /// more ends with: it takes at most an eighth of its time
    #[arg(long)]
    pub(crate) no_calibrate: bool,
    #[command(flatten)]
    pub(crate) plan: PlanArguments,
    #[command(flatten)]
    pub(crate) device: DeviceArguments,
}

/// Adapt a trained model to another dataset, such as a changed part
#[derive(Args)]
#[command(after_help = "Example:\n  imf finetune raw/model.safetensors bracket-225 --out adapted\n\n\
                        By default 5 epochs from a learning rate of 1e-4.")]
pub(crate) struct FinetuneArguments {
    /// Model to start from
    pub(crate) model: PathBuf,
    /// Folder of the dataset
    pub(crate) dataset: PathBuf,
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Continue from the checkpoint in the output folder
    #[arg(long)]
    pub(crate) resume: bool,
    /// Leave out measuring what the model's decisions are worth (imf calibrate), which a training of 2.3 million samples or
    /// more ends with: it takes at most an eighth of its time
    #[arg(long)]
    pub(crate) no_calibrate: bool,
    #[command(flatten)]
    pub(crate) plan: PlanArguments,
    #[command(flatten)]
    pub(crate) device: DeviceArguments,
}

/// Compare a model, or a harmonic or factored field, with the exact field
#[derive(Args)]
#[command(after_help = "Examples:\n  imf eval model/model.safetensors\n  imf eval model/model.safetensors \
                        --random 256 --imf grid:25 --out report")]
pub(crate) struct EvalArguments {
    /// Model or field to evaluate
    pub(crate) model: PathBuf,
    /// Section that training saw, θ,φ
    #[arg(long, default_value = "0,0", value_name = "θ,φ")]
    pub(crate) in_sample: String,
    /// Section that training did not see, θ,φ
    #[arg(long, default_value = "12,6", value_name = "θ,φ")]
    pub(crate) out_of_sample: String,
    /// Number of random orientations
    #[arg(long, default_value_t = 64, value_name = "N")]
    pub(crate) random: usize,
    /// Orientation set of the IMF; a model's training set by default, 225 spread evenly for other fields
    #[arg(long, value_name = "SET")]
    pub(crate) imf: Option<String>,
    /// CMF above which a pose is called blocked
    #[arg(long, default_value_t = 0.001, value_name = "τ")]
    pub(crate) threshold: f64,
    /// Seed of the random orientations
    #[arg(long, default_value_t = 1)]
    pub(crate) seed: u64,
    /// Also write report.json, report.md and pictures to this folder
    #[arg(long, value_name = "DIR")]
    pub(crate) out: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) device: DeviceArguments,
}

/// Answer poses from a CSV file: how much does the tool overlap the part when its tip is here
#[derive(Args)]
#[command(after_help = "Example:\n  imf query model/model.safetensors poses.csv --out answers.csv\n\n\
                        The first line names the columns: x,y,z,i,j,k (tool axis from tip to holder) or \
                        x,y,z,theta,phi (degrees). Other columns are kept. Answers add the column overlap, from 0 to \
                        1; with --exact also overlap_exact; with --sharp they are called cmf and cmf_exact.")]
pub(crate) struct QueryArguments {
    /// Trained model, or a harmonic or factored field
    pub(crate) model: PathBuf,
    /// CSV file of poses, or - for standard input
    pub(crate) poses: PathBuf,
    /// CSV file of answers; standard output by default
    #[arg(long, value_name = "FILE")]
    pub(crate) out: Option<PathBuf>,
    /// Also count the exact overlap
    #[arg(long)]
    pub(crate) exact: bool,
    /// The least over the tool's sharp points k (CMF), not the tip's overlap: each read or counted at x − R k itself, where
    /// sections take the mean of the voxels around
    #[arg(long)]
    pub(crate) sharp: bool,
    #[command(flatten)]
    pub(crate) device: DeviceArguments,
}

/// Describe a mesh, a tool, a dataset, a model or a field
#[derive(Args)]
#[command(
    after_help = "Examples:\n  imf info part.obj\n  imf info mill.toml\n  imf info model/model.safetensors"
)]
pub(crate) struct InfoArguments {
    /// A mesh, a reference part, a tool file, a dataset's folder, a model or a field
    pub(crate) what: PathBuf,
    /// Unit of a mesh: mm (the default), cm, m or inch; 3MF files state theirs
    #[arg(long, value_name = "UNIT")]
    pub(crate) unit: Option<String>,
}
