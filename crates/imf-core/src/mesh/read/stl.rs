//! STL, binary and ASCII, through `stl_io`.
//!
//! Which of the two a file is follows from its length and content, since binary files may begin with `solid` as well.
//! Normals are ignored (some exporters write NaN for them); several solids in one ASCII file are merged.

use std::io::{self, Cursor};
use std::path::Path;

use glam::DVec3;

use super::{MeshFileError, check_count};
use crate::mesh::Mesh;
use crate::mesh::weld::Welder;

/// Bytes of a binary file before its triangles: free text, then their number.
const HEADER: usize = 80;
const PREAMBLE: usize = HEADER + 4;
/// Bytes of one triangle: normal and three corners in f32, and two of no meaning.
const RECORD: usize = 50;

pub(super) fn parse(mut bytes: Vec<u8>, path: &Path) -> Result<Mesh, MeshFileError> {
    if is_ascii(&bytes) {
        return read_triangles(&clean(&bytes), path, true);
    }
    let Some(guaranteed) = promised_triangles(&bytes) else {
        let cause = "this is neither a binary nor an ASCII STL file".to_owned();
        return Err(MeshFileError::Malformed { path: path.into(), line: None, cause });
    };
    let held = (bytes.len() - PREAMBLE) / RECORD;
    if held < guaranteed {
        let cause = format!("it holds {held} of the {guaranteed} triangles that it announces");
        return Err(MeshFileError::Truncated { path: path.into(), cause });
    }
    check_count(guaranteed, path)?;
    // The reader takes a file for ASCII by its first word, which says nothing in a binary one.
    bytes[..HEADER].fill(0);
    read_triangles(&bytes, path, false)
}

/// The number of triangles that a binary file announces; `None` if it is too short for one.
fn promised_triangles(bytes: &[u8]) -> Option<usize> {
    let count = bytes.get(HEADER..PREAMBLE)?;
    Some(u32::from_le_bytes(count.try_into().ok()?) as usize)
}

fn is_ascii(bytes: &[u8]) -> bool {
    let exact = promised_triangles(bytes).is_some_and(|count| bytes.len() == PREAMBLE + count * RECORD);
    let start = bytes.trim_ascii_start();
    let start = start[..start.len().min(1024)].to_ascii_lowercase();
    let names = |word: &[u8]| start.windows(word.len()).any(|window| window == word);
    !exact && start.starts_with(b"solid") && (names(b"facet") || names(b"endsolid") || !start.contains(&0))
}

/// An ASCII file as `stl_io` wants it, line by line so that line numbers stay: lower case, one solid, plain normals.
fn clean(bytes: &[u8]) -> Vec<u8> {
    let mut cleaned = Vec::with_capacity(bytes.len() + 16);
    let mut started = false;
    let mut ended = false;
    for line in bytes.trim_ascii_start().split(|&byte| byte == b'\n') {
        let line = String::from_utf8_lossy(line).trim().to_ascii_lowercase();
        let word = line.split_whitespace().next().unwrap_or_default();
        if !word.is_empty() {
            ended = word == "endsolid";
        }
        match word {
            "solid" if !started => {
                started = true;
                cleaned.extend_from_slice(b"solid ");
            }
            "solid" | "endsolid" => {}
            "facet" => cleaned.extend_from_slice(b"facet normal 0 0 0"),
            _ => cleaned.extend_from_slice(line.as_bytes()),
        }
        cleaned.push(b'\n');
    }
    if ended {
        cleaned.extend_from_slice(b"endsolid\n");
    }
    cleaned
}

fn read_triangles(bytes: &[u8], path: &Path, ascii: bool) -> Result<Mesh, MeshFileError> {
    let mut cursor = Cursor::new(bytes);
    let mut welder = Welder::default();
    let mut count = 0;
    // Where the triangle being read is, for errors.
    let line = |count: usize| if ascii { facet_line(bytes, count) } else { None };
    let triangles = stl_io::create_stl_reader(&mut cursor).map_err(|error| explain(&error, None, path))?;
    for triangle in triangles {
        let triangle = triangle.map_err(|error| explain(&error, line(count), path))?;
        let corners = triangle.vertices.map(|vertex| DVec3::from_array(vertex.0.map(f64::from)));
        if let Some(corner) = corners.iter().position(|corner| !corner.is_finite()) {
            let vertex = format!("corner {} of triangle {}", corner + 1, count + 1);
            return Err(MeshFileError::NotFinite { path: path.into(), line: line(count), vertex });
        }
        welder.push(corners).ok_or_else(|| MeshFileError::TooLarge { path: path.into() })?;
        count += 1;
    }
    check_count(count, path)?;
    Ok(welder.finish())
}

/// The line, from 1, on which a facet begins.
fn facet_line(cleaned: &[u8], facet: usize) -> Option<usize> {
    let lines = cleaned.split(|&byte| byte == b'\n').enumerate();
    lines.filter(|(_, line)| line.starts_with(b"facet")).nth(facet).map(|(line, _)| line + 1)
}

