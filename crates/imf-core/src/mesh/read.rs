//! Reading meshes from OBJ, STL, PLY and 3MF files.
//!
//! A mesh that is read has finite vertices, each used by a triangle, no two of them equal, numbered in the order of
//! their first use: its indices are its topology ([`Mesh::welded`]). Positions are in the file's own unit, which 3MF alone states. Files are
//! not trusted: whatever they hold, the answer is a mesh or an error that says what is wrong and what to do.

use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use glam::{DMat4, DVec3};
use thiserror::Error;

use super::Mesh;
use crate::unit::LengthUnit;

mod obj;
#[cfg(feature = "formats")]
mod ply;
#[cfg(feature = "formats")]
mod stl;
#[cfg(feature = "formats")]
mod three_mf;

/// Why a mesh could not be read. Every text names the file, the cause and a remedy.
#[derive(Debug, Error)]
pub enum MeshFileError {
    /// There is no such file.
    #[error("there is no mesh file {path}; check the name and the folder")]
    Missing {
        /// The file.
        path: PathBuf,
    },
    /// The system refuses to read the file.
    #[error("cannot read {path}: {source}; check that it is a file and that you may read it")]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// The name's ending belongs to no format that is read.
    #[error("{path} is {found}; meshes are read from .obj, .stl, .ply and .3mf files: {remedy}")]
    Format {
        /// The file.
        path: PathBuf,
        /// What the ending says.
        found: String,
        /// How to get a file that can be read.
        remedy: &'static str,
    },
    /// The file has no content.
    #[error("{path} is empty; export the mesh again")]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// The content does not follow the format.
    #[error("{path}{}: {cause}; export the mesh again or correct the file", at_line(*.line))]
    Malformed {
        /// The file.
        path: PathBuf,
        /// The line, from 1, where it is known.
        line: Option<usize>,
        /// What is wrong.
        cause: String,
    },
    /// The file ends too early.
    #[error("{path} is cut short: {cause}; copy or export it again")]
    Truncated {
        /// The file.
        path: PathBuf,
        /// What is missing.
        cause: String,
    },
    /// There is nothing to work on.
    #[error(
        "{path} holds no faces; export the part as a triangle mesh, not as points, curves or an empty selection"
    )]
    NoFaces {
        /// The file.
        path: PathBuf,
    },
    /// A face names a vertex that the file does not have.
    #[error(
        "{path}{}: a face uses vertex {index}, but the file has {vertices}; export the mesh again",
        at_line(*.line)
    )]
    VertexIndex {
        /// The file.
        path: PathBuf,
        /// The line of the face, from 1, where it is known.
        line: Option<usize>,
        /// The index as the file gives it: in OBJ from 1, or negative from the end; in PLY from 0.
        index: i64,
        /// Number of vertices in the file.
        vertices: usize,
    },
    /// A coordinate is not a number or infinite.
    #[error(
        "{path}{}: {vertex} has a coordinate that is NaN or infinite; repair the mesh (MeshLab, Blender) and export it again",
        at_line(*.line)
    )]
    NotFinite {
        /// The file.
        path: PathBuf,
        /// The line of the vertex, from 1, where it is known.
        line: Option<usize>,
        /// Which vertex.
        vertex: String,
    },
    /// The mesh is larger than can be indexed.
    #[error("{path} has more than 2^31 triangles; reduce the mesh (MeshLab, Blender) and export it again")]
    TooLarge {
        /// The file.
        path: PathBuf,
    },
}

fn at_line(line: Option<usize>) -> String {
    line.map(|line| format!(", line {line}")).unwrap_or_default()
}

#[derive(Clone, Copy)]
enum Format {
    Obj,
    #[cfg(feature = "formats")]
    Stl,
    #[cfg(feature = "formats")]
    Ply,
    #[cfg(feature = "formats")]
    ThreeMf,
}

/// A mesh and what its file says of it.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshFile {
    /// The mesh.
    pub mesh: Mesh,
    /// The unit of its positions, where the file states one.
    pub unit: Option<LengthUnit>,
}

impl MeshFile {
    /// The mesh with every length in `unit`; as it is where the file states none.
    #[must_use]
    pub fn in_unit(self, unit: LengthUnit) -> Mesh {
        match self.unit {
            Some(stated) if stated != unit => {
                let factor = stated.in_mm() / unit.in_mm();
                self.mesh.transformed(&DMat4::from_scale(DVec3::splat(factor)))
            }
            _ => self.mesh,
        }
    }
}

/// Reads a mesh, in whatever unit its file is in; see [`read_mesh_file`].
///
/// # Errors
/// As [`read_mesh_file`].
pub fn read_mesh(path: impl AsRef<Path>) -> Result<Mesh, MeshFileError> {
    Ok(read_mesh_file(path)?.mesh)
}

