//! What all saved fields have in common: one safetensors file with a description in JSON, the scene, tensors and a checksum.
//!
//! The metadata have one key, `imf`: JSON that begins with the format's name and version and ends with the scene and the
//! calibration. Beside a family's own tensors there are
//!
//! ```text
//! obstacle  u8 [⌈voxels/8⌉]   the scene's solid voxels, eight a byte, first voxel in the lowest bit
//! layer     u8 [⌈voxels/8⌉]   where there is contact: the voxels that the cutter may enter
//! ```
//!
//! The obstacle travels along, so that a field can be evaluated without the part's mesh. The checksum is the CRC-32 of the
//! whole file, taken while its own eight hexadecimal digits are zeros: whatever byte is damaged, reading says so.

use std::borrow::Cow;
use std::ops::Range;
use std::path::Path;

use half::f16;
use half::slice::HalfFloatSliceExt as _;
use safetensors::tensor::{Dtype, SafeTensors};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use thiserror::Error;

use crate::calibration::Calibration;
use imf_core::scene::{Scene, SceneRecord};

/// Why a field's file cannot be read or written. Every message names the file.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum FieldFileError {
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
    #[error("{path} is not an intact {name}: {what}")]
    Damaged {
        /// What it should be.
        name: &'static str,
        /// The file.
        path: String,
        /// What is wrong.
        what: String,
    },
    /// A file of ours, of another kind.
    #[error("{path} is no {name}: its format is '{found}', not '{expected}'")]
    Foreign {
        /// What it should be.
        name: &'static str,
        /// The file.
        path: String,
        /// Its format.
        found: String,
        /// That of what it should be.
        expected: &'static str,
    },
    /// Made by a newer program.
    #[error(
        "{path} is a {name} of version {found}, and this program reads version {VERSION}: use a newer imf"
    )]
    Newer {
        /// What it is.
        name: &'static str,
        /// The file.
        path: String,
        /// Its version.
        found: u32,
    },
    /// Parts of different fields.
    #[error("the parts of a {name} do not belong together: {what}")]
    Parts {
        /// What it should be.
        name: &'static str,
        /// Which do not.
        what: &'static str,
    },
    /// The file cannot be written.
    #[cfg(feature = "fit")]
    #[error(transparent)]
    Write(#[from] imf_core::atomic_file::AtomicFileError),
}

/// The version of every format.
const VERSION: u32 = 1;
/// Bytes in which a file's format stands.
const START: usize = 512;
/// What stands before the checksum's digits, as the file's header quotes the JSON.
const CHECKSUM_KEY: &[u8] = br#"\"crc32\":\""#;
const NO_CHECKSUM: &str = "00000000";

/// A kind of file.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Format {
    /// In the file.
    pub(crate) id: &'static str,
    /// In messages.
    pub(crate) name: &'static str,
}

/// The part of a description that can be read whatever its version.
#[derive(Deserialize)]
struct Identity {
    format: String,
    version: u32,
}

/// What is common to the descriptions of all families.
#[derive(Deserialize)]
struct Common {
    scene: SceneRecord,
    #[serde(default)]
    calibration: Option<Calibration>,
}

impl Format {
    /// True for a file whose metadata begin with this format, whole or not.
    pub(crate) fn is_of(self, path: &Path) -> bool {
        use std::io::Read as _;
        let mut start = [0; START];
        let read = std::fs::File::open(path).and_then(|mut file| file.read(&mut start)).unwrap_or(0);
        self.begins(&start[..read])
    }

    /// The same of a file in memory: the JSON header follows its length, and `imf` stands at its beginning.
    pub(crate) fn begins(self, bytes: &[u8]) -> bool {
        let start = &bytes[..bytes.len().min(START)];
        start.windows(self.id.len()).any(|window| window == self.id.as_bytes())
    }

    fn damaged(self, path: &Path, what: String) -> FieldFileError {
        FieldFileError::Damaged { name: self.name, path: path.display().to_string(), what }
    }

    /// The bytes of a file.
    pub(crate) fn bytes(self, path: &Path) -> Result<Vec<u8>, FieldFileError> {
        std::fs::read(path).map_err(|source| {
            let inside = path.join("field.safetensors");
            let source = match inside.exists() {
                true => std::io::Error::new(
                    source.kind(),
                    format!("it is a folder; the field in it is {}", inside.display()),
                ),
                false => source,
            };
            FieldFileError::Read { name: self.name, path: path.display().to_string(), source }
        })
    }

