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

use std::path::Path;

use safetensors::tensor::Dtype;
use serde::{Deserialize, Serialize};

use super::basis::{Basis, Domain};
use super::coefficients::{Coefficients, Precision};
use super::{FitReport, FitSettings, HarmonicField};
use crate::calibration::Calibration;
use crate::tensor_file::{
    Format, Header, Loaded, TensorFileError, checksum, floats, halves, little_endian, little_endian_halves,
};
use imf_core::scene::{Scene, SceneRecord};

const FORMAT: Format = Format { id: "imf-harmonic", name: "harmonic field", version: 1 };

/// A harmonic field with everything that is known about it.
#[derive(Clone, Debug, PartialEq)]
pub struct HarmonicFile {
    /// The field.
    pub field: HarmonicField,
    /// What it represents.
    pub scene: Scene,
    /// How it was made.
    pub settings: FitSettings,
    /// What its decisions are worth, where that was measured.
    pub calibration: Option<Calibration>,
}

#[derive(Serialize, Deserialize)]
struct Description {
    #[serde(flatten)]
    header: Header,
    domain: Domain,
    scene: SceneRecord,
    settings: FitSettings,
    report: FitReport,
    /// Nothing in files that were never calibrated; programs that know of none pass it over.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    calibration: Option<Calibration>,
    /// CRC-32 over coefficients, axes and mean.
    crc32: u32,
}

impl HarmonicFile {
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
        let ([nx, ny, nz], functions, axes) = (field.grid.dims, field.basis.len(), field.axis_count());
        let coefficients = match &field.coefficients {
            Coefficients::F32(values) => little_endian(values),
            Coefficients::F16(values) => little_endian_halves(values),
        };
        let (axes_bytes, mean) = (little_endian(&field.axes), little_endian(&field.mean));
        let description = Description {
            header: FORMAT.header(),
            domain: field.basis.domain(),
            scene: self.scene.record.clone(),
            settings: self.settings,
            report: field.report,
            calibration: self.calibration,
            crc32: checksum(&[&coefficients, &axes_bytes, &mean]),
        };
        let voxels = self.scene.packed_voxels();
        let mut tensors = vec![
            ("axes", Dtype::F32, vec![functions, axes], &*axes_bytes),
            ("coefficients", kind(field.coefficients.precision()), vec![nx, ny, nz, axes], &coefficients),
            ("mean", Dtype::F32, vec![functions], &mean),
        ];
        tensors.extend(voxels.iter().map(|(name, bits)| (*name, Dtype::U8, vec![bits.len()], &bits[..])));
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
        let Description { domain, scene, settings, report, calibration, crc32, .. } = file.description()?;
        let tensors = file.tensors()?;
        settings.check().map_err(|e| file.damaged(&e))?;
        let grid = scene.grid;
        let sizes = settings.sizes(domain);
        if let Some(fault) = calibration.and_then(|c| c.fault()) {
            return Err(file.damaged(&fault));
        }
        let [nx, ny, nz] = grid.dims;
        let shape = [nx, ny, nz, sizes.axes];
        let coefficients = tensors.bytes("coefficients", kind(settings.precision), &shape)?;
        let axes = tensors.bytes("axes", Dtype::F32, &[sizes.functions, sizes.axes])?;
        let mean = tensors.bytes("mean", Dtype::F32, &[sizes.functions])?;
        if checksum(&[coefficients, axes, mean]) != crc32 {
            return Err(file.damaged("the checksum of its coefficients is wrong"));
        }
        let scene =
            Scene::from_packed_voxels(scene, |name| tensors.optional(name)).map_err(|e| file.damaged(&e))?;
        let field = HarmonicField {
            quantity: settings.quantity,
            grid,
            basis: Basis::new(domain, settings.degree),
            axes: floats(axes),
            mean: floats(mean),
            coefficients: match settings.precision {
                Precision::F32 => Coefficients::F32(floats(coefficients)),
                Precision::F16 => Coefficients::F16(halves(coefficients)),
            },
            report,
        };
        Ok(Self { field, scene, settings, calibration })
    }
}

/// How numbers of a precision are kept in the file.
pub(crate) const fn kind(precision: Precision) -> Dtype {
    match precision {
        Precision::F32 => Dtype::F32,
        Precision::F16 => Dtype::F16,
    }
}
