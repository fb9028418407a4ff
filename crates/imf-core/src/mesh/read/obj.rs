//! Wavefront OBJ: the vertex and face lines go through `tobj`, cleaned of everything that the geometry does not need.
//!
//! Cleaning line by line makes real files readable where `tobj` alone gives up (continued lines, names that are not
//! UTF-8, unusual vertex colours, broken texture indices, missing materials) and tells the line where it does.

use std::io::{self, BufRead, Read};
use std::path::Path;

use glam::DVec3;
use tobj::{LoadError, LoadOptions};

use super::{MeshFileError, check_count};
use crate::mesh::Mesh;
use crate::mesh::weld::Welder;

pub(super) fn parse(bytes: &[u8], path: &Path) -> Result<Mesh, MeshFileError> {
    let options =
        LoadOptions { triangulate: true, ignore_points: true, ignore_lines: true, ..LoadOptions::default() };
    let mut lines = GeometryLines::new(bytes);
    let loaded = tobj::load_obj_buf(&mut lines, &options, |_| Ok(Default::default()));
    let (models, _) = loaded.map_err(|error| explain(error, lines.line, bytes, path))?;

    check_count(models.iter().map(|model| model.mesh.indices.len() / 3).sum(), path)?;
    let mut welder = Welder::default();
    for model in &models {
        let position = |index: u32| {
            let at = 3 * index as usize;
            model.mesh.positions.get(at..at + 3).map(DVec3::from_slice)
        };
        for triangle in model.mesh.indices.chunks_exact(3) {
            let (Some(a), Some(b), Some(c)) =
                (position(triangle[0]), position(triangle[1]), position(triangle[2]))
            else {
                return Err(MeshFileError::TooLarge { path: path.into() });
            };
            if ![a, b, c].iter().all(|corner| corner.is_finite()) {
                return Err(locate_not_finite(bytes, path));
            }
            welder.push([a, b, c]).ok_or_else(|| MeshFileError::TooLarge { path: path.into() })?;
        }
    }
    Ok(welder.finish())
}

/// The lines of an OBJ file that make its geometry, one at a time: `v x y z [w]` and `f a b c ...`, without comments,
/// colours, normals and texture coordinates, continued lines joined.
struct GeometryLines<'a> {
    rest: &'a [u8],
    /// Number of the current line in the file, from 1.
    line: usize,
    /// Number of the line after it.
    next_line: usize,
    cleaned: Vec<u8>,
    consumed: usize,
}

impl<'a> GeometryLines<'a> {
    fn new(bytes: &'a [u8]) -> Self {
        // Some editors begin a file with a byte order mark.
        let rest = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
        Self { rest, line: 0, next_line: 1, cleaned: Vec::new(), consumed: 0 }
    }

    /// Moves to the next line of geometry; false at the end of the file.
    fn advance(&mut self) -> bool {
        self.consumed = 0;
        while !self.rest.is_empty() {
            self.line = self.next_line;
            let text = self.join_line();
            self.cleaned.clear();
            let mut words = text.split_whitespace();
            match words.next() {
                Some("v") => {
                    // Four numbers are a weighted point; more are colours.
                    let words: Vec<_> = words.collect();
                    let kept = if words.len() == 4 { 4 } else { words.len().min(3) };
                    self.write_line("v", words[..kept].iter().copied());
                }
                Some("f") => {
                    self.write_line("f", words.map(|word| word.split_once('/').map_or(word, |(v, _)| v)));
                }
                _ => continue,
            }
            return true;
        }
        self.cleaned.clear();
        false
    }

    /// One line of the file, with the lines that continue it, without comment.
    fn join_line(&mut self) -> String {
        let mut joined = String::new();
        loop {
            let end = self.rest.iter().position(|&byte| byte == b'\n').unwrap_or(self.rest.len());
            let line = String::from_utf8_lossy(&self.rest[..end]);
            self.rest = self.rest.get(end + 1..).unwrap_or_default();
            self.next_line += 1;
            let line = line.split_once('#').map_or(&*line, |(before, _)| before).trim_end();
            match line.strip_suffix('\\') {
                Some(part) if !self.rest.is_empty() => {
                    joined.push_str(part);
                    joined.push(' ');
                }
                _ => {
                    joined.push_str(line);
                    return joined;
                }
            }
        }
    }

