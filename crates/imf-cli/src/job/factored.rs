//! Trainings of a factored field by a harmonic field's coefficients: afresh, from another field's network, or from the checkpoint in
//! the output folder. The request is compared with that before anything is computed: first the settings, then the scene and what
//! its functions are chosen by.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail, ensure};
use imf_core::scene::{Scene, SceneRecord};
use imf_core::section::Quantity;
use imf_fields::factored::file::FactoredFile;
use imf_fields::factored::{DistillSettings, FactoredField, FactoredState, Symmetry};
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::coefficients::StoragePrecision;
use imf_fields::harmonic::file::HarmonicFile;
use imf_fields::harmonic::{FitSettings, Sizes};
use imf_fields::recipe::{Optimiser, TrainingPlan};
use imf_train::distill::{bytes_to_solve, optimiser_bytes, start_from, train_to};

use super::checkpoint::{LatestCheckpoint, to_resume};
use super::differences::differences;
use super::{Settings, Training, weights_crc32};
use crate::engine::Device;
use crate::interrupt;
use crate::session::Session;

/// Bytes of a weight: itself, transposed, gradient, two moments, and a copy of weights and moments in a checkpoint.
const BYTES_PER_PARAMETER: u64 = 4 * 8;

/// Refuses what does not fit into memory; `smaller` says what takes less.
pub(crate) fn require_memory(
    session: &Session,
    settings: &DistillSettings,
    fit: &FitSettings,
    domain: Domain,
    voxels: usize,
    smaller: &str,
) -> Result<()> {
    let Sizes { functions, components, .. } = fit.sizes(domain);
    // A symmetry-reduced network has every function for an output; whether there is any symmetry is seen later. Three
    // matrices of these are held while it is trained.
    let may_reduce = domain == Domain::Directions;
    let outputs = if may_reduce { functions } else { components };
    let frames = if may_reduce { 12 * (functions * functions) as u64 } else { 0 };
    let field = fit.memory(domain, voxels).1 + 4 * (functions * (components + 1)) as u64;
    let teacher = field + frames + bytes_to_solve(settings, voxels, outputs);
    let batch = settings.plan.batch.min(voxels) as u64;
    let signals = 8 * batch * (settings.width * settings.hidden + outputs) as u64;
    let shape = settings.shape(outputs);
    let network =
        BYTES_PER_PARAMETER * shape.parameter_count() as u64 + optimiser_bytes(settings.optimiser, shape);
    session.require_memory(teacher + network + signals, || {
        format!("the harmonic field and the network; {smaller}")
    })
}

/// Where a distillation begins, in a folder.
pub(crate) struct FactoredStart<'a> {
    /// Where checkpoint and field are written.
    out: &'a Path,
    /// What is gone on with; nothing for a training afresh.
    found: Option<LatestCheckpoint<FactoredFile>>,
}

impl<'a> FactoredStart<'a> {
    /// Refuses to begin where a training is unfinished, and to go on where there is none.
    pub(crate) fn at(out: &'a Path, resume: bool) -> Result<Self> {
        let found = to_resume::<FactoredFile>(out, resume)?;
        if let Some(LatestCheckpoint { model, path, .. }) = &found {
            ensure!(model.state.is_some(), "{} has no optimiser's state to go on from", path.display());
        }
        Ok(Self { out, found })
    }

    /// The checkpoint that is gone on with, and its file.
    fn found(&self) -> Option<(&FactoredFile, PathBuf)> {
        self.found.as_ref().map(|found| (&found.model, found.path.clone()))
    }

    /// Refuses a checkpoint of another network than that of `from`, which names its file.
    pub(crate) fn require_network_of(&self, path: &Path, from: &FactoredFile) -> Result<()> {
        let Some((found, checkpoint)) = self.found() else { return Ok(()) };
        let network = |settings: &DistillSettings| {
            let DistillSettings { width, hidden, omega, symmetry, .. } = settings;
            format!("{hidden} layers of {width}, ω = {omega} and {symmetry}")
        };
        let [begun, other] = [found, from].map(|file| network(&file.settings));
        ensure!(
            begun == other,
            "{} was not begun from {}: the one has {begun}, the other {other}; leave out --from, or give the field that it \
             was begun from",
            checkpoint.display(),
            path.display()
        );
        ensure!(
            found.settings.from == Some(weights_crc32(&from.field.parameters)),
            "{} was not begun from the weights of {}: give the field that it was begun from, or choose another --out",
            checkpoint.display(),
            path.display()
        );
        Ok(())
    }

