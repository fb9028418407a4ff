//! Tables of orientations in CSV.

use std::path::Path;

use glam::DVec3;

use super::Orientation;
use super::set::{OrientationSetError, angle_pair, numbers};
use crate::file_error::as_utf8;

/// A table of directions or angles, as `imf field` lists its orientations.
pub(super) fn read_csv(path: &Path) -> Result<Vec<Orientation>, OrientationSetError> {
    let spec = path.display().to_string();
    let bytes =
        std::fs::read(path).map_err(|source| OrientationSetError::Read { path: spec.clone(), source })?;
    let fail = |what: String| OrientationSetError::Value { spec: spec.clone(), what };
    // Some editors begin a file with a byte order mark.
    let text = String::from_utf8_lossy(&as_utf8(&bytes)).trim_start_matches('\u{feff}').to_owned();
    // As spreadsheets write tables, of other systems too.
    let text = if text.contains('\n') { text } else { text.replace('\r', "\n") };
    let text = text.replace([';', '\t'], ",").replace('"', "");
    let is_row = |(_, line): &(usize, &str)| !line.trim().is_empty() && !line.starts_with('#');
    let mut lines = text.lines().enumerate().filter(is_row);
    let header = lines.next().map(|(_, line)| line.replace(' ', "").to_ascii_lowercase());
    // As `imf field` lists its orientations.
    let numbered = header.as_ref().is_some_and(|header| header.starts_with("index,"));
    let named = header.as_deref().map(|header| header.strip_prefix("index,").unwrap_or(header));
    let directions = match named {
        Some("theta,phi" | "theta,phi,roll") => false,
        Some("i,j,k") => true,
        named => {
            let found = named.unwrap_or_default();
            return Err(fail(format!(
                "the first line must be theta,phi or theta,phi,roll or i,j,k, not '{found}'"
            )));
        }
    };
    let columns = header.map_or(0, |h| h.split(',').count());
    let mut orientations = Vec::new();
    for (number, line) in lines {
        let wrong = |what: &str| fail(format!("line {}: {what}", number + 1));
        let values = numbers(line).filter(|v| v.len() == columns);
        let values = values.ok_or_else(|| wrong(&format!("'{line}' is not {columns} numbers")))?;
        let values = &values[usize::from(numbered)..];
        orientations.push(if directions {
            Orientation::from_direction(DVec3::from_slice(values))
                .ok_or_else(|| wrong("a direction must not be zero"))?
        } else {
            angle_pair(values[0], values[1], values.get(2).copied().unwrap_or(0.0)).map_err(|e| wrong(&e))?
        });
    }
    if orientations.is_empty() {
        return Err(fail("holds no orientation".into()));
    }
    Ok(orientations)
}
#[cfg(test)]
mod tests {
    use super::*;
    use crate::file_error::tests::as_utf16;

    #[test]
    fn tables_are_read_as_spreadsheets_of_all_systems_write_them() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("two.csv");
        let read = |content: &[u8]| {
            std::fs::write(&path, content).unwrap();
            read_csv(&path)
        };
        let text = "theta,phi\n30,20\n0,90\n";
        let expected = read(text.as_bytes()).unwrap();
        assert_eq!(expected.len(), 2);
        for changed in [
            text.replace(',', ";"),
            text.replace(',', "\t"),
            text.replace('\n', "\r"),
            text.replace('\n', "\r\n"),
            text.replace("theta,phi", "\u{feff}\"Theta\",\"Phi\""),
            format!("# of the cell\n{text}"),
        ] {
            assert_eq!(read(changed.as_bytes()).unwrap(), expected, "{changed}");
        }
        assert!(as_utf16(text).iter().all(|bytes| read(bytes).unwrap() == expected));
        let other = read(b"a;b\n1;2\n").unwrap_err().to_string();
        assert!(other.contains("not 'a,b'"), "{other}");
    }
}