    /// Checks a file in memory, which errors call `path`, and opens it.
    pub(crate) fn open<'a>(self, bytes: &'a [u8], path: &'a Path) -> Result<Loaded<'a>, FieldFileError> {
        let damaged = |what: String| self.damaged(path, what);
        // The header is JSON behind its length.
        let cut = |e| match bytes.get(8) {
            None | Some(b'{') => damaged(format!("{e}; it was cut short, or is not a safetensors file")),
            Some(_) => damaged("it is a file of another kind, not a safetensors file".into()),
        };
        let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(cut)?;
        let tensors = SafeTensors::deserialize(bytes).map_err(cut)?;
        let json = metadata.metadata().as_ref().and_then(|m| m.get("imf"));
        let json = json.ok_or_else(|| damaged("it is a safetensors file, but not one of imf's".into()))?;
        let identity: Identity = serde_json::from_str(json).map_err(|e| damaged(e.to_string()))?;
        if identity.format != self.id {
            let path = path.display().to_string();
            return Err(FieldFileError::Foreign {
                name: self.name,
                path,
                found: identity.format,
                expected: self.id,
            });
        }
        if identity.version > VERSION {
            let path = path.display().to_string();
            return Err(FieldFileError::Newer { name: self.name, path, found: identity.version });
        }
        if identity.version != VERSION {
            return Err(damaged(format!("there is no version {}", identity.version)));
        }
        let digits = checksum_digits(bytes).ok_or_else(|| damaged("it has no checksum".into()))?;
        let sum = checksum([&bytes[..digits.start], NO_CHECKSUM.as_bytes(), &bytes[digits.end..]]);
        if bytes[digits] != *sum.as_bytes() {
            return Err(damaged("its checksum is wrong: it was changed after it was written".into()));
        }
        let common: Common = serde_json::from_str(json).map_err(|e| damaged(e.to_string()))?;
        let voxels = |name: &str| tensors.tensor(name).ok().map(|view| view.data());
        let scene = Scene::from_packed_voxels(common.scene, voxels).map_err(|e| damaged(e.to_string()))?;
        if let Some(fault) = common.calibration.and_then(|calibration| calibration.fault()) {
            return Err(damaged(fault.into()));
        }
        let (json, calibration) = (json.clone(), common.calibration);
        Ok(Loaded { format: self, path, json, tensors, scene, calibration })
    }
}

/// A file in memory whose checksum is right.
pub(crate) struct Loaded<'a> {
    format: Format,
    path: &'a Path,
    json: String,
    tensors: SafeTensors<'a>,
    pub(crate) scene: Scene,
    pub(crate) calibration: Option<Calibration>,
}

impl<'a> Loaded<'a> {
    /// In words what is wrong with the file.
    pub(crate) fn damaged(&self, what: &(impl ToString + ?Sized)) -> FieldFileError {
        self.format.damaged(self.path, what.to_string())
    }

    /// A family's own description.
    pub(crate) fn description<T: DeserializeOwned>(&self) -> Result<T, FieldFileError> {
        serde_json::from_str(&self.json).map_err(|e| self.damaged(&e))
    }

    /// True where there is a tensor of a name.
    pub(crate) fn has(&self, name: &str) -> bool {
        self.tensors.tensor(name).is_ok()
    }

