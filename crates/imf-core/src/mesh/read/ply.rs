//! PLY, ASCII and binary, through `ply-rs-bw`.
//!
//! What is read is the element `vertex` with its `x`, `y`, `z` and the element `face` with its list of vertices; polygons
//! become triangle fans, and everything else that a file may hold (normals, colours, qualities, edges) is skipped.

use std::borrow::Cow;
use std::io::{Cursor, ErrorKind};

use glam::DVec3;
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{
    ElementDef, Encoding, Property, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType,
};

use super::{Fault, MeshFile, no_vertex, not_finite, refuse_cut};
use crate::mesh::topology::boundary_chain;
use crate::mesh::weld::Welder;

/// A vertex or a face, whichever properties it has; unset coordinates are not numbers.
struct Item {
    position: DVec3,
    corners: Vec<i64>,
}

impl PropertyAccess for Item {
    fn new() -> Self {
        Self { position: DVec3::NAN, corners: Vec::new() }
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let set = match name {
            "x" => scalar(&property).map(|value| self.position.x = value),
            "y" => scalar(&property).map(|value| self.position.y = value),
            "z" => scalar(&property).map(|value| self.position.z = value),
            // Both names are in use.
            "vertex_indices" | "vertex_index" => indices(property).map(|corners| self.corners = corners),
            _ => return PropertyAccessResult::Ignored,
        };
        set.map_or(PropertyAccessResult::Ignored, |()| PropertyAccessResult::Set)
    }
}

fn scalar(property: &Property) -> Option<f64> {
    Some(match *property {
        Property::Char(value) => value.into(),
        Property::UChar(value) => value.into(),
        Property::Short(value) => value.into(),
        Property::UShort(value) => value.into(),
        Property::Int(value) => value.into(),
        Property::UInt(value) => value.into(),
        Property::Float(value) => value.into(),
        Property::Double(value) => value,
        _ => return None,
    })
}

fn indices(property: Property) -> Option<Vec<i64>> {
    fn widened<T: Into<i64>>(list: Vec<T>) -> Option<Vec<i64>> {
        Some(list.into_iter().map(Into::into).collect())
    }
    match property {
        Property::ListChar(list) => widened(list),
        Property::ListUChar(list) => widened(list),
        Property::ListShort(list) => widened(list),
        Property::ListUShort(list) => widened(list),
        Property::ListInt(list) => widened(list),
        Property::ListUInt(list) => widened(list),
        _ => None,
    }
}

pub(super) fn parse(bytes: &[u8]) -> Result<MeshFile, Fault> {
    let bytes = &*tidied(bytes);
    let parser = Parser::<Item>::new();
    let mut reader = Reader::new(Cursor::new(bytes));
    let header = parser.read_header(&mut reader).map_err(|error| explain(&error))?;
    for element in header.elements.values() {
        check_count(element, header.encoding, bytes.len())?;
    }
    let mut payload = parser.read_payload(&mut reader, &header).map_err(|error| explain(&error))?;
    // More than the header guarantees: the header counts wrongly, or two files have become one.
    let read = usize::try_from(reader.into_inner().position()).unwrap_or(bytes.len());
    let beyond = bytes.get(read..).unwrap_or_default();
    if !beyond.iter().all(u8::is_ascii_whitespace) {
        let cause = format!("{} bytes follow the elements that its header names", beyond.len());
        return Err(Fault::malformed(cause));
    }
    let vertices = payload.swap_remove("vertex");
    let vertices = vertices.ok_or_else(|| Fault::malformed("it has no element `vertex`"))?;
    for name in ["x", "y", "z"] {
        if header.elements.get("vertex").is_some_and(|vertex| !vertex.properties.contains_key(name)) {
            return Err(Fault::malformed(format!("its vertices have no property `{name}`")));
        }
    }
    let faces = payload.swap_remove("face").unwrap_or_default();
    if !faces.is_empty() && faces.iter().all(|face| face.corners.is_empty()) {
        return Err(Fault::malformed("its faces have no list `vertex_indices` or `vertex_index`"));
    }
    let corner = |&index: &i64| {
        let found = usize::try_from(index).ok().and_then(|at| vertices.get(at));
        let position = found.ok_or_else(|| no_vertex(index, vertices.len()))?.position;
        let vertex = || format!("vertex {index} (counted from 0)");
        if position.is_finite() { Ok(position) } else { Err(not_finite(&vertex())) }
    };
    let mut welder = Welder::default();
    for face in &faces {
        welder.push_polygon(&face.corners.iter().map(corner).collect::<Result<Vec<_>, _>>()?)?;
    }
    let mesh = welder.finish();
    if header.encoding == Encoding::Ascii {
        refuse_cut(bytes, |_| !boundary_chain(&mesh).is_empty())?;
    }
    Ok(MeshFile { mesh, unit: None })
}

