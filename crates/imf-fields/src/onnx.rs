//! Fields as ONNX graphs, for whatever runs them: onnxruntime, TensorRT, OpenVINO, a browser.
//!
//! A graph holds all of a field, its inputs' scaling too, so that its inputs are in the units of the scene:
//!
//! ```text
//! position   f32 [poses, 3]   the tool's tip less `imf.origin`, in the scene's unit, along the world's axes
//! direction  f32 [poses, 3]   the tool's axis from tip to holder, of any length but 0     harmonic and factored fields
//! angles     f32 [poses, 2]   (θ, φ) in degrees, θ of any size, φ in [0, 180]             the paper's network
//! overlap    f32 [poses]      the fraction of the tool's volume in the obstacle, in [0, 1]; or, of fields of depth,
//! depth      f32 [poses]      how far the tool must be moved to be free, below 0 how far it may be moved
//! ```
//!
//! Results are those of [`crate::field::Field`] but for the rounding of single precision: outside the box of the
//! voxel centres those of the nearest point inside, without guarantee; NaN in the row of an invalid pose, and in no
//! other. What a field is of stands in the model's metadata: part, tool, unit, clearance, the thresholds of its
//! decisions where it is calibrated, the corners of that box in the world, and the corner of the grid that positions
//! are counted from: the difference, taken in double precision, keeps its digits however far from zero the part lies.
//! Graphs are of opset 17.
//!
//! The messages are written here, a dozen of them, since the crates that have all of ONNX's are no longer maintained
//! (`onnx-pb`, of 2020) or parse only (`onnx-ir`).

mod directions;
mod graph;
mod interpolated;
mod messages;
mod network;
mod place;

use std::io::Write as _;
use std::path::Path;

use glam::DVec3;
use prost::Message as _;
use thiserror::Error;

use crate::calibration::Calibration;
use crate::factored::file::FactoredFile;
use crate::file::FieldFile;
use crate::harmonic::basis::Domain;
use crate::harmonic::file::HarmonicFile;
use crate::model::Model;
use graph::{Graph, Value};
use imf_core::atomic_file::{AtomicFileError, write_atomically};
use imf_core::grid::Grid;
use imf_core::scene::SceneRecord;
use imf_core::section::Quantity;
use imf_core::tool::Clearance;
use messages::{GraphProto, ModelProto, OperatorSetIdProto, StringStringEntryProto};
use place::Place;

/// The set of operators of the graphs.
const OPSET: i64 = 17;
/// The version of the file format that belongs to it.
const IR_VERSION: i64 = 8;
/// Protocol buffers hold no more than 2 GiB; a little is left for the graph.
const MOST_BYTES: u64 = (1 << 31) - (1 << 24);

const POSITION: &str = "the tool's tip less imf.origin, in the scene's unit, along the world's axes";
const DIRECTION: &str = "the tool's axis from tip to holder, of any length but 0";
const ANGLES: &str = "(theta, phi) of the tool's axis in degrees: theta of any size, phi in [0, 180]";
const DEPTH: &str =
    "how far the tool must be moved to be free, in the scene's unit; below 0 how far it may be moved";
const OVERLAP: &str = "the fraction of the tool's volume in the obstacle, in [0, 1]";

/// Why a field is not written.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum OnnxError {
    /// Its functions are of rotations; the family's name.
    #[error(
        "a {0} field of a tool that is not symmetric about its axis has no ONNX form: its functions are of rotations, and \
         only those of directions are written"
    )]
    Rotations(&'static str),
    /// Larger than the format holds.
    #[error(
        "the field's {0} bytes are more than an ONNX file holds (2 GiB): distil it into a network, or choose a \
         lower degree or a larger pitch"
    )]
    Size(u64),
    /// The file cannot be written.
    #[error(transparent)]
    Write(#[from] AtomicFileError),
}

/// Bytes of a field's numbers in its graph; writing takes three times as many of memory.
pub fn onnx_bytes(saved: &FieldFile) -> u64 {
    match saved {
        FieldFile::Siren(model) => 4 * model.state.parameters.len() as u64,
        FieldFile::Harmonic(file) => file.field.bytes(),
        FieldFile::Factored(file) => file.field.bytes(),
    }
}

/// Writes a field as an ONNX graph, whole or not at all. Equal fields give equal bytes.
///
/// # Errors
/// A field of rotations; one that is larger than the format holds; a file that cannot be written.
pub fn write_onnx(saved: &FieldFile, path: &Path) -> Result<(), OnnxError> {
    let bytes = model(saved)?.encode_to_vec();
    Ok(write_atomically(path, |file| file.write_all(&bytes))?)
}

fn model(saved: &FieldFile) -> Result<ModelProto, OnnxError> {
    let size = onnx_bytes(saved);
    if size > MOST_BYTES {
        return Err(OnnxError::Size(size));
    }
    let graph = match saved {
        FieldFile::Siren(model) => siren(model),
        FieldFile::Harmonic(file) => harmonic(file)?,
        FieldFile::Factored(file) => factored(file)?,
    };
    let record = &saved.scene().record;
    Ok(ModelProto {
        ir_version: IR_VERSION,
        producer_name: "imf".into(),
        producer_version: env!("CARGO_PKG_VERSION").into(),
        doc_string: match saved.quantity() {
            Quantity::Overlap => {
                format!("How much of {} lies in {}, at any pose", record.tool.name, record.part)
            }
            Quantity::Depth => format!("How deep {} is in {}, at any pose", record.tool.name, record.part),
        },
        graph: Some(graph),
        opset_import: vec![OperatorSetIdProto { domain: String::new(), version: OPSET }],
        metadata_props: metadata(record, saved.quantity(), saved.calibration()),
    })
}

