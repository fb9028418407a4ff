//! Fields of random numbers over a coarse teapot, one of every family.

use std::sync::Arc;

use imf_core::parts::ReferencePart;
use imf_core::scene::{Scene, SceneSpec};
use imf_core::section::Quantity;
use imf_core::tool::Tool;
use imf_fields::factored::{Axis, DistillSettings, FactoredField, FactoredShape, Symmetry};
use imf_fields::file::FieldFile;
use imf_fields::harmonic::HarmonicField;
use imf_fields::harmonic::basis::{Basis, Domain};
use imf_fields::harmonic::coefficients::{Coefficients, StoragePrecision};
use imf_fields::recipe::TrainingState;
use imf_fields::siren::SirenShape;

/// Numbers in [−1, 1] without order.
fn number(place: usize) -> f32 {
    (place as f32 * 0.754_878).fract() * 2.0 - 1.0
}

/// What stands in a stored file beside the field itself.
macro_rules! stored {
    ($name:literal) => {
        FieldFile::from_bytes(include_bytes!(concat!("../../../../fuzz/corpus/field/", $name)), $name)
            .expect("a field")
    };
}

/// A field's file.
pub(crate) struct Case {
    pub(crate) name: &'static str,
    pub(crate) bytes: Vec<u8>,
    /// Whether it has a network, which a graphics card takes.
    pub(crate) has_network: bool,
    /// What minima are taken over: more than a graphics card takes together, or few where a network runs for each.
    pub(crate) over: &'static str,
}

pub(crate) fn all() -> Vec<Case> {
    let (mesh, tool) = (ReferencePart::Teapot.mesh(), Tool::paper());
    // 8835 voxels: more than two passes, and no whole number of tiles.
    let spec = SceneSpec::of_reference(ReferencePart::Teapot, &mesh, [15, 19, 31], &tool);
    let scene = spec.scene().expect("a scene");
    let middle = scene.record.grid.centre([7, 9, 15]);
    let gear =
        Symmetry { mirrors: [None, Some(middle.y), None], axis: Some(Axis { along: 2, through: middle }) };
    let mirrored = Symmetry { mirrors: [Some(middle.x), None, Some(middle.z)], axis: None };
    let case = |name, bytes, over| Case { name, bytes, has_network: name != "harmonic", over };
    vec![
        case("the paper's network", siren(&scene), "fibonacci:5"),
        case("factored", factored(&scene, Symmetry::default(), false), "fibonacci:601"),
        case("factored, folded", factored(&scene, Symmetry::default(), true), "fibonacci:9"),
        case("factored, of an axis", factored(&scene, gear, false), "fibonacci:9"),
        case("factored, mirrored", factored(&scene, mirrored, true), "fibonacci:9"),
        case("harmonic", harmonic(&scene), "fibonacci:9"),
    ]
}

fn bytes(file: &FieldFile) -> Vec<u8> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("field.safetensors");
    file.write(&path).expect("written");
    std::fs::read(path).expect("read")
}

fn siren(scene: &Scene) -> Vec<u8> {
    let FieldFile::Siren(mut model) = stored!("siren") else { panic!("another family") };
    // A width that is not a whole number of tiles, and the skip.
    model.shape = SirenShape { width: 70, hidden: 4, skip_after: Some(2), omega: 10.0 };
    model.state = TrainingState::new(&model.shape, 4);
    model.scene = scene.clone();
    bytes(&FieldFile::Siren(model))
}

const DEGREE: usize = 5;

fn functions(components: usize) -> (Basis, Vec<f32>, Vec<f32>) {
    let basis = Basis::new(Domain::Directions, DEGREE);
    let mean = (0..basis.len()).map(|k| if k == 0 { 0.5 } else { 0.1 * number(k) / k as f32 }).collect();
    let components = (0..basis.len() * components).map(|place| number(place + 1) / 6.0).collect();
    (basis, mean, components)
}

fn factored(scene: &Scene, symmetry: Symmetry, folded: bool) -> Vec<u8> {
    let FieldFile::Factored(mut file) = stored!("factored") else { panic!("another family") };
    let components = Basis::count(Domain::Directions, DEGREE);
    let shape = FactoredShape { width: 44, hidden: 3, omega: 10.0, components, folded: false, symmetry };
    let (basis, mean, components) = functions(shape.components);
    let (quantity, grid) = (Quantity::Overlap, scene.record.grid);
    let parameters = shape.initial_parameters(3);
    let field = FactoredField { quantity, grid, basis, components, mean, shape, parameters, scale: 0.7 };
    file.field = if folded { field.fold() } else { field };
    // As `imf train` has it: more than a browser's 32 bits count.
    (file.fit.components, file.fit.degree) = (usize::MAX, DEGREE);
    file.settings = DistillSettings { width: 44, hidden: 3, omega: 10.0, symmetry, ..file.settings };
    file.state = None;
    file.scene = scene.clone();
    bytes(&FieldFile::Factored(file))
}

fn harmonic(scene: &Scene) -> Vec<u8> {
    let FieldFile::Harmonic(file) = stored!("harmonic") else { panic!("another family") };
    let mut file = Arc::unwrap_or_clone(file);
    let (basis, mean, components) = functions(6);
    let (quantity, grid) = (Quantity::Overlap, scene.record.grid);
    let values = (0..6 * grid.len()).map(|place| 0.3 * number(place)).collect();
    let coefficients = Coefficients::new(values, StoragePrecision::F32);
    (file.settings.components, file.settings.degree, file.settings.precision) =
        (6, DEGREE, StoragePrecision::F32);
    file.field = HarmonicField { quantity, grid, basis, components, mean, coefficients, ..file.field };
    file.scene = scene.clone();
    bytes(&FieldFile::Harmonic(file.into()))
}
