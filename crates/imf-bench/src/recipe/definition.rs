//! A recipe: how a network is trained, as plain data. One TOML file says which scene, which network, and stage after
//! stage which sections at which resolution, how they are sampled, for how long and with which learning rate, and which
//! stage's weights it starts from. A sweep is a recipe with variants: lists of changed values, run one after the other.
//!
//! Files carry a `version`; what is not known is refused, so a slip of the pen is not a silent default.

use std::collections::BTreeMap;

use anyhow::{Context as _, Result, bail, ensure};
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::tool::Clearance;
use imf_fields::recipe::{Sampling, TrainingLength, TrainingPlan};
use imf_fields::siren::SirenShape;
use serde::{Deserialize, Serialize};

/// Version of the files that this program reads.
pub(crate) const VERSION: u32 = 1;
/// [`Stage::start`] of a stage that begins with random weights.
pub(crate) const RANDOM_START: &str = "random";

/// How a network is trained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Recipe {
    /// [`VERSION`].
    pub(crate) version: u32,
    /// Name, for titles.
    pub(crate) name: String,
    /// What it is, in a line or two.
    pub(crate) about: String,
    /// What is learnt.
    #[serde(default)]
    pub(crate) scene: SceneSettings,
    /// The network, the same in every stage.
    #[serde(default)]
    pub(crate) network: NetworkSettings,
    /// What the results are compared at.
    #[serde(default)]
    pub(crate) evaluation: EvaluationSettings,
    /// The stages, in order.
    #[serde(rename = "stage")]
    pub(crate) stages: Vec<Stage>,
    /// A sweep's variants; without any the recipe is run once.
    #[serde(default, rename = "variant", skip_serializing_if = "Vec::is_empty")]
    pub(crate) variants: Vec<Variant>,
}

/// Part, full grid and tool.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct SceneSettings {
    /// A reference part or a mesh file; a stage may name another.
    pub(crate) part: String,
    /// Unit of a mesh file.
    pub(crate) unit: Option<String>,
    /// Edge of a voxel; a reference part's own grid by default.
    pub(crate) pitch: Option<f64>,
    /// The full grid has this many times as many voxels along each axis: below 1 for trials.
    pub(crate) scale: f64,
    /// Empty voxels on each side.
    pub(crate) margin: usize,
    /// Also make every voxel solid that the surface touches.
    pub(crate) conservative: bool,
    /// `paper` or a tool file.
    pub(crate) tool: String,
    /// How deep the cutter may reach below the part's surface; it may not touch by default.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) contact: Option<f64>,
    /// Clearance of the tool's elements.
    #[serde(skip_serializing_if = "Clearance::is_zero")]
    pub(crate) clearance: Clearance,
}

impl Default for SceneSettings {
    fn default() -> Self {
        Self {
            part: "teapot".into(),
            unit: None,
            pitch: None,
            scale: 1.0,
            margin: 0,
            conservative: false,
            tool: "paper".into(),
            contact: None,
            clearance: Clearance::default(),
        }
    }
}

/// The network; the default is the paper's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct NetworkSettings {
    /// Neurons of every hidden layer.
    pub(crate) width: usize,
    /// Hidden layers.
    pub(crate) layers: usize,
    /// The input is concatenated again behind this hidden layer, counted from 1; 0 for never.
    pub(crate) skip_after: usize,
    /// Frequency factor inside every sine.
    pub(crate) omega: f32,
    /// Seed of the starting weights.
    pub(crate) seed: u64,
}

impl Default for NetworkSettings {
    fn default() -> Self {
        Self { width: 512, layers: 5, skip_after: 2, omega: 30.0, seed: 0 }
    }
}

impl NetworkSettings {
    /// The network's description.
    pub(crate) fn shape(&self) -> SirenShape {
        SirenShape {
            width: self.width,
            hidden: self.layers,
            skip_after: Some(self.skip_after).filter(|&layer| layer > 0),
            omega: self.omega,
        }
    }
}

/// What results are compared at; the default is what the paper reports, and random orientations beside it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct EvaluationSettings {
    /// A section that the paper shows as one that training saw, θ,φ.
    pub(crate) in_sample: String,
    /// A section that training did not see, θ,φ.
    pub(crate) out_of_sample: String,
    /// Number of random orientations.
    pub(crate) random: usize,
    /// Seed of those.
    pub(crate) seed: u64,
    /// Orientation sets of the inaccessibility measure.
    pub(crate) imf: Vec<String>,
    /// Fraction of the voxels, drawn at random, at which the measure and the random orientations are compared: whole
    /// grids of a wide network take hours on a CPU.
    #[serde(skip_serializing_if = "is_whole")]
    pub(crate) voxels: f64,
    /// CMF above which a pose is called colliding.
    pub(crate) threshold: f64,
}

impl Default for EvaluationSettings {
    fn default() -> Self {
        Self {
            in_sample: "0,0".into(),
            out_of_sample: "12,6".into(),
            random: 64,
            seed: 1,
            imf: vec!["grid:15".into(), "grid:25".into()],
            voxels: 1.0,
            threshold: 0.001,
        }
    }
}

