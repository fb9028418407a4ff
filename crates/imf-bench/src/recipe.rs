//! A recipe: how a network is trained, as plain data. One TOML file says which scene, which network, and stage after
//! stage which sections at which resolution, how they are sampled, for how long and with which learning rate, and which
//! stage's weights it starts from. A sweep is a recipe with variants: lists of overrides, run one after the other.
//!
//! Files carry a `version`; what is not known is refused, so a slip of the pen is no silent default. Some are
//! built in: the files of the folder `recipes`.

mod built_in;
mod overrides;

pub(crate) use built_in::{BUILT_IN, built_in};
pub(crate) use overrides::{assignment, set};

use std::collections::BTreeMap;

use imf_core::orientation::OrientationSet;
use imf_core::tool::Clearance;
use imf_fields::recipe::OnlineSettings;
use imf_fields::recipe::Sampling;
use imf_fields::recipe::schedule::RateRule;
use imf_fields::recipe::{Length, TrainingPlan};
use imf_fields::siren::SirenShape;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// Version of the files that this program reads.
pub(crate) const VERSION: u32 = 1;
/// [`Stage::start`] of a stage that begins with random weights.
pub(crate) const RANDOM_START: &str = "random";

/// Why a recipe is refused.
#[derive(Debug, Error)]
pub(crate) enum RecipeError {
    /// The text is no such TOML.
    #[error("the recipe cannot be read: {0}")]
    Toml(String),
    /// Made for a newer program.
    #[error("the recipe has version {0}, and this program reads version {VERSION}: use a newer imf")]
    Newer(i64),
    /// A value out of range, or a name that leads nowhere.
    #[error("recipe: {0}")]
    Value(String),
    /// No built-in recipe has this name.
    #[error("there is no recipe '{0}'; the built-in ones are {names}; a file of your own is given by its path",
        names = BUILT_IN.iter().map(|p| p.name).collect::<Vec<_>>().join(", "))]
    Unknown(String),
}

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
    /// What is to be learnt.
    #[serde(default)]
    pub(crate) scene: SceneSettings,
    /// The network, the same in every stage.
    #[serde(default)]
    pub(crate) network: NetworkSettings,
    /// What the results are asked.
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
    /// How deep the cutter may reach below the part's surface; it may not touch where nothing is said.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(crate) contact: Option<f64>,
    /// Room that the tool's elements must keep.
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

/// What a result is asked; the default is what the paper reports, and random orientations beside it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct EvaluationSettings {
    /// A section that training saw, θ,φ.
    pub(crate) in_sample: String,
    /// A section that training did not see, θ,φ.
    pub(crate) out_of_sample: String,
    /// Number of random orientations.
    pub(crate) random: usize,
    /// Seed of those.
    pub(crate) seed: u64,
    /// Orientation sets of the inaccessibility measure.
    pub(crate) imf: Vec<String>,
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
            threshold: 0.001,
        }
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
    /// Resolution of the sections, as a share of the full grid's along each axis.
    #[serde(default = "one")]
    pub(crate) resolution: f64,
    /// A fixed set of orientations.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) orientations: Option<String>,
    /// Fresh sections at random orientations while training runs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) online: Option<OnlineSettings>,
    /// How each section is sampled.
    #[serde(default)]
    pub(crate) sampling: Sampling,
    /// How long, in which batches, at which rate.
    #[serde(default)]
    pub(crate) training: TrainingPlan,
    /// How the rate follows the batch.
    #[serde(default)]
    pub(crate) rate_rule: RateRule,
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
    /// The training plan with the rate rule applied.
    pub(crate) fn plan(&self) -> TrainingPlan {
        TrainingPlan {
            schedule: self.rate_rule.apply(self.training.schedule, self.training.batch),
            report_every: self.training.report_every.min(REPORT_EVERY),
            ..self.training
        }
    }

    fn check(&self, earlier: &[Self]) -> Result<(), String> {
        let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if self.name.is_empty() || !self.name.chars().all(is_plain) || self.name == RANDOM_START {
            return Err("its name must be letters, digits, - and _, and not 'random'".into());
        }
        if earlier.iter().any(|stage| stage.name == self.name) {
            return Err("an earlier stage has the same name".into());
        }
        if self.start != RANDOM_START && !earlier.iter().any(|stage| stage.name == self.start) {
            return Err(format!("start = \"{}\" is neither 'random' nor an earlier stage", self.start));
        }
        if !(self.resolution > 0.0 && self.resolution <= 4.0) {
            return Err(format!("resolution must be above 0 and at most 4, not {}", self.resolution));
        }
        match (&self.orientations, &self.online) {
            (Some(_), None) => {}
            (None, Some(online)) => online.check().map_err(|e| e.to_string())?,
            _ => return Err("it needs either `orientations` or `online`".into()),
        }
        self.sampling.check().map_err(|e| e.to_string())?;
        if matches!(self.training.length, Length::Epochs(0) | Length::Steps(0)) {
            return Err("its length must be at least 1".into());
        }
        self.plan().check().map_err(|e| e.to_string())
    }
}

