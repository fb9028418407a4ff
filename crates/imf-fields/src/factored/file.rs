//! The factored field on disk: one safetensors file that stands alone, for queries as for going on with teaching.
//!
//! Its metadata has one key, `imf`: JSON with the format's name and version, the scene, how teacher and field were made.
//! Its tensors:
//!
//! ```text
//! parameters  f16 or f32 [weights]             g, in the layout of FactoredShape::layers
//! axes        f32 [functions, axes]            U: orthonormal columns; of a folded network V, of the weights' kind; with symmetry
//!                                              of the functions of the direction in the frame of the place
//! mean        f32 [functions]                  μ
//! obstacle    u8  [⌈voxels/8⌉]                 the scene's solid voxels, eight a byte, first voxel in the lowest bit
//! layer       u8  [⌈voxels/8⌉]                 where there is contact: the voxels that the cutter may enter
//! state       f32 [3, weights]                 where teaching can go on: weights and both moments
//! preconditioners f32 [numbers]                what the optimiser keeps beside these (SOAP's; TrainingState)
//! ```

use std::path::Path;

use half::f16;
use safetensors::tensor::Dtype;
use serde::{Deserialize, Serialize};

use super::{DistillSettings, FactoredField, FactoredState};
use crate::calibration::Calibration;
use crate::harmonic::basis::{Basis, Domain};
use crate::harmonic::coefficients::Precision;
use crate::harmonic::file::kind;
use crate::harmonic::{FitReport, FitSettings};
use crate::recipe::Cursor;
use crate::recipe::TrainingState;
use crate::recipe::divergence::Watch;
use crate::tensor_file::{
    Format, Header, Loaded, TensorFileError, checksum, floats, halves, little_endian, little_endian_halves,
};
use imf_core::scene::{Scene, SceneRecord};

const FORMAT: Format = Format { id: "imf-factored", name: "factored field", version: 1 };

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
    /// What the teacher's making told of its errors.
    pub report: FitReport,
    /// How the field was taught.
    pub settings: DistillSettings,
    /// How the weights are kept.
    pub precision: Precision,
    /// Where teaching goes on.
    pub state: Option<FactoredState>,
    /// What its decisions are worth, where that was measured of these weights.
    pub calibration: Option<Calibration>,
}

#[derive(Serialize, Deserialize)]
struct Description {
    #[serde(flatten)]
    header: Header,
    domain: Domain,
    scene: SceneRecord,
    fit: FitSettings,
    report: FitReport,
    settings: DistillSettings,
    precision: Precision,
    scale: f32,
    /// There is no layer behind the last sines.
    folded: bool,
    /// Cursor and steps of the state.
    progress: Option<(Cursor, u64)>,
    /// Of the state.
    #[serde(default, skip_serializing_if = "Watch::is_new")]
    watch: Watch,
    /// Nothing where the field was never calibrated.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    calibration: Option<Calibration>,
    /// CRC-32 over parameters, axes, mean and state.
    crc32: u32,
}

impl FactoredFile {
    /// True where teaching stopped before the end of its plan.
    #[must_use]
    pub fn is_unfinished(&self) -> bool {
        let steps = self.settings.plan.total_steps(self.field.grid.len());
        self.state.as_ref().is_some_and(|state| state.training.step < steps)
    }

    /// What a teaching comes to: the field of this checkpoint folded, its weights kept in `precision`, no state.
    #[must_use]
    pub fn finished(self, precision: Precision) -> Self {
        Self { field: self.field.folded(), precision, state: None, calibration: None, ..self }
    }

    /// The same as it is read once it is written: weights rounded as they are kept.
    #[must_use]
    pub fn as_kept(mut self) -> Self {
        let FactoredField { parameters, axes, shape, .. } = &mut self.field;
        let of_axes = precision_of_axes(self.precision, shape.folded);
        for (values, precision) in [(parameters, self.precision), (axes, of_axes)] {
            if precision == Precision::F16 {
                values.iter_mut().for_each(|value| *value = f16::from_f32(*value).to_f32());
            }
        }
        self
    }

    /// True for a file whose header names this format, read or not.
    #[must_use]
    pub fn is_one(path: &Path) -> bool {
        FORMAT.is_of(path)
    }

