//! Graphs run by a plain interpreter in double precision, against the planner's fields.

use std::sync::Arc;

use std::collections::HashMap;

use glam::{DQuat, DVec3};
use half::f16;
use prost::Message as _;

use super::messages::{FLOAT, FLOAT16, INT64, NodeProto, TensorProto};
use super::*;
use crate::factored::reference::symmetries;
use crate::factored::{Axis, Symmetry};
use crate::field::Field;
use crate::field::scenes::{
    calibration, factored_file, harmonic_file, harmonic_in_halves, poses, scene, siren_model, with_symmetry,
};
use imf_core::field::PoseField;
use imf_core::orientation::Orientation;
use imf_core::pose::{Pose, axis_of};
use imf_core::scene::Scene;
use imf_core::tool::{Tool, ToolShape};

/// A row-major array of up to two dimensions.
#[derive(Clone, Debug)]
struct Array {
    dims: Vec<usize>,
    data: Vec<f64>,
}

impl Array {
    fn matrix(rows: usize, columns: usize, data: Vec<f64>) -> Self {
        assert_eq!(data.len(), rows * columns);
        Self { dims: vec![rows, columns], data }
    }

    fn of_constant(tensor: &TensorProto) -> Self {
        let dims = tensor.dims.iter().map(|&n| n as usize).collect::<Vec<_>>();
        let raw = &tensor.raw_data;
        let data: Vec<f64> = match tensor.data_type {
            FLOAT => raw.as_chunks().0.iter().map(|&b| f64::from(f32::from_le_bytes(b))).collect(),
            FLOAT16 => raw.as_chunks().0.iter().map(|&b| f16::from_le_bytes(b).to_f64()).collect(),
            INT64 => raw.as_chunks().0.iter().map(|&b| i64::from_le_bytes(b) as f64).collect(),
            other => panic!("kind {other}"),
        };
        assert_eq!(data.len(), dims.iter().product::<usize>(), "{}", tensor.name);
        Self { dims, data }
    }

    /// Rows and columns; a row of numbers has one row, as in broadcasting.
    fn size(&self) -> (usize, usize) {
        match *self.dims {
            [] => (1, 1),
            [columns] => (1, columns),
            [rows, columns] => (rows, columns),
            _ => panic!("{:?}", self.dims),
        }
    }

    fn at(&self, row: usize, column: usize) -> f64 {
        let (rows, columns) = self.size();
        self.data[row.min(rows - 1) * columns + column.min(columns - 1)]
    }

    fn map(&self, f: impl Fn(f64) -> f64) -> Self {
        Self { dims: self.dims.clone(), data: self.data.iter().map(|&v| f(v)).collect() }
    }

    fn with(&self, other: &Self, f: impl Fn(f64, f64) -> f64) -> Self {
        let (a, b) = (self.size(), other.size());
        let fits = |a: usize, b: usize| a == b || a == 1 || b == 1;
        assert!(fits(a.0, b.0) && fits(a.1, b.1), "{a:?} with {b:?}");
        let (rows, columns) = (a.0.max(b.0), a.1.max(b.1));
        let value = |i: usize| {
            let (row, column) = (i / columns, i % columns);
            f(self.at(row, column), other.at(row, column))
        };
        Self::matrix(rows, columns, (0..rows * columns).map(value).collect())
    }
}

