//! A field read from a file, whichever family it is of.

use std::path::Path;
use std::sync::Arc;

use thiserror::Error;

use crate::calibration::Calibration;
use crate::factored::file::FactoredFile;
use crate::harmonic::basis::Basis;
use crate::harmonic::file::HarmonicFile;
use crate::model::{Model, ModelError};
use crate::tensor_file::{TensorFileError, refuse_npz};
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

/// Why a file gives no field; the message names it.
#[derive(Debug, Error)]
pub enum FieldFileError {
    /// A network's file.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A harmonic or factored field's file.
    #[error(transparent)]
    Tensors(#[from] TensorFileError),
}

impl FieldFile {
    /// Reads and checks a field of any family.
    ///
    /// # Errors
    /// A missing, foreign, newer, truncated or damaged file, and one that was kept for NumPy.
    pub fn read(path: &Path) -> Result<Self, FieldFileError> {
        refuse_npz(path)?;
        if HarmonicFile::is_one(path) {
            return Ok(Self::Harmonic(Arc::new(HarmonicFile::read(path)?)));
        }
        if FactoredFile::is_one(path) {
            return Ok(Self::Factored(Box::new(FactoredFile::read(path)?)));
        }
        Ok(Self::Siren(Box::new(Model::read(path)?)))
    }

    /// Checks a field of any family in memory, such as in a browser or embedded in a program; errors call it `name`.
    ///
    /// # Errors
    /// Foreign, newer, truncated or damaged bytes.
    pub fn from_bytes(bytes: Vec<u8>, name: &str) -> Result<Self, FieldFileError> {
        let name = Path::new(name);
        if HarmonicFile::begins(&bytes) {
            return Ok(Self::Harmonic(Arc::new(HarmonicFile::from_bytes(bytes, name)?)));
        }
        if FactoredFile::begins(&bytes) {
            return Ok(Self::Factored(Box::new(FactoredFile::from_bytes(bytes, name)?)));
        }
        Ok(Self::Siren(Box::new(Model::from_bytes(&bytes, name)?)))
    }

    /// What its decisions are worth, where that was measured.
    #[must_use]
    pub fn calibration(&self) -> Option<&Calibration> {
        match self {
            Self::Siren(model) => model.calibration.as_ref(),
            Self::Harmonic(file) => file.calibration.as_ref(),
            Self::Factored(file) => file.calibration.as_ref(),
        }
    }

    /// Keeps what was measured of its decisions.
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
    pub fn write(&self, path: &Path) -> Result<(), FieldFileError> {
        match self {
            Self::Siren(model) => model.write(path)?,
            Self::Harmonic(file) => file.write(path)?,
            Self::Factored(file) => file.write(path)?,
        }
        Ok(())
    }

    /// What its values are.
    #[must_use]
    pub fn quantity(&self) -> Quantity {
        match self {
            Self::Siren(_) => Quantity::Overlap,
            Self::Harmonic(file) => file.field.quantity,
            Self::Factored(file) => file.field.quantity,
        }
    }

    /// The functions of an orientation that it is a sum of; none of the paper's network.
    #[must_use]
    pub fn basis(&self) -> Option<&Basis> {
        match self {
            Self::Siren(_) => None,
            Self::Harmonic(file) => Some(&file.field.basis),
            Self::Factored(file) => Some(&file.field.basis),
        }
    }

    /// What the field is of.
    #[must_use]
    pub fn scene(&self) -> &Scene {
        match self {
            Self::Siren(model) => &model.scene,
            Self::Harmonic(file) => &file.scene,
            Self::Factored(file) => &file.scene,
        }
    }
}
