//! A field read from a file, whichever family it is of.

use std::path::Path;

use thiserror::Error;

use crate::factored::file::FactoredFile;
use crate::harmonic::file::HarmonicFile;
use crate::model::{Model, ModelError};
use crate::scene::Scene;
use crate::tensor_file::TensorFileError;

/// A field and the scene that it is of.
#[derive(Clone, Debug, PartialEq)]
pub enum StoredField {
    /// The paper's network.
    Siren(Box<Model>),
    /// Exact sections fitted by harmonics.
    Harmonic(Box<HarmonicFile>),
    /// A harmonic field in a network of the point.
    Factored(Box<FactoredFile>),
}

/// Why a file gives no field; the message names it.
#[derive(Debug, Error)]
pub enum StoredFieldError {
    /// A network's file.
    #[error(transparent)]
    Model(#[from] ModelError),
    /// A harmonic or factored field's file.
    #[error(transparent)]
    Tensors(#[from] TensorFileError),
}

impl StoredField {
    /// Reads and checks a field of any family.
    ///
    /// # Errors
    /// A missing, foreign, newer, truncated or damaged file.
    pub fn read(path: &Path) -> Result<Self, StoredFieldError> {
        if HarmonicFile::is_one(path) {
            return Ok(Self::Harmonic(Box::new(HarmonicFile::read(path)?)));
        }
        if FactoredFile::is_one(path) {
            return Ok(Self::Factored(Box::new(FactoredFile::read(path)?)));
        }
        Ok(Self::Siren(Box::new(Model::read(path)?)))
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
