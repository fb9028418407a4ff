//! The harmonic field on disk (`tensor_file` has what all share), with these tensors:
//!
//! ```text
//! coefficients  f16 or f32 [nx, ny, nz, components] z, C-ordered
//! components    f32 [functions, components]         U: orthonormal columns
//! mean          f32 [functions]                     μ
//! ```
//!
//! The value at a voxel is `Σ_k (μ_k + Σ_j U_kj z_j) b_k(R)`, b as in [`super::basis`].

use std::path::Path;

use safetensors::tensor::Dtype;
use serde::{Deserialize, Serialize};

#[cfg(feature = "fit")]
use super::HarmonicError;
use super::basis::{Basis, Domain};
use super::coefficients::{Coefficients, StoragePrecision};
use super::{FitReport, FitSettings, HarmonicField};
use crate::calibration::Calibration;
use crate::tensor_file::{FieldFileError, Format, floats, halves};
#[cfg(feature = "fit")]
use imf_core::control::Control;
use imf_core::scene::Scene;
#[cfg(feature = "fit")]
use imf_core::section::{SectionPlan, ToolPoints};

pub(crate) const FORMAT: Format = Format { id: "imf-harmonic", name: "harmonic field" };

/// A harmonic field with everything that is known about it.
#[derive(Clone, Debug, PartialEq)]
pub struct HarmonicFile {
    /// The field.
    pub field: HarmonicField,
    /// What it represents.
    pub scene: Scene,
    /// How it was made.
    pub settings: FitSettings,
    /// The calibration of its decisions, where measured.
    pub calibration: Option<Calibration>,
}

#[derive(Serialize, Deserialize)]
struct Description {
    domain: Domain,
    settings: FitSettings,
    report: FitReport,
}

impl HarmonicFile {
    /// Fits the field of a scene whose tool's tip stands on a point: of every direction where the tool is round, else of every rotation.
    ///
    /// # Errors
    /// As [`fit()`](super::fit()).
    #[cfg(feature = "fit")]
    pub fn fit(scene: &Scene, settings: &FitSettings, control: Control<'_>) -> Result<Self, HarmonicError> {
        let plan = SectionPlan::of_scene(scene, ToolPoints::Tip)?;
        let field = super::fit(&plan, Domain::of_tool(scene.record.bare_tool()), settings, control)?;
        Ok(Self { field, scene: scene.clone(), settings: *settings, calibration: None })
    }

    /// True for a file whose header names this format, read or not.
    pub fn is_one(path: &Path) -> bool {
        FORMAT.is_of(path)
    }

    /// Refuses a field of another grid than the scene's.
    pub(crate) fn check_grid(&self) -> Result<(), FieldFileError> {
        let what = "the field's grid is not the scene's";
        let is_own = self.field.grid == self.scene.record.grid;
        if is_own { Ok(()) } else { Err(FieldFileError::Parts { name: FORMAT.name, what }) }
    }

    /// Refuses what could not be read again, or would be read as another field.
    #[cfg(feature = "fit")]
    fn check(&self) -> Result<(), FieldFileError> {
        self.check_grid()?;
        let Self { field, settings, .. } = self;
        let sizes = settings.sizes(field.basis.domain());
        let differ = [
            (field.quantity != settings.quantity, "the field's quantity is not that of the settings"),
            (
                field.coefficients.precision() != settings.precision,
                "its precision is not that of the settings",
            ),
            (
                (field.basis.len(), field.component_count()) != (sizes.functions, sizes.components),
                "it has not as many functions and components as the settings say",
            ),
        ];
        let first = differ.into_iter().find_map(|(differs, what)| differs.then_some(what));
        first.map_or(Ok(()), |what| Err(FieldFileError::Parts { name: FORMAT.name, what }))
    }

    /// Writes the field whole or not at all. Equal fields give equal bytes.
    ///
    /// # Errors
    /// A field of another scene or of other settings; a file that cannot be written.
    #[cfg(feature = "fit")]
    pub fn write(&self, path: &Path) -> Result<(), FieldFileError> {
        use crate::tensor_file::{Contents, little_endian, little_endian_halves, tensor};
        self.check()?;
        let field = &self.field;
        let ([nx, ny, nz], functions, components) =
            (field.grid.dims, field.basis.len(), field.component_count());
        let coefficients = match &field.coefficients {
            Coefficients::F32(values) => little_endian(values),
            Coefficients::F16(values) => little_endian_halves(values),
        };
        let (domain, settings, report) = (field.basis.domain(), self.settings, field.report);
        let contents = Contents {
            scene: &self.scene,
            calibration: self.calibration,
            description: Description { domain, settings, report },
            tensors: vec![
                tensor("components", &[functions, components], &field.components),
                (
                    "coefficients".into(),
                    kind(field.coefficients.precision()),
                    vec![nx, ny, nz, components],
                    coefficients,
                ),
                tensor("mean", &[functions], &field.mean),
            ],
        };
        FORMAT.write(path, contents)
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
        let Description { domain, settings, report } = file.description()?;
        settings.check().map_err(|e| file.damaged(&e))?;
        let (grid, sizes) = (file.scene.record.grid, settings.sizes(domain));
        let [nx, ny, nz] = grid.dims;
        let coefficients =
            file.bytes("coefficients", kind(settings.precision), &[nx, ny, nz, sizes.components])?;
        // The tables of the basis are made once the file is known to have weights for all of it.
        let components = file.floats("components", &[sizes.functions, sizes.components])?;
        let field = HarmonicField {
            quantity: settings.quantity,
            grid,
            components,
            mean: file.floats("mean", &[sizes.functions])?,
            basis: Basis::new(domain, settings.degree),
            coefficients: match settings.precision {
                StoragePrecision::F32 => {
                    Coefficients::F32(file.finite("coefficients", floats(coefficients))?)
                }
                StoragePrecision::F16 => {
                    let halves = halves(coefficients);
                    if !halves.iter().all(|half| half.is_finite()) {
                        return Err(file.damaged("coefficients holds a number that is not finite"));
                    }
                    Coefficients::F16(halves)
                }
            },
            report,
        };
        Ok(Self { field, scene: file.scene, settings, calibration: file.calibration })
    }
}

/// How numbers of a precision are saved in a file.
pub(crate) const fn kind(precision: StoragePrecision) -> Dtype {
    match precision {
        StoragePrecision::F32 => Dtype::F32,
        StoragePrecision::F16 => Dtype::F16,
    }
}
