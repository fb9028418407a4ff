//! The factored field on disk: one safetensors file that stands alone, for queries as for going on with teaching.
//!
//! Its metadata has one key, `imf`: JSON with the format's name and version, the scene, how teacher and field were made.
//! Its tensors:
//!
//! ```text
//! parameters  f16 or f32 [weights]             g, in the layout of FactoredShape::layers
//! axes        f32 [functions, axes]            U: orthonormal columns
//! mean        f32 [functions]                  μ
//! obstacle    u8  [⌈voxels/8⌉]                 the scene's solid voxels, eight a byte, first voxel in the lowest bit
//! layer       u8  [⌈voxels/8⌉]                 where there is contact: the voxels that the cutter may enter
//! state       f32 [3 or 4, weights]            where teaching can go on: weights, both moments, average if one is kept
//! ```

use std::collections::HashMap;
use std::io::Write;
use std::path::Path;

use half::f16;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::{FactoredField, FactoredState, TeachSettings};
use crate::atomic_file::{AtomicFileError, write_atomically};
use crate::harmonic::basis::{Basis, Domain};
use crate::harmonic::coefficients::Precision;
use crate::harmonic::file::{checksum, floats, little_endian};
use crate::harmonic::{FitReport, FitSettings};
use crate::scene::{Scene, SceneRecord};
use crate::training::TrainingState;
use crate::training::run::Cursor;

const FORMAT: &str = "imf-factored";
const VERSION: u32 = 1;

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
    pub settings: TeachSettings,
    /// How the weights are kept.
    pub precision: Precision,
    /// Where teaching goes on.
    pub state: Option<FactoredState>,
}

/// Why a factored field cannot be read or written. Every message names the file.
#[derive(Debug, Error)]
pub enum FactoredFileError {
    /// The file cannot be read.
    #[error("cannot read the factored field {path}: {source}")]
    Read {
        /// The file.
        path: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// No factored field, or a damaged one.
    #[error("{path} is no intact factored field: {what}")]
    Damaged {
        /// The file.
        path: String,
        /// What is wrong.
        what: String,
    },
    /// Made by a newer program.
    #[error(
        "{path} is a factored field of version {found}, and this program reads up to {VERSION}: use a newer imf"
    )]
    Newer {
        /// The file.
        path: String,
        /// Its version.
        found: u32,
    },
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] AtomicFileError),
}

#[derive(Serialize, Deserialize)]
struct Description {
    format: String,
    version: u32,
    domain: Domain,
    scene: SceneRecord,
    fit: FitSettings,
    report: FitReport,
    settings: TeachSettings,
    precision: Precision,
    scale: f32,
    /// Cursor and steps of the state.
    progress: Option<(Cursor, u64)>,
    /// CRC-32 over parameters, axes, mean and state.
    crc32: u32,
}

/// The part of the description that can be read whatever its version.
#[derive(Deserialize)]
struct Header {
    format: String,
    version: u32,
}

impl FactoredFile {
    /// True for a file whose header names this format, read or not.
    #[must_use]
    pub fn is_one(path: &Path) -> bool {
        crate::harmonic::file::names_format(path, FORMAT)
    }

