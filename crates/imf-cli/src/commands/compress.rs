//! `imf compress`: a harmonic field taught to a network, with checkpoints that go on to the same bits. `imf train` and
//! `imf demo` teach by the same lessons.

mod teacher;

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use anyhow::{Context as _, Result, bail, ensure};
use imf_core::atomic_file::remove_all_leftovers;
use imf_core::control::Control;
use imf_core::factored::file::FactoredFile;
use imf_core::factored::{FactoredField, FactoredState, TeachSettings};
use imf_core::harmonic::coefficients::Precision;
use imf_core::harmonic::file::HarmonicFile;
use imf_core::training::run::{Outcome, Report};
use imf_gpu::shader::Factors;
use imf_gpu::{Gpu, GpuTrainer, TrainerSettings};
use serde_json::json;

pub(super) use teacher::{Sections, Teacher};

use super::calibrate;
use crate::arguments::compress::CompressArguments;
use crate::engine::Device;
use crate::interrupt::{self, Interrupted};
use crate::output::{prepare_folder, print, print_json};
use crate::session::{Session, show_bytes};

/// Not the name of a training's on samples, which may lie in the same folder.
const CHECKPOINT: &str = "teaching.safetensors";
const FIELD: &str = "field.safetensors";
/// Bytes of a weight: itself, transposed, gradient, two moments, and a copy of weights and moments in a checkpoint.
const BYTES_PER_PARAMETER: u64 = 4 * 8;

pub(crate) fn run(session: &Session, arguments: &CompressArguments) -> Result<()> {
    let mut teach = arguments.settings();
    teach.check()?;
    let from = arguments.from.as_deref().map(FactoredFile::read).transpose()?;
    if let Some(from) = &from {
        let TeachSettings { width, hidden, omega, .. } = from.settings;
        teach = TeachSettings { width, hidden, omega, ..teach };
    }
    let device = Device::open(&arguments.device, session)?;
    prepare_folder(&arguments.out)?;
    check_beginning(&arguments.out, arguments.resume)?;
    let teacher = HarmonicFile::read(&arguments.field)?;
    let settings = Settings {
        teach,
        precision: arguments.teaching.precision(),
        checkpoint_every: arguments.checkpoint_every,
        go_on: "add --resume to go on",
        smaller: "use a smaller --width or --batch",
    };
    let lesson = Lesson { teacher: Teacher::Harmonic(&teacher), settings, out: &arguments.out };
    let taught = lesson.taught(session, &device, arguments.resume, from.as_ref())?;
    drop(teacher);
    concluded(session, &arguments.out, taught, arguments.no_calibrate)
}

/// True where an earlier run left a checkpoint in `out` before its end, or no field.
pub(super) fn is_unfinished(out: &Path) -> bool {
    let path = out.join(CHECKPOINT);
    if !path.exists() || !out.join(FIELD).exists() {
        return path.exists();
    }
    FactoredFile::read(&path).is_ok_and(|file| file.is_unfinished())
}

/// Refuses to begin where a teaching is unfinished, and to go on where there is none.
pub(super) fn check_beginning(out: &Path, resume: bool) -> Result<()> {
    let path = out.join(CHECKPOINT);
    if resume {
        ensure!(path.exists(), "there is nothing to resume: {} does not exist", path.display());
    } else {
        ensure!(
            !is_unfinished(out),
            "{} holds an unfinished training: add --resume, choose another --out, or remove it",
            path.display()
        );
    }
    Ok(())
}

/// The end of a teaching: its closing line, and what the field's decisions are worth, where that is short beside it.
pub(super) fn concluded(
    session: &Session,
    out: &Path,
    (file, loss): (FactoredFile, f64),
    no_calibrate: bool,
) -> Result<()> {
    let path = out.join(FIELD);
    report(session, &path, &file, loss)?;
    let plan = file.settings.plan;
    let voxels = file.field.grid.len();
    let samples = plan.total_steps(voxels).saturating_mul(plan.batch.min(voxels) as u64);
    drop(file);
    if no_calibrate || !calibrate::is_short_beside(samples) {
        return Ok(());
    }
    calibrate::afterwards(session, &path)
}

/// How a network is taught and kept.
#[derive(Clone, Copy)]
pub(super) struct Settings {
    pub(super) teach: TeachSettings,
    /// How the finished weights are kept.
    pub(super) precision: Precision,
    /// Seconds between checkpoints.
    pub(super) checkpoint_every: f64,
    /// What an interrupted user is to do.
    pub(super) go_on: &'static str,
    /// What takes less memory.
    pub(super) smaller: &'static str,
}

/// A network that is taught, in a folder.
pub(super) struct Lesson<'a> {
    pub(super) teacher: Teacher<'a>,
    pub(super) settings: Settings,
    /// Where checkpoint and field are written.
    pub(super) out: &'a Path,
}

