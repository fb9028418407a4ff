//! Safetensors files of the project's own formats: a description in JSON, tensors of stated kinds and shapes, a checksum.
//!
//! The metadata have one key, `imf`: JSON that begins with the format's name and version. What is read is checked in this
//! order: whole, of the format, not newer than the program, every tensor of its kind and shape, the checksum.

use std::borrow::Cow;
use std::collections::HashMap;
use std::io::{Read as _, Write as _};
use std::path::Path;

use half::f16;
use half::slice::HalfFloatSliceExt as _;
use safetensors::tensor::{Dtype, Metadata, SafeTensors, TensorInfo, TensorView};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use imf_core::atomic_file::{AtomicFileError, write_atomically};

/// Why such a file cannot be read or written. Every message names the file.
#[derive(Debug, Error)]
pub enum TensorFileError {
    /// The file cannot be read.
    #[error("cannot read the {name} {path}: {source}")]
    Read {
        /// What it should be.
        name: &'static str,
        /// The file.
        path: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// Another file, or a damaged one.
    #[error("{path} is no intact {name}: {what}")]
    Damaged {
        /// What it should be.
        name: &'static str,
        /// The file.
        path: String,
        /// What is wrong.
        what: String,
    },
    /// Arrays for NumPy, which lack what a field needs.
    #[error("{path} was saved for NumPy, which alone reads it: save the field as NAME.safetensors as well")]
    ForNumPy {
        /// The file.
        path: String,
    },
    /// Made by a newer program.
    #[error(
        "{path} is a {name} of version {found}, and this program reads version {readable}: use a newer imf"
    )]
    Newer {
        /// What it is.
        name: &'static str,
        /// The file.
        path: String,
        /// Its version.
        found: u32,
        /// The highest version that can be read.
        readable: u32,
    },
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] AtomicFileError),
}

/// Bytes in which a file's format stands.
const START: usize = 512;

/// A kind of file.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Format {
    /// In the file.
    pub(crate) id: &'static str,
    /// In messages.
    pub(crate) name: &'static str,
    /// The version that is read and written.
    pub(crate) version: u32,
}

/// The part of a description that can be read whatever its version.
#[derive(Serialize, Deserialize)]
pub(crate) struct Header {
    format: String,
    version: u32,
}

/// A tensor to be written: name, kind, shape and little-endian bytes.
pub(crate) type Tensor<'a> = (&'static str, Dtype, Vec<usize>, &'a [u8]);

impl Format {
    /// The beginning of a description.
    pub(crate) fn header(&self) -> Header {
        Header { format: self.id.into(), version: self.version }
    }

    /// True for a file whose metadata begin with this format, whole or not.
    pub(crate) fn is_of(&self, path: &Path) -> bool {
        // The JSON header follows its length, and `imf` stands at its beginning.
        let mut start = [0; START];
        let read = std::fs::File::open(path).and_then(|mut file| file.read(&mut start)).unwrap_or(0);
        self.begins(&start[..read])
    }

    /// The same of a file in memory.
    pub(crate) fn begins(&self, bytes: &[u8]) -> bool {
        let start = &bytes[..bytes.len().min(START)];
        start.windows(self.id.len()).any(|window| window == self.id.as_bytes())
    }

    fn damaged(&self, path: &Path, what: String) -> TensorFileError {
        TensorFileError::Damaged { name: self.name, path: path.display().to_string(), what }
    }

    /// Writes a file whole or not at all. Equal contents give equal bytes.
    pub(crate) fn write(
        &self,
        path: &Path,
        description: &impl Serialize,
        tensors: &[Tensor<'_>],
    ) -> Result<(), TensorFileError> {
        let mut tensors: Vec<&Tensor<'_>> = tensors.iter().collect();
        // In the order in which the library writes them, which is the one that it asks for.
        tensors.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(b.0)));
        let header = header(description, &tensors).map_err(|e| self.damaged(path, e.to_string()))?;
        // One after the other: the library's own way holds a copy of all of them.
        Ok(write_atomically(path, |file| {
            file.write_all(&(header.len() as u64).to_le_bytes())?;
            file.write_all(&header)?;
            tensors.iter().try_for_each(|(_, _, _, bytes)| file.write_all(bytes))
        })?)
    }

    /// Reads a file as far as its description.
    pub(crate) fn read<'p>(&self, path: &'p Path) -> Result<Loaded<'p>, TensorFileError> {
        refuse_npz(path)?;
        let bytes = std::fs::read(path).map_err(|source| TensorFileError::Read {
            name: self.name,
            path: path.display().to_string(),
            source,
        })?;
        self.in_memory(bytes, path)
    }

    /// The same of a file in memory, which errors call `path`.
    pub(crate) fn in_memory<'p>(
        &self,
        bytes: Vec<u8>,
        path: &'p Path,
    ) -> Result<Loaded<'p>, TensorFileError> {
        let shown = || path.display().to_string();
        let damaged = |what: String| self.damaged(path, what);
        let (_, metadata) = SafeTensors::read_metadata(&bytes)
            .map_err(|e| damaged(format!("{e}; it was cut short, or is no safetensors file")))?;
        let json = metadata.metadata().as_ref().and_then(|m| m.get("imf"));
        let json = json.ok_or_else(|| damaged("it is a safetensors file, but not one of imf's".into()))?;
        let header: Header = serde_json::from_str(json).map_err(|e| damaged(e.to_string()))?;
        if header.format != self.id {
            return Err(damaged(format!("its format is '{}', not '{}'", header.format, self.id)));
        }
        if header.version > self.version {
            let (found, readable) = (header.version, self.version);
            return Err(TensorFileError::Newer { name: self.name, path: shown(), found, readable });
        }
        if header.version != self.version {
            return Err(damaged(format!("there is no version {}", header.version)));
        }
        Ok(Loaded { format: *self, path, json: json.clone(), bytes })
    }
}

