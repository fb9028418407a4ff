//! `imf eval`: a field of any family against the exact one.

use anyhow::{Result, bail};
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::section::{Quantity, SectionPlan};
use imf_fields::file::FieldFile;
use imf_fields::harmonic::basis::Basis;

use crate::arguments::eval::EvalArguments;
use crate::engine::{Calls, Device, Evaluated};
use crate::output::{prepare_folder, print, print_json};
use crate::report::{Questions, Subject, evaluate};
use crate::session::Session;

/// Orientations of the IMF by default, of a field that has no training set: as many as the paper's.
pub(super) const IMF_ORIENTATIONS: usize = 225;

pub(crate) fn run(session: &Session, arguments: &EvalArguments) -> Result<()> {
    if let Some(folder) = &arguments.out {
        prepare_folder(folder)?;
    }
    let stored = FieldFile::read(&arguments.model)?;
    if stored.quantity() == Quantity::Depth {
        bail!(
            "{} is a field of depth, which exact sections do not hold: imf calibrate --verify judges its decisions",
            arguments.model.display()
        );
    }
    let device = Device::for_field(&arguments.device.device, session, &stored)?;
    require_memory(session, &device, &stored)?;
    let questions = match &stored {
        FieldFile::Siren(model) => questions(arguments, None, model.record.orientations.clone())?,
        FieldFile::Harmonic(file) => by_functions(arguments, &file.field.basis)?,
        FieldFile::Factored(file) => by_functions(arguments, &file.field.basis)?,
    };
    let subject = Subject::of_stored(&stored)?;
    let Evaluated { field, by, .. } = device.field(session, &stored, Calls::Many)?;
    session.note(&format!("evaluating on {by}"));
    let evaluation = evaluate(session, &subject, &*field, by, &questions)?;
    if let Some(folder) = &arguments.out {
        evaluation.write(folder, &subject, &*field)?;
        session.note(&format!("wrote {}", folder.join("report.md").display()));
    }
    if session.json { print_json(&evaluation.report) } else { print(&evaluation.report.table()) }
}

/// Refuses what would not fit beside the exact field.
pub(super) fn require_memory(session: &Session, device: &Device, stored: &FieldFile) -> Result<()> {
    let record = &stored.scene().record;
    let needed = SectionPlan::memory_estimate(&record.grid, &record.tool, session.threads())
        + 40 * record.grid.len() as u64 * session.threads() as u64
        + device.copied_bytes(stored, Calls::Many);
    session.require_memory(needed, || "the exact field beside the other one; use fewer --threads".into())
}

/// What is asked of a field that is a sum of functions of the orientation.
fn by_functions(arguments: &EvalArguments, basis: &Basis) -> Result<Questions> {
    questions(arguments, Some(basis), basis.even_set(IMF_ORIENTATIONS)?)
}

/// What is asked; of a harmonic field over rotations the random orientations roll too.
fn questions(arguments: &EvalArguments, fitted: Option<&Basis>, imf: OrientationSet) -> Result<Questions> {
    Ok(Questions {
        in_sample: Some(pair(&arguments.in_sample)?),
        out_of_sample: Some(pair(&arguments.out_of_sample)?),
        random: match fitted {
            Some(basis) => basis.random_set(arguments.random, arguments.seed)?,
            None => OrientationSet::parse(&format!("random:{}:{}", arguments.random, arguments.seed))?,
        },
        imf: match &arguments.imf {
            Some(spec) => OrientationSet::parse(spec)?,
            None => imf,
        },
        threshold: arguments.threshold,
    })
}

fn pair(text: &str) -> Result<Orientation> {
    match OrientationSet::parse(text)?.orientations.as_slice() {
        [one] => Ok(*one),
        _ => bail!("'{text}' must be one pair θ,φ"),
    }
}
