//! The table of the three parts: `single` and `multi` against the exact field, and baselines in the same rows.

use anyhow::{Context as _, Result, bail};
use imf_core::regime::{Regime, SceneSettings};
use imf_core::scene::Scene;

use super::baselines::{self, Method};
use super::questions::Questions;
use super::table::{Kind, Row, Table};
use super::{Bench, Run, figures, published};
use crate::arguments::paper::PaperPart;
use crate::commands::regime::Scenes;

/// The regimes of the table.
pub(super) const REGIMES: [&str; 2] = ["single", "multi"];

impl Bench<'_> {
    /// A part's training by a regime.
    pub(super) fn trained(&self, part: PaperPart, regime: &str) -> Result<Result<Run, String>> {
        let part = part.name();
        self.run(&format!("{regime}-{part}"), &self.protocol.regime(regime, Some(part))?)
    }

    /// What needs no training, for a part.
    pub(super) fn baselines(&self, part: PaperPart) -> Result<Vec<Method>> {
        let regime = Regime::from_table(self.protocol.regime("single", Some(part.name()))?)?;
        let n = trained_grid(&regime)?;
        let key = (&regime.scene, &regime.evaluation, n);
        self.cells.get(&format!("baselines-{}", part.name()), &key, || {
            let scene = self.scene(&regime.scene)?;
            baselines::measure(self.session, &scene, &Questions::of(&regime.evaluation)?, n)
        })
    }

    /// A scene at its full resolution.
    pub(super) fn scene(&self, settings: &SceneSettings) -> Result<Scene> {
        Scenes::new(settings).of_part(self.session, &settings.part, 1.0)
    }
}

/// N of the `grid:N` that `single` learns from.
fn trained_grid(single: &Regime) -> Result<usize> {
    let spec = single.stages.first().and_then(|stage| stage.orientations.as_deref());
    match spec.and_then(|spec| spec.strip_prefix("grid:")?.parse().ok()) {
        Some(n) => Ok(n),
        None => bail!("single must learn from a grid of orientations to be compared with interpolation"),
    }
}

pub(super) fn table(bench: &Bench<'_>) -> Result<Table> {
    let mut table = Table::of_errors("3d", "Three parts in space", &["part", "field", "compared"]);
    let single = bench.protocol.settings("single")?;
    let sections = trained_grid(&single)?.pow(2);
    table.notes.push(format!(
        "`single` and `multi` are the paper's network and regimes. Beside them what needs no training, from as many exact \
         sections ({sections}): the nearest one, linear interpolation in θ and φ, and the harmonic field (its fit reads each \
         section twice). Random sections are ours: at orientations of no grid."
    ));
    for &part in &bench.parts {
        let own = if part == PaperPart::Teapot { "" } else { " (ours)" };
        let name = format!("{}{own}", part.name());
        let mut runs = Vec::new();
        for regime in REGIMES {
            let questions = Questions::of(&bench.protocol.settings(regime)?.evaluation)?;
            let papers = published::space(part.name(), regime);
            let paper = |index: usize| papers.and_then(|papers| papers.get(index).copied());
            let labels = |question: String| vec![name.clone(), regime.into(), question];
            let run = match bench.trained(part, regime)? {
                Ok(run) => run,
                Err(diverged) => {
                    let rows = questions.names().into_iter().enumerate();
                    table.rows.extend(rows.map(|(index, asked)| Row::diverged(labels(asked), paper(index))));
                    table.notes.push(format!("{name}, {regime}: no result. {diverged}"));
                    continue;
                }
            };
            let outcome = run.summary.results.first().context("a regime without results")?;
            let answers = questions.names().into_iter().zip(questions.answers(outcome)?);
            table.rows.extend(
                answers
                    .enumerate()
                    .map(|(index, (asked, errors))| Row::errors(labels(asked), paper(index), &errors)),
            );
            table.notes.push(format!(
                "{name}, {regime}: {} parameters ({}), trained in {}.",
                outcome.parameters,
                Kind::Bytes.show(4.0 * outcome.parameters as f64),
                Kind::Seconds.show(run.summary.seconds())
            ));
            runs.push((regime, run));
        }
        let questions = Questions::of(&single.evaluation)?;
        for method in bench.baselines(part)? {
            for (question, errors) in questions.names().into_iter().zip(&method.answers) {
                let labels = vec![name.clone(), method.name.clone(), question];
                table.rows.push(Row::errors(labels, None, errors));
            }
            table.notes.push(format!(
                "{name}, {}: {}, made in {}; {} sections in {}.",
                method.name,
                Kind::Bytes.show(method.bytes as f64),
                Kind::Seconds.show(method.made),
                questions.imf[0].len(),
                Kind::Seconds.show(method.sections)
            ));
        }
        if !runs.is_empty() {
            table.figures.push(figures::fields(bench, part, &questions, &runs)?);
        }
    }
    table.figures.insert(0, figures::scenes(bench)?);
    Ok(table)
}
