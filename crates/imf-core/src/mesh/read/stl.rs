//! STL, binary and ASCII.
//!
//! Which of the two a file is follows from its length and content, since binary files may begin with `solid` as well.
//! Normals are ignored (some exporters write NaN for them); several solids in one ASCII file are merged. Both hold f32.

use glam::DVec3;

use super::{Fault, MeshFile, not_finite};
use crate::mesh::weld::Welder;

/// Bytes of a binary file before its triangles: free text, then their number.
const HEADER: usize = 80;
const PREAMBLE: usize = HEADER + 4;
/// Bytes of one triangle: normal and three corners in f32, and two of no meaning.
const RECORD: usize = 50;

pub(super) fn parse(bytes: &[u8]) -> Result<MeshFile, Fault> {
    // Some programs begin a text with a mark of its encoding.
    let text = bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes);
    if is_ascii(text) {
        return parse_ascii(text);
    }
    let Some(count) = announced_triangles(bytes) else {
        return Err(Fault::malformed("this is neither a binary nor an ASCII STL file"));
    };
    // Four letters, read as a count, announce more triangles than any file has.
    if bytes[..PREAMBLE].iter().all(|&byte| byte.is_ascii_graphic() || byte.is_ascii_whitespace()) {
        return Err(Fault::malformed("this is text, not an STL file: give it the ending of its own format"));
    }
    let records = bytes[PREAMBLE..].chunks_exact(RECORD);
    if records.len() < count {
        let cause = format!("it holds {} of the {count} triangles that it announces", records.len());
        return Err(Fault::truncated(cause));
    }
    // Other bytes behind them some programs write.
    if records.len() > count && records.remainder().is_empty() {
        let cause = format!("it announces {count} triangles and holds {}", records.len());
        return Err(Fault::malformed(cause));
    }
    let mut welder = Welder::default();
    for (number, record) in records.take(count).enumerate() {
        // The normal comes first.
        let values: Vec<f64> = record[12..48]
            .chunks_exact(4)
            .map(|value| f32::from_le_bytes([value[0], value[1], value[2], value[3]]).into())
            .collect();
        let corners = [0, 3, 6].map(|at| DVec3::from_slice(&values[at..]));
        if let Some(corner) = corners.iter().position(|corner| !corner.is_finite()) {
            return Err(not_finite(&format!("corner {} of triangle {}", corner + 1, number + 1)));
        }
        welder.push(corners)?;
    }
    Ok(MeshFile { mesh: welder.finish(), unit: None })
}

/// The number of triangles that a binary file announces; `None` if it is too short for one.
fn announced_triangles(bytes: &[u8]) -> Option<usize> {
    let count = bytes.get(HEADER..PREAMBLE)?;
    Some(u32::from_le_bytes(count.try_into().ok()?) as usize)
}

fn is_ascii(bytes: &[u8]) -> bool {
    let exact = announced_triangles(bytes).is_some_and(|count| bytes.len() == PREAMBLE + count * RECORD);
    let start = bytes.trim_ascii_start();
    let start = start[..start.len().min(1024)].to_ascii_lowercase();
    let names = |word: &[u8]| start.windows(word.len()).any(|window| window == word);
    !exact && start.starts_with(b"solid") && (names(b"endsolid") || !start.contains(&0))
}