impl Lesson<'_> {
    /// Teaches from the checkpoint on where `resume`, else from another field's network or from random weights; writes
    /// checkpoints and the finished field. Returns that with the last loss.
    pub(super) fn taught(
        &self,
        session: &Session,
        device: &Device,
        resume: bool,
        from: Option<&FactoredFile>,
    ) -> Result<(FactoredFile, f64)> {
        remove_all_leftovers(self.out);
        let Settings { teach: settings, .. } = &self.settings;
        let teacher = &self.teacher;
        let axes = teacher.axis_count();
        let shape = settings.shape(axes);
        let batch = settings.plan.batch.min(teacher.grid().len()) as u64;
        let signals = 8 * batch * (settings.width * settings.hidden + axes) as u64;
        let (of_teacher, what) = teacher.memory(settings);
        let needed = of_teacher + BYTES_PER_PARAMETER * shape.parameter_count() as u64 + signals;
        session.require_memory(needed, || format!("{what}; {}", self.settings.smaller))?;
        let path = self.out.join(CHECKPOINT);
        let mut state = if resume { self.resumed(&path)? } else { teacher.begun(settings, from)? };
        let total = settings.plan.total_steps(teacher.grid().len());
        session.note(&format!(
            "teaching {shape} ({} parameters) {}, {total} steps of {batch}",
            shape.parameter_count(),
            teacher.lesson(settings),
        ));
        let mut stage = session.stage("teaching", "steps", total);
        stage.begin_at(state.training.step);
        let mut loss = f64::NAN;
        let mut engine: Option<GpuTrainer> = None;
        loop {
            // A checkpoint is a stop of a moment: teaching goes on from its state to the same bits.
            // Its time begins with the first report: before it, sections may be computed anew.
            let (mut begun, pause) = (None, AtomicBool::new(false));
            let advance = |steps| stage.advance(steps);
            let control = Control { progress: &advance, cancelled: &pause };
            let observe = &mut |report: &Report| {
                loss = report.mean_loss;
                let due = begun.get_or_insert_with(Instant::now).elapsed().as_secs_f64()
                    >= self.settings.checkpoint_every;
                pause.store(due || interrupt::requested(), Ordering::Relaxed);
            };
            let outcome = match device {
                Device::Cpu => teacher.teach(settings, &mut state, None, control, observe),
                Device::Gpu(gpu) => {
                    // Made once: it goes on from where it is.
                    let mut trainer = match engine.take() {
                        Some(trainer) => trainer,
                        None => self.trainer_on(gpu, &state)?,
                    };
                    let outcome = teacher.teach(settings, &mut state, Some(&mut trainer), control, observe);
                    engine = Some(trainer);
                    outcome
                }
            };
            let outcome =
                outcome.with_context(|| format!("the last checkpoint, if any, is {}", path.display()))?;
            self.write(&path, &state, true).context("the checkpoint could not be written")?;
            match outcome {
                Outcome::Finished => break,
                Outcome::Stopped(_) if interrupt::requested() => {
                    let kept = format!("the checkpoint is {}; {}", path.display(), self.settings.go_on);
                    return Err(Interrupted(kept).into());
                }
                Outcome::Stopped(_) => {}
            }
        }
        stage.finish(&if loss.is_nan() { String::new() } else { format!("loss {loss:.2e}") });
        Ok((self.write(&self.out.join(FIELD), &state, false)?, loss))
    }

    /// The checkpoint's state.
    fn resumed(&self, path: &Path) -> Result<FactoredState> {
        let found = FactoredFile::read(path)?;
        let Some(state) = found.state else {
            bail!("{} has no optimiser's state to go on from", path.display())
        };
        ensure!(
            found.scene.record == self.teacher.scene().record && found.fit == self.teacher.fit(),
            "{} was taught by another harmonic field or other sections: resume with these, or choose another --out",
            path.display()
        );
        ensure!(
            found.settings == self.settings.teach,
            "{} was begun with other settings: give the same ones, or choose another --out",
            path.display()
        );
        Ok(state)
    }

    fn field(&self, state: &FactoredState) -> Result<FactoredField> {
        let shape = self.settings.teach.shape(self.teacher.axis_count());
        Ok(self.teacher.field(shape, state.training.parameters.clone())?)
    }

    /// An engine on a GPU that goes on from `state`.
    fn trainer_on(&self, gpu: &Gpu, state: &FactoredState) -> Result<GpuTrainer> {
        let settings = &self.settings.teach;
        let (stack, plan) = (settings.shape(self.teacher.axis_count()).stack(), settings.plan);
        let learning = TrainerSettings {
            adam: plan.adam,
            loss: plan.loss,
            optimiser: settings.optimiser,
            factors: Factors::Single,
        };
        let batch = plan.batch.min(self.teacher.grid().len());
        Ok(GpuTrainer::of_stack(gpu, stack, &learning, batch, &state.training)?)
    }

    /// Writes a checkpoint, which goes on, or the finished field.
    fn write(&self, path: &Path, state: &FactoredState, goes_on: bool) -> Result<FactoredFile> {
        let field = self.field(state)?;
        let file = FactoredFile {
            field: if goes_on { field } else { field.folded() },
            scene: self.teacher.scene().clone(),
            fit: self.teacher.fit(),
            report: self.teacher.report(),
            settings: self.settings.teach,
            precision: if goes_on { Precision::F32 } else { self.settings.precision },
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
            "field": path, "bytes": bytes, "parameters": file.field.parameter_count(), "loss": loss,
            "settings": file.settings, "teacher": file.report,
        }));
    }
    // None where a finished teaching was asked to go on.
    let its_loss = if loss.is_nan() {
        String::new()
    } else {
        format!("MSE from its teacher in the last steps {loss:.1e}, ")
    };
    print(&format!(
        "{}: {}, {its_loss}its teacher's own error {:.1e}; ask it by: imf query {}",
        path.display(),
        show_bytes(bytes),
        file.report.expected_mse(),
        path.display()
    ))
}