/// Reads a mesh: OBJ (polygons become triangle fans; groups are merged; materials, normals and texture coordinates
/// are ignored), STL or PLY, binary or ASCII, or 3MF (the objects of its build, placed and joined, but for a printer's
/// supports). The format follows from the name's ending.
///
/// # Errors
/// The file is missing, unreadable, empty, in another format, malformed or cut short; it has no faces, a vertex
/// index out of range, a NaN or infinite coordinate, or more than 2³¹ triangles.
pub fn read_mesh_file(path: impl AsRef<Path>) -> Result<MeshFile, MeshFileError> {
    let path = path.as_ref();
    let metadata = fs::metadata(path).map_err(|source| match source.kind() {
        io::ErrorKind::NotFound => MeshFileError::Missing { path: path.into() },
        _ => MeshFileError::Unreadable { path: path.into(), source },
    })?;
    if metadata.is_dir() {
        let source = io::Error::from(io::ErrorKind::IsADirectory);
        return Err(MeshFileError::Unreadable { path: path.into(), source });
    }
    let format = format_of(path)?;
    let bytes = fs::read(path).map_err(|source| MeshFileError::Unreadable { path: path.into(), source })?;
    parse(bytes, format, path)
}

/// Reads an OBJ that is in memory already, as [`read_mesh`] reads its file; errors name `path`.
///
/// # Errors
/// As those of [`read_mesh`] for a file's content.
pub fn parse_obj(content: &[u8], path: &Path) -> Result<Mesh, MeshFileError> {
    Ok(parse(content.to_vec(), Format::Obj, path)?.mesh)
}

#[cfg_attr(
    not(feature = "formats"),
    expect(clippy::needless_pass_by_value, reason = "STL files are consumed")
)]
fn parse(bytes: Vec<u8>, format: Format, path: &Path) -> Result<MeshFile, MeshFileError> {
    if bytes.trim_ascii().is_empty() {
        return Err(MeshFileError::Empty { path: path.into() });
    }
    let (mesh, unit) = match format {
        Format::Obj => (obj::parse(&bytes, path)?, None),
        #[cfg(feature = "formats")]
        Format::Stl => (stl::parse(bytes, path)?, None),
        #[cfg(feature = "formats")]
        Format::Ply => (ply::parse(&bytes, path)?, None),
        #[cfg(feature = "formats")]
        Format::ThreeMf => {
            let (mesh, unit) = three_mf::parse(&bytes, path)?;
            (mesh, Some(unit))
        }
    };
    if mesh.triangles.is_empty() {
        return Err(MeshFileError::NoFaces { path: path.into() });
    }
    Ok(MeshFile { mesh, unit })
}

fn format_of(path: &Path) -> Result<Format, MeshFileError> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let (found, remedy) = match extension.as_str() {
        "obj" => return Ok(Format::Obj),
        #[cfg(feature = "formats")]
        "stl" => return Ok(Format::Stl),
        #[cfg(feature = "formats")]
        "ply" => return Ok(Format::Ply),
        #[cfg(feature = "formats")]
        "3mf" => return Ok(Format::ThreeMf),
        #[cfg(not(feature = "formats"))]
        "stl" | "ply" | "3mf" => (
            format!("a mesh in the .{extension} format, which this program was built without"),
            "export it as OBJ, or build with the feature `formats` of imf-core",
        ),
        "step" | "stp" | "iges" | "igs" | "brep" => (
            "a CAD file of exact surfaces".to_owned(),
            "convert it to triangles at a deviation well below the voxel pitch, with gmsh \
             (`gmsh part.step -2 -clmax 1 -o part.stl`) or with FreeCAD (Mesh workbench, Create mesh from shape, then \
             export as STL)",
        ),
        "off" | "glb" | "gltf" | "amf" => (
            format!("a mesh in the .{extension} format, which is not read"),
            "open it in MeshLab or Blender and export it as OBJ or STL",
        ),
        "" => ("without an ending that names its format".to_owned(), "rename it if it is one of these"),
        _ => (format!("of an unknown kind (.{extension})"), "rename it if it is one of these, or convert it"),
    };
    Err(MeshFileError::Format { path: path.into(), found, remedy })
}

/// The most triangles that a mesh may have.
const MAX_TRIANGLES: usize = 1 << 31;