    /// The bytes of a tensor that must be of this kind and shape.
    pub(crate) fn bytes(&self, name: &str, kind: Dtype, shape: &[usize]) -> Result<&'a [u8], FieldFileError> {
        let view = self.tensors.tensor(name).map_err(|e| self.damaged(&e))?;
        if view.dtype() != kind || view.shape() != shape {
            let (found, found_shape) = (view.dtype(), view.shape());
            return Err(
                self.damaged(&format!("'{name}' is {found:?} {found_shape:?}, not {kind:?} {shape:?}"))
            );
        }
        Ok(view.data())
    }

    /// The numbers of a tensor in f32, which must be of this shape and finite.
    pub(crate) fn floats(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, FieldFileError> {
        self.finite(name, floats(self.bytes(name, Dtype::F32, shape)?))
    }

    /// The same of a tensor in f16.
    pub(crate) fn widened(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, FieldFileError> {
        let halves = halves(self.bytes(name, Dtype::F16, shape)?);
        self.finite(name, halves.into_iter().map(f16::to_f32).collect())
    }

    pub(crate) fn finite(&self, name: &str, values: Vec<f32>) -> Result<Vec<f32>, FieldFileError> {
        let finite = values.iter().all(|value| value.is_finite());
        if finite {
            Ok(values)
        } else {
            Err(self.damaged(&format!("'{name}' holds a value that is not a finite number")))
        }
    }
}

/// Where the checksum's digits stand in a file.
fn checksum_digits(bytes: &[u8]) -> Option<Range<usize>> {
    let header = bytes.first_chunk::<8>().map(|length| u64::from_le_bytes(*length))?;
    let end = usize::try_from(header).ok()?.checked_add(8).filter(|&end| end <= bytes.len())?;
    let key = bytes[..end].windows(CHECKSUM_KEY.len()).position(|window| window == CHECKSUM_KEY)?;
    let start = key + CHECKSUM_KEY.len();
    Some(start..start + NO_CHECKSUM.len()).filter(|digits| digits.end <= end)
}

/// The digits of the CRC-32 over arrays, one after the other.
fn checksum<'a>(parts: impl IntoIterator<Item = &'a [u8]>) -> String {
    let mut hasher = crc32fast::Hasher::new();
    parts.into_iter().for_each(|part| hasher.update(part));
    format!("{:08x}", hasher.finalize())
}

/// A family's own description as far as it can be read, whatever else of the file is damaged.
pub(crate) fn description_of_damaged<T: DeserializeOwned>(path: &Path) -> Option<T> {
    let bytes = std::fs::read(path).ok()?;
    let (_, metadata) = SafeTensors::read_metadata(&bytes).ok()?;
    serde_json::from_str(metadata.metadata().as_ref()?.get("imf")?).ok()
}

/// Numbers as the file holds them; without a copy where the machine is little-endian.
pub(crate) fn little_endian(values: &[f32]) -> Cow<'_, [u8]> {
    if cfg!(target_endian = "little") {
        Cow::Borrowed(bytemuck::cast_slice(values))
    } else {
        values.iter().flat_map(|v| v.to_le_bytes()).collect()
    }
}

/// Halves as the file holds them, as [`little_endian`].
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

#[cfg(feature = "fit")]
pub(crate) use writing::{Contents, tensor};

#[cfg(feature = "fit")]
mod writing;

#[cfg(test)]
mod tests {
    use super::*;
    use crate::field::scenes::scene;
    use imf_core::tool::Tool;
    use serde::Serialize;

    const FORMAT: Format = Format { id: "imf-test", name: "test file" };

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    struct Answer {
        answer: u32,
    }

    #[test]
    fn tensors_are_those_written_and_any_other_is_named() {
        let scene = scene(&Tool::paper(), 0.0);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("one.safetensors");
        let values = [1.5f32, -2.0, 0.0];
        let write = |shape: &[usize]| {
            let tensors = vec![tensor("values", shape, &values)];
            let contents =
                Contents { scene: &scene, calibration: None, description: Answer { answer: 42 }, tensors };
            FORMAT.write(&path, contents)
        };
        // Too few bytes for a shape.
        assert!(write(&[4]).is_err());
        write(&[3]).unwrap();
        assert!(FORMAT.is_of(&path) && !Format { id: "imf-other", ..FORMAT }.is_of(&path));
        let bytes = FORMAT.bytes(&path).unwrap();
        let file = FORMAT.open(&bytes, &path).unwrap();
        assert_eq!(file.description::<Answer>().unwrap(), Answer { answer: 42 });
        assert_eq!((&file.scene, file.calibration), (&scene, None));
        assert!(!file.has("none") && file.has("values"));
        assert_eq!(file.floats("values", &[3]).unwrap(), values);
        let say = |error: FieldFileError| error.to_string();
        let wrong = say(file.widened("values", &[3]).unwrap_err());
        assert!(wrong.contains("one.safetensors") && wrong.contains("not F16 [3]"), "{wrong}");
        assert!(say(file.floats("none", &[3]).unwrap_err()).contains("not an intact test file"));
        let other = Format { id: "imf-other", ..FORMAT };
        assert!(say(other.open(&bytes, &path).err().unwrap()).contains("'imf-test', not 'imf-other'"));
    }

    #[test]
    fn halves_and_the_checksum_are_those_of_the_bytes() {
        let values = [f16::from_f32(0.1), f16::NEG_INFINITY];
        assert_eq!(halves(&little_endian_halves(&values)), values);
        assert_eq!(checksum([&b"12345"[..], b"6789"]), "cbf43926");
    }
}
