//! What `imf train` is asked, and which training follows from it: options of the other family are refused by name.

use std::path::{Path, PathBuf};
use std::str::FromStr as _;

use anyhow::{Result, bail};
use clap::parser::ValueSource;
use clap::{ArgMatches, Args, Command, FromArgMatches};
use imf_core::orientation::OrientationSet;
use imf_core::parts::ReferencePart;
use imf_fields::factored::DistillSettings;
use imf_fields::recipe::OnlineSettings;
use imf_fields::recipe::Sampling;
use imf_fields::recipe::TrainingPlan;
use imf_fields::siren::SirenShape;
use imf_train::dataset::{Layout, Manifest};

use super::clearance::ContactArguments;
use super::compress::TeachingArguments;
use super::dataset::{SamplingArguments, directions};
use super::scene::SceneArguments;
use super::{LengthArguments, NetworkFamily, PlanArguments};

/// Train a network that answers every point and direction, of a part or of a dataset
#[derive(Args)]
#[command(
    mut_arg("part", |part| part.value_name("SUBJECT").help(
        "What it is a field of: an OBJ, STL, PLY or 3MF file, a built-in part (teapot, bracket, bracket-raw, \
         screw-gear), or the folder of a dataset"
    )),
    mut_arg("epochs", |epochs| epochs.help("Passes over all samples; by default 5 for a factored field, 50 for siren5")),
    mut_arg("rate", |rate| rate.help(
        "Highest learning rate; by default 1.5e-3 for a factored field in 1,000 steps, lower in more, and in fewer too where a \
         harmonic field teaches; 5e-4 for siren5, where --resume goes on from the rate that is given"
    )),
    mut_arg("seed", |seed| seed.help("Seed of starting weights and order, and of a part's samples")),
    after_help = "Examples:\n  imf train part.stl --unit mm --tool mill.toml --out model\n  imf train teapot --out model \
                  --resume\n  imf train teapot --family siren5 --omega 10 --out paper\n  imf train teapot-225 --out \
                  paper --width 128 --epochs 10 --rate 3e-4 --schedule cosine\n\n\
                  Of a part: fits a harmonic field to exact sections and teaches it to a network of about a megabyte, as imf field \
                  --method harmonic and imf compress do. Writes field.safetensors and teaching.safetensors (for \
                  --resume).\n\nBy siren5, the paper's network: learns samples of exact sections, those of a dataset, or of a \
                  part's own, which is made in the folder dataset. Writes model.safetensors, checkpoint.safetensors (for \
                  --resume) and loss.png.\n\nCtrl-C writes a checkpoint and stops."
)]
pub(crate) struct TrainArguments {
    // Before the others, which take their values away.
    #[command(flatten)]
    pub(crate) given: Given,
    #[command(flatten)]
    pub(crate) scene: SceneArguments,
    #[command(flatten)]
    pub(crate) contact: ContactArguments,
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// What is made; by default factored of a part, siren5 of a dataset
    #[arg(long, value_enum)]
    family: Option<NetworkFamily>,
    /// Continue from the checkpoint in the output folder
    #[arg(long)]
    pub(crate) resume: bool,
    /// Neurons of every hidden layer; by default 256 for a factored field, 512 for siren5
    #[arg(long, value_name = "N")]
    width: Option<usize>,
    /// Hidden layers; by default 3 for a factored field, 5 for siren5
    #[arg(long, value_name = "N")]
    layers: Option<usize>,
    /// Frequency factor ω inside every sine; by default 20 for a factored field, for siren5 the paper's 30, where 10 often
    /// does better between orientations
    #[arg(long, value_name = "ω", value_parser = super::numbers::parse_omega)]
    omega: Option<f32>,
    /// Leave out measuring what the field's decisions are worth (imf calibrate), which a training of 2.3 million samples or
    /// more ends with: it takes at most an eighth of its time
    #[arg(long)]
    pub(crate) no_calibrate: bool,
    /// Where it is trained: auto (a discrete or integrated GPU, else the CPU), cpu, gpu, software (software Vulkan), or a
    /// number or part of a name from `imf info`; by default cpu for a factored field, auto for siren5
    #[arg(long, value_name = "DEVICE")]
    device: Option<String>,
    #[command(flatten)]
    pub(crate) length: LengthArguments,
    #[command(flatten, next_help_heading = "A factored field")]
    pub(crate) factored: FactoredArguments,
    #[command(flatten, next_help_heading = "The paper's network (siren5)")]
    pub(crate) plan: PlanArguments,
    #[command(flatten, next_help_heading = "A part's samples (--family siren5)")]
    samples: SampleArguments,
}

