//! A field read from a file, whichever family it is of.

use std::io::Read;
use std::path::Path;
use std::sync::Arc;

use crate::calibration::Calibration;
use crate::factored::file::FactoredFile;
use crate::harmonic::basis::Basis;
use crate::harmonic::file::HarmonicFile;
use crate::model::Model;
pub use crate::tensor_file::FieldFileError;
use crate::{factored, harmonic, model};
use imf_core::scene::Scene;
use imf_core::section::Quantity;

/// A field and the scene that it is of.
#[derive(Clone, Debug, PartialEq)]
pub enum FieldFile {
    /// The paper's network.
    Siren(Box<Model>),
    /// Exact sections fitted by harmonics.
    Harmonic(Arc<HarmonicFile>),
    /// A harmonic field in a network of the point.
    Factored(Box<FactoredFile>),
}

impl FieldFile {
    /// Reads and checks a field of any family.
    ///
    /// # Errors
    /// A missing, foreign, newer, truncated or damaged file; the message names it.
    pub fn read(path: &Path) -> Result<Self, FieldFileError> {
        let formats = [harmonic::file::FORMAT, factored::file::FORMAT];
        let format = formats.into_iter().find(|format| format.is_of(path)).unwrap_or(model::FORMAT);
        Self::of(&format.bytes(path)?, path)
    }

    /// Checks a field of any family in memory, such as in a browser or embedded in a program; errors call it `name`.
    ///
    /// # Errors
    /// Foreign, newer, truncated or damaged bytes.
    pub fn from_bytes(bytes: &[u8], name: &str) -> Result<Self, FieldFileError> {
        Self::of(bytes, Path::new(name))
    }

    /// As [`FieldFile::from_bytes`], from all that a reader gives.
    ///
    /// # Errors
    /// A reader that fails; foreign, newer, truncated or damaged bytes.
    pub fn from_reader(mut reader: impl Read, name: &str) -> Result<Self, FieldFileError> {
        let mut bytes = Vec::new();
        let read = reader.read_to_end(&mut bytes);
        read.map_err(|source| FieldFileError::Read { name: "field", path: name.into(), source })?;
        Self::from_bytes(&bytes, name)
    }

    fn of(bytes: &[u8], name: &Path) -> Result<Self, FieldFileError> {
        if harmonic::file::FORMAT.begins(bytes) {
            return Ok(Self::Harmonic(Arc::new(HarmonicFile::from_bytes(bytes, name)?)));
        }
        if factored::file::FORMAT.begins(bytes) {
            return Ok(Self::Factored(Box::new(FactoredFile::from_bytes(bytes, name)?)));
        }
        Ok(Self::Siren(Box::new(Model::from_bytes(bytes, name)?)))
    }

    /// The calibration of its decisions, where measured.
    pub fn calibration(&self) -> Option<&Calibration> {
        self.scene_and_calibration().1
    }

    /// Saves the measured rates of its decisions.
    pub fn set_calibration(&mut self, calibration: Calibration) {
        match self {
            Self::Siren(model) => model.calibration = Some(calibration),
            Self::Harmonic(file) => Arc::make_mut(file).calibration = Some(calibration),
            Self::Factored(file) => file.calibration = Some(calibration),
        }
    }

    /// Writes the field whole or not at all.
    ///
    /// # Errors
    /// A file that cannot be written.
    #[cfg(feature = "fit")]
    pub fn write(&self, path: &Path) -> Result<(), FieldFileError> {
        match self {
            Self::Siren(model) => model.write(path),
            Self::Harmonic(file) => file.write(path),
            Self::Factored(file) => file.write(path),
        }
    }

    /// Its family by name: `siren5`, `harmonic` or `factored`.
    #[must_use]
    pub fn family(&self) -> &'static str {
        match self {
            Self::Siren(_) => "siren5",
            Self::Harmonic(_) => "harmonic",
            Self::Factored(_) => "factored",
        }
    }

    /// Coefficients of a voxel; none of the paper's network.
    #[must_use]
    pub fn coefficient_count(&self) -> usize {
        self.sum().map_or(0, |(_, _, coefficients)| coefficients)
    }

    /// What its values are.
    pub fn quantity(&self) -> Quantity {
        self.sum().map_or(Quantity::Overlap, |(quantity, ..)| quantity)
    }

    /// The functions of an orientation that it is a sum of; none of the paper's network.
    pub fn basis(&self) -> Option<&Basis> {
        self.sum().map(|(_, basis, _)| basis)
    }

    /// What the field is of.
    pub fn scene(&self) -> &Scene {
        self.scene_and_calibration().0
    }

    fn scene_and_calibration(&self) -> (&Scene, Option<&Calibration>) {
        match self {
            Self::Siren(model) => (&model.scene, model.calibration.as_ref()),
            Self::Harmonic(file) => (&file.scene, file.calibration.as_ref()),
            Self::Factored(file) => (&file.scene, file.calibration.as_ref()),
        }
    }

    /// Quantity, functions and coefficients of a voxel of what is a sum of functions.
    fn sum(&self) -> Option<(Quantity, &Basis, usize)> {
        match self {
            Self::Siren(_) => None,
            Self::Harmonic(file) => {
                Some((file.field.quantity, &file.field.basis, file.field.component_count()))
            }
            Self::Factored(file) => {
                Some((file.field.quantity, &file.field.basis, file.field.coefficient_count()))
            }
        }
    }
}

#[cfg(test)]
mod tests;