/// One run of a sweep.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Variant {
    /// Name, of letters, digits, `-` and `_`: also its folder's.
    pub(crate) name: String,
    /// Values by path, as [`set`] takes them: `"network.width" = 256`.
    pub(crate) set: BTreeMap<String, toml::Value>,
}

impl Recipe {
    /// Reads and checks a recipe's text.
    ///
    /// # Errors
    /// A text that is no TOML, an unknown key, another version, a value out of range.
    pub(crate) fn parse(text: &str) -> Result<Self, RecipeError> {
        Self::from_table(table(text)?)
    }

    /// Reads and checks a recipe's table, with overrides applied or not.
    ///
    /// # Errors
    /// As [`Recipe::parse`].
    pub(crate) fn from_table(table: toml::Table) -> Result<Self, RecipeError> {
        match table.get("version").and_then(toml::Value::as_integer) {
            Some(found) if found > i64::from(VERSION) => return Err(RecipeError::Newer(found)),
            Some(found) if found == i64::from(VERSION) => {}
            _ => return Err(RecipeError::Toml(format!("`version = {VERSION}` is missing"))),
        }
        let recipe: Self = table.try_into().map_err(|e: toml::de::Error| RecipeError::Toml(e.to_string()))?;
        recipe.check()?;
        Ok(recipe)
    }

    /// Checks the values that no type keeps in range.
    ///
    /// # Errors
    /// [`RecipeError::Value`], naming the stage and the value.
    pub(crate) fn check(&self) -> Result<(), RecipeError> {
        let fail = RecipeError::Value;
        if self.stages.is_empty() {
            return Err(fail("it has no stage".into()));
        }
        self.network.shape().check().map_err(|e| fail(e.to_string()))?;
        if !(self.scene.scale > 0.0 && self.scene.scale <= 16.0) {
            return Err(fail(format!(
                "scene.scale must be above 0 and at most 16, not {}",
                self.scene.scale
            )));
        }
        for (index, stage) in self.stages.iter().enumerate() {
            let name = &stage.name;
            stage.check(&self.stages[..index]).map_err(|what| fail(format!("stage '{name}': {what}")))?;
            if let Some(spec) = &stage.orientations {
                OrientationSet::parse(spec).map_err(|e| fail(format!("stage '{name}': {e}")))?;
            }
        }
        let asked = &self.evaluation;
        if asked.random == 0 || asked.imf.is_empty() {
            return Err(fail("evaluation needs at least one random orientation and one `imf` set".into()));
        }
        for spec in asked.imf.iter().chain([&asked.in_sample, &asked.out_of_sample]) {
            OrientationSet::parse(spec).map_err(|e| fail(format!("evaluation: {e}")))?;
        }
        let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        for (index, variant) in self.variants.iter().enumerate() {
            let name = &variant.name;
            if name.is_empty() || !name.chars().all(is_plain) {
                return Err(fail(format!("variant '{name}': its name must be letters, digits, - and _")));
            }
            if self.variants[..index].iter().any(|other| other.name == *name) {
                return Err(fail(format!("two variants are called '{name}'")));
            }
        }
        Ok(())
    }

    /// The stages that no other starts from: what the recipe is run for.
    pub(crate) fn results(&self) -> impl Iterator<Item = &Stage> {
        self.stages.iter().filter(|stage| self.stages.iter().all(|other| other.start != stage.name))
    }
}

/// A recipe's text as a table, to apply overrides to.
///
/// # Errors
/// A text that is no TOML.
pub(crate) fn table(text: &str) -> Result<toml::Table, RecipeError> {
    text.parse().map_err(|e: toml::de::Error| RecipeError::Toml(e.to_string()))
}

/// The runs of a recipe's table: each variant with its overrides applied and without variants; the table itself where
/// there is none. Every one is checked.
///
/// # Errors
/// As [`Recipe::from_table`] and [`set`], naming the variant.
pub(crate) fn runs(table: &toml::Table) -> Result<Vec<(Option<String>, toml::Table)>, RecipeError> {
    let recipe = Recipe::from_table(table.clone())?;
    if recipe.variants.is_empty() {
        return Ok(vec![(None, table.clone())]);
    }
    let run = |variant: &Variant| {
        let mut own = table.clone();
        own.remove("variant");
        for (path, value) in &variant.set {
            set(&mut own, path, value.clone())?;
        }
        Recipe::from_table(own.clone())?;
        Ok((Some(variant.name.clone()), own))
    };
    let named = |variant: &Variant| {
        run(variant).map_err(|e: RecipeError| RecipeError::Value(format!("variant '{}': {e}", variant.name)))
    };
    recipe.variants.iter().map(named).collect()
}

#[cfg(test)]
mod tests;
