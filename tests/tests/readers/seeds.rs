//! Binary files to begin from, written by the library of today: a small field of every family and precision, and a dataset.

use std::fs;
use std::sync::Arc;

use glam::{DMat4, DVec3};
use imf_core::control::Control;
use imf_core::grid::Grid;
use imf_core::occupancy::Occupancy;
use imf_core::orientation::OrientationSet;
use imf_core::scene::{Scene, SceneRecord};
use imf_core::tool::{Clearance, Tool};
use imf_core::unit::LengthUnit;
use imf_fields::factored::file::FactoredFile;
use imf_fields::factored::{DistillSettings, FactoredState};
use imf_fields::file::FieldFile;
use imf_fields::harmonic::FitSettings;
use imf_fields::harmonic::coefficients::{Coefficients, StoragePrecision};
use imf_fields::harmonic::file::HarmonicFile;
use imf_fields::model::{Model, TrainingRecord};
use imf_fields::recipe::{Sampling, TrainingState};
use imf_fields::siren::SirenShape;
use imf_tests::readers::NEXT_FILE;
use imf_train::dataset;

/// A file that its reader accepts.
pub(crate) struct Seed {
    pub(crate) reader: &'static str,
    pub(crate) name: &'static str,
    pub(crate) bytes: Vec<u8>,
}

/// Every field and the dataset.
pub(crate) fn all() -> Vec<Seed> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("field");
    let scene = scene();
    let mut seeds = Vec::new();
    for (name, file) in fields(&scene) {
        file.write(&path).unwrap();
        seeds.push(Seed { reader: "field", name, bytes: fs::read(&path).unwrap() });
    }
    let (folder, set) = (folder.path().join("dataset"), OrientationSet::parse("fibonacci:3").unwrap());
    dataset::generate(&folder, &scene, &set, &Sampling::default(), Control::quiet()).unwrap();
    let files = ["manifest.json", "obstacle.safetensors", "shard-00000.safetensors"];
    let files = files.map(|name| fs::read(folder.join(name)).unwrap());
    seeds.push(Seed { reader: "dataset", name: "three-sections", bytes: files.join(NEXT_FILE) });
    seeds
}

/// A pattern of solid voxels, and the paper's tool.
fn scene() -> Scene {
    let grid = Grid { origin: DVec3::ZERO, pitch: 8.0, dims: [3, 4, 3] };
    let solid = (0..grid.len()).map(|i| u8::from(i % 7 < 3)).collect();
    let obstacle = Occupancy { grid, solid };
    let obstacle_crc32 = crc32fast::hash(&obstacle.packed());
    let record = SceneRecord {
        part: "seed".into(),
        unit: LengthUnit::Mm,
        transform: DMat4::IDENTITY,
        grid,
        margin: 0,
        conservative: false,
        closed: true,
        tool: Tool::paper(),
        clearance: Clearance::default(),
        bare_tool: None,
        fixtures: Vec::new(),
        contact: None,
        obstacle_crc32,
    };
    Scene { record, obstacle, layer: None }
}

fn fields(scene: &Scene) -> Vec<(&'static str, FieldFile)> {
    let settings = FitSettings {
        degree: 3,
        sections_per_function: 1.5,
        components: 6,
        sample: 30,
        held_out: 2,
        precision: StoragePrecision::F32,
        ..FitSettings::default()
    };
    let harmonic = HarmonicFile::fit(scene, &settings, Control::quiet()).unwrap();
    let mut halves = harmonic.clone();
    if let Coefficients::F32(values) = halves.field.coefficients {
        halves.field.coefficients = Coefficients::new(values, StoragePrecision::F16);
    }
    halves.settings.precision = StoragePrecision::F16;

    let settings = DistillSettings { width: 6, hidden: 2, omega: 6.0, ..DistillSettings::default() };
    let shape = settings.shape(harmonic.field.component_count());
    let state = FactoredState::new(&shape, 4);
    let checkpoint = FactoredFile::distilled(&harmonic, settings, state).unwrap();
    let factored = FactoredFile { state: None, ..checkpoint.clone() };
    let finished = factored.clone().finished(StoragePrecision::F16);

    let shape = SirenShape { width: 6, hidden: 3, omega: 3.0, ..SirenShape::default() };
    let orientations = OrientationSet::parse("fibonacci:3").unwrap();
    let record = TrainingRecord { finished: true, ..TrainingRecord::untrained(orientations) };
    let state = TrainingState::new(&shape, 3);
    let model = Model { shape, scene: scene.clone(), record, state, calibration: None };
    vec![
        ("harmonic", FieldFile::Harmonic(Arc::new(harmonic))),
        ("halves", FieldFile::Harmonic(Arc::new(halves))),
        ("factored", FieldFile::Factored(Box::new(factored))),
        ("checkpoint", FieldFile::Factored(Box::new(checkpoint))),
        ("finished", FieldFile::Factored(Box::new(finished))),
        ("siren", FieldFile::Siren(Box::new(model.clone()))),
        ("weights", FieldFile::Siren(Box::new(model.without_moments()))),
    ]
}
