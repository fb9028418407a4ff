//! The command line: the commands, the options of all of them, and the arguments of the small ones; those of the others have a
//! file each.

pub(crate) mod access;
pub(crate) mod check;
pub mod clearance;
pub(crate) mod dataset;
pub(crate) mod either;
pub(crate) mod explicit;
pub(crate) mod field;
pub(crate) mod fixture;
pub(crate) mod harmonic;
pub(crate) mod inputs;
mod network;
pub mod numbers;
pub(crate) mod orientations;
pub(crate) mod quantity;
pub(crate) mod saved;
pub mod scene;
pub(crate) mod settings;
pub(crate) mod train;
pub(crate) mod transform;

use std::path::PathBuf;

use clap::{Args, Parser, Subcommand};
use imf_core::unit::LengthUnit;

use self::either::Either;
use self::train::TrainFamily;
use scene::SceneArguments;

/// Tells where, and from which directions, a tool can reach a part without collision.
#[derive(Parser)]
#[command(
    name = "imf",
    version,
    after_help = "Exit codes: 0 done; 1 failed, one message says why; 2 wrong arguments; 3 imf check found a \
                  collision; 130 stopped by Ctrl-C, \
                  finished work kept.\n\nStart with: imf demo",
    mut_subcommands(numbers::with_negative_numbers)
)]
pub struct Cli {
    #[command(flatten)]
    pub(crate) global: GlobalArguments,
    #[command(subcommand)]
    pub(crate) command: Command,
}

impl Cli {
    /// True where it takes part in a training of several processes.
    pub fn joins_ranks(&self) -> bool {
        match &self.command {
            Command::Train(Either::Sub(TrainFamily::Siren5(arguments))) => arguments.samples.mpi,
            Command::Finetune(arguments) => arguments.samples.mpi,
            _ => false,
        }
    }
}

/// Heading of the options that every command has.
const EVERYWHERE: &str = "Options of every command";

/// Options of every command.
#[derive(Args)]
pub struct GlobalArguments {
    /// Threads to compute with; all cores by default
    #[arg(long, global = true, help_heading = EVERYWHERE, value_name = "N", allow_negative_numbers = true)]
    pub(crate) threads: Option<usize>,
    /// Memory to stay within, such as 2GiB; four fifths of what is free by default
    #[arg(long, global = true, help_heading = EVERYWHERE, value_name = "SIZE", value_parser = crate::session::parse_size, allow_negative_numbers = true)]
    pub(crate) memory: Option<u64>,
    /// Results as JSON on standard output
    #[arg(long, global = true, help_heading = EVERYWHERE)]
    pub(crate) json: bool,
    /// No progress and no remarks, only results, warnings and errors
    #[arg(short, long, global = true, help_heading = EVERYWHERE, conflicts_with = "verbose")]
    pub(crate) quiet: bool,
    /// Also say how it is computed: transform sizes, devices, limits
    #[arg(short, long, global = true, help_heading = EVERYWHERE)]
    pub(crate) verbose: bool,
}

#[derive(Subcommand)]
pub(crate) enum Command {
    Demo(DemoArguments),
    Parts(PartsArguments),
    Voxelize(VoxelizeArguments),
    Field(field::FieldArguments),
    Access(access::AccessArguments),
    Crib(access::CribArguments),
    /// Sample exact sections into a dataset for training; continues one that was interrupted
    #[command(after_help = orientations::after(
        "Examples:\n  imf dataset teapot --orientations grid:15 --out teapot-225\n  \
         imf dataset teapot --orientations grid:15 --out partition-3 --shard 3/8\n  \
         imf dataset merge teapot-225 partition-1 partition-2 partition-3"
    ))]
    Dataset(dataset::DatasetArguments),
    /// Train a field of every point and direction: by a network of a megabyte, or of the family that is named
    Train(train::TrainArguments),
    Finetune(train::FinetuneArguments),
    Calibrate(saved::CalibrateArguments),
    Eval(saved::EvalArguments),
    Query(saved::QueryArguments),
    Export(saved::ExportArguments),
    Check(check::CheckArguments),
    Info(InfoArguments),
}

/// Where networks are trained and evaluated.
#[derive(Args, Clone)]
pub struct DeviceArguments {
    /// auto (a discrete or integrated GPU, else the CPU), cpu, gpu, software (software Vulkan), or a number or part of
    /// a name from `imf info`
    #[arg(long, default_value = "auto", value_name = "DEVICE")]
    pub device: String,
}

/// Where a field from a file is evaluated.
#[derive(Args)]
pub(crate) struct FieldDeviceArguments {
    /// Where the field is evaluated: auto (the CPU; for siren5 a discrete or integrated GPU where there is one), cpu, gpu, software
    /// (software Vulkan), or a number or part of a name from `imf info`
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
    /// Training steps
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u64).range(1..))]
    pub(crate) steps: u64,
    #[command(flatten)]
    pub(crate) device: DeviceArguments,
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

/// Seconds of at least 0.
pub fn parse_seconds(text: &str) -> Result<f64, String> {
    numbers::number(text, |&seconds| seconds >= 0.0, &format!("'{text}' is not a number of seconds"))
}

/// Describe a mesh, a tool, a dataset or a field; or what this machine can compute with, and the built-in parts
#[derive(Args)]
#[command(
    after_help = "Examples:\n  imf info\n  imf info part.obj\n  imf info mill.toml\n  imf info model/field.safetensors"
)]
pub(crate) struct InfoArguments {
    /// A mesh, a reference part, a tool file, a dataset's folder, a model or a field; without it, what this machine can compute with
    /// and the built-in parts
    pub(crate) what: Option<PathBuf>,
    /// Unit of a mesh: mm (the default), cm, m or inch; 3MF files state theirs
    #[arg(long, value_name = "UNIT")]
    pub(crate) unit: Option<LengthUnit>,
}

#[cfg(test)]
mod tests {
    use clap::{Command, CommandFactory as _};

    use super::Cli;

    /// Most options of a command, and most commands: one more takes the place of another.
    const MAX_OPTIONS: usize = 25;
    const MAX_COMMANDS: usize = 15;

    /// Options of a command beside those of a scene, which have a heading, and those of every command.
    fn own_options(command: &Command) -> usize {
        let own = |argument: &&clap::Arg| {
            !argument.is_positional() && argument.get_help_heading().is_none() && !argument.is_global_set()
        };
        command.get_arguments().filter(own).count()
    }

    fn check(command: &Command) {
        let count = own_options(command);
        assert!(count <= MAX_OPTIONS, "{} has {count} options of its own", command.get_name());
        command.get_subcommands().for_each(check);
    }

    #[test]
    fn commands_are_few_and_so_are_their_options() {
        let command = Cli::command();
        command.clone().debug_assert();
        assert!(command.get_subcommands().filter(|sub| !sub.is_hide_set()).count() <= MAX_COMMANDS);
        check(&command);
    }
}
