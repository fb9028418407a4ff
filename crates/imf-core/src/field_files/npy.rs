//! NumPy's `.npy`: the bare array, `numpy.load` gives it back as `[x, y, z]`.

use std::path::Path;

use ndarray_npy::{WriteNpyError, WriteNpyExt};

use super::{FieldFileError, FieldValues};
use crate::atomic_file::write_atomically;

/// Writes a field as `.npy`, shape `[x, y, z]`, whole or not at all. The grid is not part of such a file.
///
/// # Errors
/// The file cannot be written.
pub fn write_npy<'a>(
    path: impl AsRef<Path>,
    values: impl Into<FieldValues<'a>>,
) -> Result<(), FieldFileError> {
    let values = values.into();
    write_atomically(path, |out| {
        let written = match values {
            FieldValues::F32(values) => values.write_npy(out),
            FieldValues::U8(values) => values.write_npy(out),
            FieldValues::U32(values) => values.write_npy(out),
        };
        written.map_err(|error| match error {
            WriteNpyError::Io(error) => error,
            other => std::io::Error::other(other),
        })
    })?;
    Ok(())
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
        write_npy(&path, values.view()).unwrap();
        let read = || std::fs::File::open(&path).unwrap();
        assert_eq!(Array3::<f32>::read_npy(read()).unwrap(), values);
        // A view of every other voxel, in counts.
        let counts = values.mapv(|v| v as u32);
        let part = counts.slice(ndarray::s![.., ..;2, ..]);
        write_npy(&path, part).unwrap();
        assert_eq!(Array3::<u32>::read_npy(read()).unwrap(), part);
        assert!(Array3::<f32>::read_npy(read()).is_err());
    }
}