/// Refuses a file that was kept for NumPy, by its ending.
pub(crate) fn refuse_npz(path: &Path) -> Result<(), TensorFileError> {
    let npz = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("npz"));
    if npz && path.is_file() {
        return Err(TensorFileError::ForNumPy { path: path.display().to_string() });
    }
    Ok(())
}

/// A file in memory whose format and version are known.
pub(crate) struct Loaded<'p> {
    format: Format,
    path: &'p Path,
    json: String,
    bytes: Vec<u8>,
}

impl Loaded<'_> {
    /// In words what is wrong with the file.
    pub(crate) fn damaged(&self, what: &(impl ToString + ?Sized)) -> TensorFileError {
        self.format.damaged(self.path, what.to_string())
    }

    /// What stands beside format and version.
    pub(crate) fn description<T: DeserializeOwned>(&self) -> Result<T, TensorFileError> {
        serde_json::from_str(&self.json).map_err(|e| self.damaged(&e))
    }

    /// The tensors, not yet looked at.
    pub(crate) fn tensors(&self) -> Result<Tensors<'_>, TensorFileError> {
        let tensors = SafeTensors::deserialize(&self.bytes)
            .map_err(|e| self.damaged(&format!("{e}; it was cut short")))?;
        Ok(Tensors { file: self, tensors })
    }
}

/// The tensors of a file.
pub(crate) struct Tensors<'a> {
    file: &'a Loaded<'a>,
    tensors: SafeTensors<'a>,
}

impl Tensors<'_> {
    /// The bytes of a tensor that must be of this kind and shape.
    pub(crate) fn bytes(&self, name: &str, kind: Dtype, shape: &[usize]) -> Result<&[u8], TensorFileError> {
        let view = self.tensors.tensor(name).map_err(|e| self.file.damaged(&e))?;
        if view.dtype() != kind || view.shape() != shape {
            let (found, found_shape) = (view.dtype(), view.shape());
            return Err(self
                .file
                .damaged(&format!("'{name}' is {found:?} {found_shape:?}, not {kind:?} {shape:?}")));
        }
        Ok(view.data())
    }

    /// The bytes of a tensor that need not be there.
    pub(crate) fn optional(&self, name: &str) -> Option<&[u8]> {
        self.tensors.tensor(name).ok().map(|view| view.data())
    }
}

/// What stands before the tensors' bytes: description, names, kinds, shapes and places, in whole words.
fn header(
    description: &impl Serialize,
    tensors: &[&Tensor<'_>],
) -> Result<Vec<u8>, Box<dyn std::error::Error>> {
    let mut end = 0;
    let mut places = Vec::with_capacity(tensors.len());
    for (name, kind, shape, bytes) in tensors {
        let view = TensorView::new(*kind, shape.clone(), bytes)?;
        let data_offsets = (end, end + bytes.len());
        end = data_offsets.1;
        let info = TensorInfo { dtype: view.dtype(), shape: shape.clone(), data_offsets };
        places.push(((*name).to_owned(), info));
    }
    let json = serde_json::to_string(description)?;
    let metadata = Metadata::new(Some(HashMap::from([("imf".to_owned(), json)])), places)?;
    let mut header = serde_json::to_vec(&metadata)?;
    header.resize(header.len().next_multiple_of(size_of::<u64>()), b' ');
    Ok(header)
}

/// Numbers as the file keeps them: where they lie, where the machine keeps them so.
pub(crate) fn little_endian(values: &[f32]) -> Cow<'_, [u8]> {
    if cfg!(target_endian = "little") {
        Cow::Borrowed(bytemuck::cast_slice(values))
    } else {
        values.iter().flat_map(|v| v.to_le_bytes()).collect()
    }
}

