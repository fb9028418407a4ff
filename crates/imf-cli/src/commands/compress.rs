//! `imf compress`: a harmonic field taught to a network, with checkpoints that go on to the same bits.

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use anyhow::{Context as _, Result, bail, ensure};
use imf_core::atomic_file::remove_all_leftovers;
use imf_core::control::Control;
use imf_core::factored::file::FactoredFile;
use imf_core::factored::{FactoredField, FactoredState, Optimiser, TeachSettings, teach, teach_on};
use imf_core::harmonic::HarmonicField;
use imf_core::harmonic::coefficients::Precision;
use imf_core::harmonic::file::HarmonicFile;
use imf_core::training::run::{Outcome, Report};
use imf_gpu::shader::Factors;
use imf_gpu::{Gpu, GpuTrainer};
use serde_json::json;

use super::calibrate;
use crate::arguments::compress::CompressArguments;
use crate::engine::Device;
use crate::interrupt::{self, Interrupted};
use crate::output::{prepare_folder, print, print_json};
use crate::session::{Session, show_bytes};

const CHECKPOINT: &str = "checkpoint.safetensors";
const FIELD: &str = "field.safetensors";
/// Bytes of a weight: itself, transposed, gradient, two moments, and a copy of weights and moments in a checkpoint.
const BYTES_PER_PARAMETER: u64 = 4 * 8;

pub(crate) fn run(session: &Session, arguments: &CompressArguments) -> Result<()> {
    let mut settings = arguments.settings();
    settings.check()?;
    let from = arguments.from.as_deref().map(FactoredFile::read).transpose()?;
    if let Some(from) = &from {
        let TeachSettings { width, hidden, omega, .. } = from.settings;
        settings = TeachSettings { width, hidden, omega, ..settings };
    }
    let device = Device::open(&arguments.device, session)?;
    ensure!(
        matches!(device, Device::Cpu) || settings.optimiser == Optimiser::Adam,
        "Muon is computed on the CPU alone: add --adam to teach on another device"
    );
    prepare_folder(&arguments.out)?;
    remove_all_leftovers(&arguments.out);
    let teacher = HarmonicFile::read(&arguments.field)?;
    let axes = teacher.field.axis_count();
    let shape = settings.shape(axes);
    let batch = settings.plan.batch as u64;
    let signals = 8 * batch * (settings.width * settings.hidden + axes) as u64;
    let needed = teacher.field.bytes() + BYTES_PER_PARAMETER * shape.parameter_count() as u64 + signals;
    session.require_memory(needed, || {
        "the harmonic field and the network; use a smaller --width or --batch".into()
    })?;
    let path = arguments.out.join(CHECKPOINT);
    let mut work = Work { teacher: &teacher, settings, precision: arguments.precision() };
    let mut state = work.start(&path, arguments.resume, from.as_ref())?;
    let voxels = teacher.field.grid.len();
    let total = settings.plan.total_steps(voxels);
    session.note(&format!(
        "teaching 3→{}×{}→{axes} ({} parameters, {}) the coefficients of {voxels} voxels, {total} steps of {batch}",
        settings.width,
        settings.hidden,
        shape.parameter_count(),
        show_bytes(work.field(&state)?.bytes()),
    ));
    let mut stage = session.stage("teaching", "steps", total);
    stage.begin_at(state.training.step);
    let mut loss = f64::NAN;
    let mut engine: Option<GpuTrainer> = None;
    loop {
        // A checkpoint is a stop of a moment: teaching goes on from its state to the same bits.
        let (begun, pause) = (Instant::now(), AtomicBool::new(false));
        let advance = |steps| stage.advance(steps);
        let control = Control { progress: &advance, cancelled: &pause };
        let observe = &mut |report: &Report| {
            loss = report.mean_loss;
            let due = begun.elapsed().as_secs_f64() >= arguments.checkpoint_every;
            pause.store(due || interrupt::requested(), Ordering::Relaxed);
        };
        let outcome = match &device {
            Device::Cpu => teach(&teacher.field, &settings, &mut state, control, observe),
            Device::Gpu(gpu) => {
                // Made once: it goes on from where it is.
                let mut trainer = match engine.take() {
                    Some(trainer) => trainer,
                    None => trainer_on(gpu, &settings, &teacher.field, &state)?,
                };
                let outcome = teach_on(&teacher.field, &settings, &mut state, &mut trainer, control, observe);
                engine = Some(trainer);
                outcome
            }
        };
        let outcome =
            outcome.with_context(|| format!("the last checkpoint, if any, is {}", path.display()))?;
        work.write(&path, &state, true).context("the checkpoint could not be written")?;
        match outcome {
            Outcome::Finished => break,
            Outcome::Stopped(_) if interrupt::requested() => {
                let kept = format!("the checkpoint is {}; add --resume to go on", path.display());
                return Err(Interrupted(kept).into());
            }
            Outcome::Stopped(_) => {}
        }
    }
    stage.finish(&format!("loss {loss:.2e}"));
    let out = arguments.out.join(FIELD);
    let file = work.write(&out, &state, false)?;
    report(session, &out, &file, loss)?;
    drop((file, teacher));
    if arguments.no_calibrate || !calibrate::is_short_beside(total * batch) {
        return Ok(());
    }
    calibrate::afterwards(session, &out)
}