fn check_count(triangles: usize, path: &Path) -> Result<(), MeshFileError> {
    if triangles > MAX_TRIANGLES { Err(MeshFileError::TooLarge { path: path.into() }) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::mesh::tests::unit_cube;

    pub(super) fn parse_obj(text: &str) -> Result<Mesh, MeshFileError> {
        Ok(parse(text.as_bytes().to_vec(), Format::Obj, Path::new("part.obj"))?.mesh)
    }

    pub(super) fn parse_stl(bytes: &[u8]) -> Result<Mesh, MeshFileError> {
        Ok(parse(bytes.to_vec(), Format::Stl, Path::new("part.stl"))?.mesh)
    }

    #[test]
    fn files_that_are_no_meshes_are_told_apart() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let failure = |path: PathBuf| {
            let error = read_mesh(&path).unwrap_err();
            assert!(error.to_string().contains(&path.display().to_string()), "{error}");
            error
        };
        assert!(matches!(failure(at("none.obj")), MeshFileError::Missing { .. }));
        assert!(matches!(failure(folder.path().into()), MeshFileError::Unreadable { .. }));
        for name in ["empty.obj", "empty.stl", "empty.ply", "empty.3mf"] {
            fs::write(at(name), " \n").unwrap();
            assert!(matches!(failure(at(name)), MeshFileError::Empty { .. }));
        }
        for (name, hint) in [
            ("a.STEP", "gmsh"),
            ("a.stp", "FreeCAD"),
            ("a.off", "MeshLab"),
            ("a.amf", "MeshLab"),
            ("a.xyz", "xyz"),
            ("a", "ending"),
        ] {
            fs::write(at(name), "something").unwrap();
            let text = failure(at(name)).to_string();
            assert!(text.contains(hint) && text.contains(".obj, .stl, .ply and .3mf"), "{text}");
        }
        assert!(matches!(
            check_count(MAX_TRIANGLES + 1, Path::new("a")),
            Err(MeshFileError::TooLarge { .. })
        ));
        assert!(check_count(MAX_TRIANGLES, Path::new("a")).is_ok());
    }

    #[test]
    fn the_ending_decides_in_any_case() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("PART.OBJ");
        fs::write(&path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
        assert_eq!(read_mesh(&path).unwrap().triangles, [[0, 1, 2]]);
    }

    /// Whatever the bytes are, the answer is an error or a mesh that keeps the module's guarantee.
    fn survives(bytes: &[u8], format: Format) {
        if let Ok(MeshFile { mesh, .. }) = parse(bytes.to_vec(), format, Path::new("part")) {
            assert!(mesh.vertices.iter().all(|v| v.is_finite()));
            assert_eq!(mesh.welded(), mesh);
        }
    }

    #[test]
    fn truncated_and_mutated_files_never_panic() {
        let cube = unit_cube();
        let mut obj = "mtllib a.mtl\no part\nvn 0 0 1\nvt 0 0\n".to_owned();
        for v in &cube.vertices {
            obj += &format!("v {} {} {}\n", v.x, v.y, v.z);
        }
        for t in &cube.triangles {
            obj += &format!("g side\nf {}/1/1 {}//1 -{} \\\n # note\n", t[0] + 1, t[1] + 1, 8 - t[2]);
        }
        let samples = [
            (obj.into_bytes(), Format::Obj),
            (stl::tests::ascii(&cube).into_bytes(), Format::Stl),
            (stl::tests::binary(&cube), Format::Stl),
            (ply::tests::ascii(&cube).into_bytes(), Format::Ply),
            (ply::tests::binary(&cube, true), Format::Ply),
            (ply::tests::binary(&cube, false), Format::Ply),
            (three_mf::tests::archive(&three_mf::tests::cube(&cube)), Format::ThreeMf),
        ];
        let telling = b"0123456789-+e./ \n#\\fv";
        let mut random = ChaCha8Rng::seed_from_u64(3);
        for (sample, format) in &samples {
            assert_eq!(parse(sample.clone(), *format, Path::new("part")).unwrap().mesh.triangles.len(), 12);
            for length in 0..sample.len() {
                survives(&sample[..length], *format);
            }
            for _ in 0..3000 {
                let mut bytes = sample.clone();
                for _ in 0..random.random_range(1..6) {
                    let at = random.random_range(0..bytes.len());
                    match random.random_range(0..4) {
                        0 => bytes[at] = random.random(),
                        1 => bytes[at] = telling[random.random_range(0..telling.len())],
                        2 => {
                            bytes.remove(at);
                        }
                        _ => {
                            let end = (at + random.random_range(1..40)).min(bytes.len());
                            let piece = bytes[at..end].to_vec();
                            let to = random.random_range(0..bytes.len());
                            bytes.splice(to..to, piece);
                        }
                    }
                }
                survives(&bytes, *format);
            }
            for _ in 0..300 {
                let noise: Vec<u8> = (0..random.random_range(0..400)).map(|_| random.random()).collect();
                survives(&noise, *format);
            }
        }
    }
}