fn run(node: &NodeProto, inputs: &[&Array]) -> Array {
    let attribute = |name: &str| node.attribute.iter().find(|a| a.name == name).map(|a| a.i);
    let product = |a: &Array, b: &dyn Fn(usize, usize) -> f64, columns: usize| {
        let (rows, inner) = a.size();
        let value = |i: usize| (0..inner).map(|k| a.at(i / columns, k) * b(k, i % columns)).sum();
        Array::matrix(rows, columns, (0..rows * columns).map(value).collect())
    };
    match (node.op_type.as_str(), inputs) {
        ("Add", [a, b]) => a.with(b, |a, b| a + b),
        ("Sub", [a, b]) => a.with(b, |a, b| a - b),
        ("Mul", [a, b]) => a.with(b, |a, b| a * b),
        ("Div", [a, b]) => a.with(b, |a, b| a / b),
        // As onnxruntime, which lets no NaN pass for a number.
        ("Max", [a, b]) => a.with(b, |a, b| if a.is_nan() { a } else { a.max(b) }),
        ("Min", [a, b]) => a.with(b, |a, b| if a.is_nan() { a } else { a.min(b) }),
        ("IsNaN", [a]) => a.map(|v| f64::from(u8::from(v.is_nan()))),
        ("Less", [a, b]) => a.with(b, |a, b| f64::from(u8::from(a < b))),
        ("Where", [which, a, b]) => {
            let (a, b) = (
                which.with(a, |w, a| if w == 1.0 { a } else { 0.0 }),
                which.with(b, |w, b| if w == 0.0 { b } else { 0.0 }),
            );
            a.with(&b, |a, b| a + b)
        }
        ("Sin", [a]) => a.map(f64::sin),
        ("Sqrt", [a]) => a.map(f64::sqrt),
        ("Floor", [a]) => a.map(f64::floor),
        ("Sigmoid", [a]) => a.map(|v| 1.0 / (1.0 + (-v).exp())),
        ("Cast", [a]) => a.map(|v| v),
        ("Clip", [a, from, to]) => a.map(|v| v.clamp(from.data[0], to.data[0])),
        ("Reshape", [a, to]) if to.data == [-1.0] => Array { dims: vec![a.data.len()], data: a.data.clone() },
        ("MatMul", [a, b]) => product(a, &|k, column| b.at(k, column), b.size().1),
        ("Gemm", [a, b, bias]) => {
            assert_eq!((attribute("transB"), b.size().1), (Some(1), a.size().1));
            product(a, &|k, column| b.at(column, k), b.size().0).with(bias, |v, bias| v + bias)
        }
        ("ReduceSum", [a, axes]) if axes.data == [1.0] => {
            assert_eq!(attribute("keepdims"), Some(1));
            let (rows, columns) = a.size();
            Array::matrix(rows, 1, a.data.chunks_exact(columns).map(|row| row.iter().sum()).collect())
        }
        ("Concat", parts) if attribute("axis") == Some(1) => {
            let rows = parts[0].size().0;
            assert!(parts.iter().all(|p| p.size().0 == rows));
            let row = |row: usize| parts.iter().flat_map(move |p| (0..p.size().1).map(move |c| p.at(row, c)));
            let columns = parts.iter().map(|p| p.size().1).sum();
            Array::matrix(rows, columns, (0..rows).flat_map(row).collect())
        }
        ("Gather", [a, places]) => {
            let (rows, columns) = a.size();
            assert!(places.data.iter().all(|&p| p >= 0.0), "no row");
            let places: Vec<usize> = places.data.iter().map(|&p| p as usize).collect();
            if attribute("axis") == Some(1) {
                assert!(places.iter().all(|&p| p < columns));
                let row = |row: usize| places.iter().map(move |&p| a.at(row, p));
                return Array::matrix(rows, places.len(), (0..rows).flat_map(row).collect());
            }
            assert!(places.iter().all(|&p| p < rows));
            let data = places.iter().flat_map(|&p| (0..columns).map(move |c| a.at(p, c))).collect();
            Array::matrix(places.len(), columns, data)
        }
        (kind, inputs) => panic!("{kind} of {} inputs", inputs.len()),
    }
}

