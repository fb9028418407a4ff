//! A harmonic field for NumPy: one `.npz` of plain arrays.
//!
//! ```text
//! coefficients  f4 [nx, ny, nz, axes]   z
//! axes          f4 [functions, axes]    U
//! mean          f4 [functions]          μ
//! origin        f8 [3]                  lower corner of voxel (0, 0, 0)
//! pitch         f8 [1]
//! degree        u4 [1]                  L
//! depth         b1 [1]                  true: values are signed depths, in the grid's unit; false: overlaps
//! obstacle      u1 [nx, ny, nz]         1 where solid
//! ```
//!
//! The value at voxel (i, j, k) in the orientation R is `b(R) @ (mean + axes @ coefficients[i, j, k])`, with b the functions of
//! [`super::basis`]: an overlap, to be clipped to [0, 1], or a depth ([`Quantity`]), taken as it is.

use std::io;
use std::path::Path;

use ndarray::{ArrayView1, ArrayView2, ArrayView3, ArrayView4, ShapeError};
use ndarray_npy::{NpzWriter, WriteNpzError};

use super::file::HarmonicFile;
use crate::tensor_file::TensorFileError;
use imf_core::atomic_file::write_atomically;
use imf_core::section::Quantity;

impl HarmonicFile {
    /// Writes the field as `.npz`, whole or not at all; coefficients in f32 whatever they are kept in.
    ///
    /// # Errors
    /// The file cannot be written.
    pub fn write_npz(&self, path: &Path) -> Result<(), TensorFileError> {
        let field = &self.field;
        let (grid, axes) = (&field.grid, field.axis_count());
        let ([nx, ny, nz], functions) = (grid.dims, field.basis.len());
        let mut scratch = Vec::new();
        let coefficients = field.coefficients.read(0, field.coefficients.len(), &mut scratch);
        let written = write_atomically(path, |out| {
            let shape = |error: ShapeError| io::Error::other(error);
            let write = |error: WriteNpzError| match error {
                WriteNpzError::Zip(error) => error.into(),
                other => io::Error::other(other),
            };
            let mut npz = NpzWriter::new(out);
            let view = ArrayView4::from_shape((nx, ny, nz, axes), coefficients).map_err(shape)?;
            npz.add_array("coefficients", &view).map_err(write)?;
            let view = ArrayView2::from_shape((functions, axes), &field.axes).map_err(shape)?;
            npz.add_array("axes", &view).map_err(write)?;
            npz.add_array("mean", &ArrayView1::from(&field.mean)).map_err(write)?;
            npz.add_array("origin", &ArrayView1::from(&grid.origin.to_array())).map_err(write)?;
            npz.add_array("pitch", &ArrayView1::from(&[grid.pitch])).map_err(write)?;
            npz.add_array("degree", &ArrayView1::from(&[self.settings.degree as u32])).map_err(write)?;
            npz.add_array("depth", &ArrayView1::from(&[field.quantity == Quantity::Depth])).map_err(write)?;
            let view = ArrayView3::from_shape((nx, ny, nz), &self.scene.obstacle.solid).map_err(shape)?;
            npz.add_array("obstacle", &view).map_err(write)?;
            npz.finish().map_err(write)?;
            Ok(())
        });
        Ok(written?)
    }
}
