//! `imf compress`: a harmonic field taught to a network, with checkpoints that go on to the same bits. `imf train` and
//! `imf demo` teach by the same lessons.

mod beginning;
mod teacher;

use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

use anyhow::{Context as _, Result, bail};
use imf_core::atomic_file::remove_all_leftovers;
use imf_core::control::Control;
use imf_fields::factored::file::FactoredFile;
use imf_fields::factored::{DistillSettings, FactoredField, FactoredState, Symmetry};
use imf_fields::harmonic::coefficients::Precision;
use imf_fields::harmonic::file::HarmonicFile;
use imf_gpu::{Gpu, GpuTrainer, TrainerSettings};
use imf_train::training::run::{Outcome, Report};
use serde_json::json;

pub use beginning::Beginning;
use beginning::checkpoint_in;
pub(super) use beginning::is_unfinished;
pub use teacher::{Extent, Sections, Teacher};

use super::calibrate;
use crate::arguments::compress::CompressArguments;
use crate::engine::Device;
use crate::interrupt::{self, Interrupted};
use crate::output::{claim, keep_former, prepare_folder, print, print_json, require_other};
use crate::session::{Session, show_bytes};

const FIELD: &str = "field.safetensors";

pub(crate) fn run(session: &Session, arguments: &CompressArguments) -> Result<()> {
    let mut teach = arguments.settings();
    teach.check()?;
    let field = arguments.field.display();
    if FactoredFile::is_one(&arguments.field) {
        bail!(
            "{field} is a factored field already: imf compress needs a harmonic field to teach (imf field --method harmonic \
             --save FILE); --from {field} begins with this one's network"
        );
    }
    let from = match &arguments.from {
        Some(path) => Some((path, FactoredFile::read(path)?)),
        None => None,
    };
    for source in [Some(&arguments.field), arguments.from.as_ref()].into_iter().flatten() {
        require_other(source, &arguments.out.join(FIELD))?;
    }
    let device = Device::open(&arguments.device, session)?;
    prepare_folder(&arguments.out)?;
    let _claim = claim(&arguments.out)?;
    let beginning = Beginning::at(&arguments.out, arguments.resume)?;
    if let Some((path, from)) = &from {
        beginning.require_network_of(path, from)?;
        let DistillSettings { width, hidden, omega, .. } = from.settings;
        teach = DistillSettings { width, hidden, omega, ..teach };
    }
    teach = beginning.settled(arguments.rate, arguments.teaching.optimiser(), teach);
    let symmetry = match &from {
        Some((_, from)) => Some(from.settings.symmetry),
        None => beginning.symmetry(arguments.teaching.symmetry()),
    };
    teach.symmetry = symmetry.unwrap_or_default();
    beginning.require_settings(&teach)?;
    let teacher = HarmonicFile::read(&arguments.field)?;
    beginning.require_teacher(&teacher.scene, &teacher.settings)?;
    if symmetry.is_none() {
        teach.symmetry = symmetry_of(session, &teacher);
    }
    let precision = arguments.teaching.precision();
    let taught = match beginning.finished(session, precision)? {
        Some(file) => (file, f64::NAN),
        None => {
            let settings = Settings {
                teach,
                precision,
                checkpoint_every: arguments.checkpoint_every,
                go_on: "add --resume to go on",
                smaller: "use a smaller --width or --batch",
            };
            let lesson = Lesson { teacher: Teacher::Harmonic(&teacher), settings, beginning: &beginning };
            lesson.taught(session, &device, from.as_ref().map(|(_, from)| from))?
        }
    };
    drop(teacher);
    concluded(session, &arguments.out, taught, arguments.no_calibrate)
}

/// The end of a teaching: its closing line, and what the field's decisions are worth, where that is short beside it and not
/// yet known.
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
    let known = file.calibration.is_some();
    drop(file);
    if known || no_calibrate || !calibrate::is_short_beside(samples) {
        return Ok(());
    }
    calibrate::afterwards(session, &path)
}

/// What the network of a field is told of symmetry.
pub fn symmetry_of(session: &Session, teacher: &HarmonicFile) -> Symmetry {
    let symmetry = Symmetry::of(&teacher.field, &teacher.scene.obstacle);
    if !symmetry.is_none() {
        session.note(&format!("the network is told of symmetry: {symmetry}"));
    }
    symmetry
}

