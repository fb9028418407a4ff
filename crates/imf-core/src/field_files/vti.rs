//! ParaView's `.vti` (VTK XML image data): several named fields on the voxels, placed in the world.
//!
//! A voxel is a cell: cell (i, j, k) spans `Origin + Spacing·(i, j, k)` to the next, so `Origin` is the grid's own
//! origin and the values are cell data. VTK counts with x fastest, so the values are transposed on the way. They
//! follow the XML as appended raw little-endian binary, each block after its length in bytes (u64).
//!
//! Written here because the one crate for these files, `vtkio`, stores origin and spacing in f32, which displaces the
//! voxels of a part far from the origin, and wants a copy of all values in memory.

use std::io::{self, Write};
use std::path::Path;

use super::vtk::{begin, check_fields, write_cell_data};
use super::{FieldValues, NamedField};
use crate::atomic_file::{AtomicFileError, write_atomically};
use crate::grid::Grid;

/// Layers in z that are gathered together: one cache line of f32, so that each is read once.
const LAYERS: usize = 16;

/// Writes fields over a grid as `.vti`, whole or not at all. Positions are in the grid's unit.
///
/// # Errors
/// No field, a field that does not fit the grid, a name that is empty or used twice, or a file that cannot be written.
pub fn write_vti(
    path: impl AsRef<Path>,
    grid: &Grid,
    fields: &[NamedField<'_>],
) -> Result<(), AtomicFileError> {
    write_atomically(path, |out| {
        check_fields(fields, grid.len())?;
        write_header(out, grid, fields)?;
        for field in fields {
            out.write_all(&(field.values.bytes() as u64).to_le_bytes())?;
            match field.values {
                FieldValues::F32(values) => write_x_fastest(out, grid, values, f32::to_le_bytes)?,
                FieldValues::U8(values) => write_x_fastest(out, grid, values, u8::to_le_bytes)?,
                FieldValues::U32(values) => write_x_fastest(out, grid, values, u32::to_le_bytes)?,
            }
        }
        out.write_all(b"\n  </AppendedData>\n</VTKFile>\n")
    })
}

fn write_header(out: &mut impl Write, grid: &Grid, fields: &[NamedField<'_>]) -> io::Result<()> {
    let [x, y, z] = grid.dims;
    let (origin, pitch) = (grid.origin, grid.pitch);
    let extent = format!("0 {x} 0 {y} 0 {z}");
    begin(out, "ImageData")?;
    write!(out, r#"  <ImageData WholeExtent="{extent}" "#)?;
    writeln!(out, r#"Origin="{} {} {}" Spacing="{pitch} {pitch} {pitch}">"#, origin.x, origin.y, origin.z)?;
    writeln!(out, r#"    <Piece Extent="{extent}">"#)?;
    write_cell_data(out, fields)?;
    writeln!(out, "    </Piece>\n  </ImageData>")?;
    // Offsets count from the byte after the underscore.
    write!(out, "  <AppendedData encoding=\"raw\">\n   _")
}

/// Writes the values of a grid with x fastest, a few layers of z at a time.
fn write_x_fastest<T: Copy, const N: usize>(
    out: &mut impl Write,
    grid: &Grid,
    values: &[T],
    to_bytes: impl Fn(T) -> [u8; N],
) -> io::Result<()> {
    let [nx, ny, nz] = grid.dims;
    let mut slab = vec![[0; N]; nx * ny * LAYERS.min(nz)];
    for first in (0..nz).step_by(LAYERS) {
        let layers = LAYERS.min(nz - first);
        for x in 0..nx {
            for y in 0..ny {
                for layer in 0..layers {
                    slab[(layer * ny + y) * nx + x] = to_bytes(values[grid.index([x, y, first + layer])]);
                }
            }
        }
        out.write_all(slab[..nx * ny * layers].as_flattened())?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::super::vtk::tests::block;
    use super::*;

    fn grid() -> Grid {
        Grid { origin: DVec3::new(-1.5, 1000.5, 0.1), pitch: 0.1, dims: [5, 4, 19] }
    }

    /// Reads one value back by the format's rules: x fastest.
    fn value_at<const N: usize>(file: &[u8], name: &str, voxel: [usize; 3]) -> [u8; N] {
        let block = block(file, &format!("Name=\"{name}\""));
        let [nx, ny, nz] = grid().dims;
        assert_eq!(block.len(), nx * ny * nz * N);
        let at = (voxel[2] * ny + voxel[1]) * nx + voxel[0];
        block.as_chunks().0[at]
    }

    #[test]
    fn every_voxel_of_every_field_is_where_vtk_looks_for_it() {
        let grid = grid();
        let real: Vec<f32> = (0..grid.len()).map(|i| i as f32 + 0.25).collect();
        let flags: Vec<u8> = (0..grid.len()).map(|i| i as u8).collect();
        let counts: Vec<u32> = (0..grid.len()).map(|i| 1000 * i as u32).collect();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("field.vti");
        let fields = [
            NamedField::new("imf", &real[..]),
            NamedField::new("solid <&\">", &flags[..]),
            NamedField::new("best", &counts[..]),
        ];
        write_vti(&path, &grid, &fields).unwrap();
        let file = std::fs::read(&path).unwrap();
        for i in 0..grid.len() {
            let voxel = grid.voxel(i);
            assert_eq!(f32::from_le_bytes(value_at(&file, "imf", voxel)), i as f32 + 0.25);
            assert_eq!(value_at(&file, "solid &lt;&amp;&quot;&gt;", voxel), [i as u8]);
            assert_eq!(u32::from_le_bytes(value_at(&file, "best", voxel)), 1000 * i as u32);
        }
        let text = String::from_utf8_lossy(&file);
        assert!(
            text.contains(r#"WholeExtent="0 5 0 4 0 19" Origin="-1.5 1000.5 0.1" Spacing="0.1 0.1 0.1""#)
        );
        assert!(file.ends_with(b"\n  </AppendedData>\n</VTKFile>\n"));
    }

    #[test]
    fn what_does_not_fit_is_refused_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("field.vti");
        let (good, small) = ([0_u8; 5 * 4 * 19], [0_u8; 5 * 4 * 18]);
        let refusal = |fields: &[NamedField<'_>]| write_vti(&path, &grid(), fields).unwrap_err().to_string();
        let text = refusal(&[NamedField::new("imf", &small[..])]);
        assert!(
            text.contains("field.vti") && text.contains("imf") && text.contains("360 values, not 380"),
            "{text}"
        );
        let twice = NamedField::new("imf", &good[..]);
        assert!(refusal(&[twice, twice]).contains("used twice"));
        assert!(refusal(&[]).contains("no field"));
        assert!(!path.exists());
    }
}