    /// The settings with the optimiser given, if any. A resumed training retains its optimiser and rates where none
    /// are given, and the interval at which its output layer is solved.
    pub(crate) fn resolve_settings(
        &self,
        rate: Option<f32>,
        optimiser: Option<Optimiser>,
        settings: DistillSettings,
    ) -> DistillSettings {
        let begun = self.found().map_or(settings, |(found, _)| found.settings);
        let schedule = if rate.is_some() { settings.plan.schedule } else { begun.plan.schedule };
        DistillSettings {
            plan: TrainingPlan { schedule, ..settings.plan },
            solve_every: begun.solve_every,
            optimiser: optimiser.unwrap_or(begun.optimiser),
            from: settings.from.or(begun.from),
            ..settings
        }
    }

    /// The network's symmetry where it is known already: that of the checkpoint, or none where none is wanted. `None` where it is
    /// to be detected in the field.
    pub(crate) fn symmetry(&self, wanted: bool) -> Option<Symmetry> {
        match (wanted, self.found()) {
            (false, _) => Some(Symmetry::default()),
            (true, found) => found.map(|(found, _)| found.settings.symmetry),
        }
    }

    /// Refuses a checkpoint of other settings, and says which.
    pub(crate) fn require_settings(&self, settings: &DistillSettings) -> Result<()> {
        match self.found() {
            Some((found, checkpoint)) if found.settings != *settings => bail!(
                "{} was begun with other settings ({}): give the same ones, or choose another --out",
                checkpoint.display(),
                differences(&found.settings, settings)?.join("; ")
            ),
            _ => Ok(()),
        }
    }

    /// Refuses a checkpoint of another scene, or of functions that were chosen otherwise.
    pub(crate) fn require_source(&self, scene: &Scene, fit: &FitSettings) -> Result<()> {
        let Some((found, checkpoint)) = self.found() else { return Ok(()) };
        ensure!(
            found.fit.quantity == fit.quantity,
            "{} is of another quantity: one is of overlaps, the other of depths; give its --quantity, or choose another --out",
            checkpoint.display()
        );
        if found.scene.record != scene.record {
            let mut what = found.scene.differences(scene);
            if what.is_empty() {
                what.push("the same voxels, made of another part, set-up, margin or fixtures");
            }
            bail!(
                "{} is of another scene ({}): give its part, tool and grid, or choose another --out",
                checkpoint.display(),
                what.join(", ")
            );
        }
        ensure!(
            found.fit == *fit,
            "{} was distilled from another harmonic field ({}): resume with these, or choose another --out",
            checkpoint.display(),
            differences(&found.fit, fit)?.join("; ")
        );
        Ok(())
    }

    /// Refuses a checkpoint of a network along other functions than `field`'s, though they were chosen by the same settings.
    fn require_functions(&self, session: &Session, field: &FactoredField) -> Result<()> {
        let Some((found, checkpoint)) = self.found() else { return Ok(()) };
        // Components are of length 1; means are fractions of the tool, or depths. Rounding moves either by far less.
        let near = |there: &[f32], here: &[f32]| {
            let scale = there.iter().fold(1e-3, |most: f32, v| most.max(v.abs()));
            there.len() == here.len() && there.iter().zip(here).all(|(a, b)| (a - b).abs() < 1e-3 * scale)
        };
        ensure!(
            near(&found.field.components, &field.components) && near(&found.field.mean, &field.mean),
            "{} was trained along other functions, which another limit of memory or another version chose by the same \
             settings: resume as it was begun (--memory), or choose another --out",
            checkpoint.display()
        );
        if found.field.components != field.components || found.field.mean != field.mean {
            session.warn(
                "the functions differ in their last digits from those that this was begun with (less or more memory, or another \
                 processor): the weights will not be those of an uninterrupted run to the bit",
            );
        }
        Ok(())
    }

    /// The field of a training that is finished, its weights saved so; nothing where steps are left.
    pub(crate) fn finished(
        &self,
        session: &Session,
        precision: StoragePrecision,
    ) -> Result<Option<FactoredFile>> {
        self.found.as_ref().map_or(Ok(None), |found| found.finished(session, self.out, precision))
    }

