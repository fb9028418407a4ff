//! How much of the paper's protocol is run: the built-in recipes, which are the paper's text, with the changes of a scale's
//! file (`paper/SCALE.toml`), which the report lists.

use std::collections::BTreeMap;

use anyhow::Result;
use imf_fields::factored::DistillSettings;
use imf_fields::recipe::{Precision, TrainingLength};
use serde::Deserialize;

use super::PaperScale;
use crate::recipe::{Source, built_in};

/// The protocol of a scale.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Protocol {
    about: String,
    /// What was tried at this scale for the rows that fall short of the paper.
    pub(super) tried: String,
    /// Steps in which the factored field is distilled.
    distillation: u64,
    /// True where parts, resolution and network are the paper's, so that times can be held against its own.
    #[serde(skip)]
    pub(super) full: bool,
    /// What networks learn in here.
    #[serde(skip)]
    pub(super) precision: Precision,
    /// Changes of every recipe, as `imf-bench recipe run --set` takes them.
    all: Vec<String>,
    /// By recipe, or `RECIPE of PART` for one part alone.
    own: BTreeMap<String, Vec<String>>,
}

impl Protocol {
    /// At the paper's scale networks learn in the precision given.
    pub(super) fn new(scale: PaperScale, precision: Precision) -> Result<Self> {
        let mut protocol: Self = toml::from_str(match scale {
            PaperScale::Full => include_str!("../../paper/full.toml"),
            PaperScale::Reduced => include_str!("../../paper/reduced.toml"),
            PaperScale::Tiny => include_str!("../../paper/tiny.toml"),
        })?;
        protocol.full = scale == PaperScale::Full;
        if protocol.full {
            protocol.precision = precision;
        }
        Ok(protocol)
    }

    /// A built-in recipe with the scale's changes; `part` replaces the scene's.
    pub(super) fn recipe(&self, name: &str, part: Option<&str>) -> Result<Source> {
        let mut source = Source::parse(built_in(name)?)?;
        let own = self.own.get(name).into_iter().flatten();
        self.all.iter().chain(own).try_for_each(|text| source.assign(text))?;
        if let Some(part) = part {
            let mut of_part = self.own.get(&format!("{name} of {part}")).into_iter().flatten();
            of_part.try_for_each(|text| source.assign(text))?;
            source.set("scene.part", part)?;
        }
        Ok(source)
    }

    /// `single` with the scale's changes for the plane, whose samples are few.
    pub(super) fn plane(&self) -> Result<Source> {
        let mut source = self.recipe("single", None)?;
        self.own.get("plane").into_iter().flatten().try_for_each(|text| source.assign(text))?;
        Ok(source)
    }

    /// How the factored field is distilled: as `imf` does by itself, but for the length.
    pub(super) fn distillation(&self) -> DistillSettings {
        DistillSettings::of_length(TrainingLength::Steps(self.distillation))
    }

    /// What differs from the paper, for the report.
    pub(super) fn statement(&self) -> Vec<String> {
        let mut lines = vec![self.about.clone()];
        if !self.all.is_empty() {
            lines.push(format!("every recipe: {}", self.all.join(" ")));
        }
        lines.extend(self.own.iter().map(|(recipe, list)| format!("{recipe}: {}", list.join(" "))));
        lines
    }
}

/// A recipe as it runs in a precision, which no recipe of this protocol states.
pub(crate) fn in_precision(source: &Source, precision: Precision) -> Result<Source> {
    let mut source = source.clone();
    if precision == Precision::Bf16 {
        source.set("stage.*.training.precision", "bf16")?;
    }
    Ok(source)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recipe::Recipe;

    const SCALES: [PaperScale; 3] = [PaperScale::Full, PaperScale::Reduced, PaperScale::Tiny];

    #[test]
    fn every_scale_makes_recipes_that_are_valid_and_full_has_the_papers_resolution_and_networks() {
        for scale in SCALES {
            let protocol = Protocol::new(scale, Precision::Bf16).unwrap();
            assert_eq!(protocol.full, scale == PaperScale::Full);
            for name in ["single", "multi", "transfer", "sparsity", "architecture"] {
                let source = protocol.recipe(name, None).unwrap();
                // Cells are keyed by it, whatever the machine.
                assert_eq!(source, Protocol::new(scale, Precision::F32).unwrap().recipe(name, None).unwrap());
                let recipe = in_precision(&source, protocol.precision).unwrap().recipe().unwrap();
                let papers = Source::parse(built_in(name).unwrap()).unwrap().recipe().unwrap();
                let network =
                    |recipe: &Recipe| (recipe.network.width, recipe.network.layers, recipe.scene.scale);
                assert_eq!(
                    network(&recipe) == network(&papers),
                    scale == PaperScale::Full,
                    "{name} at {scale:?}"
                );
                let halves = recipe.stages.iter().all(|stage| stage.training.precision == Precision::Bf16);
                assert_eq!(halves, scale == PaperScale::Full);
                let variants = source.variants().unwrap().len();
                assert_eq!(variants >= 3, matches!(name, "sparsity" | "architecture"), "{name}");
            }
            assert!(!protocol.statement().is_empty());
            let parts = ["teapot", "bracket", "screw-gear"];
            for key in protocol.own.keys().filter(|key| *key != "plane") {
                let (name, part) = key.split_once(" of ").unwrap_or((key, parts[0]));
                assert!(parts.contains(&part), "{key}");
                let [whole, own] = [None, Some(part)].map(|part| protocol.recipe(name, part).unwrap());
                assert_eq!(
                    whole.recipe().unwrap().stages != own.recipe().unwrap().stages,
                    key.contains(" of "),
                    "{key}"
                );
            }
        }
    }

    #[test]
    fn networks_of_the_architecture_are_as_many_times_narrower_as_the_scale_says() {
        for (scale, narrower) in SCALES.into_iter().zip([1, 4, 8]) {
            let protocol = Protocol::new(scale, Precision::F32).unwrap();
            let source = protocol.recipe("architecture", None).unwrap();
            for (name, source) in source.variants().unwrap() {
                let network = source.recipe().unwrap().network;
                assert_eq!(format!("{}x{}", network.layers, network.width * narrower), name, "{scale:?}");
            }
        }
    }
}
