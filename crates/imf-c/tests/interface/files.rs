//! Small fields on disk, and poses around them.

use std::path::{Path, PathBuf};

use imf_core::control::Control;
use imf_core::glam::DVec3;
use imf_core::mesh::Mesh;
use imf_core::orientation::OrientationSet;
use imf_core::parts::ReferencePart;
use imf_core::scene::{Scene, SceneSpec};
use imf_core::section::Quantity;
use imf_core::tool::{Clearance, Tool};
use imf_fields::harmonic::FitSettings;
use imf_fields::harmonic::coefficients::StoragePrecision;
use imf_fields::harmonic::file::HarmonicFile;
use imf_fields::model::{Model, TrainingRecord};
use imf_fields::recipe::TrainingState;
use imf_fields::siren::SirenShape;

/// Voxels of [`scene`]: few for Miri, which takes a thousand times as long.
pub(crate) const DIMS: [usize; 3] = if cfg!(miri) { [3, 6, 5] } else { [8, 24, 15] };

/// How many of `count` poses or points Miri sees.
pub(crate) fn some(count: usize) -> usize {
    if cfg!(miri) { count.min(24) } else { count }
}

/// A coarse bracket (for Miri a block) with a tool that is offset by a clearance of a pitch.
pub(crate) fn scene() -> Scene {
    // Miri takes minutes to read the bracket.
    let block = || Mesh::cuboid(DVec3::ZERO, DVec3::new(50.0, 147.0, 87.0));
    let mesh = if cfg!(miri) { block() } else { ReferencePart::Bracket.mesh() };
    let tool = Tool::paper();
    let spec = SceneSpec::of_reference(ReferencePart::Bracket, &mesh, DIMS, &tool);
    let scene = spec.scene().unwrap();
    let room = scene.record.grid.pitch;
    scene.with_clearance(&Clearance { holder: room, shank: room, cutter: room }).unwrap()
}

/// A harmonic field of the scene's overlaps.
pub(crate) fn harmonic(scene: &Scene, folder: &Path) -> PathBuf {
    harmonic_of(Quantity::Overlap, scene, folder)
}

/// A harmonic field of the scene.
pub(crate) fn harmonic_of(quantity: Quantity, scene: &Scene, folder: &Path) -> PathBuf {
    let settings = FitSettings {
        quantity,
        degree: if cfg!(miri) { 1 } else { 5 },
        sections_per_function: 1.5,
        components: if cfg!(miri) { 3 } else { 20 },
        sample: some(500),
        held_out: 2,
        precision: StoragePrecision::F32,
        ..FitSettings::default()
    };
    let path = folder.join(format!("harmonic-{quantity:?}.safetensors"));
    HarmonicFile::fit(scene, &settings, Control::quiet()).unwrap().write(&path).unwrap();
    path
}

/// A network of the paper's kind with its starting weights.
pub(crate) fn siren(scene: &Scene, folder: &Path) -> PathBuf {
    let shape = SirenShape { width: if cfg!(miri) { 17 } else { 33 }, hidden: 3, ..SirenShape::paper() };
    let orientations = OrientationSet::parse("fibonacci:3").unwrap();
    let record = TrainingRecord { finished: true, ..TrainingRecord::untrained(orientations) };
    let state = TrainingState::new(&shape, 3);
    let path = folder.join("siren.safetensors");
    Model { shape, scene: scene.clone(), record, state, calibration: None }.write(&path).unwrap();
    path
}

/// Tips and axes spread over the grid's box and a little beyond.
pub(crate) fn spread(scene: &Scene, count: usize) -> Vec<(DVec3, DVec3)> {
    let grid = scene.record.grid;
    let at = |i: usize| {
        let share = |prime: usize| (i * prime % 701) as f64 / 701.0;
        let unit = DVec3::new(share(37), share(53), share(71)) * 1.1 - 0.05;
        let axis = DVec3::new(share(11) - 0.5, share(13) - 0.5, share(17) - 0.4);
        (grid.origin + unit * grid.size(), axis)
    };
    (0..count).map(at).collect()
}
