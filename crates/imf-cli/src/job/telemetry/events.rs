//! TensorBoard's event files.
//!
//! A file is a run of records: length `u64`, its masked CRC-32C, a protocol buffer of that length, its masked CRC-32C, all
//! little-endian. Messages and their numbers are those of TensorFlow's `event.proto` and `summary.proto`. Every run of the
//! program writes a file of its own that begins with a session start: TensorBoard then forgets what earlier files say of
//! the same steps.

use std::fs::{self, File};
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use anyhow::{Context as _, Result};
use prost::Message;

use super::Row;

/// `Event`
#[derive(Clone, PartialEq, Message)]
struct Event {
    /// Seconds since 1970.
    #[prost(double, tag = "1")]
    wall_time: f64,
    #[prost(int64, tag = "2")]
    step: i64,
    #[prost(oneof = "What", tags = "3, 5, 7")]
    what: Option<What>,
}

#[derive(Clone, PartialEq, prost::Oneof)]
enum What {
    #[prost(string, tag = "3")]
    FileVersion(String),
    #[prost(message, tag = "5")]
    Summary(Summary),
    #[prost(message, tag = "7")]
    SessionLog(SessionLog),
}

/// `Summary`
#[derive(Clone, PartialEq, Message)]
struct Summary {
    #[prost(message, repeated, tag = "1")]
    values: Vec<Scalar>,
}

/// `Summary.Value` of a plain number.
#[derive(Clone, PartialEq, Message)]
struct Scalar {
    #[prost(string, tag = "1")]
    tag: String,
    /// One of several kinds of value, so it is written even where it is zero.
    #[prost(float, optional, tag = "2")]
    value: Option<f32>,
}

/// `SessionLog`
#[derive(Clone, PartialEq, Message)]
struct SessionLog {
    #[prost(int32, tag = "1")]
    status: i32,
}

/// `SessionLog.START`
const START: i32 = 1;
const FILE_VERSION: &str = "brain.Event:2";

/// The event file of this run of the program.
pub(super) struct EventFile {
    path: PathBuf,
    file: File,
}

impl EventFile {
    /// Begins a file in `folder` for a training that has done `steps` steps.
    pub(super) fn create(folder: &Path, steps: u64) -> Result<Self> {
        fs::create_dir_all(folder)
            .with_context(|| format!("cannot create the folder {}", folder.display()))?;
        let now = now();
        // TensorBoard reads files in the order of their names.
        let name = format!("events.out.tfevents.{:010}.{:09}.imf", now.as_secs(), now.subsec_nanos());
        let path = folder.join(name);
        let file = File::create_new(&path).with_context(|| format!("cannot write {}", path.display()))?;
        let mut events = Self { path, file };
        events.record(0, What::FileVersion(FILE_VERSION.into()))?;
        let repeated_from = if steps == 0 { 0 } else { steps + 1 };
        events.record(repeated_from, What::SessionLog(SessionLog { status: START }))?;
        Ok(events)
    }

    /// Adds a row's numbers.
    pub(super) fn add(&mut self, row: &Row) -> Result<()> {
        let named = [
            ("loss/training", row.loss),
            ("held_out/mse", row.held_out_mse),
            ("held_out/mae", row.held_out_mae),
            ("progress/learning_rate", Some(f64::from(row.rate))),
            ("progress/samples_per_second", Some(row.samples_per_second)),
        ];
        let scalar = |(tag, value): (&str, Option<f64>)| {
            value.map(|value| Scalar { tag: tag.into(), value: Some(value as f32) })
        };
        let values = named.into_iter().filter_map(scalar).collect();
        self.record(row.step, What::Summary(Summary { values }))
    }

    fn record(&mut self, step: u64, what: What) -> Result<()> {
        let step = i64::try_from(step).unwrap_or(i64::MAX);
        let event = Event { wall_time: now().as_secs_f64(), step, what: Some(what) };
        self.file
            .write_all(&framed(&event.encode_to_vec()))
            .with_context(|| format!("cannot write {}", self.path.display()))
    }
}