fn parse_ascii(bytes: &[u8]) -> Result<MeshFile, Fault> {
    let mut welder = Welder::default();
    // The line of the facet that is being read, and its corners up to here.
    let mut facet: Option<(usize, Vec<DVec3>)> = None;
    let mut ended = false;
    for (number, line) in bytes.split(|&byte| byte == b'\n').enumerate() {
        let line = String::from_utf8_lossy(line).to_ascii_lowercase();
        let mut words = line.split_whitespace();
        let Some(word) = words.next() else { continue };
        ended = word == "endsolid";
        match (word, &mut facet) {
            ("solid" | "endsolid", None) | ("outer" | "endloop", Some(_)) => {}
            ("facet", None) => facet = Some((number + 1, Vec::new())),
            ("vertex", Some((begin, corners))) => {
                let values: Option<Vec<f32>> = words.map(|word| word.parse().ok()).collect();
                let Some(&[x, y, z]) = values.as_deref() else { return Err(unreadable(*begin)) };
                corners.push(DVec3::new(x.into(), y.into(), z.into()));
            }
            ("endfacet", Some((begin, corners))) => {
                let corners: [DVec3; 3] = corners[..].try_into().map_err(|_| unreadable(*begin))?;
                if !corners.iter().all(|corner| corner.is_finite()) {
                    return Err(not_finite("a corner of the facet that begins here").on_line(*begin));
                }
                welder.push(corners)?;
                facet = None;
            }
            (_, found) => return Err(unreadable(found.as_ref().map_or(number + 1, |(begin, _)| *begin))),
        }
    }
    match facet {
        Some((begin, _)) => {
            Err(Fault::truncated(format!("it ends within the facet that begins on line {begin}")))
        }
        None if !ended => Err(Fault::truncated("the last solid has no `endsolid`")),
        None => Ok(MeshFile { mesh: welder.finish(), unit: None }),
    }
}

fn unreadable(line: usize) -> Fault {
    Fault::malformed("cannot read this facet").on_line(line)
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;

    use super::super::tests::mesh_of;
    use super::*;
    use crate::mesh::Mesh;
    use crate::mesh::tests::unit_cube;

    fn parse_stl(bytes: &[u8]) -> Result<Mesh, String> {
        mesh_of(bytes, parse)
    }

    fn ascii(mesh: &Mesh) -> String {
        let mut text = "solid cube\n".to_owned();
        for corners in mesh.all_corners() {
            text += "  facet normal 0 0 1\n    outer loop\n";
            for p in corners {
                writeln!(text, "      vertex {:e} {} {}", p.x, p.y, p.z).unwrap();
            }
            text += "    endloop\n  endfacet\n";
        }
        text + "endsolid cube\n"
    }

    fn binary(mesh: &Mesh) -> Vec<u8> {
        let mut bytes = vec![b' '; HEADER];
        // As some CAD systems do.
        bytes[..10].copy_from_slice(b"solid cube");
        bytes.extend((mesh.triangles.len() as u32).to_le_bytes());
        for corners in mesh.all_corners() {
            bytes.extend([f32::NAN; 3].iter().flat_map(|v| v.to_le_bytes()));
            bytes.extend(corners.iter().flat_map(|p| p.as_vec3().to_array()).flat_map(f32::to_le_bytes));
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
        assert_eq!(parse_stl(&bytes).unwrap(), cube);
        bytes[..16].copy_from_slice(b"solid with facet");
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
            let error = parse_stl(changed.as_bytes()).unwrap_err();
            assert!(error.contains("part") && error.contains(expected), "{error}");
        }
        let bytes = binary(&cube);
        let error = parse_stl(&bytes[..bytes.len() - 1]).unwrap_err();
        assert!(error.contains("11 of the 12 triangles"), "{error}");
        let mut bytes = bytes;
        bytes[PREAMBLE + RECORD + 24..][..4].copy_from_slice(&f32::INFINITY.to_le_bytes());
        let error = parse_stl(&bytes).unwrap_err();
        assert!(error.contains("corner 2 of triangle 2"), "{error}");
    }

    #[test]
    fn text_of_another_format_is_told_from_a_binary_file_that_was_cut_short() {
        let text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n".repeat(4);
        assert!(parse_stl(text.as_bytes()).unwrap_err().contains("this is text"));
        let binary = binary(&unit_cube());
        assert!(parse_stl(&binary[..200]).unwrap_err().contains("cut short"));
        // With the mark of a text.
        let marked = [b"\xef\xbb\xbf", ascii(&unit_cube()).as_bytes()].concat();
        assert_eq!(parse_stl(&marked).unwrap().triangles.len(), 12);
        // Fewer announced than there are.
        let mut few = binary.clone();
        few[HEADER] -= 3;
        assert!(parse_stl(&few).unwrap_err().contains("it announces 9 triangles and holds 12"));
    }
}
