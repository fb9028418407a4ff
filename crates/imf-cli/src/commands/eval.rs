//! `imf eval`: a model against the exact field.

use anyhow::{Result, bail};
use imf_core::model::Model;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::section::SectionPlan;

use crate::arguments::EvalArguments;
use crate::engine::Device;
use crate::output::{prepare_folder, print, print_json};
use crate::report::{Questions, evaluate};
use crate::session::Session;

pub(crate) fn run(session: &Session, arguments: &EvalArguments) -> Result<()> {
    if let Some(folder) = &arguments.out {
        prepare_folder(folder)?;
    }
    let model = Model::read(&arguments.model)?;
    let record = &model.scene.record;
    let needed = SectionPlan::memory_estimate(&record.grid, &record.tool, session.threads())
        + 40 * record.grid.len() as u64 * session.threads() as u64;
    session.require_memory(needed, || "the exact field beside the learnt one; use fewer --threads".into())?;
    let questions = Questions {
        in_sample: Some(pair(&arguments.in_sample)?),
        out_of_sample: Some(pair(&arguments.out_of_sample)?),
        random: OrientationSet::parse(&format!("random:{}:{}", arguments.random, arguments.seed))?,
        imf: match &arguments.imf {
            Some(spec) => OrientationSet::parse(spec)?,
            None => model.record.orientations.clone(),
        },
        threshold: arguments.threshold,
    };
    let device = Device::open(&arguments.device.device, session)?;
    let mut engine = device.evaluator(model.shape, &model.state.parameters)?;
    session.note(&format!("evaluating on {}", engine.describe()));
    let evaluation = evaluate(session, &model, engine.as_mut(), &questions)?;
    if let Some(folder) = &arguments.out {
        evaluation.write(folder, &model, engine.as_mut())?;
        session.note(&format!("wrote {}", folder.join("report.md").display()));
    }
    if session.json { print_json(&evaluation.report) } else { print(&evaluation.report.table()) }
}

fn pair(text: &str) -> Result<Orientation> {
    match OrientationSet::parse(text)?.orientations.as_slice() {
        [one] => Ok(*one),
        _ => bail!("'{text}' must be one pair θ,φ"),
    }
}
