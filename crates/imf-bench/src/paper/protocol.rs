//! How much of the paper's protocol is run: the built-in recipes as they are, or with changes that the report lists.

use anyhow::Result;
use imf_fields::factored::DistillSettings;
use imf_fields::recipe::Length;

use crate::arguments::paper::PaperScale;
use crate::recipe::{Source, built_in};

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
        (
            "architecture",
            &[
                "stage.*.training.length={epochs=12}",
                QUARTER,
                "variant=[{name=\"5x256\",set={\"network.width\"=64}},{name=\"4x512\",set={\"network.layers\"=4}},\
                 {name=\"5x512\",set={}},{name=\"6x512\",set={\"network.layers\"=6}},\
                 {name=\"5x1024\",set={\"network.width\"=256}}]",
            ],
        ),
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
        (
            "architecture",
            // Depth shows nothing in so few steps; width does, from a quarter to four times, as the paper's.
            &[
                "stage.*.training.length={steps=1500}",
                "variant=[{name=\"5x256\",set={}},{name=\"5x512\",set={\"network.width\"=128}},\
                 {name=\"5x1024\",set={\"network.width\"=256}}]",
            ],
        ),
    ],
};

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

    /// A built-in recipe with the scale's changes; `part` replaces the scene's.
    pub(super) fn recipe(self, name: &str, part: Option<&str>) -> Result<Source> {
        let mut source = Source::parse(built_in(name)?)?;
        let changes = self.changes();
        let own = changes.own.iter().filter(|(recipe, _)| *recipe == name).flat_map(|(_, list)| list.iter());
        changes.all.iter().chain(own).try_for_each(|text| source.assign(text))?;
        if let Some(part) = part {
            source.set("scene.part", part)?;
        }
        Ok(source)
    }

    /// How the factored field is distilled: as `imf` does by itself, with a step for each 1,024 voxels five times
    /// over at the full resolution; a tiny one has a fifth of them.
    pub(super) fn distillation(self) -> DistillSettings {
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

    const SCALES: [PaperScale; 3] = [PaperScale::Full, PaperScale::Reduced, PaperScale::Tiny];

    #[test]
    fn every_scale_makes_recipes_that_are_valid_and_full_is_the_built_in_ones() {
        for scale in SCALES {
            let protocol = Protocol::new(scale);
            for name in ["single", "multi", "transfer", "sparsity", "architecture"] {
                let source = protocol.recipe(name, None).unwrap();
                source.recipe().unwrap();
                let same = source == Source::parse(built_in(name).unwrap()).unwrap();
                assert_eq!(same, scale == PaperScale::Full, "{name} at {scale:?}");
                let variants = source.variants().unwrap().len();
                assert_eq!(variants >= 3, matches!(name, "sparsity" | "architecture"), "{name}");
            }
            assert!(!protocol.statement().is_empty());
        }
    }

    #[test]
    fn networks_of_the_architecture_are_as_many_times_narrower_as_the_scale_says() {
        for (scale, narrower) in SCALES.into_iter().zip([1, 4, 4]) {
            let variants = Protocol::new(scale).recipe("architecture", None).unwrap().variants().unwrap();
            for (name, source) in variants {
                let network = source.recipe().unwrap().network;
                let found = format!("{}x{}", network.layers, network.width * narrower);
                assert_eq!(found, name, "{scale:?}");
            }
        }
    }
}
