//! What VTK's XML files share: the description of an array among the appended raw bytes.

use super::{FieldValues, NamedField};

/// The element of an array whose block begins at `offset`, which moves on to the next one. A block is its length in bytes
/// (u64) and the values.
pub(super) fn data_array(field: &NamedField<'_>, offset: &mut u64) -> String {
    let kind = match field.values {
        FieldValues::F32(_) => "Float32",
        FieldValues::U8(_) => "UInt8",
        FieldValues::U32(_) => "UInt32",
    };
    let name = escaped(field.name);
    let array = format!(r#"<DataArray type="{kind}" Name="{name}" format="appended" offset="{offset}"/>"#);
    *offset += (size_of::<u64>() + field.values.bytes()) as u64;
    array
}

/// A name as the value of an XML attribute.
pub(super) fn escaped(name: &str) -> String {
    name.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}