/// What the crate's grammar does not know, as it does: comments that are not UTF-8, and in text numbers such as `40.`, `.5` and `nan`,
/// which programs write beside the coordinates.
fn tidied(bytes: &[u8]) -> Cow<'_, [u8]> {
    const END: &[u8] = b"end_header";
    let Some(end) = bytes.windows(END.len()).position(|window| window == END) else { return bytes.into() };
    let (header, body) = bytes.split_at(end + END.len());
    let is_text = header.windows(12).any(|window| window == b"format ascii");
    let is_word = |byte: &u8| !byte.is_ascii_whitespace();
    let words = || body.chunk_by(|a, b| is_word(a) == is_word(b));
    let is_tidy = !is_text || words().all(|word| !is_word(&word[0]) || is_plain_number(word));
    if is_tidy && std::str::from_utf8(header).is_ok() {
        return bytes.into();
    }
    let mut tidied = String::from_utf8_lossy(header).into_owned().into_bytes();
    if is_tidy {
        tidied.extend(body);
        return tidied.into();
    }
    for word in words() {
        let number = std::str::from_utf8(word).ok().filter(|_| !is_plain_number(word));
        match number.and_then(|word| word.parse::<f64>().ok()) {
            Some(number) if number.is_finite() => tidied.extend(number.to_string().bytes()),
            // Infinite, as its grammar has it.
            Some(_) => tidied.extend(b"1e999"),
            None => tidied.extend(word),
        }
    }
    tidied.into()
}

/// Digits, with others behind a point and an exponent if it has them.
fn is_plain_number(word: &[u8]) -> bool {
    let are_digits = |text: &[u8]| !text.is_empty() && text.iter().all(u8::is_ascii_digit);
    let mut halves = word.splitn(2, |byte| b"eE".contains(byte)).map(unsigned);
    let mut mantissa = halves.next().unwrap_or_default().splitn(2, |&byte| byte == b'.');
    mantissa.all(are_digits) && halves.next().is_none_or(are_digits)
}

fn unsigned(number: &[u8]) -> &[u8] {
    number.strip_prefix(b"-").or(number.strip_prefix(b"+")).unwrap_or(number)
}

/// Refuses an element count that a file of `room` bytes cannot hold: the parser allocates for it, and would count
/// forever elements that take no bytes.
fn check_count(element: &ElementDef, encoding: Encoding, room: usize) -> Result<(), Fault> {
    let ElementDef { name, count, properties } = element;
    let width = |scalar: &ScalarType| match scalar {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    };
    let least = |property: &PropertyType| match property {
        // A digit and what follows it; a list may be empty, and its length stands there.
        _ if encoding == Encoding::Ascii => 2,
        PropertyType::Scalar(scalar) | PropertyType::List(scalar, _) => width(scalar),
    };
    let bytes: usize = properties.values().map(|property| least(&property.data_type)).sum();
    if *count > 0 && bytes == 0 {
        return Err(Fault::malformed(format!("its element `{name}` has no property")));
    }
    // The last line needs no end.
    if count.saturating_mul(bytes) > room + 1 {
        let cause = format!(
            "its header says that {count} of the element `{name}` follow, and it has {room} bytes in all"
        );
        return Err(Fault::truncated(cause));
    }
    Ok(())
}