    /// The state to go on from.
    fn state(&self, session: &Session) -> Option<FactoredState> {
        let found = self.found.as_ref()?;
        found.damage.iter().for_each(|damage| session.warn(damage));
        found.model.state.clone()
    }
}

/// A factored field that is trained, in a folder.
pub(crate) struct Distillation<'a> {
    pub(crate) settings: DistillSettings,
    /// The network uses the harmonic field's symmetry regardless of the settings.
    pub(crate) find_symmetry: bool,
    pub(crate) precision: StoragePrecision,
    /// What happens beside the steps.
    pub(crate) beside: Settings,
    /// What takes less memory.
    pub(crate) smaller: &'static str,
    /// From where, and where checkpoint and field are written.
    pub(crate) start: &'a FactoredStart<'a>,
}

impl Distillation<'_> {
    /// Trains by `teacher`: from the checkpoint on where there is one to go on from, else from another field's network or from random
    /// weights; writes checkpoints and the finished field. Also says the loss of the last steps.
    pub(crate) fn run(
        self,
        session: &Session,
        device: &Device,
        teacher: &HarmonicFile,
        from: Option<&FactoredFile>,
    ) -> Result<(FactoredFile, Option<f64>)> {
        let Self { mut settings, find_symmetry, precision, beside, smaller, start } = self;
        let HarmonicFile { field, scene, settings: fit, .. } = teacher;
        let voxels = field.grid.len();
        if find_symmetry {
            settings.symmetry = Symmetry::of(field, &scene.obstacle);
            if !settings.symmetry.is_none() {
                session.note(&format!("symmetry-reduced: {}", settings.symmetry));
            }
        }
        require_memory(session, &settings, fit, field.basis.domain(), voxels, smaller)?;
        let shape = settings.shape_for(field);
        let distilled = |parameters| FactoredField::new(field, shape, parameters);
        let resumed = start.state(session);
        let state = match &resumed {
            Some(state) => {
                start.require_functions(session, &distilled(state.training.parameters.clone())?)?;
                state.clone()
            }
            None => {
                let [record, other] = [Some(&scene.record), from.map(|from| &from.scene.record)];
                let is_other = |(own, other): (&SceneRecord, &SceneRecord)| {
                    own.unit == other.unit && own.tool.shape != other.tool.shape
                };
                if record.zip(other).is_some_and(is_other) {
                    session.warn("--from is a field of another tool; it will be adapted all the same");
                }
                initial_state(teacher, &settings, from)?
            }
        };
        let (batch, total) = (settings.batch(field), settings.plan.total_steps(voxels));
        let parameters = shape.parameter_count();
        let _keeping = interrupt::stop_cleanly();
        session.note(&format!(
            "training {shape} ({parameters} parameters) to the coefficients of {voxels} voxels, {total} steps of {batch}"
        ));
        let mut engine = device.distiller(field, &settings, &state)?;
        let begun = FactoredFile {
            field: distilled(state.training.parameters.clone())?,
            scene: scene.clone(),
            fit: *fit,
            report: field.report,
            settings,
            precision: StoragePrecision::F32,
            state: Some(state),
            calibration: None,
        };
        let training = Training {
            session,
            out: start.out,
            settings: &beside,
            field: begun,
            plan: settings.plan,
            samples: voxels,
            resumed: resumed.is_some(),
            precision,
            held_out: None,
        };
        training.run(engine.as_mut(), &mut |_, engine, start, observer| {
            train_to(field, &settings, engine, start, observer)
        })
    }
}

/// Random weights, or those of another field.
fn initial_state(
    teacher: &HarmonicFile,
    settings: &DistillSettings,
    from: Option<&FactoredFile>,
) -> Result<FactoredState> {
    let field = &teacher.field;
    let Some(from) = from else {
        return Ok(FactoredState::new(&settings.shape_for(field), settings.plan.seed));
    };
    ensure!(
        from.field.basis.domain() == field.basis.domain(),
        "--from is a field of another kind of tool: one is symmetric about its axis, the other is not"
    );
    ensure!(
        from.field.quantity == field.quantity,
        "--from is a field of another quantity: one is of overlaps, the other of depths"
    );
    let [unit, own] = [&from.scene, &teacher.scene].map(|scene| scene.record.unit);
    ensure!(
        unit == own || field.quantity == Quantity::Overlap,
        "--from is a field of depths in {unit}, and this one is in {own}: train that one in the same unit"
    );
    start_from(&from.field, field, &teacher.scene.obstacle).context("--from")
}
