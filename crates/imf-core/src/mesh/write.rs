//! Writing a mesh as an OBJ file.

use std::io::{self, Write};
use std::path::Path;

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
        if let Some(vertex) = mesh.vertices.iter().position(|v| !v.is_finite()) {
            let cause =
                format!("vertex {vertex} (from 0) of the mesh has a coordinate that is NaN or infinite");
            return Err(io::Error::other(cause));
        }
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

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::mesh::read::read_mesh;

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
        write_obj(&mesh, &path, "a part\nv 1 2 3 is no vertex here").unwrap();
        assert_eq!(read_mesh(&path).unwrap(), mesh);
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