/// What is asked of factored fields alone.
#[derive(Args)]
pub(crate) struct FactoredArguments {
    /// Highest degree of the harmonics that are taught: more is finer and costs memory and time by its square; by default 16, and
    /// 5 of whole rotations, where the tool is not symmetric about its axis
    #[arg(long, value_name = "L")]
    pub(crate) degree: Option<usize>,
    /// Teach by exact sections themselves, N at a time and always fresh ones, not by a harmonic field: takes less memory, for
    /// large grids and tools that are not symmetric about their axis, and learns more slowly; 225 where N is left out
    #[arg(long, value_name = "N", num_args = 0..=1, default_missing_value = "225", value_parser = clap::value_parser!(u32).range(1..=1000))]
    online: Option<u32>,
    #[command(flatten)]
    pub(crate) teaching: TeachingArguments,
}

/// What is asked of samples that are made first.
#[derive(Args)]
struct SampleArguments {
    /// grid:N, fibonacci:N, random:N:SEED, cone:X,Y,Z:HALF_ANGLE:N, pairs such as 0,0;30,40 or a CSV file
    #[arg(long, value_name = "SET", allow_hyphen_values = true, default_value = "fibonacci:225")]
    orientations: String,
    #[command(flatten)]
    sampling: SamplingArguments,
}

/// A training that was asked for, checked.
pub(crate) enum Training<'a> {
    /// A network is taught by a part's harmonic field.
    Taught(DistillSettings),
    /// The paper's network learns samples.
    Learnt(SirenShape, Samples<'a>),
}

/// Where samples come from.
pub(crate) enum Samples<'a> {
    /// The folder of a dataset.
    Dataset(&'a Path),
    /// They are made of the part.
    OfPart { set: OrientationSet, sampling: Sampling, layout: Layout },
}

