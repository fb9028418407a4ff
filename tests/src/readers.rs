//! Every reader of foreign files behind one interface: bytes in, and neither a panic nor more memory than a stated multiple of
//! them, whatever they are.

use std::borrow::Cow;
use std::io::{Cursor, Write as _};
use std::path::Path;
use std::sync::LazyLock;

use glam::DVec3;
use imf_core::field::PoseField as _;
use imf_core::machine::Machine;
use imf_core::mesh::read::MeshFile;
use imf_core::pose::Pose;
use imf_core::tool::Tool;
use imf_core::toolpath::{PathReading, Toolpath};
use imf_core::unit::LengthUnit;
use imf_fields::field::Field;
use imf_fields::file::FieldFile;
use imf_train::dataset;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

use crate::checksums;

/// Between the files that an input of several consists of.
pub const NEXT_FILE: &[u8] = b"\n--next file--\n";

/// A reader of one kind of file.
#[derive(Clone, Copy)]
pub struct Reader {
    /// Its name, which is that of the fuzzer's target and of the folder with its inputs.
    pub name: &'static str,
    /// The most memory at any time, as a multiple of the file's size, and of `UNFOLDING` times that of an archive.
    pub multiple: u64,
    /// Memory beside that, in bytes: buffers, tables of the libraries, messages.
    pub constant: u64,
    /// The file of an input: what random changes would break before anything is read, such as checksums, is mended.
    prepare: fn(&[u8]) -> Cow<'_, [u8]>,
    /// Reads a file; true where it is accepted.
    read: fn(&[u8]) -> bool,
}

/// What an archive may unfold to.
const UNFOLDING: u64 = 200;

/// Each reader. The multiples are those of the worst files that are known, and a third more: growing lists take three times what is
/// in them, a line of three bytes of G-code or of two characters in an array is a record of its own, a dot in a key of TOML a
/// table. Of 3MF files and G-code the readers' own limits count: 100 placed triangles, 100 chords of arcs for each byte, and some for
/// files of any size.
pub const READERS: [Reader; 13] = [
    Reader::new("mesh_obj", 60, |bytes| mesh(bytes, "part.obj")),
    Reader::new("mesh_stl", 20, |bytes| mesh(bytes, "part.stl")),
    // Lists of a polygon have room for 65,536 corners at once.
    Reader { constant: 1 << 20, ..Reader::new("mesh_ply", 100, |bytes| mesh(bytes, "part.ply")) },
    Reader {
        prepare: archive,
        constant: 128 << 20,
        ..Reader::new("mesh_3mf", 500, |bytes| mesh(bytes, "part.3mf"))
    },
    Reader { constant: 1 << 18, ..Reader::new("tool_toml", 1500, |bytes| tools(bytes, "tool.toml")) },
    Reader::new("tool_freecad", 130, |bytes| tools(bytes, "tool.fctb")),
    Reader::new("tool_fusion", 300, |bytes| tools(bytes, "tools.json")),
    Reader::new("path_csv", 80, |bytes| !is_program(bytes) && path(bytes, "path.csv")),
    Reader::new("path_apt", 60, |bytes| !is_program(bytes) && path(bytes, "path.apt")),
    Reader { constant: 48 << 20, ..Reader::new("gcode", 50_000, |bytes| path(bytes, "path.nc")) },
    Reader { constant: 1 << 18, ..Reader::new("machine", 1500, machine) },
    Reader { prepare: checksums::of_field, ..Reader::new("field", 50, field) },
    Reader { prepare: checked_dataset, ..Reader::new("dataset", 50, dataset) },
];

impl Reader {
    const fn new(name: &'static str, multiple: u64, read: fn(&[u8]) -> bool) -> Self {
        Self { name, multiple, constant: 1 << 16, prepare: |bytes| Cow::Borrowed(bytes), read }
    }

    /// Reads an input; true where it is accepted.
    ///
    /// # Panics
    /// If the reader does, breaks what it guarantees of what it accepts, or takes too much memory.
    pub fn check(&self, input: &[u8]) -> bool {
        let file = (self.prepare)(input);
        let mut accepted = false;
        let taken = allocation_counter::measure(|| accepted = (self.read)(&file)).bytes_max;
        let unfolded = file.len() as u64 * if file.starts_with(b"PK") { UNFOLDING } else { 1 };
        let most = self.multiple * unfolded + self.constant;
        assert!(
            taken <= most,
            "{} took {taken} bytes for a file of {}, more than {most}",
            self.name,
            file.len()
        );
        accepted
    }
}

/// Of a name, for the fuzzer's targets.
///
/// # Panics
/// If there is no such reader, or as [`Reader::check`].
pub fn check(name: &str, input: &[u8]) {
    READERS.iter().find(|reader| reader.name == name).expect("a reader of this name").check(input);
}

