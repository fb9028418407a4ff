//! Wavefront OBJ: its vertices `v x y z [w]` and faces `f a b c …`.
//!
//! Continued lines are joined. Comments, colours, normals, texture coordinates, groups and materials are skipped,
//! also where they are broken, and so are faces of one corner or two.

use std::iter;

use glam::DVec3;

use super::{Fault, MeshFile, no_vertex, not_finite, refuse_cut};
use crate::mesh::topology::boundary_chain;
use crate::mesh::weld::Welder;

/// A face as it stands in the file, which may name vertices that follow it.
struct Face {
    line: usize,
    /// Vertices before it, from whose end negative numbers count.
    before: usize,
    /// Where its corners begin among those of all faces.
    first: usize,
}

pub(super) fn parse(bytes: &[u8]) -> Result<MeshFile, Fault> {
    let mut vertices: Vec<DVec3> = Vec::new();
    let (mut faces, mut indices) = (Vec::new(), Vec::new());
    for (line, text) in lines(bytes) {
        let mut words = text.split_whitespace();
        match words.next() {
            Some("v") => vertices.push(vertex(words).map_err(|cause| Fault::malformed(cause).on_line(line))?),
            Some("f") => {
                faces.push(Face { line, before: vertices.len(), first: indices.len() });
                for word in words {
                    let number = word.split('/').next().unwrap_or_default().parse::<i64>();
                    let cause = "a face is not a list of vertex numbers";
                    indices.push(number.map_err(|_| Fault::malformed(cause).on_line(line))?);
                }
                if faces.last().is_some_and(|face| face.first == indices.len()) {
                    return Err(Fault::malformed("a face has no vertices").on_line(line));
                }
            }
            _ => {}
        }
    }
    let mut welder = Welder::default();
    let mut corners = Vec::new();
    let ends = faces.iter().skip(1).map(|next| next.first).chain([indices.len()]);
    for (face, end) in faces.iter().zip(ends) {
        corners.clear();
        for &index in &indices[face.first..end] {
            let from_zero = if index < 0 { face.before as i64 + index } else { index - 1 };
            let found = usize::try_from(from_zero).ok().filter(|&at| at < vertices.len());
            let at = found.ok_or_else(|| no_vertex(index, vertices.len()).on_line(face.line))?;
            corners.push(vertices[at]);
            if end - face.first > 2 && !vertices[at].is_finite() {
                let line =
                    lines(bytes).filter(|(_, text)| text.split_whitespace().next() == Some("v")).nth(at);
                let fault = not_finite(&format!("vertex {}", at + 1));
                return Err(fault.on_line(line.map_or(face.line, |(line, _)| line)));
            }
        }
        welder.push_polygon(&corners)?;
    }
    let mesh = welder.finish();
    let is_open = || !boundary_chain(&mesh).is_empty();
    refuse_cut(bytes, |tail| tail.starts_with(b"v ") || tail.starts_with(b"f ") && is_open())?;
    Ok(MeshFile { mesh, unit: None })
}

/// Four numbers are a point and its weight, which says something of rational curves alone; more are a point and its colour.
fn vertex<'a>(words: impl Iterator<Item = &'a str>) -> Result<DVec3, &'static str> {
    let words: Vec<&str> = words.collect();
    let used = if words.len() == 4 { 4 } else { words.len().min(3) };
    let numbers: Option<Vec<f64>> = words[..used].iter().map(|word| word.parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[x, y, z]) => Ok(DVec3::new(x, y, z)),
        Some(&[x, y, z, 1.0]) => Ok(DVec3::new(x, y, z)),
        Some(&[..]) if used == 4 => Err("a vertex has a weight other than 1, which meshes do not have"),
        _ => Err("a vertex is not three numbers"),
    }
}

/// Every line with its number, from 1: without comment, with the lines that continue it. What is not UTF-8 (in names) is replaced.
fn lines(bytes: &[u8]) -> impl Iterator<Item = (usize, String)> {
    // Some editors begin a file with a byte order mark.
    let bytes = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    let mut rest = bytes.split(|&byte| byte == b'\n').enumerate();
    iter::from_fn(move || {
        let (number, mut line) = rest.next()?;
        let mut joined = String::new();
        loop {
            let text = String::from_utf8_lossy(line);
            let text = text.split('#').next().unwrap_or_default().trim_end();
            // A name may end in one, as folders do.
            let goes_on = !joined.is_empty() || text.trim_start().starts_with(['v', 'f']);
            let (text, next) = match text.strip_suffix('\\').filter(|_| goes_on) {
                Some(part) => (part, rest.next()),
                None => (text, None),
            };
            joined.push_str(text);
            match next {
                Some((_, next)) => line = next,
                None => return Some((number + 1, joined)),
            }
            joined.push(' ');
        }
    })
}

#[cfg(test)]
mod tests {
    use super::super::tests::mesh_of;
    use super::*;
    use crate::mesh::Mesh;

    fn parse_obj(text: impl AsRef<[u8]>) -> Result<Mesh, String> {
        mesh_of(text, parse)
    }

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
        // A folder's name joins no lines.
        let mut bytes =
            b"# na\xefve name\nmtllib C:\\parts\\\nv 0 0 0 # first\nv 2 \\\n 0 0\nv 0 2 0 1\nf 1//9 \\\n2//9 3/7\n"
                .to_vec();
        let mesh = parse_obj(&bytes).unwrap();
        assert_eq!(mesh.vertices, [DVec3::ZERO, DVec3::new(2.0, 0.0, 0.0), DVec3::new(0.0, 2.0, 0.0)]);
        bytes.extend(b"# last words");
        assert_eq!(parse_obj(&bytes).unwrap(), mesh);
        let marked = "\u{feff}v 0 0 0\nv 2 0 0\nv 0 2 0\nf 1 2 3\n";
        assert_eq!(parse_obj(marked).unwrap(), mesh);
        for bytes in crate::file_error::tests::as_utf16(&marked[3..]) {
            assert_eq!(parse_obj(bytes).unwrap(), mesh);
        }
    }

    #[test]
    fn a_file_that_was_cut_in_a_number_is_not_taken_for_a_whole_one() {
        let vertices = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n".to_owned() + &"v 5 0 0\n".repeat(8);
        let tetrahedron = vertices + "f 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4";
        // Nothing is missing, but for the end of the last line.
        assert_eq!(parse_obj(&tetrahedron).unwrap().triangles.len(), 4);
        // Of "f 3 1 12" the last digit is lost.
        let cut = tetrahedron.replace("f 3 1 4", "f 3 1 1");
        let text = parse_obj(&cut).unwrap_err();
        assert!(text.contains("part, line 16: the file ends in the middle of a line"), "{text}");
        assert!(parse_obj(&(cut + "\n")).is_ok(), "an open mesh, and the file has an end");
        let text = parse_obj("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nv 0 0 1.").unwrap_err();
        assert!(text.contains("line 5: the file ends"), "{text}");
    }

    #[test]
    fn errors_name_line_and_cause() {
        let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\n";
        for (tail, expected) in [
            ("v 1 zwei 3\nf 1 2 3\n", "part, line 4: a vertex is not three numbers"),
            ("v 1 2\nf 1 2 3\n", "line 4: a vertex is not three numbers"),
            ("v 1 2 3 0\nf 1 2 3\n", "line 4: a vertex has a weight other than 1"),
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
            let text = parse_obj(format!("{square}{tail}")).unwrap_err();
            assert!(text.contains(expected), "{text}");
        }
    }
}