/// The overlaps of some poses by a field's graph.
fn answers(model: &ModelProto, poses: &[Pose]) -> Vec<f64> {
    let graph = model.graph.as_ref().unwrap();
    let origin = model.metadata_props.iter().find(|entry| entry.key == "imf.origin").unwrap();
    let origin: Vec<f64> = origin.value.split(' ').map(|v| v.parse().unwrap()).collect();
    let origin = DVec3::from_slice(&origin);
    let mut values: HashMap<&str, Array> =
        graph.initializer.iter().map(|t| (t.name.as_str(), Array::of_constant(t))).collect();
    assert_eq!(values.len(), graph.initializer.len(), "a constant's name is used twice");
    for input in &graph.input {
        let rows = poses.iter().flat_map(|pose| {
            let numbers = match input.name.as_str() {
                "position" => (pose.position - origin).as_vec3().to_array().to_vec(),
                // Any length.
                "direction" => (axis_of(pose.rotation).unwrap().as_vec3() * 3.0).to_array().to_vec(),
                "angles" => {
                    Orientation::from_direction(axis_of(pose.rotation).unwrap()).unwrap().angles().to_vec()
                }
                other => panic!("{other}"),
            };
            numbers.into_iter().map(f64::from)
        });
        let data: Vec<f64> = rows.collect();
        values.insert(&input.name, Array::matrix(poses.len(), data.len() / poses.len(), data));
    }
    for node in &graph.node {
        let inputs: Vec<&Array> = node.input.iter().map(|name| &values[name.as_str()]).collect();
        let found = run(node, &inputs);
        let [output] = &node.output[..] else { panic!() };
        assert!(values.insert(output, found).is_none(), "{output} is made twice");
    }
    let [output] = &graph.output[..] else { panic!() };
    let answer = &values[output.name.as_str()];
    let quantity = model.metadata_props.iter().find(|entry| entry.key == "imf.quantity").unwrap();
    assert_eq!((&output.name, answer.dims.as_slice()), (&quantity.value, &[poses.len()][..]));
    answer.data.clone()
}

/// A field of each family.
fn one_of_each(scene: &Scene, factored: FactoredFile) -> [FieldFile; 3] {
    [
        FieldFile::Siren(Box::new(siren_model(scene))),
        FieldFile::Harmonic(Arc::new(harmonic_file(scene, 4))),
        FieldFile::Factored(Box::new(factored)),
    ]
}

/// The field evaluates in single precision, its networks with sums of some tens of products.
const ROUNDING: f64 = 2e-5;

/// The field's own values, which the graph's are held against.
fn agreed(graph: &ModelProto, field: &Field, asked: &[Pose]) -> Vec<f32> {
    let mut expected = vec![0.0; asked.len()];
    field.values(asked, &mut expected).unwrap();
    for ((found, &expected), pose) in answers(graph, asked).iter().zip(&expected).zip(asked) {
        let (name, apart) = (&graph.graph.as_ref().unwrap().name, (found - f64::from(expected)).abs());
        assert!(apart < ROUNDING, "{name}, {pose:?}: {found} against {expected}");
    }
    expected
}

