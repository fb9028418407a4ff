//! What VTK's XML files share: fields among the appended raw bytes, each block after its length in bytes (u64).

use std::io::{self, Write};

use super::{FieldValues, NamedField, check_length, check_names, refused};

/// Begins the file of a kind of data.
pub(super) fn begin(out: &mut impl Write, kind: &str) -> io::Result<()> {
    writeln!(out, r#"<?xml version="1.0"?>"#)?;
    writeln!(out, r#"<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian" header_type="UInt64">"#)
}

/// Refuses fields that do not have `count` values, or that cannot be told apart, or none at all.
pub(super) fn check_fields(fields: &[NamedField<'_>], count: usize) -> io::Result<()> {
    if fields.is_empty() {
        return Err(refused("no field was given".into()));
    }
    for field in fields {
        check_length(field.name, field.values.len(), count)?;
    }
    check_names(fields.iter().map(|field| field.name), |_| true)
}

/// Describes the fields, whose blocks come first, and gives the offset behind those.
pub(super) fn write_cell_data(out: &mut impl Write, fields: &[NamedField<'_>]) -> io::Result<u64> {
    // The first field is the one that a viewer shows.
    writeln!(out, r#"      <CellData Scalars="{}">"#, escaped(fields[0].name))?;
    let mut offset = 0;
    for NamedField { name, values } in fields {
        let kind = match values {
            FieldValues::F32(_) => "Float32",
            FieldValues::U8(_) => "UInt8",
            FieldValues::U32(_) => "UInt32",
        };
        let name = escaped(name);
        writeln!(
            out,
            r#"        <DataArray type="{kind}" Name="{name}" format="appended" offset="{offset}"/>"#
        )?;
        offset += (size_of::<u64>() + values.bytes()) as u64;
    }
    writeln!(out, "      </CellData>")?;
    Ok(offset)
}

/// A name as the value of an XML attribute.
fn escaped(name: &str) -> String {
    name.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
pub(super) mod tests {
    /// The values of the array whose description holds some words, by the format's rules: offset attribute, u64 length.
    pub(in super::super) fn block<'a>(file: &'a [u8], words: &str) -> &'a [u8] {
        let start = file.windows(5).position(|w| w == b"\n   _").unwrap() + 5;
        let xml = std::str::from_utf8(&file[..start]).unwrap();
        let line = xml.lines().find(|line| line.contains(words)).unwrap();
        let offset = line.split("offset=\"").nth(1).unwrap().split('"').next().unwrap();
        let (length, values) = file[start + offset.parse::<usize>().unwrap()..].split_at(8);
        &values[..u64::from_le_bytes(length.try_into().unwrap()) as usize]
    }
}