    /// Writes the field whole or not at all. Equal fields give equal bytes.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), FactoredFileError> {
        let damaged = |what: String| FactoredFileError::Damaged { path: path.display().to_string(), what };
        let field = &self.field;
        let count = field.parameters.len();
        let (kind, parameters): (Dtype, Vec<u8>) = match self.precision {
            Precision::F32 => (Dtype::F32, little_endian(&field.parameters)),
            Precision::F16 => {
                (Dtype::F16, field.parameters.iter().flat_map(|&w| f16::from_f32(w).to_le_bytes()).collect())
            }
        };
        let (axes, mean) = (little_endian(&field.axes), little_endian(&field.mean));
        let state = self.state.as_ref().map_or(Vec::new(), |state| {
            let FactoredState { training, averaged, .. } = state;
            let arrays = [&training.parameters, &training.first_moment, &training.second_moment, averaged];
            arrays.iter().flat_map(|values| little_endian(values)).collect()
        });
        let description = Description {
            format: FORMAT.into(),
            version: VERSION,
            domain: field.basis.domain(),
            scene: self.scene.record.clone(),
            fit: self.fit,
            report: self.report,
            settings: self.settings,
            precision: self.precision,
            scale: field.scale,
            progress: self.state.as_ref().map(|state| (state.cursor, state.training.step)),
            crc32: checksum(&[&parameters, &axes, &mean, &state]),
        };
        let json = serde_json::to_string(&description).map_err(|e| damaged(e.to_string()))?;
        let voxels = self.scene.packed_voxels();
        let serialized = || {
            let functions = field.basis.len();
            let mut views = vec![
                ("axes", TensorView::new(Dtype::F32, vec![functions, field.shape.axes], &axes)?),
                ("mean", TensorView::new(Dtype::F32, vec![functions], &mean)?),
                ("parameters", TensorView::new(kind, vec![count], &parameters)?),
            ];
            for (name, bits) in &voxels {
                views.push((*name, TensorView::new(Dtype::U8, vec![bits.len()], bits)?));
            }
            if !state.is_empty() {
                let arrays = state.len() / (4 * count);
                views.push(("state", TensorView::new(Dtype::F32, vec![arrays, count], &state)?));
            }
            safetensors::serialize(views, Some(HashMap::from([("imf".to_owned(), json.clone())])))
        };
        let bytes = serialized().map_err(|e| damaged(e.to_string()))?;
        Ok(write_atomically(path, |file| file.write_all(&bytes))?)
    }

    /// Reads and checks a field.
    ///
    /// # Errors
    /// A missing, foreign, newer, truncated or damaged file; the message names it and what is wrong.
    pub fn read(path: &Path) -> Result<Self, FactoredFileError> {
        let shown = path.display().to_string();
        let damaged = |what: String| FactoredFileError::Damaged { path: shown.clone(), what };
        let bytes =
            std::fs::read(path).map_err(|source| FactoredFileError::Read { path: shown.clone(), source })?;
        let (_, metadata) = SafeTensors::read_metadata(&bytes)
            .map_err(|e| damaged(format!("{e}; it was cut short, or is no safetensors file")))?;
        let json = metadata.metadata().as_ref().and_then(|m| m.get("imf"));
        let json = json.ok_or_else(|| damaged("it is a safetensors file, but not one of imf's".into()))?;
        let header: Header = serde_json::from_str(json).map_err(|e| damaged(e.to_string()))?;
        if header.format != FORMAT {
            return Err(damaged(format!("its format is '{}', not '{FORMAT}'", header.format)));
        }
        if header.version > VERSION {
            return Err(FactoredFileError::Newer { path: shown, found: header.version });
        }
        let Description { domain, scene, fit, report, settings, precision, scale, progress, crc32, .. } =
            serde_json::from_str(json).map_err(|e| damaged(e.to_string()))?;
        let tensors =
            SafeTensors::deserialize(&bytes).map_err(|e| damaged(format!("{e}; it was cut short")))?;
        fit.check().map_err(|e| damaged(e.to_string()))?;
        settings.check().map_err(|e| damaged(e.to_string()))?;
        if !(scale.is_finite() && scale > 0.0) {
            return Err(damaged(format!("its scale is {scale}")));
        }
        let sizes = fit.sizes(domain);
        let shape = settings.shape(sizes.axes);
        let count = shape.parameter_count();
        let tensor = |name: &str, kind: Dtype, dims: &[usize]| {
            let view = tensors.tensor(name).map_err(|e| damaged(e.to_string()))?;
            if view.dtype() != kind || view.shape() != dims {
                let (found, shape) = (view.dtype(), view.shape());
                return Err(damaged(format!("'{name}' is {found:?} {shape:?}, not {kind:?} {dims:?}")));
            }
            Ok(view.data().to_vec())
        };
        let kind = match precision {
            Precision::F32 => Dtype::F32,
            Precision::F16 => Dtype::F16,
        };
        let parameters = tensor("parameters", kind, &[count])?;
        let axes = tensor("axes", Dtype::F32, &[sizes.functions, sizes.axes])?;
        let mean = tensor("mean", Dtype::F32, &[sizes.functions])?;
        let arrays = if settings.averaging > 0.0 { 4 } else { 3 };
        let state = match progress {
            Some(_) => tensor("state", Dtype::F32, &[arrays, count])?,
            None => Vec::new(),
        };
        if checksum(&[&parameters, &axes, &mean, &state]) != crc32 {
            return Err(damaged("the checksum of its weights is wrong".into()));
        }
        let bits = |name: &str| tensors.tensor(name).ok().map(|view| view.data());
        let scene = Scene::from_packed_voxels(scene, bits).map_err(|e| damaged(e.to_string()))?;
        let parameters = match precision {
            Precision::F32 => floats(&parameters),
            Precision::F16 => {
                parameters.as_chunks::<2>().0.iter().map(|&b| f16::from_le_bytes(b).to_f32()).collect()
            }
        };
        if parameters.iter().any(|w: &f32| !w.is_finite()) {
            return Err(damaged("a weight is not a finite number".into()));
        }
        let state = progress.map(|(cursor, step)| {
            let mut arrays =
                floats(&state).chunks_exact(count).map(<[f32]>::to_vec).collect::<Vec<_>>().into_iter();
            let mut next = || arrays.next().unwrap_or_default();
            let training =
                TrainingState { parameters: next(), first_moment: next(), second_moment: next(), step };
            FactoredState { training, averaged: next(), cursor }
        });
        let field = FactoredField {
            grid: scene.record.grid,
            basis: Basis::new(domain, fit.degree),
            axes: floats(&axes),
            mean: floats(&mean),
            shape,
            parameters,
            scale,
        };
        Ok(Self { field, scene, fit, report, settings, precision, state })
    }
}
