//! Makes the checksums of changed files right again, so that what lies behind them is tested too.

use std::borrow::Cow;
use std::ops::Range;

use safetensors::tensor::SafeTensors;

/// What stands before the checksum of a scene's voxels, in JSON and in JSON that is quoted.
const VOXELS: [&[u8]; 2] = [b"\"obstacle_crc32\":", b"\\\"obstacle_crc32\\\":"];

/// A field whose checksums of the voxels and of the file are right, where it is whole enough to have them.
pub(crate) fn of_field(bytes: &[u8]) -> Cow<'_, [u8]> {
    try_field(bytes).map_or(Cow::Borrowed(bytes), Cow::Owned)
}

fn try_field(bytes: &[u8]) -> Option<Vec<u8>> {
    const KEY: &[u8] = br#"\"crc32\":\""#;
    let voxels = crc32fast::hash(SafeTensors::deserialize(bytes).ok()?.tensor("obstacle").ok()?.data());
    let end = usize::try_from(u64::from_le_bytes(*bytes.first_chunk()?)).ok()?.checked_add(8)?;
    let text = with_number(bytes.get(8..end)?, &VOXELS, voxels);
    let header = 8 + text.len();
    let mut whole = [&(text.len() as u64).to_le_bytes(), &text[..], &bytes[end..]].concat();
    seal(&mut whole, header, KEY)?;
    Some(whole)
}

/// Writes the checksum of the whole, with zeros in place of its digits, behind a key in the first bytes.
fn seal(whole: &mut [u8], header: usize, key: &[u8]) -> Option<()> {
    let start = position(&whole[..header], key)? + key.len();
    whole.get_mut(start..start + 8)?.fill(b'0');
    let sum = format!("{:08x}", crc32fast::hash(whole));
    whole[start..start + 8].copy_from_slice(sum.as_bytes());
    Some(())
}

/// A dataset's manifest whose checksums are those of its voxels, its shard and its own text.
pub(crate) fn of_manifest(manifest: &[u8], obstacle: &[u8], shard: &[u8]) -> Vec<u8> {
    let tensors = SafeTensors::deserialize(obstacle);
    let voxels = tensors.as_ref().ok().and_then(|tensors| tensors.tensor("obstacle").ok());
    let text = voxels.map(|voxels| with_number(manifest, &VOXELS, crc32fast::hash(voxels.data())));
    let mut text = with_number(text.as_deref().unwrap_or(manifest), &[b"\"crc32\":"], crc32fast::hash(shard));
    let length = text.len();
    // A text without a checksum stays as it is.
    let _ = seal(&mut text, length, b"\"checksum\": \"");
    text
}

/// The text with another number behind the first of `keys` that it has.
fn with_number(text: &[u8], keys: &[&[u8]], number: u32) -> Vec<u8> {
    let Some(Range { start, end }) = keys.iter().find_map(|key| number_behind(text, key)) else {
        return text.to_vec();
    };
    [&text[..start], number.to_string().as_bytes(), &text[end..]].concat()
}

fn number_behind(text: &[u8], key: &[u8]) -> Option<Range<usize>> {
    let mut start = position(text, key)? + key.len();
    start += text[start..].iter().take_while(|byte| **byte == b' ').count();
    let digits = text[start..].iter().take_while(|byte| byte.is_ascii_digit()).count();
    Some(start..start + digits)
}

fn position(text: &[u8], word: &[u8]) -> Option<usize> {
    text.windows(word.len()).position(|window| window == word)
}