#[test]
fn graphs_of_every_family_answer_as_the_fields_do() {
    let scene = scene(&Tool::paper(), 0.0);
    // As if its values were depths, below 0 too.
    let mut deep = factored_file(&scene);
    deep.field.quantity = Quantity::Depth;
    let mut deep_harmonic = harmonic_file(&scene, 7);
    deep_harmonic.field.quantity = Quantity::Depth;
    let mut folded = factored_file(&scene);
    folded.field = folded.field.folded();
    assert!(folded.field.shape.folded);
    let mut asked = poses(&scene, 200, 21);
    // Vertical, where the paper's network does not read θ.
    for (turn, pose) in (0..).zip(&mut asked[..6]) {
        let down = DQuat::from_rotation_x(f64::from(turn % 2) * std::f64::consts::PI);
        pose.rotation = down * DQuat::from_rotation_z(f64::from(turn));
    }
    for saved in [
        FieldFile::Factored(Box::new(folded)),
        FieldFile::Harmonic(Arc::new(deep_harmonic)),
        FieldFile::Factored(Box::new(deep)),
        FieldFile::Siren(Box::new(siren_model(&scene))),
        FieldFile::Harmonic(Arc::new(harmonic_file(&scene, 7))),
        FieldFile::Harmonic(Arc::new(harmonic_in_halves(&scene, 7))),
        FieldFile::Factored(Box::new(FactoredFile {
            calibration: Some(calibration(0.125, 0.25)),
            ..factored_file(&scene)
        })),
    ] {
        let threshold = saved.calibration().and_then(|known| known.free_up_to);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("field.onnx");
        write_onnx(&saved, &path).unwrap();
        let model = ModelProto::decode(std::fs::read(&path).unwrap().as_slice()).unwrap();
        assert_eq!((model.ir_version, model.opset_import[0].version), (8, 17));
        let expected = agreed(&model, &Field::new(saved).unwrap(), &asked);
        let name = &model.graph.as_ref().unwrap().name;
        assert!(expected.iter().any(|v| *v > 0.05), "{name} answers more than nothing");
        let output = &model.graph.as_ref().unwrap().output[0].name;
        assert_eq!(expected.iter().any(|v| *v < 0.0), output == "depth", "{name}: {output}");
        let said = |key: &str| model.metadata_props.iter().find(|entry| entry.key == key);
        assert_eq!(said("imf.unit").unwrap().value, "mm");
        let free_up_to = said("imf.free_up_to").map(|entry| entry.value.parse::<f32>().unwrap());
        assert_eq!(free_up_to, threshold);
    }
}

#[test]
fn graphs_of_fields_with_symmetry_answer_as_the_fields_do() {
    let scene = scene(&Tool::paper(), 0.0);
    let grid = scene.record.grid;
    // What single precision holds, so that graph and field agree about which side a position is on.
    let middle = (grid.origin + 0.45 * grid.size()).as_vec3().as_dvec3();
    for symmetry in symmetries(middle) {
        let saved = FieldFile::Factored(Box::new(with_symmetry(&scene, symmetry)));
        let mut asked = poses(&scene, 200, 23);
        // On the axis and the planes, in directions at the poles of every axis.
        for (pose, axis) in
            asked.iter_mut().zip([DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z])
        {
            *pose = Pose::along(middle, axis);
        }
        for (index, pose) in asked[6..12].iter_mut().enumerate() {
            pose.position[index % 3] = middle[index % 3];
        }
        let expected = agreed(&model(&saved).unwrap(), &Field::new(saved).unwrap(), &asked);
        assert!(expected.iter().any(|v| *v > 0.05 && *v < 0.95), "{symmetry}: answers more than nothing");
    }
}

#[test]
fn positions_outside_are_answered_by_every_graph_as_at_the_nearest_inside() {
    let scene = scene(&Tool::paper(), 0.0);
    let grid = scene.record.grid;
    let through = grid.origin + 0.45 * grid.size();
    let symmetry =
        Symmetry { mirrors: [Some(through.x), None, None], axis: Some(Axis { along: 2, through }) };
    let reduced = with_symmetry(&scene, symmetry);
    let mut deep = factored_file(&scene);
    deep.field.quantity = Quantity::Depth;
    // Less than half a voxel outside, and far from all.
    let inside = poses(&scene, 60, 22);
    let mut asked = inside.clone();
    let [low, high] = grid.box_of_centres();
    for (index, pose) in asked.iter_mut().enumerate() {
        let (axis, room) = (index % 3, [0.4 * grid.pitch, 1e4][index / 3 % 2]);
        pose.position[axis] = if index % 4 < 2 { low[axis] - room } else { high[axis] + room };
    }
    let more = [deep, reduced].map(|file| FieldFile::Factored(Box::new(file)));
    for saved in one_of_each(&scene, factored_file(&scene)).into_iter().chain(more) {
        let graph = model(&saved).unwrap();
        let name = graph.graph.as_ref().unwrap().name.clone();
        let nearest: Vec<Pose> =
            asked.iter().map(|pose| Pose { position: pose.position.clamp(low, high), ..*pose }).collect();
        let field = Field::new(saved).unwrap();
        agreed(&graph, &field, &asked);
        let mut at_nearest = vec![0.0; asked.len()];
        field.values(&nearest, &mut at_nearest).unwrap();
        let (found, moved) = (answers(&graph, &asked), answers(&graph, &inside));
        let mut pairs = found.iter().zip(&at_nearest);
        assert!(pairs.all(|(found, &value)| (found - f64::from(value)).abs() < ROUNDING), "{name}");
        assert!(moved.iter().zip(&found).any(|(a, b)| (a - b).abs() > 1e-3), "{name} varies in space");
    }
}

