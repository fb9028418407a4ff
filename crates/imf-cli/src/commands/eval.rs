//! `imf eval`: a field of any family against the exact one.

use anyhow::{Result, bail};
use imf_core::factored::file::FactoredFile;
use imf_core::field::{LearntField, WholeField};
use imf_core::harmonic::basis::Basis;
use imf_core::harmonic::coefficients::Precision;
use imf_core::harmonic::{HarmonicAnswers, HarmonicField};
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::scene::SceneRecord;
use imf_core::section::{Quantity, SectionPlan};
use imf_core::stored::StoredField;

use crate::arguments::eval::EvalArguments;
use crate::engine::Device;
use crate::output::{prepare_folder, print, print_json};
use crate::report::{Evaluation, Questions, Subject, evaluate};
use crate::session::Session;

/// Orientations of the IMF by default, of a field that has no training set: as many as the paper's.
pub(super) const IMF_ORIENTATIONS: usize = 225;

pub(crate) fn run(session: &Session, arguments: &EvalArguments) -> Result<()> {
    if let Some(folder) = &arguments.out {
        prepare_folder(folder)?;
    }
    let stored = StoredField::read(&arguments.model)?;
    if stored.quantity() == Quantity::Depth {
        bail!(
            "{} is a field of depth, which exact sections do not hold: imf calibrate --verify judges its decisions",
            arguments.model.display()
        );
    }
    let record = &stored.scene().record;
    let axes = match &stored {
        StoredField::Factored(file) => file.field.coefficient_count(),
        StoredField::Siren(_) | StoredField::Harmonic(_) => 0,
    };
    require_memory(session, record, axes)?;
    let subject = Subject::of_stored(&stored)?;
    let evaluation = match &stored {
        StoredField::Siren(model) => {
            let questions = questions(arguments, None, &model.record.orientations)?;
            let device = Device::open(&arguments.device.device, session)?;
            let mut engine = device.evaluator(model.shape, &model.state.parameters)?;
            let engine_name = engine.describe();
            session.note(&format!("evaluating on {engine_name}"));
            let mut field = LearntField::new(record.grid, engine.as_mut());
            let evaluation = evaluate(session, &subject, &mut field, engine_name, &questions)?;
            write(session, arguments, &evaluation, &subject, &mut field)?;
            evaluation
        }
        StoredField::Harmonic(file) => harmonic(session, arguments, &subject, &file.field)?,
        StoredField::Factored(file) => harmonic(session, arguments, &subject, &expanded(file))?,
    };
    if session.json { print_json(&evaluation.report) } else { print(&evaluation.report.table()) }
}

/// Refuses what would not fit beside the exact field; `axes` are those of coefficients that are taken at every voxel.
pub(super) fn require_memory(session: &Session, record: &SceneRecord, axes: usize) -> Result<()> {
    let coefficients = 4 * (record.grid.len() * axes) as u64;
    let needed = SectionPlan::memory_estimate(&record.grid, &record.tool, session.threads())
        + 40 * record.grid.len() as u64 * session.threads() as u64
        + coefficients;
    session.require_memory(needed, || "the exact field beside the other one; use fewer --threads".into())
}

/// The network's coefficients at every voxel, taken once for all sections.
pub(super) fn expanded(file: &FactoredFile) -> HarmonicField {
    file.field.evaluator().expanded(Precision::F32, file.report)
}

fn harmonic(
    session: &Session,
    arguments: &EvalArguments,
    subject: &Subject<'_>,
    field: &HarmonicField,
) -> Result<Evaluation> {
    Device::require_cpu(&arguments.device.device)?;
    let basis = &field.basis;
    let questions = questions(arguments, Some(basis), &basis.even_set(IMF_ORIENTATIONS)?)?;
    let engine = format!("CPU, {} threads", session.threads());
    let mut answers = HarmonicAnswers(field);
    let evaluation = evaluate(session, subject, &mut answers, engine, &questions)?;
    write(session, arguments, &evaluation, subject, &mut answers)?;
    Ok(evaluation)
}

/// What is asked; of a harmonic field over rotations the random orientations roll too.
fn questions(arguments: &EvalArguments, fitted: Option<&Basis>, imf: &OrientationSet) -> Result<Questions> {
    Ok(Questions {
        in_sample: Some(pair(&arguments.in_sample)?),
        out_of_sample: Some(pair(&arguments.out_of_sample)?),
        random: match fitted {
            Some(basis) => basis.random_set(arguments.random, arguments.seed)?,
            None => OrientationSet::parse(&format!("random:{}:{}", arguments.random, arguments.seed))?,
        },
        imf: match &arguments.imf {
            Some(spec) => OrientationSet::parse(spec)?,
            None => imf.clone(),
        },
        threshold: arguments.threshold,
    })
}

fn write(
    session: &Session,
    arguments: &EvalArguments,
    evaluation: &Evaluation,
    subject: &Subject<'_>,
    field: &mut dyn WholeField,
) -> Result<()> {
    if let Some(folder) = &arguments.out {
        evaluation.write(folder, subject, field)?;
        session.note(&format!("wrote {}", folder.join("report.md").display()));
    }
    Ok(())
}

fn pair(text: &str) -> Result<Orientation> {
    match OrientationSet::parse(text)?.orientations.as_slice() {
        [one] => Ok(*one),
        _ => bail!("'{text}' must be one pair θ,φ"),
    }
}