fn siren(model: &Model) -> GraphProto {
    let mut graph = Graph::default();
    let position = graph.input("position", 3, POSITION);
    let angles = graph.input("angles", 2, ANGLES);
    let (grid, parameters) = (own_frame(&model.scene.record.grid), &model.state.parameters);
    let held = network::held(&mut graph, &grid, &position);
    let overlap = network::siren(&mut graph, &model.shape, parameters, &grid, &held, &angles);
    let invalid = [graph.nothing_of(&position), graph.nothing_of(&angles)];
    let overlap = graph.with_invalid(&overlap, &invalid);
    graph.answering("siren5", "overlap", &overlap, OVERLAP)
}

fn harmonic(file: &HarmonicFile) -> Result<GraphProto, OnnxError> {
    let field = &file.field;
    require_directions("harmonic", field.basis.domain())?;
    let mut graph = Graph::default();
    let position = graph.input("position", 3, POSITION);
    let direction = graph.input("direction", 3, DIRECTION);
    let z = interpolated::coefficients(&mut graph, &field.coefficients, &own_frame(&field.grid), &position);
    let degree = field.basis.degree();
    let value = directions::value(&mut graph, &direction, degree, &field.components, &field.mean, &z);
    let invalid = [graph.nothing_of(&position), directions::nothing_of(&mut graph, &direction)];
    Ok(answering(graph, "harmonic", &value, &invalid, (field.quantity, field.grid.pitch)))
}

fn factored(file: &FactoredFile) -> Result<GraphProto, OnnxError> {
    let field = &file.field;
    require_directions("factored", field.basis.domain())?;
    let mut graph = Graph::default();
    let position = graph.input("position", 3, POSITION);
    let direction = graph.input("direction", 3, DIRECTION);
    let grid = own_frame(&field.grid);
    let held = network::held(&mut graph, &grid, &position);
    let place = Place::new(&mut graph, &field.shape.symmetry.less(field.grid.origin), &held);
    let z = network::coefficients(&mut graph, field, &grid, &place);
    let invalid = [graph.nothing_of(&position), directions::nothing_of(&mut graph, &direction)];
    let direction = place.to_local(&mut graph, &direction);
    let degree = field.basis.degree();
    let value = directions::value(&mut graph, &direction, degree, &field.components, &field.mean, &z);
    Ok(answering(graph, "factored", &value, &invalid, (field.quantity, field.grid.pitch)))
}

/// The same grid with its corner at zero.
fn own_frame(grid: &Grid) -> Grid {
    Grid { origin: DVec3::ZERO, ..*grid }
}

/// The graph whose result is a value, clamped as its quantity is on a grid of this pitch, and NaN where something is
/// invalid.
fn answering(
    mut graph: Graph,
    family: &str,
    value: &Value,
    invalid: &[Value],
    (quantity, pitch): (Quantity, f64),
) -> GraphProto {
    let [low, high] = quantity.bounds(pitch);
    let clamped = graph.clip(value, low, high);
    let answer = graph.with_invalid(&clamped, invalid);
    let (name, meaning) = name_and_meaning(quantity);
    graph.answering(family, name, &answer, meaning)
}

fn name_and_meaning(quantity: Quantity) -> (&'static str, &'static str) {
    match quantity {
        Quantity::Overlap => ("overlap", OVERLAP),
        Quantity::Depth => ("depth", DEPTH),
    }
}

fn require_directions(family: &'static str, domain: Domain) -> Result<(), OnnxError> {
    if domain == Domain::Directions { Ok(()) } else { Err(OnnxError::Rotations(family)) }
}

/// What a user of the graph must know of the scene.
fn metadata(
    record: &SceneRecord,
    quantity: Quantity,
    calibration: Option<&Calibration>,
) -> Vec<StringStringEntryProto> {
    let Grid { dims, pitch, .. } = record.grid;
    let corner = |voxel| {
        let [x, y, z] = record.grid.centre(voxel).to_array();
        format!("{x} {y} {z}")
    };
    let Clearance { holder, shank, cutter } = record.clearance;
    let [x, y, z] = record.grid.origin.to_array();
    let entries = [
        ("imf.quantity", name_and_meaning(quantity).0.to_owned()),
        ("imf.part", record.part.clone()),
        ("imf.tool", record.tool.name.clone()),
        ("imf.unit", record.unit.to_string()),
        ("imf.pitch", pitch.to_string()),
        ("imf.origin", format!("{x} {y} {z}")),
        ("imf.box_lower", corner([0; 3])),
        ("imf.box_upper", corner(dims.map(|n| n - 1))),
        ("imf.clearance_holder_shank_cutter", format!("{holder} {shank} {cutter}")),
    ];
    let thresholds = calibration.into_iter().flat_map(|known| {
        [("imf.free_up_to", known.free_up_to), ("imf.colliding_from", known.colliding_from)]
    });
    let thresholds = thresholds.filter_map(|(key, value)| Some((key, value?.to_string())));
    let entry = |(key, value): (&str, String)| StringStringEntryProto { key: key.into(), value };
    entries.into_iter().chain(thresholds).map(entry).collect()
}

#[cfg(test)]
mod tests;
