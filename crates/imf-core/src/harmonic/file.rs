//! The harmonic field on disk: one safetensors file that stands alone.
//!
//! Its metadata has one key, `imf`: JSON with the format's name and version, the scene, the settings and the report.
//! Its tensors:
//!
//! ```text
//! coefficients  f16 or f32 [nx, ny, nz, axes]   z, C-ordered
//! axes          f32 [functions, axes]           U: orthonormal columns
//! mean          f32 [functions]                 μ
//! obstacle      u8  [⌈voxels/8⌉]                the scene's solid voxels, eight a byte, first voxel in the lowest bit
//! ```
//!
//! The value at a voxel is `Σ_k (μ_k + Σ_j U_kj z_j) b_k(R)`, b as in [`super::basis`].

use std::collections::HashMap;
use std::io::Write;
use std::path::Path;

use half::f16;
use safetensors::tensor::{Dtype, SafeTensors, TensorView};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::basis::{Basis, Domain};
use super::coefficients::{Coefficients, Precision};
use super::{FitReport, FitSettings, HarmonicField};
use crate::atomic_file::{AtomicFileError, write_atomically};
use crate::scene::{Scene, SceneRecord};

const FORMAT: &str = "imf-harmonic";
const VERSION: u32 = 1;

/// A harmonic field with everything that is known about it.
#[derive(Clone, Debug, PartialEq)]
pub struct HarmonicFile {
    /// The field.
    pub field: HarmonicField,
    /// What it represents.
    pub scene: Scene,
    /// How it was made.
    pub settings: FitSettings,
}

/// Why a harmonic field cannot be read or written. Every message names the file.
#[derive(Debug, Error)]
pub enum HarmonicFileError {
    /// The file cannot be read.
    #[error("cannot read the harmonic field {path}: {source}")]
    Read {
        /// The file.
        path: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// No harmonic field, or a damaged one.
    #[error("{path} is no intact harmonic field: {what}")]
    Damaged {
        /// The file.
        path: String,
        /// What is wrong.
        what: String,
    },
    /// Made by a newer program.
    #[error(
        "{path} is a harmonic field of version {found}, and this program reads up to {VERSION}: use a newer imf"
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
    settings: FitSettings,
    report: FitReport,
    /// CRC-32 over coefficients, axes and mean.
    crc32: u32,
}

/// The part of the description that can be read whatever its version.
#[derive(Deserialize)]
struct Header {
    format: String,
    version: u32,
}

impl HarmonicFile {
    /// True for a file whose header names this format, read or not.
    #[must_use]
    pub fn is_one(path: &Path) -> bool {
        use std::io::Read as _;
        // The JSON header of a safetensors file follows its length, and `imf` stands at its beginning.
        let mut start = [0; 512];
        let read = std::fs::File::open(path).and_then(|mut file| file.read(&mut start)).unwrap_or(0);
        start[..read].windows(FORMAT.len()).any(|window| window == FORMAT.as_bytes())
    }

