//! What the results of a recipe are worth: each against the exact field.

use std::path::Path;

use anyhow::{Result, bail};
use imf_cli::engine::{Calls, Evaluated};
use imf_cli::interrupt::Interrupted;
use imf_cli::report::{Questions, Subject, evaluate as compare};
use imf_cli::session::Session;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::scene::SceneRecord;
use imf_core::section::{At, SectionError, SectionPlan};
use imf_fields::evaluation::{EvaluationError, grid_imf};
use imf_fields::file::FieldFile;
use imf_fields::metrics::ErrorReport;
use serde::{Deserialize, Serialize};

use super::GO_ON;
use super::stage::{Finished, Workshop};
use crate::recipe::{EvaluationSettings, Recipe};

/// One comparison with the exact field.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Answer {
    /// What was compared.
    pub(crate) name: String,
    /// Its errors.
    #[serde(flatten)]
    pub(crate) errors: ErrorReport,
}

/// A result with all its comparisons.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Outcome {
    /// Its stage.
    pub(crate) stage: String,
    /// Parameters of the network.
    pub(crate) parameters: usize,
    /// In the order of the report: sections, random orientations, IMF.
    pub(crate) answers: Vec<Answer>,
}

impl Outcome {
    /// The comparisons of single sections: the one asked for as in-sample, then the one asked for as out-of-sample.
    pub(crate) fn sections(&self) -> impl Iterator<Item = &Answer> {
        self.answers.iter().filter(|answer| answer.name.starts_with("section ("))
    }

    /// The comparison at random orientations.
    pub(crate) fn random(&self) -> Option<&Answer> {
        self.answers.iter().find(|answer| answer.name.ends_with("random sections"))
    }

    /// Those of the inaccessibility measure.
    pub(crate) fn imf(&self) -> impl Iterator<Item = &Answer> {
        self.answers.iter().filter(|answer| answer.name.starts_with("IMF"))
    }
}

/// Evaluates every result, writes its report beside it, and the first result as the recipe's model.
pub(super) fn evaluate(
    workshop: &Workshop<'_>,
    recipe: &Recipe,
    finished: &[Finished],
    out: &Path,
) -> Result<Vec<Outcome>> {
    let mut outcomes = Vec::new();
    for stage in recipe.results() {
        let Some(done) = finished.iter().find(|done| done.name == stage.name) else { continue };
        if outcomes.is_empty() {
            done.model.write(&out.join("model.safetensors"))?;
        }
        let outcome = one(workshop, &recipe.evaluation, done).map_err(|error| interruption(error, out))?;
        outcomes.push(outcome);
    }
    Ok(outcomes)
}

fn one(workshop: &Workshop<'_>, asked: &EvaluationSettings, done: &Finished) -> Result<Outcome> {
    let session = workshop.session;
    let model = &done.model;
    let sets = asked.imf.iter().map(|spec| OrientationSet::parse(spec)).collect::<Result<Vec<_>, _>>()?;
    let Some((first, others)) = sets.split_first() else { bail!("evaluation.imf names no set") };
    let questions = Questions {
        in_sample: Some(pair(&asked.in_sample)?),
        out_of_sample: Some(pair(&asked.out_of_sample)?),
        random: OrientationSet::parse(&format!("random:{}:{}", asked.random, asked.seed))?,
        imf: first.clone(),
        threshold: asked.threshold,
    };
    require_memory(session, &model.scene.record)?;
    let file = FieldFile::Siren(Box::new(model.clone()));
    let Evaluated { field, by, .. } = workshop.device.field(session, &file, Calls::Many)?;
    let subject = Subject::of_model(model);
    let evaluation = compare(session, &subject, &*field, by, &questions)?;
    evaluation.write(&done.folder, &subject, &*field)?;
    let mut answers: Vec<Answer> = evaluation
        .report
        .rows
        .iter()
        .map(|row| Answer { name: row.name.clone(), errors: row.errors })
        .collect();
    let plan = SectionPlan::of_scene(&model.scene, At::Tip)?;
    for set in others {
        let stage = session.stage("evaluating", "sections", set.len() as u64);
        let advance = |n| stage.advance(n);
        let control = session.control(&advance);
        let imf = grid_imf(&plan, &set.orientations, &*field, asked.threshold, control)?;
        stage.finish("");
        let name = format!("IMF over {} ({})", set.len(), set.spec);
        answers.push(Answer { name, errors: imf.errors });
    }
    Ok(Outcome { stage: done.name.clone(), parameters: model.shape.parameter_count(), answers })
}

/// Refuses the comparison of a scene's exact field with a learnt one where it would not fit.
pub(super) fn require_memory(session: &Session, record: &SceneRecord) -> Result<()> {
    let threads = session.threads();
    let needed = SectionPlan::memory_estimate(&record.grid, &record.tool, threads)
        + 40 * record.grid.len() as u64 * threads as u64;
    session.require_memory(needed, || "the exact field beside the learnt one; use fewer --threads".into())
}

/// Work that was interrupted leaves what was finished before it.
pub(crate) fn interruption(error: anyhow::Error, out: &Path) -> anyhow::Error {
    let cancelled = error.chain().any(|cause| {
        matches!(cause.downcast_ref(), Some(SectionError::Cancelled))
            || matches!(cause.downcast_ref(), Some(EvaluationError::Section(SectionError::Cancelled)))
    });
    if cancelled {
        let kept = format!("what was finished is kept in {}; {GO_ON} to go on", out.display());
        return Interrupted(kept).into();
    }
    error
}

fn pair(text: &str) -> Result<Orientation> {
    match OrientationSet::parse(text)?.orientations.as_slice() {
        [one] => Ok(*one),
        _ => bail!("'{text}' must be one pair θ,φ"),
    }
}
