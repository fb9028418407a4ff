//! `imf eval`: a field of any family against the exact one.

use anyhow::{Result, ensure};
use glam::DVec3;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::section::SectionPlan;
use imf_fields::field::Field;
use imf_fields::file::FieldFile;
use imf_fields::harmonic::basis::Basis;

use crate::arguments::saved::EvalArguments;
use crate::commands::calibrate::{DecisionQuality, measure_decisions};
use crate::engine::{Device, DeviceField, Workload, read_field};
use crate::output::{OutputFolder, print_written, short};
use crate::report::{EvaluationSettings, Report, Subject, evaluate, forget};
use crate::session::Session;

/// Orientations of the IMF by default, of a field that has no training set: as many as the paper's.
pub(super) const IMF_ORIENTATIONS: usize = 225;

/// Directions that lie closer together are one.
const SAME: f64 = 1e-9;

pub(crate) fn run(session: &Session, arguments: &EvalArguments) -> Result<()> {
    let out = arguments.out.as_deref().map(OutputFolder::check).transpose()?;
    let saved = read_field(session, &arguments.model)?;
    let device = Device::for_field(&arguments.device.device, session, &saved)?;
    let settings = eval_settings(arguments, &saved)?;
    let (report, written) = make_report(session, &device, &saved, &settings, out.as_ref())?;
    print_written(session, &report, &report.table(), written)
}

/// Holds a field against the exact one; with a folder, writes the report and its pictures there, and says whether that failed.
pub(super) fn make_report(
    session: &Session,
    device: &Device,
    saved: &FieldFile,
    settings: &EvaluationSettings,
    out: Option<&OutputFolder>,
) -> Result<(Report, Result<()>)> {
    let record = &saved.scene().record;
    let needed = SectionPlan::memory_estimate(&record.grid, &record.tool, session.threads())
        + 40 * record.grid.len() as u64 * session.threads() as u64
        + device.copied_bytes(saved, Workload::Many);
    session.require_memory(needed, || "the exact field beside the other one; use fewer --threads".into())?;
    let subject = Subject::of_saved_field(saved)?;
    // Error rates of the field's decisions: from its file, else measured for the report.
    let quality = match saved.calibration() {
        Some(known) => DecisionQuality::Known(Box::new(*known)),
        None => {
            let held = Device::Cpu.copied_bytes(saved, Workload::Many);
            measure_decisions(session, &Field::new(saved.clone())?, held, "no report was made")?
        }
    };
    let DeviceField { field, by, .. } = device.field(session, saved, Workload::Many)?;
    session.note(&format!("evaluating on {by}"));
    let evaluation = evaluate(session, &subject, &*field, by, settings, &quality)?;
    let write = |folder: &OutputFolder| -> Result<()> {
        folder.begin(session)?;
        forget(&folder.path);
        evaluation.write(&folder.path)?;
        folder.complete();
        session.note(&format!("wrote {}", folder.file("report.md").display()));
        Ok(())
    };
    let written = out.map_or(Ok(()), write);
    Ok((evaluation.report, written))
}

/// What is compared; of a field over rotations the random orientations roll too.
fn eval_settings(arguments: &EvalArguments, saved: &FieldFile) -> Result<EvaluationSettings> {
    let EvalArguments { in_sample, out_of_sample, random, seed, threshold, .. } = *arguments;
    let [least, most] = saved.quantity().bounds(saved.scene().record.grid.pitch);
    ensure!(
        threshold.is_none_or(|threshold| (least..most).contains(&threshold)),
        "a threshold of this field is at least {} and below {}, as its values are",
        short(least),
        short(most)
    );
    let (random, imf) = match saved {
        FieldFile::Siren(model) => {
            let trained = &model.record.orientations;
            (unseen(random, seed, &trained.orientations)?, trained.clone())
        }
        FieldFile::Harmonic(file) => by_functions(&file.field.basis, random, seed)?,
        FieldFile::Factored(file) => by_functions(&file.field.basis, random, seed)?,
    };
    let imf = arguments.imf.as_deref().map_or(Ok(imf), OrientationSet::parse)?;
    Ok(EvaluationSettings {
        in_sample: Some(in_sample),
        out_of_sample: Some(out_of_sample),
        random,
        imf,
        threshold,
    })
}

/// Random directions without those that a network was trained on, which may be random ones too.
fn unseen(count: usize, seed: u64, trained: &[Orientation]) -> Result<OrientationSet> {
    let seen: Vec<DVec3> = trained.iter().map(Orientation::direction).collect();
    // A set of more begins with those of one of fewer.
    let mut set = OrientationSet::parse(&format!("random:{}:{seed}", count + seen.len()))?;
    let new = |own: &Orientation| seen.iter().all(|other| other.distance(own.direction()) > SAME);
    let begins_new = set.orientations.iter().take(count).all(new);
    set.orientations.retain(new);
    set.orientations.truncate(count);
    set.spec = format!("random:{count}:{seed}");
    if !begins_new {
        set.spec += " without those that it was trained on";
    }
    Ok(set)
}

/// Random orientations, and those of the IMF.
fn by_functions(basis: &Basis, random: usize, seed: u64) -> Result<(OrientationSet, OrientationSet)> {
    Ok((basis.random_set(random, seed)?, basis.even_set(IMF_ORIENTATIONS)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_random_direction_is_one_that_was_trained_on() {
        let of = |spec: &str| OrientationSet::parse(spec).unwrap().orientations;
        let usual = unseen(16, 1, &of("fibonacci:30")).unwrap();
        assert_eq!((usual.orientations, usual.spec.as_str()), (of("random:16:1"), "random:16:1"));
        let trained = of("random:10:1");
        let new = unseen(16, 1, &trained).unwrap();
        assert_eq!(new.orientations, of("random:26:1")[10..]);
        assert!(new.spec.contains("without"), "{}", new.spec);
    }
}
