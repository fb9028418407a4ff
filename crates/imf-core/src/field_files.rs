//! Fields written to files that other programs open: NumPy's `.npy` and ParaView's `.vti` for values of voxels, `.vtp` for values
//! of a mesh's triangles, `.ply` for values of its vertices.
//!
//! A field of voxels is an array `[x, y, z]`, C-ordered like every array of this crate. Each file appears whole or not at all;
//! fields that do not fit are refused by name, and nothing is written.

use std::io::{self, Write};
use std::path::Path;

use crate::atomic_file::{AtomicFileError, write_atomically};

mod ply;
mod vti;
mod vtk;
mod vtp;

pub use ply::write_ply;
pub use vti::write_vti;
pub use vtp::write_vtp;

/// The values of a field in one of the types that fields have.
#[derive(Clone, Copy, Debug)]
pub enum FieldValues<'a> {
    /// Measures and other real numbers.
    F32(&'a [f32]),
    /// Occupancy and flags.
    U8(&'a [u8]),
    /// Counts and indices, such as the best orientation's.
    U32(&'a [u32]),
}

impl FieldValues<'_> {
    fn len(&self) -> usize {
        match self {
            Self::F32(values) => values.len(),
            Self::U8(values) => values.len(),
            Self::U32(values) => values.len(),
        }
    }

    /// Size of the values in a file.
    fn bytes(&self) -> usize {
        match self {
            Self::F32(_) | Self::U32(_) => 4 * self.len(),
            Self::U8(_) => self.len(),
        }
    }

    /// Writes the values as they stand, little-endian.
    fn write(&self, out: &mut impl Write) -> io::Result<()> {
        match self {
            Self::F32(values) => values.iter().try_for_each(|v| out.write_all(&v.to_le_bytes())),
            Self::U8(values) => out.write_all(values),
            Self::U32(values) => values.iter().try_for_each(|v| out.write_all(&v.to_le_bytes())),
        }
    }
}

impl<'a> From<&'a [f32]> for FieldValues<'a> {
    fn from(values: &'a [f32]) -> Self {
        Self::F32(values)
    }
}

impl<'a> From<&'a [u8]> for FieldValues<'a> {
    fn from(values: &'a [u8]) -> Self {
        Self::U8(values)
    }
}

impl<'a> From<&'a [u32]> for FieldValues<'a> {
    fn from(values: &'a [u32]) -> Self {
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

/// Content that is refused.
fn refused(what: String) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, what)
}

/// Refuses a field whose number of values is not that of what it belongs to.
fn check_length(name: &str, found: usize, expected: usize) -> io::Result<()> {
    if found == expected {
        return Ok(());
    }
    Err(refused(format!("the field `{name}` has {found} values, not {expected}")))
}

/// Refuses names that are empty, malformed or used twice.
fn check_names<'a>(names: impl Iterator<Item = &'a str>, is_good: impl Fn(&str) -> bool) -> io::Result<()> {
    let mut before = Vec::new();
    for name in names {
        if name.is_empty() || !is_good(name) || before.contains(&name) {
            return Err(refused(format!("the field name `{name}` is empty, malformed or used twice")));
        }
        before.push(name);
    }
    Ok(())
}

/// Writes an array `[x, y, z]` as NumPy's `.npy`, whole or not at all. The grid is not part of such a file.
///
/// # Errors
/// Values that do not fit the shape, or a file that cannot be written.
pub fn write_npy<'a>(
    path: impl AsRef<Path>,
    shape: [usize; 3],
    values: impl Into<FieldValues<'a>>,
) -> Result<(), AtomicFileError> {
    let values = values.into();
    write_atomically(path, |out| {
        check_length("values", values.len(), shape.iter().product())?;
        let kind = match values {
            FieldValues::F32(_) => "<f4",
            FieldValues::U8(_) => "|u1",
            FieldValues::U32(_) => "<u4",
        };
        let [x, y, z] = shape;
        let header = format!("{{'descr': '{kind}', 'fortran_order': False, 'shape': ({x}, {y}, {z}), }}");
        // Magic and version, length and text: together a multiple of 64 bytes, the last of them a line's end.
        let length = (10 + header.len() + 1).next_multiple_of(64) - 10;
        out.write_all(b"\x93NUMPY\x01\x00")?;
        out.write_all(&(length as u16).to_le_bytes())?;
        writeln!(out, "{header:<width$}", width = length - 1)?;
        values.write(out)
    })
}

#[cfg(test)]
mod tests {
    use ndarray::Array3;
    use ndarray_npy::ReadNpyExt;

    use super::*;

    #[test]
    fn arrays_come_back_equal_in_type_shape_and_order() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("field.npy");
        let values = Array3::from_shape_fn((3, 4, 5), |(x, y, z)| (100 * x + 10 * y + z) as f32 + 0.5);
        write_npy(&path, [3, 4, 5], values.as_slice().unwrap()).unwrap();
        let read = || std::fs::File::open(&path).unwrap();
        assert_eq!(Array3::<f32>::read_npy(read()).unwrap(), values);
        let counts = values.mapv(|v| v as u32);
        write_npy(&path, [3, 4, 5], counts.as_slice().unwrap()).unwrap();
        assert_eq!(Array3::<u32>::read_npy(read()).unwrap(), counts);
        assert!(Array3::<f32>::read_npy(read()).is_err());
        let flags = values.mapv(|v| v as u8);
        write_npy(&path, [3, 4, 5], flags.as_slice().unwrap()).unwrap();
        assert_eq!(Array3::<u8>::read_npy(read()).unwrap(), flags);
        let error = write_npy(&path, [3, 4, 4], flags.as_slice().unwrap()).unwrap_err().to_string();
        assert!(error.contains("60 values, not 48"), "{error}");
    }
}
