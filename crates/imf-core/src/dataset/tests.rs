//! A small dataset made, interrupted, damaged and read.

use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use glam::{DMat4, DVec3};

use super::*;
use crate::grid::Grid;
use crate::occupancy::Occupancy;
use crate::scene::SceneRecord;
use crate::section::sections;
use crate::tool::Tool;
use crate::unit::LengthUnit;

fn scene() -> Scene {
    let grid = Grid { origin: DVec3::ZERO, pitch: 8.0, dims: [9, 10, 11] };
    let solid = (0..grid.len()).map(|i| u8::from(i % 7 < 3)).collect();
    let obstacle = Occupancy { grid, solid };
    let record = SceneRecord {
        part: "test".into(),
        unit: LengthUnit::Mm,
        transform: DMat4::IDENTITY,
        grid,
        margin: 0,
        conservative: false,
        closed: true,
        tool: Tool::paper(),
        clearance: crate::tool::Clearance::default(),
        ungrown: None,
        fixtures: Vec::new(),
        obstacle_crc32: crc32fast::hash(&obstacle.packed()),
    };
    Scene::from_union(record, obstacle)
}

fn make(folder: &Path) -> Result<Generated, DatasetError> {
    generate(
        folder,
        &scene(),
        &OrientationSet::parse("fibonacci:12").unwrap(),
        &Sampling::default(),
        Control::quiet(),
    )
}

#[test]
fn samples_are_values_of_the_exact_sections() {
    let folder = tempfile::tempdir().unwrap();
    let generated = make(folder.path()).unwrap();
    let (manifest, read_scene, samples) = load(folder.path()).unwrap();
    assert_eq!(read_scene, scene());
    assert_eq!(samples.len() as u64, generated.samples);
    let plan = SectionPlan::new(&scene().obstacle, &scene().record.tool).unwrap();
    let exact = sections(&plan, &manifest.orientations.orientations, Control::quiet()).unwrap();
    for (section, cmf) in exact.iter().enumerate() {
        let range = samples.starts[section]..samples.starts[section + 1];
        assert_eq!(range.len(), (cmf.len() as f64 * 0.35).round() as usize);
        for sample in range {
            assert_eq!(samples.values[sample], cmf[samples.voxels[sample] as usize]);
            let (input, target) = samples.sample(sample);
            assert_eq!(target, samples.values[sample]);
            assert_eq!(input[3], manifest.orientations.orientations[section].theta as f32 / 180.0 - 1.0);
        }
    }
}

#[test]
fn an_interrupted_dataset_goes_on_and_is_the_same() {
    let (whole, broken) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    make(whole.path()).unwrap();
    let stop = AtomicBool::new(false);
    let seen = AtomicU64::new(0);
    let progress = |n| {
        if seen.fetch_add(n, Ordering::Relaxed) > 3 {
            stop.store(true, Ordering::Relaxed);
        }
    };
    let set = OrientationSet::parse("fibonacci:12").unwrap();
    let control = Control { progress: &progress, cancelled: &stop };
    let error = generate(broken.path(), &scene(), &set, &Sampling::default(), control).unwrap_err();
    assert!(matches!(error, DatasetError::Section(crate::section::SectionError::Cancelled)));
    assert!(matches!(load(broken.path()), Err(DatasetError::Unfinished { .. })));
    make(broken.path()).unwrap();
    assert_eq!(load(whole.path()).unwrap().2, load(broken.path()).unwrap().2);
    // Nothing is left to do, and nothing is done again.
    assert_eq!(make(broken.path()).unwrap().made, 0);
}

#[test]
fn other_scenes_and_damage_are_noticed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    make(path).unwrap();
    let set = OrientationSet::parse("fibonacci:13").unwrap();
    let other = generate(path, &scene(), &set, &Sampling::default(), Control::quiet()).unwrap_err();
    assert!(other.to_string().contains("orientation set differs"), "{other}");

    let shard = path.join("shard-00000.safetensors");
    let bytes = std::fs::read(&shard).unwrap();
    std::fs::write(&shard, &bytes[..bytes.len() / 2]).unwrap();
    let error = load(path).unwrap_err().to_string();
    assert!(error.contains("shard-00000") && error.contains("checksum"), "{error}");
    // Making it again repairs what is damaged.
    assert_eq!(make(path).unwrap().made, 1);
    assert_eq!(std::fs::read(&shard).unwrap(), bytes);

    let manifest = std::fs::read_to_string(path.join("manifest.json")).unwrap();
    std::fs::write(path.join("manifest.json"), manifest.replace("\"version\": 1", "\"version\": 9")).unwrap();
    assert!(matches!(load(path), Err(DatasetError::Newer { found: 9, .. })));
    std::fs::write(path.join("manifest.json"), "{}").unwrap();
    assert!(matches!(load(path), Err(DatasetError::Damaged { .. })));
    assert!(matches!(load(&path.join("nowhere")), Err(DatasetError::Read { .. })));
}
