//! PLY with values at the vertices, for MeshLab and ParaView: binary, little-endian.
//!
//! ```text
//! vertex: float x y z, float for each value by its name, uchar red green blue
//! face:   uchar count (3), int vertex_indices
//! ```
//!
//! Written here because the crates for these files store every vertex as a map from names to values, which takes
//! hundreds of bytes each, and leave the order of properties to chance.

use std::io::{self, Write};
use std::path::Path;

use super::{check_length, check_names};
use crate::atomic_file::{AtomicFileError, write_atomically};
use crate::mesh::Mesh;

/// Writes a mesh with values and colours at its vertices, whole or not at all. Values go by the name of their PLY property, such
/// as `imf`: letters, digits and underscores. Positions are written in f32 (the format that every viewer reads), in the mesh's
/// unit; `comments` become lines of the header.
///
/// # Errors
/// Values or colours of another number than the vertices, a name that is empty, malformed or used twice, or a file that
/// cannot be written.
pub fn write_ply(
    path: impl AsRef<Path>,
    mesh: &Mesh,
    values: &[(&str, &[f32])],
    colours: &[[u8; 3]],
    comments: &[String],
) -> Result<(), AtomicFileError> {
    write_atomically(path, |out| {
        let lengths =
            values.iter().map(|(name, values)| (*name, values.len())).chain([("colour", colours.len())]);
        for (name, found) in lengths {
            check_length(name, found, mesh.vertices.len())?;
        }
        let taken = ["x", "y", "z", "red", "green", "blue"];
        check_names(values.iter().map(|(name, _)| *name), |name| {
            !taken.contains(&name) && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
        })?;
        write_header(out, mesh, values, comments)?;
        for (vertex, position) in mesh.vertices.iter().enumerate() {
            for coordinate in position.as_vec3().to_array() {
                out.write_all(&coordinate.to_le_bytes())?;
            }
            for (_, values) in values {
                out.write_all(&values[vertex].to_le_bytes())?;
            }
            out.write_all(&colours[vertex])?;
        }
        for triangle in &mesh.triangles {
            out.write_all(&[3])?;
            for &corner in triangle {
                // The format's int is signed; more than 2³¹ vertices do not fit the memory either.
                out.write_all(&corner.to_le_bytes())?;
            }
        }
        Ok(())
    })
}

/// A header's line as readers take it: in ASCII alone.
fn ascii(line: &str) -> String {
    let line = line.replace("√3", "sqrt(3)").replace('°', " deg").replace('×', "x");
    line.chars().map(|c| if c.is_ascii() { c } else { '?' }).collect()
}

fn write_header(
    out: &mut impl Write,
    mesh: &Mesh,
    values: &[(&str, &[f32])],
    comments: &[String],
) -> io::Result<()> {
    writeln!(out, "ply\nformat binary_little_endian 1.0")?;
    for line in comments.iter().flat_map(|comment| comment.lines()) {
        writeln!(out, "comment {}", ascii(line))?;
    }
    writeln!(out, "element vertex {}", mesh.vertices.len())?;
    let names = ["x", "y", "z"].into_iter().chain(values.iter().map(|(name, _)| *name));
    for name in names {
        writeln!(out, "property float {name}")?;
    }
    writeln!(out, "property uchar red\nproperty uchar green\nproperty uchar blue")?;
    writeln!(out, "element face {}\nproperty list uchar int vertex_indices\nend_header", mesh.triangles.len())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::mesh::tests::unit_cube;

    #[test]
    fn vertices_carry_their_values_and_faces_follow() {
        let mesh = unit_cube();
        let imf: Vec<f32> = (0..8).map(|i| i as f32 / 8.0).collect();
        let colours: Vec<[u8; 3]> = (0..8).map(|i| [i, 2 * i, 3 * i]).collect();
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("surface.ply");
        let values = [("imf", &imf[..])];
        write_ply(
            &path,
            &mesh,
            &values,
            &colours,
            &["unit mm\nof a cube, √3/2 pitch wide at 60°, '½'".into()],
        )
        .unwrap();
        let file = std::fs::read(&path).unwrap();
        let end = b"end_header\n";
        let body = file.windows(end.len()).position(|w| w == end).unwrap() + end.len();
        let header = String::from_utf8_lossy(&file[..body]);
        assert!(
            header.contains(
                "comment unit mm\ncomment of a cube, sqrt(3)/2 pitch wide at 60 deg, '?'\nelement vertex 8\n"
            ),
            "{header}"
        );
        assert!(header.contains("property float z\nproperty float imf\nproperty uchar red\n"), "{header}");
        assert_eq!(file.len(), body + 8 * 19 + 12 * 13);
        let fifth = &file[body + 5 * 19..][..19];
        let float = |at: usize| f32::from_le_bytes(fifth[at..at + 4].try_into().unwrap());
        assert_eq!([float(0), float(4), float(8), float(12)], [1.0, 0.0, 1.0, 5.0 / 8.0]);
        assert_eq!(fifth[16..], [5, 10, 15]);
        assert_eq!(file[body + 8 * 19..][..5], [3, 0, 0, 0, 0]);
    }

    #[test]
    fn what_does_not_fit_is_refused_by_name() {
        let (mesh, colours, seven) = (unit_cube(), [[0; 3]; 8], [0.0; 7]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("surface.ply");
        let refusal = |name: &str, values: &[f32]| {
            write_ply(&path, &mesh, &[(name, values)], &colours, &[]).unwrap_err().to_string()
        };
        assert!(refusal("imf", &seven).contains("imf"));
        assert!(refusal("x", &[0.0; 8]).contains("`x`"));
        assert!(refusal("two words", &[0.0; 8]).contains("two words"));
        assert!(!path.exists());
    }
}
