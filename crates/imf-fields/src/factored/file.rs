//! The factored field on disk (`tensor_file` has what all share), for queries as for going on with distillation, with these
//! tensors:
//!
//! ```text
//! parameters  f16 or f32 [weights]       g, in the layout of FactoredShape::layers
//! components  f32 [functions, components] U: orthonormal columns; of a folded network V, of the weights' kind; with symmetry
//!                                        of the functions of the direction in the frame of the place
//! mean        f32 [functions]            μ
//! state       f32 [3, weights]           where distillation can go on: weights and both moments
//! preconditioners f32 [numbers]          what the optimiser keeps beside these (SOAP's; TrainingState)
//! ```

use std::path::Path;

use half::f16;
use serde::{Deserialize, Serialize};

use super::{DistillSettings, FactoredField, FactoredState};
use crate::calibration::Calibration;
use crate::harmonic::basis::{Basis, Domain};
use crate::harmonic::coefficients::StoragePrecision;
use crate::harmonic::file::HarmonicFile;
use crate::harmonic::{FitReport, FitSettings};
use crate::recipe::divergence::Watch;
use crate::recipe::{Cursor, TrainingState};
use crate::siren::ShapeError;
use crate::tensor_file::{FieldFileError, Format, Loaded};
use imf_core::scene::Scene;

pub(crate) const FORMAT: Format = Format { id: "imf-factored", name: "factored field" };

/// Arrays of a state.
const STATE: usize = 3;

/// A factored field with everything that is known about it.
#[derive(Clone, Debug, PartialEq)]
pub struct FactoredFile {
    /// The field.
    pub field: FactoredField,
    /// What it represents.
    pub scene: Scene,
    /// How the teacher was made.
    pub fit: FitSettings,
    /// The errors of the teacher's fit.
    pub report: FitReport,
    /// How the field was trained.
    pub settings: DistillSettings,
    /// How the weights are saved.
    pub precision: StoragePrecision,
    /// Where training goes on.
    pub state: Option<FactoredState>,
    /// The calibration of its decisions, where measured with these weights.
    pub calibration: Option<Calibration>,
}

#[derive(Serialize, Deserialize)]
struct Description {
    domain: Domain,
    fit: FitSettings,
    report: FitReport,
    settings: DistillSettings,
    precision: StoragePrecision,
    scale: f32,
    /// There is no layer behind the last sines.
    folded: bool,
    /// Cursor and steps of the state.
    progress: Option<(Cursor, u64)>,
    /// Of the state.
    #[serde(default, skip_serializing_if = "Watch::is_new")]
    watch: Watch,
}

impl FactoredFile {
    /// The network of `state`, which is distilled from `teacher`, as training goes on with it.
    ///
    /// # Errors
    /// Weights that do not fit, or a symmetry that the teacher has not.
    pub fn distilled(
        teacher: &HarmonicFile,
        settings: DistillSettings,
        state: FactoredState,
    ) -> Result<Self, ShapeError> {
        let HarmonicFile { field, scene, settings: fit, .. } = teacher;
        let shape = settings.shape(settings.outputs(field));
        Ok(Self {
            field: FactoredField::new(field, shape, state.training.parameters.clone())?,
            scene: scene.clone(),
            fit: *fit,
            report: field.report,
            settings,
            precision: StoragePrecision::F32,
            state: Some(state),
            calibration: None,
        })
    }

    /// True where training stopped before the end of its plan.
    pub fn is_unfinished(&self) -> bool {
        let steps = self.settings.plan.total_steps(self.field.grid.len());
        self.state.as_ref().is_some_and(|state| state.training.step < steps)
    }

    /// The result of a training: the field of this checkpoint folded, its weights saved in `precision`, no state.
    #[must_use]
    pub fn finished(self, precision: StoragePrecision) -> Self {
        Self { field: self.field.folded(), precision, state: None, calibration: None, ..self }
    }

    /// The same as it will be read back: weights rounded as they are saved.
    #[must_use]
    pub fn as_saved(mut self) -> Self {
        let FactoredField { parameters, components, shape, .. } = &mut self.field;
        let of_components = precision_of_components(self.precision, shape.folded);
        for (values, precision) in [(parameters, self.precision), (components, of_components)] {
            if precision == StoragePrecision::F16 {
                values.iter_mut().for_each(|value| *value = f16::from_f32(*value).to_f32());
            }
        }
        self
    }

    /// True for a file whose header names this format, read or not.
    pub fn is_one(path: &Path) -> bool {
        FORMAT.is_of(path)
    }

