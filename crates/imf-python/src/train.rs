//! Fields of a scene: fitted harmonics, the network that is distilled from them, the paper's network; as `imf train` makes them.

use std::ops::ControlFlow;
use std::sync::Arc;

use imf_core::control::Cancelled;
use imf_core::field::EngineError;
use imf_core::orientation::OrientationSet;
use imf_core::scene;
use imf_core::section::{Quantity, SectionError, SectionPlan, ToolPoints};
use imf_core::tool::{Clearance, ClearanceError, Tool, ToolShape};
use imf_fields::factored::file::FactoredFile;
use imf_fields::factored::{DistillSettings, FactoredState, Symmetry};
use imf_fields::field;
use imf_fields::field::calibrate::{CalibrationError, CalibrationSettings, calibrate};
use imf_fields::file::FieldFile;
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::coefficients::StoragePrecision;
use imf_fields::harmonic::file::HarmonicFile;
use imf_fields::harmonic::{FitSettings, fit, section_count};
use imf_fields::model::{LossPoint, Model};
use imf_fields::recipe::{Sampling, TrainingLength, TrainingPlan, TrainingState};
use imf_fields::siren::SirenShape;
use imf_train::dataset::{generate, load};
use imf_train::distill::{distil, optimiser_bytes};
use imf_train::engine::CpuTrainer;
use imf_train::training::run::{Outcome, Start, TrainError, train as train_on};
use imf_train::training::{BYTES_BESIDE_ENGINE, TrainingEngine as _};
use pyo3::prelude::*;

use crate::errors::{ImfError, Raise, value_error};
use crate::field::Field;
use crate::memory;
use crate::scene::Scene;
use crate::sections::DirectionsInput;
use crate::work::{Progress, run};

/// Weights that are trained between two reports, at which Ctrl-C is polled: half a second or so on two cores.
const WEIGHTS_A_REPORT: usize = 5_000_000;

/// Steps between two reports of a network of `weights` weights.
fn report_every(weights: usize) -> u64 {
    (WEIGHTS_A_REPORT / weights).clamp(1, 20) as u64
}

/// Refuses a network that does not fit into memory, with the engine's bytes.
fn require_for_network(engine: u64, weights: usize, (hidden, width): (usize, usize)) -> PyResult<()> {
    memory::require(engine.saturating_add(BYTES_BESIDE_ENGINE * weights as u64), || {
        format!("{hidden} hidden layers of {width} neurons, {weights} weights; ask for fewer")
    })
}

/// The field of a scene. `layers` are hidden layers and neurons of each, `directions` those that siren5 learns from.
///
/// # Errors
/// A scene or settings that the family cannot have; a training that diverged; `KeyboardInterrupt`.
#[pyfunction]
pub(crate) fn train<'py>(
    py: Python<'py>,
    scene: &Bound<'py, Scene>,
    family: &str,
    quantity: Option<&str>,
    degree: Option<usize>,
    steps: Option<u64>,
    layers: Option<(usize, usize)>,
    omega: Option<f32>,
    symmetry: bool,
    directions: DirectionsInput<'py>,
    seed: u64,
    wants_calibration: bool,
    progress: Progress<'py>,
) -> PyResult<Field> {
    let own = scene.get();
    let is_papers = own.reference.is_some() && *own.scene.record.bare_tool() == Tool::paper();
    let quantity = match quantity {
        Some("depth") => Quantity::Depth,
        Some("overlap") => Quantity::Overlap,
        Some(other) => {
            return Err(value_error(format!("quantity must be 'depth' or 'overlap', not '{other}'")));
        }
        None if is_papers || family == "siren5" => Quantity::Overlap,
        None => Quantity::Depth,
    };
    let scene = with_room(&own.scene, quantity).map_err(Raise::raise)?;
    let of = Training { scene: &scene, quantity, degree, steps, layers, omega, symmetry, seed };
    let file = match family {
        "harmonic" => FieldFile::Harmonic(Arc::new(of.harmonic(py, &progress, false)?)),
        "factored" => FieldFile::Factored(Box::new(of.factored(py, &progress)?)),
        "siren5" => {
            if !quantity.is_overlap() {
                return Err(value_error(
                    "siren5, the paper's network, learns overlaps alone: take family='factored' for depths",
                ));
            }
            FieldFile::Siren(Box::new(of.siren5(py, &progress, &directions.of(py, own)?)?))
        }
        other => {
            return Err(value_error(format!(
                "family must be 'harmonic', 'factored' or 'siren5', not '{other}'"
            )));
        }
    };
    let file = if wants_calibration { calibrated(py, &progress, file)? } else { file };
    run(py, (&None, "", 0), |_| Field::new(file))
}

