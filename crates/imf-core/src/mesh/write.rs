//! Writing a mesh as an OBJ or an STL file.

use std::io::{self, Write};
use std::path::Path;

use glam::DVec3;

use super::Mesh;
use crate::atomic_file::{AtomicFileError, write_atomically};

/// Writes a mesh as OBJ, whole or not at all. The comment, of any number of lines, goes before it.
///
/// Coordinates are written with as many digits as it takes to read the same `f64` again: a welded mesh comes back
/// equal in every bit ([`Mesh::welded`]; any other comes back welded).
///
/// # Errors
/// A coordinate is not finite, or the file cannot be written.
pub fn write_obj(mesh: &Mesh, path: impl AsRef<Path>, header_comment: &str) -> Result<(), AtomicFileError> {
    write_atomically(path, |out| {
        require_finite(mesh)?;
        for line in header_comment.lines() {
            writeln!(out, "# {line}")?;
        }
        for v in &mesh.vertices {
            writeln!(out, "v {} {} {}", v.x, v.y, v.z)?;
        }
        for t in &mesh.triangles {
            let [a, b, c] = t.map(|v| u64::from(v) + 1);
            writeln!(out, "f {a} {b} {c}")?;
        }
        Ok(())
    })
}

/// Writes a mesh as binary STL, whole or not at all: coordinates in f32 and no unit, as in every such file. The comment's first 80
/// bytes stand at its beginning.
///
/// # Errors
/// A coordinate is not finite, more triangles than such a file holds, or the file cannot be written.
pub fn write_stl(mesh: &Mesh, path: impl AsRef<Path>, comment: &str) -> Result<(), AtomicFileError> {
    write_atomically(path, |out| {
        require_finite(mesh)?;
        let count = u32::try_from(mesh.triangles.len()).map_err(io::Error::other)?;
        let mut header = [b' '; 80];
        header.iter_mut().zip(comment.bytes()).for_each(|(own, byte)| *own = byte);
        out.write_all(&header)?;
        out.write_all(&count.to_le_bytes())?;
        for [a, b, c] in mesh.all_corners() {
            let normal = (b - a).cross(c - a).normalize_or_zero();
            for value in [normal, a, b, c].iter().flat_map(DVec3::to_array) {
                out.write_all(&(value as f32).to_le_bytes())?;
            }
            out.write_all(&[0; 2])?;
        }
        Ok(())
    })
}

fn require_finite(mesh: &Mesh) -> io::Result<()> {
    match mesh.vertices.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(vertex) => Err(io::Error::other(format!(
            "vertex {vertex} (from 0) of the mesh has a coordinate that is NaN or infinite"
        ))),
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::mesh::read::read_mesh_file;

    #[test]
    fn what_is_written_is_read_back_bit_for_bit() {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let mut vertices = vec![
            DVec3::new(0.1, 1.0 / 3.0, -1e-300),
            DVec3::new(f64::MAX, f64::MIN_POSITIVE, 5e-324),
            DVec3::new(-0.1, 1e22, 123_456_789.012_345_67),
        ];
        vertices
            .extend((0..300).map(|_| DVec3::from_array([(); 3].map(|()| random.random_range(-1e3..1e3)))));
        let triangles = (0..500).map(|_| [(); 3].map(|()| random.random_range(0..303)));
        let mesh = Mesh { vertices, triangles: [[0, 1, 2]].into_iter().chain(triangles).collect() }.welded();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("part.obj");
        write_obj(&mesh, &path, "a part\nv 1 2 3 is not a vertex here").unwrap();
        assert_eq!(read_mesh_file(&path).unwrap().mesh, mesh);
    }

    #[test]
    fn an_stl_file_holds_the_mesh_in_f32() {
        let vertices = [(0.1, 0.2, 0.3), (1.0, 0.0, 0.5), (0.0, 1e3, 0.0), (0.3, 0.1, 7.0)];
        let vertices = vertices.map(|(x, y, z)| DVec3::new(x, y, z)).to_vec();
        let mesh = Mesh { vertices, triangles: vec![[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]] };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("part.stl");
        write_stl(
            &mesh,
            &path,
            "solid facet, and a comment that is longer than the eighty bytes of a file's head may be",
        )
        .unwrap();
        let read = read_mesh_file(&path).unwrap().mesh;
        let corners = |mesh: &Mesh| mesh.all_corners().map(|c| c.map(DVec3::as_vec3)).collect::<Vec<_>>();
        assert_eq!(corners(&read), corners(&mesh));
        let broken = Mesh { vertices: vec![DVec3::NAN], triangles: vec![] };
        assert!(write_stl(&broken, &path, "").is_err());
    }

    #[test]
    fn a_mesh_that_cannot_be_read_back_is_not_written() {
        let mesh = Mesh { vertices: vec![DVec3::ZERO, DVec3::NAN], triangles: vec![] };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("part.obj");
        let error = write_obj(&mesh, &path, "").unwrap_err().to_string();
        assert!(error.contains("part.obj") && error.contains("vertex 1"), "{error}");
        assert!(!path.exists());
    }
}