fn mesh(bytes: &[u8], name: &str) -> bool {
    let Ok(MeshFile { mesh, .. }) = MeshFile::from_bytes(bytes, name) else { return false };
    assert!(!mesh.triangles.is_empty() && mesh.vertices.iter().all(|vertex| vertex.is_finite()));
    assert!(mesh.triangles.iter().flatten().all(|&vertex| (vertex as usize) < mesh.vertices.len()));
    assert_eq!(mesh.welded(), mesh);
    true
}

/// An archive as it is, or the models of one.
fn archive(input: &[u8]) -> Cow<'_, [u8]> {
    if input.starts_with(b"PK") {
        return Cow::Borrowed(input);
    }
    let mut archive = ZipWriter::new(Cursor::new(Vec::new()));
    let options = SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    for (model, name) in parts(input).into_iter().zip(["3D/3dmodel.model", "3D/other.model", "_rels/.rels"]) {
        archive.start_file(name, options).expect("memory takes a file");
        archive.write_all(model).expect("memory takes bytes");
    }
    Cow::Owned(archive.finish().expect("memory takes an archive").into_inner())
}

fn parts(input: &[u8]) -> Vec<&[u8]> {
    let mut parts = Vec::new();
    let mut rest = input;
    while let Some(at) = rest.windows(NEXT_FILE.len()).position(|window| window == NEXT_FILE) {
        parts.push(&rest[..at]);
        rest = &rest[at + NEXT_FILE.len()..];
    }
    parts.push(rest);
    parts
}

fn tools(bytes: &[u8], name: &str) -> bool {
    let Ok(tools) = Tool::all_from_bytes(bytes, Path::new(name)) else { return false };
    tools.into_iter().flatten().all(|tool| tool.check().is_ok())
}

/// The machine that follows paths.
static TRUNNION: LazyLock<Machine> = LazyLock::new(|| {
    let text = include_str!("../../docs/guide/machines/trunnion-ac.toml");
    Machine::parse(text, Path::new("trunnion-ac.toml")).expect("the guide's machine")
});

/// True for what is read as G-code whatever its name, to which the multiples of tables do not apply.
fn is_program(bytes: &[u8]) -> bool {
    let text = String::from_utf8_lossy(bytes);
    let mut lines = text.split(['\n', '\r']).map(|line| line.trim_start_matches('\u{feff}').trim());
    let first = lines.find(|line| !line.is_empty() && !line.starts_with([';', '#'])).unwrap_or_default();
    first.starts_with(['%', '('])
        || first.chars().nth(1).is_some_and(|second| second.is_ascii_digit() || "+-.".contains(second))
}

/// With and without a machine that follows it.
fn path(bytes: &[u8], name: &str) -> bool {
    let text = String::from_utf8_lossy(bytes);
    let reading = PathReading { unit: LengthUnit::Mm, machine: Some(&TRUNNION), lengths: &[(None, 80.0)] };
    let read = |reading: PathReading<'_>| {
        let path = Toolpath::parse(&text, reading, name);
        let valid = |path: &Toolpath| path.locations.iter().all(|location| location.pose.is_valid());
        assert!(path.as_ref().map_or(true, valid), "a pose of the path is none");
        path.is_ok()
    };
    let alone = read(LengthUnit::Mm.into());
    read(reading) || alone
}

fn machine(bytes: &[u8]) -> bool {
    let Ok(text) = std::str::from_utf8(bytes) else { return false };
    let Ok(machine) = Machine::parse(text, Path::new("machine.toml")) else { return false };
    let _ = machine.inverse(DVec3::new(0.6, 0.0, 0.8));
    true
}

fn field(bytes: &[u8]) -> bool {
    let Ok(file) = FieldFile::from_bytes(bytes, "field") else { return false };
    let mut accepted = false;
    // What it takes to use a field is no matter of its file's size.
    allocation_counter::opt_out(|| accepted = has_value(file));
    accepted
}

fn has_value(file: FieldFile) -> bool {
    let Ok(field) = Field::new(file) else { return false };
    let grid = field.scene().record.grid;
    let pose = Pose::along(grid.centre([0, 0, 0]), DVec3::new(0.6, 0.0, 0.8));
    field.values(&[pose], &mut [0.0]).is_ok()
}

fn checked_dataset(input: &[u8]) -> Cow<'_, [u8]> {
    let parts = parts(input);
    let &[manifest, obstacle, shard] = parts.as_slice() else { return Cow::Borrowed(input) };
    let manifest = checksums::of_manifest(manifest, obstacle, shard);
    Cow::Owned([&manifest[..], obstacle, shard].join(NEXT_FILE))
}

fn dataset(bytes: &[u8]) -> bool {
    let folder = tempfile::tempdir().expect("a folder for a dataset");
    let names = ["manifest.json", "obstacle.safetensors", "shard-00000.safetensors"];
    for (bytes, name) in parts(bytes).into_iter().zip(names) {
        std::fs::write(folder.path().join(name), bytes).expect("room for a dataset");
    }
    dataset::load(folder.path()).is_ok()
}