/// How a network is taught and kept.
#[derive(Clone, Copy)]
pub struct Settings {
    /// Shape, length and rates.
    pub teach: DistillSettings,
    /// How the finished weights are kept.
    pub precision: Precision,
    /// Seconds between checkpoints.
    pub checkpoint_every: f64,
    /// What an interrupted user is to do.
    pub go_on: &'static str,
    /// What takes less memory.
    pub smaller: &'static str,
}

/// A network that is taught, in a folder.
pub struct Lesson<'a> {
    /// What teaches.
    pub teacher: Teacher<'a>,
    /// How.
    pub settings: Settings,
    /// From where, and where checkpoint and field are written.
    pub beginning: &'a Beginning<'a>,
}

impl Lesson<'_> {
    /// Teaches from the checkpoint on where there is one to go on from, else from another field's network or from random
    /// weights; writes checkpoints and the finished field. Returns that with the last loss.
    pub fn taught(
        &self,
        session: &Session,
        device: &Device,
        from: Option<&FactoredFile>,
    ) -> Result<(FactoredFile, f64)> {
        let out = self.beginning.out;
        remove_all_leftovers(out);
        let Settings { teach: settings, .. } = &self.settings;
        let teacher = &self.teacher;
        let shape = settings.shape(teacher.outputs(settings));
        let batch = settings.plan.batch.min(teacher.grid().len());
        teacher.extent().require(session, &self.settings)?;
        let path = checkpoint_in(out);
        let mut state = match self.beginning.state() {
            Some(state) => {
                self.beginning.require_functions(&self.field(&state)?)?;
                state
            }
            None => teacher.begun(settings, from)?,
        };
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
            // Told of no steps between two sections of a pool that fills: Ctrl-C is heeded there too.
            let advance = |steps| match steps {
                0 if interrupt::requested() => pause.store(true, Ordering::Relaxed),
                0 => {}
                steps => stage.advance(steps),
            };
            let control = Control { progress: &advance, cancelled: &pause };
            let observe = &mut |report: &Report| {
                loss = report.mean_loss;
                let due = begun.get_or_insert_with(Instant::now).elapsed().as_secs_f64()
                    >= self.settings.checkpoint_every;
                // A state that may be lost must not take the place of a good one.
                let due = due && !report.watch.is_suspicious();
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
        keep_former(session, &out.join(FIELD))?;
        Ok((self.write(&out.join(FIELD), &state, false)?, loss))
    }

    fn field(&self, state: &FactoredState) -> Result<FactoredField> {
        let teach = &self.settings.teach;
        let shape = teach.shape(self.teacher.outputs(teach));
        Ok(self.teacher.field(shape, state.training.parameters.clone())?)
    }

    /// An engine on a GPU that goes on from `state`.
    fn trainer_on(&self, gpu: &Gpu, state: &FactoredState) -> Result<GpuTrainer> {
        let settings = &self.settings.teach;
        let (stack, plan) = (settings.shape(self.teacher.outputs(settings)).stack(), settings.plan);
        let learning = TrainerSettings {
            adam: plan.adam,
            loss: plan.loss,
            optimiser: settings.optimiser,
            ..TrainerSettings::default()
        };
        let batch = plan.batch.min(self.teacher.grid().len());
        Ok(GpuTrainer::new(gpu, stack, &learning, batch, &state.training)?)
    }

    /// Writes a checkpoint, which goes on, or the finished field.
    fn write(&self, path: &Path, state: &FactoredState, goes_on: bool) -> Result<FactoredFile> {
        let file = FactoredFile {
            field: self.field(state)?,
            scene: self.teacher.scene().clone(),
            fit: self.teacher.fit(),
            report: self.teacher.report(),
            settings: self.settings.teach,
            precision: Precision::F32,
            state: Some(state.clone()),
            calibration: None,
        };
        let file = if goes_on { file } else { file.finished(self.settings.precision) };
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
    let (teacher, own) = match file.settings.online {
        Some(_) => ("exact sections", "a fit of its functions to them has"),
        None => ("its teacher", "its teacher's own error"),
    };
    // None where a finished teaching was asked to go on.
    let its_loss = if loss.is_nan() {
        String::new()
    } else {
        format!("MSE from {teacher} in the last steps {loss:.1e}, ")
    };
    print(&format!(
        "{}: {}, {its_loss}{own} {:.1e}; ask it by: imf query {}",
        path.display(),
        show_bytes(bytes),
        file.report.expected_mse(),
        path.display()
    ))
}