    fn write_line<'w>(&mut self, keyword: &str, words: impl Iterator<Item = &'w str>) {
        self.cleaned.extend_from_slice(keyword.as_bytes());
        for word in words {
            self.cleaned.push(b' ');
            self.cleaned.extend_from_slice(word.as_bytes());
        }
        self.cleaned.push(b'\n');
    }
}

impl BufRead for GeometryLines<'_> {
    fn fill_buf(&mut self) -> io::Result<&[u8]> {
        if self.consumed == self.cleaned.len() {
            self.advance();
        }
        Ok(&self.cleaned[self.consumed..])
    }

    fn consume(&mut self, amount: usize) {
        self.consumed = (self.consumed + amount).min(self.cleaned.len());
    }
}

impl Read for GeometryLines<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let count = self.fill_buf()?.read(buffer)?;
        self.consume(count);
        Ok(count)
    }
}

fn explain(error: LoadError, line: usize, bytes: &[u8], path: &Path) -> MeshFileError {
    let malformed = |cause: &str| MeshFileError::Malformed {
        path: path.into(),
        line: Some(line),
        cause: cause.to_owned(),
    };
    match error {
        LoadError::PositionParseError => malformed("a vertex is not three numbers"),
        LoadError::ScalingByZeroError => malformed("a vertex has weight zero"),
        LoadError::FaceParseError => malformed("a face is not a list of vertex numbers"),
        LoadError::FaceVertexOutOfBounds | LoadError::InvalidPolygon => locate_bad_face(bytes, path),
        other => malformed(&other.to_string()),
    }
}

/// Finds the face that names a vertex which the file does not have. Faces are only resolved at the end, so `tobj`
/// cannot tell its line.
fn locate_bad_face(bytes: &[u8], path: &Path) -> MeshFileError {
    let vertices = count_vertices(bytes);
    let mut so_far = 0;
    let mut lines = GeometryLines::new(bytes);
    while lines.advance() {
        let line = Some(lines.line);
        let text = String::from_utf8_lossy(&lines.cleaned);
        let mut words = text.split_whitespace();
        if words.next() == Some("v") {
            so_far += 1;
            continue;
        }
        let mut corners = 0;
        for word in words {
            corners += 1;
            let index: i64 = word.parse().unwrap_or(0);
            let exists = if index < 0 { index >= -so_far } else { (1..=vertices).contains(&index) };
            if !exists {
                return MeshFileError::VertexIndex {
                    path: path.into(),
                    line,
                    index,
                    vertices: vertices as usize,
                };
            }
        }
        if corners == 0 {
            let cause = "a face has no vertices".to_owned();
            return MeshFileError::Malformed { path: path.into(), line, cause };
        }
    }
    let cause = "a face uses a vertex that the file does not have".to_owned();
    MeshFileError::Malformed { path: path.into(), line: None, cause }
}

fn count_vertices(bytes: &[u8]) -> i64 {
    let mut lines = GeometryLines::new(bytes);
    let mut count = 0;
    while lines.advance() {
        count += i64::from(lines.cleaned.starts_with(b"v"));
    }
    count
}

/// Finds the first vertex with a coordinate that is not finite, for the error's sake.
fn locate_not_finite(bytes: &[u8], path: &Path) -> MeshFileError {
    let mut number = 0;
    let mut lines = GeometryLines::new(bytes);
    while lines.advance() {
        let text = String::from_utf8_lossy(&lines.cleaned);
        let mut words = text.split_whitespace();
        if words.next() == Some("v") {
            number += 1;
            let mut values: Vec<f64> = words.filter_map(|word| word.parse().ok()).collect();
            let weight = if values.len() == 4 { values.pop().unwrap_or(1.0) } else { 1.0 };
            if !values.iter().all(|value| (value / weight).is_finite()) {
                let vertex = format!("vertex {number}");
                return MeshFileError::NotFinite { path: path.into(), line: Some(lines.line), vertex };
            }
        }
    }
    MeshFileError::NotFinite { path: path.into(), line: None, vertex: "a vertex".to_owned() }
}

