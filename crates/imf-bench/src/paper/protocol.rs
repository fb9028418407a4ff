//! How much of the paper's protocol is run: the built-in recipes as they are, or with changes that the report lists.

use anyhow::Result;
use imf_fields::factored::DistillSettings;
use imf_fields::recipe::Length;
use serde::Serialize;

use crate::arguments::paper::PaperScale;
use crate::recipe::{self, Recipe, built_in};

/// What is changed in a recipe, as `imf-bench recipe run --set` takes it, and why in words.
struct Changes {
    about: &'static str,
    /// What was tried at this scale for the rows that fall short of the paper.
    tried: &'static str,
    all: &'static [&'static str],
    /// By recipe.
    own: &'static [(&'static str, &'static [&'static str])],
}

const FULL: Changes = Changes {
    about: "the built-in recipes as they are: the paper's protocol",
    tried: "the paper's protocol as it is printed, nothing else.",
    all: &[],
    own: &[],
};

const REDUCED: Changes = Changes {
    about: "half the resolution along each axis, networks a quarter as wide, about a quarter of the epochs, over which the \
            rate falls as far (0.74 = 0.93^4.15 an epoch); transfer keeps its epochs. ω = 10 instead of 30: at 30 a network \
            of 5×128 loses from the paper's rate what it learnt, and from a lower one errs up to nine times more. The rate \
            rises over 500 steps first",
    tried: "ω = 30 with rates from 5e-4 (5×128 loses what it learnt) and from 3e-4 (`multi` of the teapot diverges, the other \
            rows err one and a half to nine times more at random orientations), ω = 15 (`multi` of the teapot diverges); of \
            depth, width and density what the tables of architecture and sparsity hold; without training the other fields of \
            the table of the parts. The paper's own resolution, width, ω and epochs are `--scale full`.",
    all: &["scene.scale=0.5", "network.width=128", "network.omega=10"],
    own: &[
        ("single", &["stage.*.training.length={epochs=12}", QUARTER]),
        (
            "multi",
            &["stage.coarse.training.length={epochs=5}", "stage.full.training.length={epochs=6}", QUARTER],
        ),
        (
            "transfer",
            &[
                "stage.raw.training.schedule={kind=\"exponential\",initial=5e-4,factor=0.93,warmup=500}",
                "stage.control.training.schedule={kind=\"exponential\",initial=5e-4,factor=0.93,warmup=500}",
            ],
        ),
        ("sparsity", &["stage.*.training.length={epochs=12}", QUARTER]),
        ("architecture", &["stage.*.training.length={epochs=12}", QUARTER]),
    ],
};

/// The rate over a quarter of the epochs.
const QUARTER: &str = "stage.*.training.schedule={kind=\"exponential\",initial=5e-4,factor=0.74,warmup=500}";

const TINY: Changes = Changes {
    about: "a quarter of the resolution along each axis, networks an eighth as wide (64, 128 and 256 for the \
            architecture's 256, 512 and 1024), a few thousand steps with a cosine schedule instead of 50 epochs; single \
            and multi learn from 64 sections (multi from 256 first), so that what lies between them is hard for a small \
            network too, and (22.5°, 11.25°) stands for the paper's (12°, 6°): on multi's coarse grid, not on single's",
    tried: "225 sections instead of 64 (an error of 4e-5 at random orientations, but `single` and `multi` no longer differ); \
            ω = 10 instead of 30 in the recipes' own benchmark; more width in the table of architecture. Longer training is \
            what `--scale reduced` and `--scale full` are for.",
    all: &[
        "scene.scale=0.25",
        "network.width=64",
        "stage.*.training.schedule={kind=\"cosine\",initial=5e-4,last=5e-6,warmup=100}",
    ],
    own: &[
        (
            "single",
            &[
                "stage.*.orientations=grid:8",
                "stage.*.training.length={steps=4000}",
                "evaluation.out_of_sample=22.5,11.25",
            ],
        ),
        (
            "multi",
            &[
                "stage.coarse.orientations=grid:16",
                "stage.full.orientations=grid:8",
                "stage.*.training.length={steps=2000}",
                "evaluation.out_of_sample=22.5,11.25",
            ],
        ),
        (
            "transfer",
            &[
                "stage.raw.training.length={steps=2000}",
                "stage.adapted.training.length={steps=300}",
                "stage.control.training.length={steps=300}",
            ],
        ),
        ("sparsity", &["stage.*.training.length={steps=2000}"]),
        ("architecture", &["stage.*.training.length={steps=1500}"]),
    ],
};

/// A variant of a sweep at a scale: the paper's name, and what is changed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(super) struct Variant {
    /// As the recipe calls it.
    pub(super) name: &'static str,
    /// What it is at this scale.
    pub(super) about: String,
    pub(super) table: toml::Table,
}

/// The protocol of a scale.
#[derive(Clone, Copy)]
pub(super) struct Protocol {
    scale: PaperScale,
}

impl Protocol {
    pub(super) fn new(scale: PaperScale) -> Self {
        Self { scale }
    }

    /// True where nothing of the paper's protocol is changed.
    pub(super) fn is_the_papers(self) -> bool {
        self.scale == PaperScale::Full
    }