fn now() -> Duration {
    SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default()
}

/// One record.
fn framed(data: &[u8]) -> Vec<u8> {
    let length = (data.len() as u64).to_le_bytes();
    [&length[..], &masked_crc(&length).to_le_bytes(), data, &masked_crc(data).to_le_bytes()].concat()
}

/// CRC-32C, turned and shifted as TensorFlow's records want it.
fn masked_crc(bytes: &[u8]) -> u32 {
    crc32c::crc32c(bytes).rotate_right(15).wrapping_add(0xa282_ead8)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All events of a file, every checksum compared.
    fn read(path: &Path) -> Vec<Event> {
        let bytes = fs::read(path).unwrap();
        let (mut rest, mut events) = (&bytes[..], Vec::new());
        while !rest.is_empty() {
            let word = |at: usize| u32::from_le_bytes(rest[at..at + 4].try_into().unwrap());
            let length = u64::from_le_bytes(rest[..8].try_into().unwrap()) as usize;
            assert_eq!(word(8), masked_crc(&rest[..8]));
            let data = &rest[12..12 + length];
            assert_eq!(word(12 + length), masked_crc(data));
            events.push(Event::decode(data).unwrap());
            rest = &rest[16 + length..];
        }
        events
    }

    #[test]
    fn checksums_are_those_of_the_definition() {
        // CRC-32C bit by bit, and the check value of "123456789".
        let slow = |bytes: &[u8]| {
            !bytes.iter().fold(!0u32, |crc, &byte| {
                (0..8).fold(crc ^ u32::from(byte), |crc, _| {
                    crc >> 1 ^ if crc & 1 == 1 { 0x82f6_3b78 } else { 0 }
                })
            })
        };
        assert_eq!(slow(b"123456789"), 0xe306_9283);
        for bytes in [&b"123456789"[..], b"", b"a", &[0; 100]] {
            let crc = slow(bytes);
            assert_eq!(masked_crc(bytes), crc.rotate_right(15).wrapping_add(0xa282_ead8));
        }
        // The first record of every event file that TensorBoard's own writer makes, but for its time.
        let event = Event { wall_time: 0.0, step: 0, what: Some(What::FileVersion(FILE_VERSION.into())) };
        assert_eq!(event.encode_to_vec(), b"\x1a\x0dbrain.Event:2");
    }

    #[test]
    fn rows_are_read_back_and_a_later_run_takes_steps_back() {
        let folder = tempfile::tempdir().unwrap();
        let row = Row {
            step: 40,
            epoch: 1,
            loss: Some(0.25),
            rate: 0.5,
            held_out_mse: Some(0.0),
            held_out_mae: None,
            samples_per_second: 1024.0,
            seconds: 1.0,
            seconds_left: None,
        };
        let mut events = EventFile::create(folder.path(), 0).unwrap();
        events.add(&row).unwrap();
        let found = read(&events.path);
        assert_eq!(found.len(), 3);
        assert!(found.iter().all(|event| event.wall_time > 1.7e9));
        assert_eq!(found[0].what, Some(What::FileVersion(FILE_VERSION.into())));
        assert_eq!((found[1].step, &found[1].what), (0, &Some(What::SessionLog(SessionLog { status: 1 }))));
        let Some(What::Summary(summary)) = &found[2].what else { panic!("{:?}", found[2]) };
        let scalars: Vec<_> =
            summary.values.iter().map(|scalar| (scalar.tag.as_str(), scalar.value.unwrap())).collect();
        assert_eq!(
            scalars,
            [
                ("loss/training", 0.25),
                ("held_out/mse", 0.0),
                ("progress/learning_rate", 0.5),
                ("progress/samples_per_second", 1024.0)
            ]
        );
        assert_eq!(found[2].step, 40);
        let second = EventFile::create(folder.path(), 20).unwrap();
        assert!(second.path > events.path);
        assert_eq!(read(&second.path)[1].step, 21);
    }
}
