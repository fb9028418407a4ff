//! Scalar fields over a grid, written to files that other programs open: NumPy's `.npy` and ParaView's `.vti`.
//!
//! A field is an array `[x, y, z]` of the grid's dimensions with one value for each voxel, C-ordered like every array
//! of this crate. Each file appears whole or not at all.

use std::path::PathBuf;

use ndarray::ArrayView3;
use thiserror::Error;

use crate::atomic_file::AtomicFileError;

mod npy;
mod ply;
mod vti;

pub use npy::write_npy;
pub use ply::{VertexValues, write_ply};
pub use vti::write_vti;

/// The values of a field, `[x, y, z]`, in one of the types that fields have.
#[derive(Clone, Copy, Debug)]
pub enum FieldValues<'a> {
    /// Measures and other real numbers.
    F32(ArrayView3<'a, f32>),
    /// Occupancy and flags.
    U8(ArrayView3<'a, u8>),
    /// Counts and indices, such as the best orientation's.
    U32(ArrayView3<'a, u32>),
}

impl FieldValues<'_> {
    /// The array's shape.
    #[must_use]
    pub fn dims(&self) -> [usize; 3] {
        let (x, y, z) = match self {
            Self::F32(values) => values.dim(),
            Self::U8(values) => values.dim(),
            Self::U32(values) => values.dim(),
        };
        [x, y, z]
    }
}

impl<'a> From<ArrayView3<'a, f32>> for FieldValues<'a> {
    fn from(values: ArrayView3<'a, f32>) -> Self {
        Self::F32(values)
    }
}

impl<'a> From<ArrayView3<'a, u8>> for FieldValues<'a> {
    fn from(values: ArrayView3<'a, u8>) -> Self {
        Self::U8(values)
    }
}

impl<'a> From<ArrayView3<'a, u32>> for FieldValues<'a> {
    fn from(values: ArrayView3<'a, u32>) -> Self {
        Self::U32(values)
    }
}

/// A field and the name under which a viewer lists it.
#[derive(Clone, Copy, Debug)]
pub struct NamedField<'a> {
    /// The name, for instance `imf`.
    pub name: &'a str,
    /// The values.
    pub values: FieldValues<'a>,
}

impl<'a> NamedField<'a> {
    /// A field under a name.
    pub fn new(name: &'a str, values: impl Into<FieldValues<'a>>) -> Self {
        Self { name, values: values.into() }
    }
}

/// Why a field could not be written.
#[derive(Debug, Error)]
pub enum FieldFileError {
    /// The field does not fit the grid.
    #[error("cannot write {path}: the field `{name}` has {found:?} values, its grid {expected:?} voxels")]
    Dims {
        /// The file to be written.
        path: PathBuf,
        /// The field's name.
        name: String,
        /// The field's shape.
        found: [usize; 3],
        /// The grid's dimensions.
        expected: [usize; 3],
    },
    /// Values at vertices that do not fit the mesh.
    #[error("cannot write {path}: `{name}` has {found} values, the mesh {expected} vertices")]
    Vertices {
        /// The file to be written.
        path: PathBuf,
        /// The property's name.
        name: String,
        /// Values given.
        found: usize,
        /// Vertices.
        expected: usize,
    },
    /// Two fields of one file have the same name, or a name is empty or malformed.
    #[error("cannot write {path}: the field name `{name}` is empty, malformed or used twice")]
    Name {
        /// The file to be written.
        path: PathBuf,
        /// The name.
        name: String,
    },
    /// There is no field to write.
    #[error("cannot write {path}: no field was given")]
    NoField {
        /// The file to be written.
        path: PathBuf,
    },
    /// The file system refused.
    #[error(transparent)]
    File(#[from] AtomicFileError),
}