fn is_whole(voxels: &f64) -> bool {
    *voxels == 1.0
}

impl EvaluationSettings {
    fn check(&self) -> Result<()> {
        ensure!(
            self.random > 0 && !self.imf.is_empty(),
            "it needs at least one random orientation and one `imf` set"
        );
        let voxels = self.voxels;
        ensure!(voxels > 0.0 && voxels <= 1.0, "voxels must be above 0 and at most 1, not {voxels}");
        self.imf.iter().try_for_each(|spec| OrientationSet::parse(spec).map(drop))?;
        [&self.in_sample, &self.out_of_sample].into_iter().try_for_each(|text| pair(text).map(drop))
    }
}

/// The orientation θ,φ.
pub(crate) fn pair(text: &str) -> Result<Orientation> {
    match OrientationSet::parse(text)?.orientations.as_slice() {
        [one] => Ok(*one),
        _ => bail!("'{text}' must be one pair θ,φ"),
    }
}

/// One training within a recipe.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Stage {
    /// Name, of letters, digits, `-` and `_`: also its folder's.
    pub(crate) name: String,
    /// Part, where it is not the scene's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) part: Option<String>,
    /// [`RANDOM_START`], or an earlier stage whose weights it starts from; the optimiser's moments start at zero.
    #[serde(default = "random_start")]
    pub(crate) start: String,
    /// Resolution of the sections, as a fraction of the full grid's along each axis.
    #[serde(default = "one")]
    pub(crate) resolution: f64,
    /// The set of orientations.
    pub(crate) orientations: String,
    /// How each section is sampled.
    #[serde(default)]
    pub(crate) sampling: Sampling,
    /// How long, in which batches, at which rate.
    #[serde(default)]
    pub(crate) training: TrainingPlan,
}

fn random_start() -> String {
    RANDOM_START.into()
}

fn one() -> f64 {
    1.0
}

/// Steps between two reports of a stage, so that interruption is noticed soon.
const REPORT_EVERY: u64 = 20;

impl Stage {
    /// The training plan, which notices interruption soon.
    pub(crate) fn plan(&self) -> TrainingPlan {
        TrainingPlan { report_every: self.training.report_every.min(REPORT_EVERY), ..self.training }
    }

    fn check(&self, earlier: &[Self]) -> Result<()> {
        ensure!(
            is_plain(&self.name) && self.name != RANDOM_START,
            "its name must be letters, digits, - and _, and not 'random'"
        );
        ensure!(earlier.iter().all(|stage| stage.name != self.name), "an earlier stage has the same name");
        ensure!(
            self.start == RANDOM_START || earlier.iter().any(|stage| stage.name == self.start),
            "start = \"{}\" is neither 'random' nor an earlier stage",
            self.start
        );
        ensure!(
            self.resolution > 0.0 && self.resolution <= 4.0,
            "resolution must be above 0 and at most 4, not {}",
            self.resolution
        );
        self.directions()?;
        self.sampling.check()?;
        ensure!(
            !matches!(self.training.length, TrainingLength::Epochs(0) | TrainingLength::Steps(0)),
            "its length must be at least 1"
        );
        Ok(self.plan().check()?)
    }

    /// The set of directions.
    pub(crate) fn directions(&self) -> Result<OrientationSet> {
        let spec = &self.orientations;
        let set = OrientationSet::parse(spec)?;
        ensure!(
            set.orientations.iter().all(|o| o.roll == 0.0),
            "'{spec}' rolls the tool about its own axis, which siren5's five inputs cannot express"
        );
        Ok(set)
    }
}

/// True for what may name a folder.
fn is_plain(name: &str) -> bool {
    !name.is_empty() && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_')
}

/// One run of a sweep.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Variant {
    /// Name, of letters, digits, `-` and `_`: also its folder's.
    pub(crate) name: String,
    /// Values by path: `"network.width" = 256`.
    pub(crate) set: BTreeMap<String, toml::Value>,
}

impl Recipe {
    /// Checks the ranges that types do not ensure.
    ///
    /// # Errors
    /// The value, with its stage.
    pub(crate) fn check(&self) -> Result<()> {
        ensure!(!self.stages.is_empty(), "it has no stage");
        self.network.shape().check()?;
        let scale = self.scene.scale;
        ensure!(scale > 0.0 && scale <= 16.0, "scene.scale must be above 0 and at most 16, not {scale}");
        for (index, stage) in self.stages.iter().enumerate() {
            stage.check(&self.stages[..index]).with_context(|| format!("stage '{}'", stage.name))?;
        }
        self.evaluation.check().context("evaluation")?;
        for (index, variant) in self.variants.iter().enumerate() {
            let name = &variant.name;
            ensure!(is_plain(name), "variant '{name}': its name must be letters, digits, - and _");
            let earlier = &self.variants[..index];
            ensure!(earlier.iter().all(|other| other.name != *name), "two variants are called '{name}'");
        }
        Ok(())
    }

    /// The stages that no other starts from: what the recipe is run for.
    pub(crate) fn results(&self) -> impl Iterator<Item = &Stage> {
        self.stages.iter().filter(|stage| self.stages.iter().all(|other| other.start != stage.name))
    }
}