#[cfg(test)]
mod tests {
    use super::super::tests::parse_obj;
    use super::*;

    #[test]
    fn polygons_become_fans_and_groups_one_mesh() {
        let text = "mtllib missing.mtl\r\no first\r\nusemtl steel\r\nv 0 0 0\r\nv 1 0 0\r\nv 1 1 0\r\nv 0 1 0\r\n\
                    vn 0 0 1\r\nvt 0 0\r\nf 1/1/1 2/1/1 3/1/1 4/1/1\r\ng second\r\nv 0.1 0 1 0.2 0.3 0.4\r\n\
                    f -1 1 2\r\nl 1 2\r\np 1\r\nf 1 2\r\nv 5 5 5\r\n";
        let mesh = parse_obj(text).unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3], [4, 0, 1]]);
        // Twice the precision of f32, and the vertex that no face uses is gone.
        assert_eq!(mesh.vertices[4], DVec3::new(0.1, 0.0, 1.0));
        assert_eq!(mesh.vertices.len(), 5);
    }

    #[test]
    fn coinciding_vertices_are_shared_across_groups() {
        let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\ng b\nv -0 0 0\nv 0 1 0\nv -1 0 0\nf 4 5 6\n";
        let mesh = parse_obj(text).unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
    }

    #[test]
    fn unusual_lines_are_understood() {
        let mut bytes =
            b"# na\xefve name\no caf\xe9\nv 0 0 0 # first\nv 2 \\\n 0 0\nv 0 4 0 2\nf 1//9 \\\n2//9 3/7\n"
                .to_vec();
        let mesh = parse(&bytes, Path::new("part.obj")).unwrap();
        assert_eq!(mesh.vertices, [DVec3::ZERO, DVec3::new(2.0, 0.0, 0.0), DVec3::new(0.0, 2.0, 0.0)]);
        bytes.truncate(bytes.len() - 1);
        assert_eq!(parse(&bytes, Path::new("part.obj")).unwrap(), mesh);
        let marked = "\u{feff}v 0 0 0\nv 2 0 0\nv 0 2 0\nf 1 2 3\n";
        assert_eq!(parse_obj(marked).unwrap(), mesh);
    }

    #[test]
    fn errors_name_line_and_cause() {
        let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\n";
        for (tail, expected) in [
            ("v 1 zwei 3\nf 1 2 3\n", "part.obj, line 4: a vertex is not three numbers"),
            ("v 1 2\nf 1 2 3\n", "line 4: a vertex is not three numbers"),
            ("v 1 2 3 0\nf 1 2 3\n", "line 4: a vertex has weight zero"),
            ("\n# x\nf 1 b 3\n", "line 6: a face is not a list"),
            ("f 1 2 3\nf 1 2 4\n", "line 5: a face uses vertex 4, but the file has 3"),
            ("f 1 2 0\n", "line 4: a face uses vertex 0, but"),
            ("f 1 2 -4\n", "line 4: a face uses vertex -4, but"),
            ("f\n", "line 4: a face has no vertices"),
            ("v nan 0 0\nf 1 2 4\n", "line 4: vertex 4 has a coordinate that is NaN or infinite"),
            ("v 0 1e999 0\nf 1 2 4\n", "line 4: vertex 4 has"),
            ("", "holds no faces"),
            ("f 1 2\n", "holds no faces"),
        ] {
            let text = parse_obj(&format!("{square}{tail}")).unwrap_err().to_string();
            assert!(text.contains(expected), "{text}");
        }
    }
}