    /// Writes the field whole or not at all. Equal fields give equal bytes.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), TensorFileError> {
        let field = &self.field;
        let count = field.parameters.len();
        let stored = |values: &[f32], precision| match precision {
            Precision::F32 => little_endian(values).into_owned(),
            Precision::F16 => {
                let halves: Vec<f16> = values.iter().map(|&w| f16::from_f32(w)).collect();
                little_endian_halves(&halves).into_owned()
            }
        };
        let of_axes = precision_of_axes(self.precision, field.shape.folded);
        let (parameters, axes) = (stored(&field.parameters, self.precision), stored(&field.axes, of_axes));
        let mean = little_endian(&field.mean);
        let state = self.state.as_ref().map_or(Vec::new(), |state| {
            let TrainingState { parameters, first_moment, second_moment, .. } = &state.training;
            let arrays = [parameters, first_moment, second_moment];
            arrays.map(|values| little_endian(values)).concat()
        });
        let kept = self.state.as_ref().map_or(&[][..], |state| &state.training.preconditioners);
        let preconditioners = little_endian(kept);
        let description = Description {
            header: FORMAT.header(),
            domain: field.basis.domain(),
            scene: self.scene.record.clone(),
            fit: self.fit,
            report: self.report,
            settings: self.settings,
            precision: self.precision,
            scale: field.scale,
            folded: field.shape.folded,
            progress: self.state.as_ref().map(|state| (state.cursor, state.training.step)),
            watch: self.state.as_ref().map_or_else(Watch::default, |state| state.watch),
            calibration: self.calibration,
            crc32: checksum(&[&parameters, &axes, &mean, &state, &preconditioners]),
        };
        let voxels = self.scene.packed_voxels();
        let functions = field.basis.len();
        let mut tensors = vec![
            ("axes", kind(of_axes), vec![functions, field.shape.axes], axes.as_slice()),
            ("mean", Dtype::F32, vec![functions], &mean),
            ("parameters", kind(self.precision), vec![count], &parameters),
        ];
        tensors.extend(voxels.iter().map(|(name, bits)| (*name, Dtype::U8, vec![bits.len()], &bits[..])));
        if !state.is_empty() {
            tensors.push(("state", Dtype::F32, vec![STATE, count], &state));
        }
        if !kept.is_empty() {
            tensors.push(("preconditioners", Dtype::F32, vec![kept.len()], &preconditioners));
        }
        FORMAT.write(path, &description, &tensors)
    }

    /// Reads and checks a field.
    ///
    /// # Errors
    /// A missing, foreign, newer, truncated or damaged file; the message names it and what is wrong.
    pub fn read(path: &Path) -> Result<Self, TensorFileError> {
        Self::of(&FORMAT.read(path)?)
    }

    /// True for the bytes of such a file.
    pub(crate) fn begins(bytes: &[u8]) -> bool {
        FORMAT.begins(bytes)
    }

    /// Checks a file in memory, which errors call `name`.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn from_bytes(bytes: Vec<u8>, name: &Path) -> Result<Self, TensorFileError> {
        Self::of(&FORMAT.in_memory(bytes, name)?)
    }

    fn of(file: &Loaded<'_>) -> Result<Self, TensorFileError> {
        let Description {
            domain,
            scene,
            fit,
            report,
            settings,
            precision,
            scale,
            folded,
            progress,
            watch,
            calibration,
            crc32,
            ..
        } = file.description()?;
        let tensors = file.tensors()?;
        fit.check().map_err(|e| file.damaged(&e))?;
        settings.check().map_err(|e| file.damaged(&e))?;
        if let Some(fault) = calibration.and_then(|c| c.fault()) {
            return Err(file.damaged(&fault));
        }
        let symmetry = settings.symmetry;
        if !symmetry.is_none() && (domain != Domain::Directions || !symmetry.is_within(&scene.grid)) {
            return Err(
                file.damaged(&format!("it says that its network is told of {symmetry}, which cannot be"))
            );
        }
        if !(scale.is_finite() && scale > 0.0) {
            return Err(file.damaged(&format!("its scale is {scale}")));
        }
        let sizes = fit.sizes(domain);
        let shape = settings.shape(settings.symmetry.coefficients(sizes.axes, sizes.functions));
        let shape = if folded { shape.folded() } else { shape };
        if folded && progress.is_some() {
            return Err(file.damaged("it has a state, and a folded network is not taught"));
        }
        let count = shape.parameter_count();
        let parameters = tensors.bytes("parameters", kind(precision), &[count])?;
        let of_axes = precision_of_axes(precision, folded);
        let axes = tensors.bytes("axes", kind(of_axes), &[sizes.functions, shape.axes])?;
        let mean = tensors.bytes("mean", Dtype::F32, &[sizes.functions])?;
        let state = match progress {
            Some(_) => tensors.bytes("state", Dtype::F32, &[STATE, count])?,
            None => &[],
        };
        let kept_count = match progress {
            Some((_, step)) if step > 0 => {
                shape.between().map(|layer| settings.optimiser.kept_count(layer.outputs, layer.inputs)).sum()
            }
            _ => 0,
        };
        let preconditioners = match kept_count {
            0 => &[],
            count => tensors.bytes("preconditioners", Dtype::F32, &[count])?,
        };
        if checksum(&[parameters, axes, mean, state, preconditioners]) != crc32 {
            return Err(file.damaged("the checksum of its weights is wrong"));
        }
        let scene =
            Scene::from_packed_voxels(scene, |name| tensors.optional(name)).map_err(|e| file.damaged(&e))?;
        let kept = |bytes, precision| match precision {
            Precision::F32 => floats(bytes),
            Precision::F16 => halves(bytes).into_iter().map(f16::to_f32).collect(),
        };
        let (parameters, axes): (Vec<f32>, Vec<f32>) = (kept(parameters, precision), kept(axes, of_axes));
        if parameters.iter().chain(&axes).any(|w| !w.is_finite()) {
            return Err(file.damaged("a weight is not a finite number"));
        }
        let state = progress.map(|(cursor, step)| {
            let mut arrays =
                floats(state).chunks_exact(count).map(<[f32]>::to_vec).collect::<Vec<_>>().into_iter();
            let mut next = || arrays.next().unwrap_or_default();
            let training = TrainingState {
                parameters: next(),
                first_moment: next(),
                second_moment: next(),
                preconditioners: floats(preconditioners),
                step,
            };
            FactoredState { training, cursor, watch }
        });
        let field = FactoredField {
            quantity: fit.quantity,
            grid: scene.record.grid,
            basis: Basis::new(domain, fit.degree),
            axes,
            mean: floats(mean),
            shape,
            parameters,
            scale,
        };
        Ok(Self { field, scene, fit, report, settings, precision, state, calibration })
    }
}

/// How the axes are kept: those of a folded network are most of its weights.
fn precision_of_axes(weights: Precision, folded: bool) -> Precision {
    if folded { weights } else { Precision::F32 }
}