    /// Writes the field whole or not at all. Equal fields give equal bytes.
    ///
    /// # Errors
    /// A file that cannot be written.
    #[cfg(feature = "fit")]
    pub fn write(&self, path: &Path) -> Result<(), FieldFileError> {
        use crate::tensor_file::{Contents, little_endian_halves, tensor};
        use safetensors::tensor::Dtype;
        let in_half = |name: &'static str, shape: &[usize], values: &[f32]| {
            let halves: Vec<f16> = values.iter().map(|&value| f16::from_f32(value)).collect();
            (name.into(), Dtype::F16, shape.to_vec(), little_endian_halves(&halves).into_owned().into())
        };
        let numbers = |name, shape: &[usize], values, precision| match precision {
            StoragePrecision::F32 => tensor(name, shape, values),
            StoragePrecision::F16 => in_half(name, shape, values),
        };
        let (field, state) = (&self.field, self.state.as_ref());
        let (functions, count) = (field.basis.len(), field.parameters.len());
        let of_components = precision_of_components(self.precision, field.shape.folded);
        let mut tensors = vec![
            numbers("components", &[functions, field.shape.components], &field.components, of_components),
            tensor("mean", &[functions], &field.mean),
            numbers("parameters", &[count], &field.parameters, self.precision),
        ];
        let arrays = state.map(|FactoredState { training, .. }| {
            [&training.parameters[..], &training.first_moment, &training.second_moment].concat()
        });
        if let Some(arrays) = &arrays {
            tensors.push(tensor("state", &[STATE, count], arrays));
        }
        let kept = state.map_or(&[][..], |state| &state.training.preconditioners);
        if !kept.is_empty() {
            tensors.push(tensor("preconditioners", &[kept.len()], kept));
        }
        let description = Description {
            domain: field.basis.domain(),
            fit: self.fit,
            report: self.report,
            settings: self.settings,
            precision: self.precision,
            scale: field.scale,
            folded: field.shape.folded,
            progress: state.map(|state| (state.cursor, state.training.step)),
            watch: state.map_or_else(Watch::default, |state| state.watch),
        };
        let (scene, calibration) = (&self.scene, self.calibration);
        FORMAT.write(path, Contents { scene, calibration, description, tensors })
    }

    /// Reads and checks a field.
    ///
    /// # Errors
    /// A missing, foreign, newer, truncated or damaged file; the message names it and what is wrong.
    pub fn read(path: &Path) -> Result<Self, FieldFileError> {
        Self::from_bytes(&FORMAT.bytes(path)?, path)
    }

    /// Checks a file in memory, which errors call `name`.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn from_bytes(bytes: &[u8], name: &Path) -> Result<Self, FieldFileError> {
        let file = FORMAT.open(bytes, name)?;
        let description: Description = file.description()?;
        let Description { domain, fit, report, settings, precision, scale, folded, progress, watch } =
            description;
        fit.check().map_err(|e| file.damaged(&e))?;
        settings.check().map_err(|e| file.damaged(&e))?;
        let (symmetry, grid) = (settings.symmetry, file.scene.record.grid);
        if !symmetry.is_none() && (domain != Domain::Directions || !symmetry.is_within(&grid)) {
            return Err(file.damaged(&format!(
                "it says that its network is reduced by the symmetry '{symmetry}', which cannot be"
            )));
        }
        if !(scale.is_finite() && scale > 0.0) {
            return Err(file.damaged(&format!("its scale is {scale}")));
        }
        if folded && progress.is_some() {
            return Err(file.damaged("it has a state, and a folded network is not trained"));
        }
        let sizes = fit.sizes(domain);
        let shape = settings.shape(symmetry.coefficients(sizes.components, sizes.functions));
        let shape = if folded { shape.folded() } else { shape };
        let numbers = |name: &str, shape: &[usize], precision| match precision {
            StoragePrecision::F32 => file.floats(name, shape),
            StoragePrecision::F16 => file.widened(name, shape),
        };
        // The tables of the basis are made once the file is known to have weights for all of it.
        let of_components = precision_of_components(precision, folded);
        let components = numbers("components", &[sizes.functions, shape.components], of_components)?;
        let field = FactoredField {
            quantity: fit.quantity,
            grid,
            components,
            basis: Basis::new(domain, fit.degree),
            mean: file.floats("mean", &[sizes.functions])?,
            shape,
            parameters: numbers("parameters", &[shape.parameter_count()], precision)?,
            scale,
        };
        let training =
            progress.map(|(_, step)| training_state(&file, &field, &settings, step)).transpose()?;
        let state =
            progress.zip(training).map(|((cursor, _), training)| FactoredState { training, cursor, watch });
        let (scene, calibration) = (file.scene, file.calibration);
        Ok(Self { field, scene, fit, report, settings, precision, state, calibration })
    }
}

fn training_state(
    file: &Loaded<'_>,
    field: &FactoredField,
    settings: &DistillSettings,
    step: u64,
) -> Result<TrainingState, FieldFileError> {
    let count = field.parameters.len();
    let arrays = file.floats("state", &[STATE, count])?;
    let kept = field.shape.between().map(|layer| settings.optimiser.state_count(layer.outputs, layer.inputs));
    let preconditioners = match kept.sum::<usize>() {
        count if count > 0 && step > 0 => file.floats("preconditioners", &[count])?,
        _ => Vec::new(),
    };
    let array = |index: usize| arrays[index * count..][..count].to_vec();
    let [parameters, first_moment, second_moment] = [0, 1, 2].map(array);
    Ok(TrainingState { parameters, first_moment, second_moment, preconditioners, step })
}

/// How the axes are saved: those of a folded network are most of its weights.
fn precision_of_components(weights: StoragePrecision, folded: bool) -> StoragePrecision {
    if folded { weights } else { StoragePrecision::F32 }
}
