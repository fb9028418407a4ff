//! A recipe's report: its stages, its results, and one picture of all loss curves.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;
use imf_cli::output::{table, write_json, write_text};
use imf_cli::picture::{AxisScale, Chart, Series};
use serde::{Deserialize, Serialize};

use super::results::Outcome;
use super::stage::Finished;
use super::tally::Tally;
use crate::recipe::{RANDOM_START, Recipe};

/// What a stage came to.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct StageRow {
    pub(crate) name: String,
    start: String,
    pub(crate) part: String,
    /// Voxels of its sections.
    pub(crate) dims: [usize; 3],
    /// Orientations of the fixed set; of an online stage all that it met.
    sections: String,
    pub(crate) samples: u64,
    pub(crate) steps: u64,
    pub(crate) batch: usize,
    pub(crate) seconds: f64,
    /// Mean loss over the last point of its curve.
    loss: f64,
    /// (step, mean loss), steps of the stages before it included.
    curve: Vec<(u64, f64)>,
    /// Who waited, of an online stage.
    waits: Option<Tally>,
}

/// What a recipe came to.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Summary {
    program: String,
    pub(crate) recipe: String,
    about: String,
    pub(crate) stages: Vec<StageRow>,
    pub(crate) results: Vec<Outcome>,
}

impl Summary {
    pub(super) fn new(recipe: &Recipe, finished: &[Finished], results: Vec<Outcome>) -> Self {
        let mut before: BTreeMap<&str, u64> = BTreeMap::from([(RANDOM_START, 0)]);
        let mut stages = Vec::new();
        for done in finished {
            let record = &done.model.record;
            let first = before.get(done.start.as_str()).copied().unwrap_or(0);
            before.insert(&done.name, first + record.steps);
            stages.push(StageRow {
                name: done.name.clone(),
                start: done.start.clone(),
                part: done.model.scene.record.part.clone(),
                dims: done.section_dims,
                sections: record.orientations.spec.clone(),
                samples: record.samples,
                steps: record.steps,
                batch: record.plan.batch,
                seconds: record.seconds,
                loss: record.losses.last().map_or(f64::NAN, |point| point.loss),
                curve: record.losses.iter().map(|point| (first + point.step, point.loss)).collect(),
                waits: done.waits,
            });
        }
        Self {
            program: format!("imf {}", env!("CARGO_PKG_VERSION")),
            recipe: recipe.name.clone(),
            about: recipe.about.clone(),
            stages,
            results,
        }
    }

    /// What a recipe came to in an earlier run, if it came to its end.
    pub(super) fn read(folder: &Path) -> Option<Self> {
        serde_json::from_str(&std::fs::read_to_string(folder.join("recipe.json")).ok()?).ok()
    }

    /// Calls it what its recipe is called by now; true where that is another name, or says something else.
    pub(super) fn retitle(&mut self, recipe: &Recipe) -> bool {
        let differs = (&self.recipe, &self.about) != (&recipe.name, &recipe.about);
        (self.recipe, self.about) = (recipe.name.clone(), recipe.about.clone());
        differs
    }

    /// Seconds of all stages' training.
    pub(crate) fn seconds(&self) -> f64 {
        self.stages.iter().map(|stage| stage.seconds).sum()
    }

    /// The stages' curves, named.
    pub(super) fn curves(&self, prefix: &str) -> Vec<Series> {
        let curve = |stage: &StageRow| Series {
            name: format!("{prefix}{}", stage.name),
            points: stage.curve.iter().map(|&(step, loss)| (step as f64, loss)).collect(),
            markers: false,
        };
        self.stages.iter().map(curve).collect()
    }

    /// Writes the report, and the loss curves beside it.
    pub(super) fn write(&self, out: &Path) -> Result<()> {
        loss_chart(&self.recipe, self.curves("")).save(&out.join("loss.png"))?;
        write_text(&out.join("recipe.md"), &self.markdown())?;
        write_json(&out.join("recipe.json"), self)
    }

    fn rows(&self) -> Vec<Vec<String>> {
        let several = self.results.len() > 1;
        let row = |outcome: &Outcome| -> Vec<Vec<String>> {
            let stage = if several { format!("{}: ", outcome.stage) } else { String::new() };
            let cells = |answer: &super::results::Answer| {
                let e = &answer.errors;
                vec![
                    format!("{stage}{}", answer.name),
                    format!("{:.2e}", e.mse),
                    format!("{:.4}", e.mpe),
                    format!("{:.2} %", 100.0 * e.false_free),
                    format!("{:.2} %", 100.0 * e.false_colliding),
                    format!("{:.4}", e.iou),
                ]
            };
            outcome.answers.iter().map(cells).collect()
        };
        self.results.iter().flat_map(row).collect()
    }

    /// The results for a terminal.
    pub(super) fn text(&self) -> String {
        table(&["", "MSE", "MPE", "false-free", "false-colliding", "IoU"], &self.rows())
    }

    fn markdown(&self) -> String {
        let mut text = format!("# {}\n\n{} · {}\n\n", self.recipe, self.about, self.program);
        text.push_str("| stage | starts from | part | voxels | sections | samples | steps × batch | training | loss |\n");
        text.push_str("| --- | --- | --- | --- | --- | --- | --- | --- | --- |\n");
        for stage in &self.stages {
            let [x, y, z] = stage.dims;
            let _ = writeln!(
                text,
                "| {} | {} | {} | {x}×{y}×{z} | {} | {} | {} × {} | {:.1} s | {:.2e} |",
                stage.name,
                stage.start,
                stage.part,
                stage.sections,
                stage.samples,
                stage.steps,
                stage.batch,
                stage.seconds,
                stage.loss
            );
        }
        for stage in &self.stages {
            if let Some(waits) = &stage.waits {
                let _ = writeln!(text, "\nStage {}: {}", stage.name, waits.said());
            }
        }
        text.push_str("\n| against the exact field | MSE | MPE | false-free | false-colliding | IoU |\n");
        text.push_str("| --- | --- | --- | --- | --- | --- |\n");
        for row in self.rows() {
            let _ = writeln!(text, "| {} |", row.join(" | "));
        }
        text.push_str("\n![Training loss of every stage](loss.png)\n");
        let reports: Vec<String> = self
            .results
            .iter()
            .map(|outcome| format!("[{0}](stages/{0}/report.md)", outcome.stage))
            .collect();
        let _ = writeln!(text, "\nPictures and decisions: {}", reports.join(", "));
        text
    }
}

/// Loss curves in one picture.
pub(super) fn loss_chart(recipe: &str, series: Vec<Series>) -> Chart {
    Chart {
        title: format!("{recipe}: training loss"),
        x_name: "steps".into(),
        x_scale: AxisScale::Linear,
        value_name: "mean loss".into(),
        value_scale: AxisScale::Logarithmic,
        series,
    }
}