impl TrainArguments {
    /// What is trained, and from what.
    pub(crate) fn training(&self) -> Result<Training<'_>> {
        let subject = &self.scene.part;
        let dataset = Manifest::is_in(Path::new(subject)).then_some(Path::new(subject));
        if dataset.is_none() && !Path::new(subject).is_file() && ReferencePart::from_str(subject).is_err() {
            bail!(
                "{subject} is neither a part (an OBJ, STL, PLY or 3MF file, or teapot, bracket, bracket-raw or screw-gear) nor \
                 the folder of a dataset (see imf dataset)"
            );
        }
        let usual = if dataset.is_some() { NetworkFamily::Siren5 } else { NetworkFamily::Factored };
        match (self.family.unwrap_or(usual), dataset) {
            (NetworkFamily::Factored, Some(_)) => bail!(
                "{subject} is a dataset, which has samples of some directions, and a factored field is taught all of them: give \
                 the part instead of the dataset, or leave out --family factored"
            ),
            (NetworkFamily::Factored, None) => {
                self.refuse::<PlanArguments>("--family siren5, and a factored field is asked for")?;
                self.refuse::<SampleArguments>("--family siren5, and a factored field is asked for")?;
                if self.factored.online.is_some() && self.factored.teaching.asks_for_symmetry() {
                    bail!(
                        "--symmetry auto is of a harmonic field that teaches, and exact sections are to teach (--online), which \
                         cannot tell of symmetry: leave out one of them"
                    );
                }
                let teach = self.teaching();
                teach.check()?;
                Ok(Training::Taught(teach))
            }
            (NetworkFamily::Siren5, dataset) => {
                self.refuse::<FactoredArguments>("--family factored, and siren5 is asked for")?;
                let shape = self.shape();
                shape.check()?;
                Ok(Training::Learnt(shape, self.samples(dataset)?))
            }
        }
    }

    /// The device's name, or the family's own choice.
    pub(crate) fn device_or<'a>(&'a self, usual: &'a str) -> &'a str {
        self.device.as_deref().unwrap_or(usual)
    }

    fn teaching(&self) -> DistillSettings {
        let length = self.length.or_epochs(DistillSettings::EPOCHS);
        let online = self.factored.online.map(|pool| OnlineSettings {
            pool: pool as usize,
            seed: self.length.seed,
            ..OnlineSettings::default()
        });
        let usual = match online {
            Some(online) => DistillSettings::of_sections(length, online),
            None => DistillSettings::of_length(length),
        };
        DistillSettings {
            width: self.width.unwrap_or(usual.width),
            hidden: self.layers.unwrap_or(usual.hidden),
            omega: self.omega.unwrap_or(usual.omega),
            plan: TrainingPlan {
                batch: self.length.batch,
                schedule: self.length.rate.map_or(usual.plan.schedule, DistillSettings::rates_from),
                seed: self.length.seed,
                ..usual.plan
            },
            ..usual
        }
    }

    fn shape(&self) -> SirenShape {
        let usual = SirenShape::default();
        SirenShape {
            width: self.width.unwrap_or(usual.width),
            hidden: self.layers.unwrap_or(usual.hidden),
            omega: self.omega.unwrap_or(usual.omega),
            ..usual
        }
    }

    fn samples<'a>(&'a self, dataset: Option<&'a Path>) -> Result<Samples<'a>> {
        let SampleArguments { orientations, sampling } = &self.samples;
        if let Some(folder) = dataset {
            let made = "a part, and the dataset was made with its own";
            self.refuse::<SceneArguments>(made)?;
            self.refuse::<ContactArguments>(made)?;
            self.refuse::<SampleArguments>(made)?;
            return Ok(Samples::Dataset(folder));
        }
        if self.plan.mpi {
            bail!(
                "--mpi is of a dataset, and {} is a part: make its dataset first (imf dataset)",
                self.scene.part
            );
        }
        Ok(Samples::OfPart {
            set: directions(orientations)?,
            sampling: sampling.sampling(self.length.seed)?,
            layout: sampling.layout(None),
        })
    }

    /// Refuses the first option of a group that was given; `whose` says to what the group belongs, and why it cannot be.
    fn refuse<T: Args>(&self, whose: &str) -> Result<()> {
        match self.given.first_of::<T>() {
            Some(option) => bail!("{option} is of {whose}: leave it out"),
            None => Ok(()),
        }
    }
}

/// The names of what was given on the command line, whatever its value.
pub(crate) struct Given(Vec<String>);

impl Given {
    /// Whether an argument of this name was given.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.0.iter().any(|given| given == name)
    }

    /// The first option of a group that was given.
    pub(super) fn first_of<T: Args>(&self) -> Option<String> {
        let group = T::augment_args(Command::new("group"));
        let given = group.get_arguments().filter(|option| self.0.iter().any(|name| option.get_id() == name));
        given.filter_map(|option| option.get_long()).map(|long| format!("--{long}")).next()
    }
}

// By hand: it has no arguments of its own, and looks at those of the others.
impl Args for Given {
    fn augment_args(command: Command) -> Command {
        command
    }

    fn augment_args_for_update(command: Command) -> Command {
        command
    }
}

impl FromArgMatches for Given {
    fn from_arg_matches(matches: &ArgMatches) -> Result<Self, clap::Error> {
        let names = matches.ids().map(clap::Id::as_str);
        let given = names.filter(|name| matches.value_source(name) == Some(ValueSource::CommandLine));
        Ok(Self(given.map(str::to_owned).collect()))
    }

    fn update_from_arg_matches(&mut self, matches: &ArgMatches) -> Result<(), clap::Error> {
        *self = Self::from_arg_matches(matches)?;
        Ok(())
    }
}