/// An engine on a GPU that goes on from `state`.
fn trainer_on(
    gpu: &Gpu,
    settings: &TeachSettings,
    teacher: &HarmonicField,
    state: &FactoredState,
) -> Result<GpuTrainer> {
    let (stack, plan) = (settings.shape(teacher.axis_count()).stack(), settings.plan);
    let (batch, state) = (settings.batch(teacher), &state.training);
    Ok(GpuTrainer::of_stack(gpu, stack, plan.adam, plan.loss, batch, state, Factors::Single)?)
}

/// What is the same from beginning to end.
struct Work<'a> {
    teacher: &'a HarmonicFile,
    settings: TeachSettings,
    precision: Precision,
}

impl Work<'_> {
    /// Where teaching begins: at random weights, at those of another field, or at the checkpoint.
    fn start(&mut self, path: &Path, resume: bool, from: Option<&FactoredFile>) -> Result<FactoredState> {
        if !resume {
            ensure!(
                !path.exists() || path.with_file_name(FIELD).exists(),
                "{} holds an unfinished training: add --resume, choose another --out, or remove it",
                path.display()
            );
            let Some(from) = from else {
                return Ok(self.settings.start(self.teacher.field.axis_count()));
            };
            ensure!(
                from.field.basis.domain() == self.teacher.field.basis.domain(),
                "--from is a field of another kind of tool: one is symmetric about its axis, the other is not"
            );
            ensure!(
                from.field.quantity == self.teacher.field.quantity,
                "--from is a field of another quantity: one is of overlaps, the other of depths"
            );
            return Ok(FactoredState::of_another(&from.field, &self.teacher.field)?);
        }
        let found = FactoredFile::read(path)?;
        let Some(state) = found.state else {
            bail!("{} has no optimiser's state to go on from", path.display())
        };
        ensure!(
            found.scene.record == self.teacher.scene.record && found.fit == self.teacher.settings,
            "{} was taught by another harmonic field: resume with that, or choose another --out",
            path.display()
        );
        ensure!(
            found.settings == self.settings,
            "{} was begun with other settings: give the same ones, or choose another --out",
            path.display()
        );
        Ok(state)
    }

    fn field(&self, state: &FactoredState) -> Result<FactoredField> {
        let shape = self.settings.shape(self.teacher.field.axis_count());
        Ok(FactoredField::new(&self.teacher.field, shape, state.training.parameters.clone())?)
    }

    /// Writes a checkpoint, which goes on, or the finished field.
    fn write(&self, path: &Path, state: &FactoredState, goes_on: bool) -> Result<FactoredFile> {
        let file = FactoredFile {
            field: self.field(state)?,
            scene: self.teacher.scene.clone(),
            fit: self.teacher.settings,
            report: self.teacher.field.report,
            settings: self.settings,
            precision: if goes_on { Precision::F32 } else { self.precision },
            state: goes_on.then(|| state.clone()),
            calibration: None,
        };
        file.write(path)?;
        Ok(file)
    }
}

fn report(session: &Session, path: &Path, file: &FactoredFile, loss: f64) -> Result<()> {
    let bytes = std::fs::metadata(path).with_context(|| format!("cannot read {}", path.display()))?.len();
    if session.json {
        return print_json(&json!({
            "field": path, "bytes": bytes, "parameters": file.field.parameters.len(), "loss": loss,
            "settings": file.settings, "teacher": file.report,
        }));
    }
    print(&format!(
        "{}: {}, mean squared error from its teacher {loss:.1e}, its teacher's own {:.1e}; ask it by: imf query {}",
        path.display(),
        show_bytes(bytes),
        file.report.expected_mse(),
        path.display()
    ))
}