/// Halves as the file keeps them, as [`little_endian`].
pub(crate) fn little_endian_halves(values: &[f16]) -> Cow<'_, [u8]> {
    if cfg!(target_endian = "little") {
        Cow::Borrowed(bytemuck::cast_slice(values.reinterpret_cast()))
    } else {
        values.iter().flat_map(|v| v.to_le_bytes()).collect()
    }
}

/// The numbers of [`little_endian`].
pub(crate) fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b)).collect()
}

/// The numbers of [`little_endian_halves`].
pub(crate) fn halves(bytes: &[u8]) -> Vec<f16> {
    bytes.as_chunks::<2>().0.iter().map(|&b| f16::from_le_bytes(b)).collect()
}

/// CRC-32 over arrays, one after the other.
pub(crate) fn checksum(parts: &[&[u8]]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    parts.iter().for_each(|part| hasher.update(part));
    hasher.finalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    const FORMAT: Format = Format { id: "imf-test", name: "test file", version: 3 };

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    struct Description {
        format: String,
        version: u32,
        answer: u32,
    }

    fn described(version: u32) -> Description {
        Description { format: FORMAT.id.into(), version, answer: 42 }
    }

    #[test]
    fn files_are_the_librarys_byte_for_byte() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("one.safetensors");
        let (floats, bits) = ([1.5f32, -2.0, 0.0].map(f32::to_le_bytes).concat(), [7u8; 5]);
        let tensors: [Tensor<'_>; 4] = [
            ("b", Dtype::F32, vec![3], &floats),
            ("c", Dtype::U8, vec![5], &bits),
            ("d", Dtype::F16, vec![2, 3], &floats),
            ("a", Dtype::F32, vec![1, 3], &floats),
        ];
        FORMAT.write(&path, &described(3), &tensors).unwrap();
        let views = tensors
            .iter()
            .map(|(name, kind, shape, bytes)| (*name, TensorView::new(*kind, shape.clone(), bytes).unwrap()));
        let json = serde_json::to_string(&described(3)).unwrap();
        let whole = safetensors::serialize(views, Some(HashMap::from([("imf".to_owned(), json)]))).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), whole);
        // Too few bytes for a shape.
        assert!(FORMAT.write(&path, &described(3), &[("a", Dtype::F32, vec![4], &floats)]).is_err());
    }

    #[test]
    fn what_was_written_is_read_and_anything_else_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("one.safetensors");
        let values = [1.5f32, -2.0, 0.0];
        let bytes = little_endian(&values);
        FORMAT.write(&path, &described(3), &[("values", Dtype::F32, vec![3], &bytes)]).unwrap();
        assert!(FORMAT.is_of(&path) && !Format { id: "imf-other", ..FORMAT }.is_of(&path));
        let loaded = FORMAT.read(&path).unwrap();
        assert_eq!(loaded.description::<Description>().unwrap(), described(3));
        let tensors = loaded.tensors().unwrap();
        assert_eq!(floats(tensors.bytes("values", Dtype::F32, &[3]).unwrap()), values);
        assert!(tensors.optional("none").is_none() && tensors.optional("values").is_some());
        let say = |error: TensorFileError| error.to_string();
        let wrong = say(tensors.bytes("values", Dtype::F16, &[3]).unwrap_err());
        assert!(wrong.contains("one.safetensors") && wrong.contains("not F16 [3]"), "{wrong}");
        assert!(say(tensors.bytes("none", Dtype::F32, &[3]).unwrap_err()).contains("no intact test file"));

        let other = Format { id: "imf-other", ..FORMAT };
        assert!(say(other.read(&path).err().unwrap()).contains("'imf-test', not 'imf-other'"));
        let older = Format { version: 2, ..FORMAT };
        assert!(
            say(older.read(&path).err().unwrap()).contains("version 3, and this program reads version 2")
        );
        std::fs::write(&path, b"short").unwrap();
        assert!(say(FORMAT.read(&path).err().unwrap()).contains("cut short"));
        assert!(say(FORMAT.read(&folder.path().join("none")).err().unwrap()).contains("cannot read"));
    }

    #[test]
    fn halves_and_the_checksum_are_those_of_the_bytes() {
        let values = [f16::from_f32(0.1), f16::NEG_INFINITY];
        assert_eq!(halves(&little_endian_halves(&values)), values);
        assert_eq!(checksum(&[b"12345", b"6789"]), 0xCBF4_3926);
    }
}