/// The scene; of depths with the clearance that makes them decide, where it has none.
pub(crate) fn with_room(scene: &scene::Scene, quantity: Quantity) -> Result<scene::Scene, ClearanceError> {
    let record = &scene.record;
    let is_mesh = matches!(record.bare_tool().shape, ToolShape::Mesh(_));
    if quantity.is_overlap() || is_mesh || !record.clearance.is_zero() {
        return Ok(scene.clone());
    }
    scene
        .clone()
        .with_clearance(&Clearance::around_holder_and_shank(FitSettings::CLEARANCE * record.grid.pitch))
}

/// What is trained, and how.
struct Training<'a> {
    scene: &'a scene::Scene,
    quantity: Quantity,
    degree: Option<usize>,
    steps: Option<u64>,
    layers: Option<(usize, usize)>,
    omega: Option<f32>,
    symmetry: bool,
    seed: u64,
}

impl Training<'_> {
    /// A fit, along all functions and in full precision where it is `for_distillation`.
    fn harmonic(
        &self,
        py: Python<'_>,
        progress: &Progress<'_>,
        for_distillation: bool,
    ) -> PyResult<HarmonicFile> {
        let domain = Domain::of_tool(self.scene.record.bare_tool());
        let usual = if for_distillation {
            FitSettings::for_distillation(domain)
        } else {
            FitSettings::for_domain(domain)
        };
        let degree = self.degree.unwrap_or(usual.degree);
        let settings = FitSettings { quantity: self.quantity, degree, ..usual };
        settings.check().map_err(Raise::raise)?;
        let plan = run(py, (&None, "", 0), |_| SectionPlan::of_scene(self.scene, ToolPoints::Tip))?;
        let needed = |one_pass| FitSettings { one_pass, ..settings }.memory_with(&plan, domain).0;
        // One pass over the sections where they fit into memory, else two.
        let passes = [needed(true), needed(false)];
        let one_pass = passes[0] <= memory::free().max(passes[1]);
        memory::require(passes[usize::from(!one_pass)], || {
            format!("a harmonic field of degree {}; use a lower degree, or a larger pitch", settings.degree)
        })?;
        let sections = section_count(domain, &settings) as u64;
        let by = FitSettings { one_pass, ..settings };
        let field = run(py, (progress, "sections", sections), |control| fit(&plan, domain, &by, control))?;
        Ok(HarmonicFile { field, scene: self.scene.clone(), settings, calibration: None })
    }

    fn factored(&self, py: Python<'_>, progress: &Progress<'_>) -> PyResult<FactoredFile> {
        let usual = DistillSettings::default();
        let length =
            self.steps.map_or(TrainingLength::Epochs(DistillSettings::EPOCHS), TrainingLength::Steps);
        let usual = DistillSettings { plan: TrainingPlan { length, ..usual.plan }, ..usual };
        let (hidden, width) = self.layers.unwrap_or((usual.hidden, usual.width));
        let settings = DistillSettings {
            hidden,
            width,
            omega: self.omega.unwrap_or(usual.omega),
            plan: TrainingPlan { seed: self.seed, ..usual.plan },
            ..usual
        };
        // Before the sections, which take long.
        settings.check().map_err(Raise::raise)?;
        let teacher = self.harmonic(py, progress, true)?;
        let (settings, shape) = run(py, (&None, "", 0), |_| {
            let symmetry = match self.symmetry {
                true => Symmetry::of(&teacher.field, &self.scene.obstacle),
                false => Symmetry::default(),
            };
            let settings = DistillSettings { symmetry, ..settings };
            let shape = settings.shape_for(&teacher.field);
            Ok::<_, TrainError>((settings, shape))
        })?;
        let weights = shape.parameter_count();
        let engine = CpuTrainer::BYTES_PER_PARAMETER * weights as u64;
        let engine = engine.saturating_add(optimiser_bytes(settings.optimiser, shape));
        require_for_network(engine, weights, (hidden, width))?;
        let plan = TrainingPlan { report_every: report_every(weights), ..settings.plan };
        let settings = DistillSettings { plan, ..settings };
        let steps = settings.plan.total_steps(self.scene.record.grid.len());
        run(py, (progress, "training", steps), |control| {
            let mut state = FactoredState::new(&shape, self.seed);
            if let Outcome::Stopped(_) = distil(&teacher.field, &settings, &mut state, control, &mut |_| {})?
            {
                return Err(SectionError::from(Cancelled).into());
            }
            let file = FactoredFile::distilled(&teacher, settings, state)
                .map_err(|error| EngineError::Shape(error.to_string()))?;
            Ok::<_, TrainError>(file.finished(StoragePrecision::F32))
        })
    }

    fn siren5(&self, py: Python<'_>, progress: &Progress<'_>, set: &OrientationSet) -> PyResult<Model> {
        let usual = SirenShape::default();
        let (hidden, width) = self.layers.unwrap_or((usual.hidden, usual.width));
        let shape = SirenShape { hidden, width, omega: self.omega.unwrap_or(usual.omega), ..usual };
        shape.check().map_err(Raise::raise)?;
        let usual = TrainingPlan::siren5(&shape);
        let plan = TrainingPlan {
            length: self.steps.map_or(usual.length, TrainingLength::Steps),
            seed: self.seed,
            report_every: report_every(shape.parameter_count()),
            ..usual
        };
        let engine = CpuTrainer::memory_bytes(shape, plan.batch, plan.precision);
        require_for_network(engine, shape.parameter_count(), (hidden, width))?;
        let folder = tempfile::tempdir().map_err(|error| ImfError::new_err(error.to_string()))?;
        let sampling = Sampling { seed: self.seed, ..Sampling::default() };
        let (manifest, scene, samples) = run(py, (progress, "sections", set.len() as u64), |control| {
            generate(folder.path(), self.scene, set, &sampling, control)?;
            load(folder.path())
        })?;
        drop(folder);
        let total = plan.total_steps(samples.len());
        run(py, (progress, "training", total), |control| {
            let state = TrainingState::new(&shape, self.seed);
            let mut model =
                manifest.fresh_model(scene, samples.len() as u64, shape, plan, state.clone(), None);
            let mut engine = CpuTrainer::new(shape.stack(), plan.adam, plan.loss, plan.batch, state)?;
            let mut losses = Vec::new();
            let mut done = 0;
            let outcome = train_on(&plan, &samples, &mut engine, Start::default(), &mut |report, _| {
                (control.progress)(report.step - done);
                done = report.step;
                losses.push(LossPoint { step: report.step, loss: report.mean_loss });
                if control.is_cancelled() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
            })?;
            if let Outcome::Stopped(_) = outcome {
                return Err(SectionError::from(Cancelled).into());
            }
            model.state = engine.state()?;
            (model.record.steps, model.record.finished) = (total, true);
            (model.record.engine, model.record.losses) = (engine.describe(), losses);
            Ok::<_, TrainError>(model.without_moments())
        })
    }
}

/// The field with its calibration; unchanged where that cannot be measured.
fn calibrated(py: Python<'_>, progress: &Progress<'_>, mut file: FieldFile) -> PyResult<FieldFile> {
    if matches!(file.scene().record.bare_tool().shape, ToolShape::Mesh(_)) {
        // A mesh tool is voxelised at every pose, which may take hours.
        return Ok(file);
    }
    let field = run(py, (&None, "", 0), |_| field::Field::new(file.clone()))?;
    let mut settings = CalibrationSettings::default();
    loop {
        let found = run(py, (progress, "calibrating", settings.units()), |control| {
            match calibrate(&field, &settings, control) {
                Err(stopped @ CalibrationError::Cancelled(_)) => Err(stopped),
                other => Ok(other),
            }
        })?;
        match found {
            Ok(calibration) => {
                file.set_calibration(calibration);
                return Ok(file);
            }
            Err(CalibrationError::TooFew { colliding, .. }) => match settings.with_more_poses(colliding) {
                Some(more) => settings = more,
                None => return Ok(file),
            },
            Err(_) => return Ok(file),
        }
    }
}