fn explain(error: &io::Error, line: Option<usize>, path: &Path) -> MeshFileError {
    let path = path.into();
    match (error.kind(), line) {
        (io::ErrorKind::UnexpectedEof, None) => {
            let cause = "the last solid has no `endsolid`".to_owned();
            MeshFileError::Truncated { path, cause }
        }
        (io::ErrorKind::UnexpectedEof, Some(line)) => {
            let cause = format!("it ends within the facet that begins on line {line}");
            MeshFileError::Truncated { path, cause }
        }
        _ if error.to_string().contains("finite") => MeshFileError::NotFinite {
            path,
            line,
            vertex: "a corner of the facet that begins here".to_owned(),
        },
        _ => MeshFileError::Malformed { path, line, cause: format!("cannot read this facet: {error}") },
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::fmt::Write as _;

    use super::super::tests::parse_stl;
    use super::*;
    use crate::mesh::tests::unit_cube;

    pub(in crate::mesh::read) fn ascii(mesh: &Mesh) -> String {
        let mut text = "solid cube\n".to_owned();
        for t in 0..mesh.triangles.len() {
            text += "  facet normal 0 0 1\n    outer loop\n";
            for p in mesh.corners(t) {
                writeln!(text, "      vertex {:e} {} {}", p.x, p.y, p.z).unwrap();
            }
            text += "    endloop\n  endfacet\n";
        }
        text + "endsolid cube\n"
    }

    pub(in crate::mesh::read) fn binary(mesh: &Mesh) -> Vec<u8> {
        let mut bytes = vec![b' '; HEADER];
        // As some CAD systems do.
        bytes[..10].copy_from_slice(b"solid cube");
        bytes.extend((mesh.triangles.len() as u32).to_le_bytes());
        for t in 0..mesh.triangles.len() {
            bytes.extend([f32::NAN; 3].iter().flat_map(|v| v.to_le_bytes()));
            bytes.extend(
                mesh.corners(t).iter().flat_map(|p| p.as_vec3().to_array()).flat_map(f32::to_le_bytes),
            );
            bytes.extend([0, 0]);
        }
        bytes
    }

    #[test]
    fn both_kinds_give_the_same_welded_mesh() {
        let cube = unit_cube().welded();
        assert_eq!(parse_stl(&binary(&cube)).unwrap(), cube);
        assert_eq!(parse_stl(ascii(&cube).as_bytes()).unwrap(), cube);
    }

    #[test]
    fn unusual_files_are_understood() {
        let cube = unit_cube().welded();
        let text = ascii(&cube);
        for changed in [
            text.to_uppercase(),
            text.replace('\n', "\r\n"),
            text.replace("solid cube", "solid"),
            text.replace("normal 0 0 1", "normal -nan(ind) nan nan"),
            format!("\n{text}\n\n"),
        ] {
            assert_eq!(parse_stl(changed.as_bytes()).unwrap(), cube, "{changed}");
        }
        // Two solids in one file.
        assert_eq!(parse_stl(format!("{text}{text}").as_bytes()).unwrap().triangles.len(), 24);
        // Bytes after the last triangle.
        let mut bytes = binary(&cube);
        bytes.extend(b"appendix");
        bytes[..5].fill(b' ');
        assert_eq!(parse_stl(&bytes).unwrap(), cube);
    }

    #[test]
    fn errors_name_place_and_cause() {
        let cube = unit_cube();
        let text = ascii(&cube);
        for (changed, expected) in [
            (text.replacen("vertex 0e0 0 0", "vertex 0e0 0 null", 1), "line 2: cannot read this facet"),
            (
                text.replacen("vertex 0e0 0 0", "vertex 0e0 0 nan", 1),
                "line 2: a corner of the facet that begins here",
            ),
            (text.replacen("endsolid cube", "", 1), "cut short: the last solid has no `endsolid`"),
            (
                text[..text.rfind("    endloop").unwrap()].to_owned(),
                "cut short: it ends within the facet that begins on line 79",
            ),
            ("solid a\nendsolid a\n".to_owned(), "holds no faces"),
            ("something else".to_owned(), "neither a binary nor an ASCII STL"),
        ] {
            let error = parse_stl(changed.as_bytes()).unwrap_err().to_string();
            assert!(error.contains("part.stl") && error.contains(expected), "{error}");
        }
        let bytes = binary(&cube);
        let error = parse_stl(&bytes[..bytes.len() - 1]).unwrap_err().to_string();
        assert!(error.contains("11 of the 12 triangles"), "{error}");
        let mut bytes = bytes;
        bytes[PREAMBLE + RECORD + 24..][..4].copy_from_slice(&f32::INFINITY.to_le_bytes());
        let error = parse_stl(&bytes).unwrap_err().to_string();
        assert!(error.contains("corner 2 of triangle 2"), "{error}");
    }
}
