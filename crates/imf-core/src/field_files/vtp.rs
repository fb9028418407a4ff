//! ParaView's `.vtp` (VTK XML polygons): a mesh with values of its triangles, which ParaView and PyVista colour by.
//!
//! The values follow the XML as appended raw little-endian binary, as in `.vti`.

use std::io::Write as _;
use std::path::Path;

use glam::DVec3;

use super::NamedField;
use super::vtk::{begin, check_fields, write_cell_data};
use crate::atomic_file::{AtomicFileError, write_atomically};
use crate::mesh::Mesh;

/// Writes a mesh with values of its triangles as `.vtp`, whole or not at all. Positions are in the mesh's unit.
///
/// # Errors
/// No field, a field of another number of values than there are triangles, a name that is empty or used twice, or a file that
/// cannot be written.
pub fn write_vtp(
    path: impl AsRef<Path>,
    mesh: &Mesh,
    fields: &[NamedField<'_>],
) -> Result<(), AtomicFileError> {
    write_atomically(path, |out| {
        check_fields(fields, mesh.triangles.len())?;
        let (points, triangles) = (mesh.vertices.len(), mesh.triangles.len());
        begin(out, "PolyData")?;
        writeln!(
            out,
            r#"  <PolyData>
    <Piece NumberOfPoints="{points}" NumberOfVerts="0" NumberOfLines="0" NumberOfStrips="0" NumberOfPolys="{triangles}">"#
        )?;
        let offset = write_cell_data(out, fields)?;
        let corners = offset + 8 + 24 * points as u64;
        let ends = corners + 8 + 24 * triangles as u64;
        writeln!(
            out,
            r#"      <Points>
        <DataArray type="Float64" NumberOfComponents="3" format="appended" offset="{offset}"/>
      </Points>
      <Polys>
        <DataArray type="Int64" Name="connectivity" format="appended" offset="{corners}"/>
        <DataArray type="Int64" Name="offsets" format="appended" offset="{ends}"/>
      </Polys>
    </Piece>
  </PolyData>"#
        )?;
        // Offsets count from the byte after the underscore.
        write!(out, "  <AppendedData encoding=\"raw\">\n   _")?;
        for field in fields {
            out.write_all(&(field.values.bytes() as u64).to_le_bytes())?;
            field.values.write(out)?;
        }
        out.write_all(&(24 * points as u64).to_le_bytes())?;
        for coordinate in mesh.vertices.iter().flat_map(DVec3::to_array) {
            out.write_all(&coordinate.to_le_bytes())?;
        }
        out.write_all(&(24 * triangles as u64).to_le_bytes())?;
        for &corner in mesh.triangles.iter().flatten() {
            out.write_all(&i64::from(corner).to_le_bytes())?;
        }
        out.write_all(&(8 * triangles as u64).to_le_bytes())?;
        for end in 1..=triangles as i64 {
            out.write_all(&(3 * end).to_le_bytes())?;
        }
        out.write_all(b"\n  </AppendedData>\n</VTKFile>\n")
    })
}

#[cfg(test)]
mod tests {
    use super::super::vtk::tests::block;
    use super::*;
    use crate::mesh::tests::unit_cube;

    #[test]
    fn values_points_and_triangles_are_where_vtk_looks_for_them() {
        let mesh = unit_cube();
        let share: Vec<f32> = (0..12).map(|i| i as f32 / 8.0).collect();
        let class: Vec<u8> = (0..12).collect();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("surface.vtp");
        let fields = [NamedField::new("class", &class[..]), NamedField::new("share", &share[..])];
        write_vtp(&path, &mesh, &fields).unwrap();
        let file = std::fs::read(&path).unwrap();
        let block = |words: &str| block(&file, words);
        assert_eq!(block("Name=\"class\""), &class[..]);
        let of_f32 = block("Name=\"share\"").chunks(4).map(|b| f32::from_le_bytes(b.try_into().unwrap()));
        assert_eq!(of_f32.collect::<Vec<_>>(), share);
        let points = block("Float64").chunks(8).map(|b| f64::from_le_bytes(b.try_into().unwrap()));
        let expected: Vec<f64> = mesh.vertices.iter().flat_map(DVec3::to_array).collect();
        assert_eq!(points.collect::<Vec<_>>(), expected);
        let whole = |name: &str| -> Vec<i64> {
            block(name).chunks(8).map(|b| i64::from_le_bytes(b.try_into().unwrap())).collect()
        };
        let expected: Vec<i64> = mesh.triangles.iter().flatten().map(|&c| i64::from(c)).collect();
        assert_eq!(whole("Name=\"connectivity\""), expected);
        assert_eq!(whole("Name=\"offsets\""), (1..=12).map(|n| 3 * n).collect::<Vec<_>>());
        let xml = String::from_utf8_lossy(&file);
        assert!(xml.contains(r#"NumberOfPoints="8""#) && xml.contains(r#"NumberOfPolys="12""#));
        let refusal = write_vtp(&path, &mesh, &[NamedField::new("class", &class[1..])]).unwrap_err();
        assert!(refusal.to_string().contains("11 values, not 12"), "{refusal}");
    }
}