    /// Writes the field whole or not at all. Equal fields give equal bytes.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(&self, path: &Path) -> Result<(), HarmonicFileError> {
        let damaged = |what: String| HarmonicFileError::Damaged { path: path.display().to_string(), what };
        let field = &self.field;
        let (functions, axes) = (field.basis.len(), field.axis_count());
        let [nx, ny, nz] = field.grid.dims;
        let (kind, coefficients): (Dtype, Vec<u8>) = match &field.coefficients {
            Coefficients::F32(values) => (Dtype::F32, little_endian(values)),
            Coefficients::F16(values) => (Dtype::F16, values.iter().flat_map(|v| v.to_le_bytes()).collect()),
        };
        let (axes_bytes, mean) = (little_endian(&field.axes), little_endian(&field.mean));
        let description = Description {
            format: FORMAT.into(),
            version: VERSION,
            domain: field.basis.domain(),
            scene: self.scene.record.clone(),
            settings: self.settings,
            report: field.report,
            crc32: checksum([&coefficients, &axes_bytes, &mean]),
        };
        let json = serde_json::to_string(&description).map_err(|e| damaged(e.to_string()))?;
        let voxels = self.scene.packed_voxels();
        let serialized = || {
            let mut views = vec![
                ("axes", TensorView::new(Dtype::F32, vec![functions, axes], &axes_bytes)?),
                ("coefficients", TensorView::new(kind, vec![nx, ny, nz, axes], &coefficients)?),
                ("mean", TensorView::new(Dtype::F32, vec![functions], &mean)?),
            ];
            for (name, bits) in &voxels {
                views.push((*name, TensorView::new(Dtype::U8, vec![bits.len()], bits)?));
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
    pub fn read(path: &Path) -> Result<Self, HarmonicFileError> {
        let shown = path.display().to_string();
        let damaged = |what: String| HarmonicFileError::Damaged { path: shown.clone(), what };
        let bytes =
            std::fs::read(path).map_err(|source| HarmonicFileError::Read { path: shown.clone(), source })?;
        let (_, metadata) = SafeTensors::read_metadata(&bytes)
            .map_err(|e| damaged(format!("{e}; it was cut short, or is no safetensors file")))?;
        let json = metadata.metadata().as_ref().and_then(|m| m.get("imf"));
        let json = json.ok_or_else(|| damaged("it is a safetensors file, but not one of imf's".into()))?;
        let header: Header = serde_json::from_str(json).map_err(|e| damaged(e.to_string()))?;
        if header.format != FORMAT {
            return Err(damaged(format!("its format is '{}', not '{FORMAT}'", header.format)));
        }
        if header.version > VERSION {
            return Err(HarmonicFileError::Newer { path: shown, found: header.version });
        }
        let description: Description = serde_json::from_str(json).map_err(|e| damaged(e.to_string()))?;
        let tensors =
            SafeTensors::deserialize(&bytes).map_err(|e| damaged(format!("{e}; it was cut short")))?;
        let grid = description.scene.grid;
        let settings = description.settings;
        settings.check().map_err(|e| damaged(e.to_string()))?;
        let sizes = settings.sizes(description.domain);
        let tensor = |name: &str, kind: Dtype, dims: &[usize]| {
            let view = tensors.tensor(name).map_err(|e| damaged(e.to_string()))?;
            if view.dtype() != kind || view.shape() != dims {
                let (found, shape) = (view.dtype(), view.shape());
                return Err(damaged(format!("'{name}' is {found:?} {shape:?}, not {kind:?} {dims:?}")));
            }
            Ok(view.data().to_vec())
        };
        let kind = match settings.precision {
            Precision::F32 => Dtype::F32,
            Precision::F16 => Dtype::F16,
        };
        let [nx, ny, nz] = grid.dims;
        let coefficients = tensor("coefficients", kind, &[nx, ny, nz, sizes.axes])?;
        let axes = tensor("axes", Dtype::F32, &[sizes.functions, sizes.axes])?;
        let mean = tensor("mean", Dtype::F32, &[sizes.functions])?;
        if checksum([&coefficients, &axes, &mean]) != description.crc32 {
            return Err(damaged("the checksum of its coefficients is wrong".into()));
        }
        let bits = |name: &str| tensors.tensor(name).ok().map(|view| view.data());
        let scene = Scene::from_packed_voxels(description.scene, bits).map_err(|e| damaged(e.to_string()))?;
        let coefficients = match settings.precision {
            Precision::F32 => Coefficients::F32(floats(&coefficients)),
            Precision::F16 => Coefficients::F16(
                coefficients.as_chunks::<2>().0.iter().map(|&b| f16::from_le_bytes(b)).collect(),
            ),
        };
        let field = HarmonicField {
            grid,
            basis: Basis::new(description.domain, settings.degree),
            axes: floats(&axes),
            mean: floats(&mean),
            coefficients,
            report: description.report,
        };
        Ok(Self { field, scene, settings })
    }
}

fn little_endian(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}

fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b)).collect()
}

fn checksum(parts: [&[u8]; 3]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    parts.iter().for_each(|part| hasher.update(part));
    hasher.finalize()
}
