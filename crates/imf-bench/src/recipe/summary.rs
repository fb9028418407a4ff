//! Summary of a recipe: stages and results as one table for all variants, and one picture of all loss curves.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use imf_cli::picture::{AxisScale, Chart, Series};
use imf_fields::model::Model;
use imf_fields::recipe::Precision;
use serde::{Deserialize, Serialize};

use super::definition::{RANDOM_START, Recipe, Stage};
use super::evaluation_sets::{Answer, RANDOM};
use crate::document::Document;

/// Summary of a recipe.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Summary {
    program: String,
    pub(crate) recipe: String,
    about: String,
    /// The variants, or the recipe itself.
    pub(crate) runs: Vec<RunSummary>,
}

/// Summary of a variant.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct RunSummary {
    /// Empty where there are no variants.
    pub(crate) variant: String,
    pub(crate) stages: Vec<StageSummary>,
    pub(crate) results: Vec<Outcome>,
}

/// Summary of a stage.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct StageSummary {
    pub(crate) name: String,
    start: String,
    part: String,
    /// Voxels of its sections.
    dims: [usize; 3],
    /// Orientations of its set.
    sections: String,
    pub(crate) samples: u64,
    pub(crate) steps: u64,
    batch: usize,
    pub(crate) precision: Precision,
    pub(crate) seconds: f64,
    /// Mean loss over the last point of its curve.
    loss: f64,
    /// (step, mean loss), steps of the stages before it included.
    curve: Vec<(u64, f64)>,
}

/// A result with all its comparisons.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Outcome {
    /// Its stage.
    pub(crate) stage: String,
    /// Parameters of the network.
    pub(crate) parameters: usize,
    pub(crate) answers: Vec<Answer>,
}

impl RunSummary {
    pub(super) fn new(variant: &str) -> Self {
        Self { variant: variant.into(), ..Self::default() }
    }

    pub(super) fn add(&mut self, stage: &Stage, dims: [usize; 3], trained: &Model) {
        let record = &trained.record;
        let ends: BTreeMap<&str, u64> =
            self.stages.iter().map(|s| (s.name.as_str(), s.curve.last().map_or(0, |p| p.0))).collect();
        let first = if stage.start == RANDOM_START { 0 } else { ends[stage.start.as_str()] };
        self.stages.push(StageSummary {
            name: stage.name.clone(),
            start: stage.start.clone(),
            part: trained.scene.record.part.clone(),
            dims,
            sections: record.orientations.spec.clone(),
            samples: record.samples,
            steps: record.steps,
            batch: record.plan.batch,
            precision: record.plan.precision,
            seconds: record.seconds,
            loss: record.losses.last().map_or(f64::NAN, |point| point.loss),
            curve: record.losses.iter().map(|point| (first + point.step, point.loss)).collect(),
        });
    }

    /// Seconds of all stages' training.
    pub(crate) fn seconds(&self) -> f64 {
        self.stages.iter().map(|stage| stage.seconds).sum()
    }

    /// Steps of all stages.
    pub(crate) fn steps(&self) -> u64 {
        self.stages.iter().map(|stage| stage.steps).sum()
    }
}

impl Summary {
    pub(super) fn new(recipe: &Recipe, runs: Vec<RunSummary>) -> Self {
        let program = format!("imf {}", env!("CARGO_PKG_VERSION"));
        Self { program, recipe: recipe.name.clone(), about: recipe.about.clone(), runs }
    }

    /// Writes recipe.json, recipe.md and loss.png.
    pub(super) fn write(&self, out: &Path) -> Result<()> {
        self.loss_chart().save(&out.join("loss.png"))?;
        self.document().write(out, "recipe", self)?;
        Ok(())
    }

    fn answers(&self) -> impl Iterator<Item = &Answer> {
        self.runs.iter().flat_map(|run| &run.results).flat_map(|outcome| &outcome.answers)
    }

    pub(super) fn document(&self) -> Document {
        let mut document = Document::new(&self.recipe);
        document.paragraph(format!("{} · {}", self.about, self.program));
        let head = [
            "stage",
            "starts from",
            "part",
            "voxels",
            "sections",
            "samples",
            "steps × batch",
            "training",
            "loss",
        ];
        let stages = self.runs.iter().flat_map(|run| run.stages.iter().map(move |stage| (run, stage)));
        let rows = stages.map(|(run, stage)| {
            let [x, y, z] = stage.dims;
            vec![
                name(&run.variant, &stage.name),
                stage.start.clone(),
                stage.part.clone(),
                format!("{x}×{y}×{z}"),
                stage.sections.clone(),
                stage.samples.to_string(),
                format!("{} × {}", stage.steps, stage.batch),
                format!("{:.1} s", stage.seconds),
                format!("{:.2e}", stage.loss),
            ]
        });
        document.table(&head, rows.collect());
        let head = [
            "result",
            "parameters",
            "against the exact field",
            "MSE",
            "MPE",
            "false-free",
            "false-colliding",
            "IoU",
        ];
        let mut rows = Vec::new();
        for (run, outcome) in self.runs.iter().flat_map(|run| run.results.iter().map(move |o| (run, o))) {
            for Answer { name: asked, errors, standard_error } in &outcome.answers {
                let error = standard_error.map_or_else(String::new, |error| format!(" ± {error:.1e}"));
                rows.push(vec![
                    name(&run.variant, &outcome.stage),
                    outcome.parameters.to_string(),
                    asked.clone(),
                    format!("{:.2e}{error}", errors.mse),
                    format!("{:.4}", errors.mpe),
                    format!("{:.2} %", 100.0 * errors.false_free),
                    format!("{:.2} %", 100.0 * errors.false_colliding),
                    format!("{:.4}", errors.iou),
                ]);
            }
        }
        document.table(&head, rows);
        document.picture("loss.png", "Training loss");
        if self.answers().any(|answer| answer.standard_error.is_some()) {
            document.paragraph(
                "± is a standard error: minima and random sections were compared at a share of the voxels (`evaluation.voxels`), drawn \
                 at random, of which MPE is the largest error; that of all voxels may be larger.",
            );
        }
        if self.answers().any(|answer| answer.standard_error.is_none() && answer.name.ends_with(RANDOM)) {
            document
                .paragraph("Pictures and decisions are in report.md in the folders of the results' stages.");
        }
        document
    }

    fn loss_chart(&self) -> Chart {
        let curve = |run: &RunSummary, stage: &StageSummary| Series {
            name: name(&run.variant, &stage.name),
            points: stage.curve.iter().map(|&(step, loss)| (step as f64, loss)).collect(),
            markers: false,
        };
        Chart {
            title: format!("{}: training loss", self.recipe),
            x_name: "steps".into(),
            x_scale: AxisScale::Linear,
            value_name: "mean loss".into(),
            value_scale: AxisScale::Logarithmic,
            series: self.runs.iter().flat_map(|run| run.stages.iter().map(move |s| curve(run, s))).collect(),
        }
    }
}

/// A stage, of a variant where there are some.
pub(super) fn name(variant: &str, stage: &str) -> String {
    if variant.is_empty() { stage.to_owned() } else { format!("{variant}, {stage}") }
}