    fn changes(self) -> &'static Changes {
        match self.scale {
            PaperScale::Full => &FULL,
            PaperScale::Reduced => &REDUCED,
            PaperScale::Tiny => &TINY,
        }
    }

    /// How many times fewer neurons a layer has.
    fn narrower(self) -> usize {
        match self.scale {
            PaperScale::Full => 1,
            PaperScale::Reduced => 4,
            PaperScale::Tiny => 8,
        }
    }

    /// A built-in recipe's table with the scale's changes; `part` replaces the scene's.
    pub(super) fn recipe(self, name: &str, part: Option<&str>) -> Result<toml::Table> {
        let mut table = recipe::table(built_in(name)?.text)?;
        let changes = self.changes();
        let own = changes.own.iter().filter(|(recipe, _)| *recipe == name).flat_map(|(_, list)| list.iter());
        for text in changes.all.iter().chain(own) {
            let (path, value) = recipe::assignment(text)?;
            recipe::set(&mut table, &path, value)?;
        }
        if let Some(part) = part {
            recipe::set(&mut table, "scene.part", part.into())?;
        }
        Recipe::from_table(table.clone())?;
        Ok(table)
    }

    /// The settings of a recipe at this scale, read.
    pub(super) fn settings(self, name: &str) -> Result<Recipe> {
        Ok(Recipe::from_table(self.recipe(name, None)?)?)
    }

    /// The variants of a sweep at this scale.
    pub(super) fn sweep(self, name: &str) -> Result<Vec<Variant>> {
        let mut base = self.recipe(name, None)?;
        base.remove("variant");
        let mut variants = Vec::new();
        let listed: &[&'static str] = match (name, self.scale) {
            ("sparsity", _) => &["10-percent", "35-percent", "50-percent"],
            // Depth shows nothing in so few steps; width does.
            (_, PaperScale::Tiny) => &["5x256", "5x512", "5x1024"],
            _ => &["5x256", "4x512", "5x512", "6x512", "5x1024"],
        };
        for &name in listed {
            let mut table = base.clone();
            let about = match name.split_once("-percent") {
                Some((percent, _)) => {
                    let density: f64 = percent.parse()?;
                    recipe::set(&mut table, "stage.*.sampling.density", (density / 100.0).into())?;
                    format!("{percent} %")
                }
                None => {
                    let (layers, width) = self.network(name)?;
                    recipe::set(&mut table, "network.layers", (layers as i64).into())?;
                    recipe::set(&mut table, "network.width", (width as i64).into())?;
                    format!("{layers}×{width}")
                }
            };
            Recipe::from_table(table.clone())?;
            variants.push(Variant { name, about, table });
        }
        Ok(variants)
    }

    /// Layers and width of a variant such as 5x256 at this scale.
    fn network(self, name: &str) -> Result<(usize, usize)> {
        let (layers, width) = name.split_once('x').unwrap_or(("5", "512"));
        let width: usize = width.parse()?;
        // The narrowest and the widest of tiny are 64 and 256, four times apart as the paper's.
        let width = if self.scale == PaperScale::Tiny { width / 4 } else { width / self.narrower() };
        Ok((layers.parse()?, width))
    }

    /// How the factored field is taught: as `imf train factored` does by itself, with a step for each 1,024 voxels five times
    /// over at the full resolution; a tiny one has a fifth of them.
    pub(super) fn teaching(self) -> DistillSettings {
        let steps = if self.scale == PaperScale::Tiny { 500 } else { 2600 };
        DistillSettings::of_length(Length::Steps(steps))
    }

    /// What was tried for rows that fall short.
    pub(super) fn tried(self) -> String {
        self.changes().tried.into()
    }

    /// What differs from the paper, for the report.
    pub(super) fn statement(self) -> Vec<String> {
        let changes = self.changes();
        let mut lines = vec![changes.about.to_owned()];
        if !changes.all.is_empty() {
            lines.push(format!("every recipe: {}", changes.all.join(" ")));
        }
        lines.extend(changes.own.iter().map(|(recipe, list)| format!("{recipe}: {}", list.join(" "))));
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_scale_makes_recipes_that_are_valid_and_full_is_the_built_in_ones() {
        for scale in [PaperScale::Full, PaperScale::Reduced, PaperScale::Tiny] {
            let protocol = Protocol::new(scale);
            for name in ["single", "multi", "transfer"] {
                let table = protocol.recipe(name, None).unwrap();
                let same = table == recipe::table(built_in(name).unwrap().text).unwrap();
                assert_eq!(same, scale == PaperScale::Full, "{name} at {scale:?}");
            }
            for name in ["sparsity", "architecture"] {
                assert!(protocol.sweep(name).unwrap().len() >= 3);
            }
            assert!(!protocol.statement().is_empty());
        }
    }

    #[test]
    fn full_variants_are_those_of_the_recipes() {
        for name in ["sparsity", "architecture"] {
            let runs = recipe::runs(&recipe::table(built_in(name).unwrap().text).unwrap()).unwrap();
            let ours = Protocol::new(PaperScale::Full).sweep(name).unwrap();
            assert_eq!(ours.len(), runs.len());
            for (variant, (run, table)) in ours.iter().zip(&runs) {
                assert_eq!(Some(variant.name), run.as_deref());
                let read = |table: &toml::Table| Recipe::from_table(table.clone()).unwrap();
                assert_eq!(read(&variant.table), read(table), "{}", variant.name);
            }
        }
    }
}
