//! Writing such files, one tensor after the other.

use std::io::{self, Write};

use imf_core::atomic_file::write_atomically;
use safetensors::tensor::{Metadata, TensorInfo, TensorView};
use serde::Serialize;

use super::*;

/// A tensor to be written: name, kind, shape and little-endian bytes.
pub(crate) type Tensor<'a> = (Cow<'static, str>, Dtype, Vec<usize>, Cow<'a, [u8]>);

/// A tensor in f32.
pub(crate) fn tensor<'a>(
    name: impl Into<Cow<'static, str>>,
    shape: &[usize],
    values: &'a [f32],
) -> Tensor<'a> {
    (name.into(), Dtype::F32, shape.to_vec(), little_endian(values))
}

/// What a family writes.
pub(crate) struct Contents<'a, T> {
    pub(crate) scene: &'a Scene,
    pub(crate) calibration: Option<Calibration>,
    pub(crate) description: T,
    pub(crate) tensors: Vec<Tensor<'a>>,
}

#[derive(Serialize)]
struct Description<'a, T> {
    format: &'static str,
    version: u32,
    crc32: &'static str,
    #[serde(flatten)]
    own: &'a T,
    scene: &'a SceneRecord,
    /// Nothing where the field was never calibrated.
    #[serde(skip_serializing_if = "Option::is_none")]
    calibration: Option<Calibration>,
}

impl Format {
    /// Writes a file whole or not at all. Equal contents give equal bytes.
    pub(crate) fn write<T: Serialize>(
        self,
        path: &Path,
        contents: Contents<'_, T>,
    ) -> Result<(), FieldFileError> {
        let Contents { scene, calibration, description, mut tensors } = contents;
        let voxels = scene.packed_voxels().into_iter();
        tensors.extend(voxels.map(|(name, bits)| {
            (Cow::Borrowed(name), Dtype::U8, vec![bits.len()], Cow::Owned::<[u8]>(bits))
        }));
        // In the order that the library requires.
        tensors.sort_by(|a, b| b.1.cmp(&a.1).then(a.0.cmp(&b.0)));
        let description = Description {
            format: self.id,
            version: VERSION,
            crc32: NO_CHECKSUM,
            own: &description,
            scene: &scene.record,
            calibration,
        };
        let header = header(&description, &tensors).map_err(|error| self.damaged(path, error.to_string()))?;
        // One after the other: the library's own way holds a copy of all of them.
        let write = |file: &mut io::BufWriter<&std::fs::File>| {
            file.write_all(&header)?;
            tensors.iter().try_for_each(|(_, _, _, bytes)| file.write_all(bytes))
        };
        Ok(write_atomically(path, write)?)
    }
}

/// What stands before the tensors' bytes: the length of the rest, then description, names, kinds, shapes and places, in
/// whole words.
fn header(
    description: &impl Serialize,
    tensors: &[Tensor<'_>],
) -> Result<Vec<u8>, Box<dyn std::error::Error>> {
    let mut end = 0;
    let mut places = Vec::with_capacity(tensors.len());
    for (name, kind, shape, bytes) in tensors {
        let view = TensorView::new(*kind, shape.clone(), bytes)?;
        let data_offsets = (end, end + bytes.len());
        end = data_offsets.1;
        let info = TensorInfo { dtype: view.dtype(), shape: shape.clone(), data_offsets };
        places.push((name.clone().into_owned(), info));
    }
    let json = serde_json::to_string(description)?;
    let metadata = Metadata::new(Some([("imf".to_owned(), json)].into_iter().collect()), places)?;
    let mut text = serde_json::to_vec(&metadata)?;
    text.resize(text.len().next_multiple_of(size_of::<u64>()), b' ');
    let mut header = (text.len() as u64).to_le_bytes().to_vec();
    header.extend(text);
    let digits = checksum_digits(&header).ok_or("no place for its checksum")?;
    let sum = checksum(std::iter::once(&header[..]).chain(tensors.iter().map(|tensor| &*tensor.3)));
    header[digits].copy_from_slice(sum.as_bytes());
    Ok(header)
}