#[test]
fn an_invalid_position_is_nan_in_its_own_row_alone() {
    let scene = scene(&Tool::paper(), 0.0);
    for saved in one_of_each(&scene, factored_file(&scene)) {
        let graph = model(&saved).unwrap();
        let name = graph.graph.as_ref().unwrap().name.clone();
        let mut asked = poses(&scene, 9, 25);
        let expected = answers(&graph, &asked);
        asked[3].position.y = f64::NAN;
        asked[6].position.x = f64::INFINITY;
        for (row, (found, expected)) in answers(&graph, &asked).iter().zip(&expected).enumerate() {
            if row == 3 || row == 6 {
                assert!(found.is_nan(), "{name}, {row}: {found}");
            } else {
                assert_eq!(found, expected, "{name}, {row}");
            }
        }
    }
}

#[test]
fn a_part_far_from_zero_loses_no_digits() {
    let near = scene(&Tool::paper(), 0.0);
    // Far enough for single precision to know whole millimetres alone.
    let away = DVec3::new(1.0e7, -2.0e7, 3.0e7);
    let middle = near.record.grid.origin + 0.45 * near.record.grid.size();
    let moved = |mut saved: FieldFile| {
        match &mut saved {
            FieldFile::Siren(model) => model.scene.record.grid.origin += away,
            FieldFile::Harmonic(file) => {
                let file = Arc::make_mut(file);
                file.field.grid.origin += away;
                file.scene.record.grid.origin += away;
            }
            FieldFile::Factored(file) => {
                file.field.grid.origin += away;
                file.scene.record.grid.origin += away;
                file.field.shape.symmetry = file.field.shape.symmetry.less(-away);
            }
        }
        saved
    };
    let symmetry =
        Symmetry { mirrors: [Some(middle.x), None, None], axis: Some(Axis { along: 2, through: middle }) };
    let asked = poses(&near, 60, 26);
    let there: Vec<Pose> =
        asked.iter().map(|pose| Pose { position: pose.position + away, ..*pose }).collect();
    for saved in one_of_each(&near, with_symmetry(&near, symmetry)) {
        let expected = answers(&model(&saved).unwrap(), &asked);
        let graph = model(&moved(saved)).unwrap();
        let name = graph.graph.as_ref().unwrap().name.clone();
        for (found, expected) in answers(&graph, &there).iter().zip(&expected) {
            assert!((found - expected).abs() < ROUNDING, "{name}: {found} against {expected}");
        }
    }
}

#[test]
fn functions_of_rotations_are_refused() {
    let cube = imf_core::mesh::Mesh::cuboid(DVec3::ZERO, DVec3::splat(9.0));
    let scene = scene(&Tool { shape: ToolShape::Mesh(cube), ..Tool::paper() }, 0.0);
    let saved = FieldFile::Harmonic(Arc::new(harmonic_file(&scene, 1)));
    let error = model(&saved).unwrap_err();
    assert!(matches!(error, OnnxError::Rotations("harmonic")), "{error}");
    assert!(error.to_string().starts_with("a harmonic field"), "{error}");
}
