//! Reading meshes from OBJ, STL, PLY and 3MF files.
//!
//! A mesh that is read has finite vertices, each used by a triangle, no two of them equal, numbered in the order of
//! their first use: its indices are its topology ([`Mesh::welded`]). Positions are in the file's own unit, which 3MF alone states. Files are
//! not trusted: whatever they hold, the result is a mesh or an error that says what is wrong and what to do.

use std::fs;
use std::io;
use std::path::Path;

use glam::{DMat4, DVec3};

use super::Mesh;
use crate::file_error::{CUT, Fault, FaultKind, FileError, as_utf8, unended_line};
use crate::unit::LengthUnit;

mod obj;
#[cfg(feature = "formats")]
mod ply;
#[cfg(feature = "formats")]
mod stl;
#[cfg(feature = "formats")]
mod three_mf;

/// Reads the content of a file of one format.
type Parser = fn(&[u8]) -> Result<MeshFile, Fault>;

/// A mesh and what its file says of it.
#[derive(Clone, Debug, PartialEq)]
pub struct MeshFile {
    /// The mesh.
    pub mesh: Mesh,
    /// The unit of its positions, where the file states one.
    pub unit: Option<LengthUnit>,
}

impl MeshFile {
    /// Reads a mesh that is in memory already, as [`read_mesh_file`] reads the file `name`, whose ending says the format.
    ///
    /// # Errors
    /// As [`read_mesh_file`]; they call the file `name`.
    pub fn from_bytes(bytes: &[u8], name: impl AsRef<Path>) -> Result<Self, FileError> {
        let name = name.as_ref();
        parser_of(name).and_then(|parser| parse(bytes, parser)).map_err(|fault| fault.at(name))
    }

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

/// Reads a mesh: OBJ (polygons become triangle fans; groups are merged; materials, normals and texture coordinates
/// are ignored), STL or PLY, binary or ASCII, or 3MF (the objects of its build, placed and joined, but for a printer's
/// supports). The format follows from the name's ending.
///
/// # Errors
/// The file is missing, unreadable, empty, in another format, malformed or cut short; it has no faces, a vertex
/// index out of range, a NaN or infinite coordinate, or more than 2³¹ triangles.
pub fn read_mesh_file(path: impl AsRef<Path>) -> Result<MeshFile, FileError> {
    let path = path.as_ref();
    read(path).map_err(|fault| fault.at(path))
}

fn read(path: &Path) -> Result<MeshFile, Fault> {
    let refused = |error: io::Error| Fault::of_system("mesh file", &error);
    if fs::metadata(path).map_err(refused)?.is_dir() {
        return Err(refused(io::ErrorKind::IsADirectory.into()));
    }
    let parser = parser_of(path)?;
    parse(&fs::read(path).map_err(refused)?, parser)
}

fn parse(bytes: &[u8], parser: Parser) -> Result<MeshFile, Fault> {
    if bytes.trim_ascii().is_empty() {
        return Err(Fault::new(FaultKind::Empty, "it is empty; export the mesh again"));
    }
    let file = parser(&as_utf8(bytes)).map_err(|mut fault| {
        fault.cause += match fault.kind {
            FaultKind::Malformed => "; export the mesh again or correct the file",
            FaultKind::Truncated => "; copy or export it again",
            _ => "",
        };
        fault
    })?;
    if file.mesh.triangles.is_empty() {
        let cause = "it holds no faces; export the part as a triangle mesh, not as points, curves or an empty selection";
        return Err(Fault::new(FaultKind::Empty, cause));
    }
    Ok(file)
}

fn parser_of(path: &Path) -> Result<Parser, Fault> {
    let extension = path.extension().map(|e| e.to_string_lossy().to_ascii_lowercase()).unwrap_or_default();
    let (found, remedy) = match extension.as_str() {
        "obj" => return Ok(obj::parse),
        #[cfg(feature = "formats")]
        "stl" => return Ok(stl::parse),
        #[cfg(feature = "formats")]
        "ply" => return Ok(ply::parse),
        #[cfg(feature = "formats")]
        "3mf" => return Ok(three_mf::parse),
        #[cfg(not(feature = "formats"))]
        "stl" | "ply" | "3mf" => (
            format!("a mesh in the .{extension} format, which this program was built without"),
            "export it as OBJ, or build with the feature `formats` of imf-core",
        ),
        "step" | "stp" | "iges" | "igs" | "brep" => (
            "a CAD file of exact surfaces".to_owned(),
            "convert it to triangles at a deviation well below the voxel pitch, with this project's Python package \
             (`pip install cadquery-ocp`, `python -m imf.step part.step part.stl`), with gmsh \
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
    let cause = format!("it is {found}; meshes are read from .obj, .stl, .ply and .3mf files: {remedy}");
    Err(Fault::new(FaultKind::Format, cause))
}

/// Refuses a text whose last line has no end where something `is_missing`, as only a mesh without a boundary shows that nothing is.
fn refuse_cut(bytes: &[u8], is_missing: impl Fn(&[u8]) -> bool) -> Result<(), Fault> {
    match unended_line(bytes) {
        Some((line, tail)) if is_missing(tail) => {
            let cause = format!("{CUT}, and what it holds is not closed; if it is whole, end its last line");
            Err(Fault::new(FaultKind::Truncated, cause).on_line(line))
        }
        _ => Ok(()),
    }
}

/// A face that names a vertex which the file does not have; `index` as the file gives it: in OBJ from 1, or negative from the
/// end; in PLY and 3MF from 0.
fn no_vertex(index: i64, vertices: usize) -> Fault {
    Fault::malformed(format!("a face uses vertex {index}, but the file has {vertices}"))
}

/// A coordinate that is not a number or infinite.
fn not_finite(vertex: &str) -> Fault {
    let remedy = "repair the mesh (MeshLab, Blender)";
    Fault::malformed(format!("{vertex} has a coordinate that is NaN or infinite; {remedy}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A mesh of the format, or the error's text for the file `part`.
    pub(super) fn mesh_of(bytes: impl AsRef<[u8]>, parser: Parser) -> Result<Mesh, String> {
        let parsed = parse(bytes.as_ref(), parser);
        parsed.map(|file| file.mesh).map_err(|fault| fault.at(Path::new("part")).to_string())
    }

    #[test]
    fn files_that_are_no_meshes_are_told_apart() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let failure = |path: std::path::PathBuf| {
            let error = read_mesh_file(&path).unwrap_err();
            assert!(error.to_string().contains(&path.display().to_string()), "{error}");
            error
        };
        assert_eq!(failure(at("none.obj")).fault.kind, FaultKind::Missing);
        assert_eq!(failure(folder.path().into()).fault.kind, FaultKind::Unreadable);
        for name in ["empty.obj", "empty.stl", "empty.ply", "empty.3mf"] {
            fs::write(at(name), " \n").unwrap();
            assert_eq!(failure(at(name)).fault.kind, FaultKind::Empty);
        }
        for (name, hint) in [
            ("a.STEP", "imf.step"),
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
    }

    #[test]
    fn the_ending_decides_in_any_case() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("PART.OBJ");
        fs::write(&path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
        assert_eq!(read_mesh_file(&path).unwrap().mesh.triangles, [[0, 1, 2]]);
    }
}