fn explain(error: &ParseError) -> Fault {
    // Of its several lines the first names the cause.
    let cause = error.to_string().lines().next().unwrap_or_default().to_owned();
    if error.kind() == ErrorKind::UnexpectedEof {
        return Fault::truncated(cause);
    }
    let prefix = error.line().map(|line| format!("Line {line}: ")).unwrap_or_default();
    Fault { line: error.line(), ..Fault::malformed(cause.strip_prefix(&prefix).unwrap_or(&cause)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::file_error::FaultKind;
    use crate::mesh::Mesh;
    use crate::mesh::tests::unit_cube;

    fn mesh_of(bytes: impl AsRef<[u8]>) -> Result<Mesh, Fault> {
        parse(bytes.as_ref()).map(|file| file.mesh)
    }

    /// The mesh with a colour at each vertex and a quality at each face.
    fn ascii(mesh: &Mesh) -> String {
        let mut text = format!(
            "ply\nformat ascii 1.0\ncomment by hand\nelement vertex {}\nproperty float x\nproperty double y\n\
             property float z\nproperty uchar red\nelement face {}\nproperty list uchar int vertex_indices\n\
             property float quality\nend_header\n",
            mesh.vertices.len(),
            mesh.triangles.len()
        );
        for v in &mesh.vertices {
            text += &format!("{} {} {} 200\n", v.x, v.y, v.z);
        }
        for t in &mesh.triangles {
            text += &format!("3 {} {} {} 0.5\n", t[0], t[1], t[2]);
        }
        text
    }

    /// The mesh in little or big endian.
    fn binary(mesh: &Mesh, little: bool) -> Vec<u8> {
        let order = if little { "little" } else { "big" };
        let mut bytes = format!(
            "ply\nformat binary_{order}_endian 1.0\nelement vertex {}\nproperty double x\nproperty double y\n\
             property double z\nelement face {}\nproperty list uchar uint vertex_index\nend_header\n",
            mesh.vertices.len(),
            mesh.triangles.len()
        )
        .into_bytes();
        for value in mesh.vertices.iter().flat_map(DVec3::to_array) {
            bytes.extend(if little { value.to_le_bytes() } else { value.to_be_bytes() });
        }
        for triangle in &mesh.triangles {
            bytes.push(3);
            bytes
                .extend(triangle.iter().flat_map(|i| if little { i.to_le_bytes() } else { i.to_be_bytes() }));
        }
        bytes
    }

    #[test]
    fn text_and_both_orders_of_bytes_give_the_same_mesh() {
        let cube = unit_cube().welded();
        assert_eq!(mesh_of(ascii(&cube)).unwrap(), cube);
        for little in [true, false] {
            assert_eq!(mesh_of(binary(&cube, little)).unwrap(), cube);
        }
    }

    #[test]
    fn numbers_and_comments_are_read_as_other_programs_write_them() {
        let cube = unit_cube().welded();
        let text = ascii(&cube);
        for number in ["0.", ".5", "nan", "-inf", "5.E-1"] {
            let written = text.replace(" 0.5\n", &format!(" {number}\n"));
            assert_ne!(written, text);
            assert_eq!(mesh_of(written).unwrap(), cube, "{number}");
        }
        assert_eq!(mesh_of(text.replace("0 0 0 200", "-0. .0 +0.e0 200")).unwrap(), cube);
        for mut bytes in [text.into_bytes(), binary(&cube, true)] {
            let at = bytes.iter().position(|&byte| byte == b'\n').unwrap();
            bytes.splice(at..at, *b"\ncomment K\xf6rper");
            assert_eq!(mesh_of(bytes).unwrap(), cube);
        }
    }

    #[test]
    fn polygons_become_fans_and_elements_beside_are_passed_over() {
        let text = "ply\nformat ascii 1.0\nelement edge 1\nproperty int vertex1\nproperty int vertex2\n\
                    element vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
                    element face 1\nproperty list uchar short vertex_index\nend_header\n\
                    0 1\n0 0 0\n1 0 0\n1 1 0\n0 1 0\n4 0 1 2 3\n";
        let mesh = mesh_of(text).unwrap();
        assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]]);
        // Of the last number a digit may be lost, unless the mesh is closed.
        let fault = mesh_of(text.trim_end()).unwrap_err();
        assert!(fault.line == Some(18) && fault.cause.contains("in the middle of a line"), "{fault:?}");
        assert!(mesh_of(ascii(&unit_cube()).trim_end()).is_ok());
    }

    #[test]
    fn what_follows_the_elements_is_refused_but_for_blank_lines() {
        let cube = unit_cube().welded();
        assert_eq!(mesh_of(&(ascii(&cube) + "\n \n")).unwrap(), cube);
        let message = mesh_of(&(ascii(&cube) + "3 0 1 2 0.5\n")).unwrap_err().cause;
        assert!(message.contains("12 bytes follow"), "{message}");
        for little in [true, false] {
            let mut bytes = binary(&cube, little);
            bytes.push(b'\n');
            assert_eq!(mesh_of(&bytes).unwrap(), cube);
            bytes.push(3);
            let message = mesh_of(&bytes).unwrap_err().cause;
            assert!(message.contains("2 bytes follow"), "{message}");
        }
    }

    #[test]
    fn mistakes_are_told_apart() {
        let cube = unit_cube();
        let text = ascii(&cube);
        let failure = |text: &str| mesh_of(text).unwrap_err();
        for index in ["9", "-1"] {
            let message = failure(&text.replace("3 0 ", &format!("3 {index} "))).cause;
            assert!(message.contains(&format!("vertex {index}, but")), "{message}");
        }
        for number in ["nan", "inf"] {
            let message = failure(&text.replacen("0 0 0 200", &format!("{number} 0 0 200"), 1)).cause;
            assert!(message.contains("vertex 0 (counted from 0) has a coordinate that is"), "{message}");
        }
        assert!(mesh_of(text.replace("0 0 0 200", "one 0 0 200")).is_err());
        let mut broken = cube.clone();
        broken.vertices[0].x = f64::NAN;
        let message = mesh_of(binary(&broken, true)).unwrap_err().cause;
        assert!(message.contains("vertex 0 (counted from 0) has a coordinate that is NaN"), "{message}");
        assert_eq!(failure(&text.replace("property float z\n", "")).kind, FaultKind::Malformed);
        let message = failure(&text.replace("vertex_indices", "corners")).cause;
        assert!(message.contains("vertex_indices"), "{message}");
        let fault = failure(&text.replace("format ascii", "format strange"));
        assert!(fault.line == Some(2) && !fault.cause.contains("Line 2"), "{fault:?}");
        let message = failure(&text.replace("vertex 8", "vertex 42949672958")).cause;
        assert!(message.contains("42949672958 of the element `vertex`"), "{message}");
        let endless = text.replace("element face", "element nothing 99999999999\nelement face");
        assert!(failure(&endless).cause.contains("`nothing` has no property"));
        let cut = binary(&cube, true);
        assert_eq!(mesh_of(&cut[..cut.len() - 5]).unwrap_err().kind, FaultKind::Truncated);
    }
}
