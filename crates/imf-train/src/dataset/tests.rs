//! A small dataset made, interrupted, damaged and read.

use std::path::Path;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use super::manifest::{BEHIND_CHECKSUM, sealed};
use super::*;
use crate::fixtures::{on_threads, scene};
use imf_core::section::sections;

fn make(folder: &Path) -> Result<GenerateSummary, DatasetError> {
    let set = OrientationSet::parse("fibonacci:12").unwrap();
    generate(folder, &scene(), &set, &Sampling::default(), Control::quiet())
}

#[test]
fn samples_are_values_of_the_exact_sections() {
    let folder = tempfile::tempdir().unwrap();
    let generated = make(folder.path()).unwrap();
    let (manifest, read_scene, samples) = load(folder.path()).unwrap();
    assert_eq!(read_scene, scene());
    assert_eq!(samples.len() as u64, generated.samples);
    let plan = SectionPlan::new(&scene().obstacle, &scene().record.tool, ToolPoints::SharpPoints).unwrap();
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
fn threads_change_no_byte() {
    let files = |threads: usize| {
        let folder = tempfile::tempdir().unwrap();
        on_threads(threads, || make(folder.path())).unwrap();
        contents(folder.path())
    };
    let one = files(1);
    assert_eq!(one.len(), 3, "manifest, obstacle, one shard");
    assert!(files(3) == one, "three threads wrote other files");
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
    assert!(matches!(error, DatasetError::Section(imf_core::section::SectionError::Cancelled(_))));
    assert!(matches!(load(broken.path()), Err(DatasetError::Unfinished { .. })));
    make(broken.path()).unwrap();
    assert_eq!(load(whole.path()).unwrap().2, load(broken.path()).unwrap().2);
    // The obstacle too is made again where it is damaged or gone.
    let obstacle = broken.path().join("obstacle.safetensors");
    std::fs::write(&obstacle, b"half").unwrap();
    assert!(load(broken.path()).is_err());
    make(broken.path()).unwrap();
    std::fs::remove_file(&obstacle).unwrap();
    make(broken.path()).unwrap();
    assert_eq!(load(whole.path()).unwrap().1, load(broken.path()).unwrap().1);
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
    assert!(error.contains("shard-00000") && error.contains("cut short"), "{error}");
    // Making it again repairs what is damaged.
    assert_eq!(make(path).unwrap().made, 1);
    assert_eq!(std::fs::read(&shard).unwrap(), bytes);

    let manifest = std::fs::read_to_string(path.join("manifest.json")).unwrap();
    std::fs::write(path.join("manifest.json"), manifest.replace("\"version\": 1", "\"version\": 9")).unwrap();
    assert!(matches!(load(path), Err(DatasetError::Newer { found: 9, .. })));
    // One digit of a direction.
    let changed = manifest.replacen("\"phi\": ", "\"phi\": 1", 1);
    assert_ne!(changed, manifest);
    std::fs::write(path.join("manifest.json"), changed).unwrap();
    let error = load(path).unwrap_err().to_string();
    assert!(error.contains("manifest.json") && error.contains("checksum"), "{error}");
    std::fs::write(path.join("manifest.json"), "{}").unwrap();
    assert!(matches!(load(path), Err(DatasetError::Damaged { .. })));
    assert!(matches!(load(&path.join("nowhere")), Err(DatasetError::Read { .. })));
}

/// Four shards of three sections each.
fn make_partition(folder: &Path, partition: Option<&str>) -> GenerateSummary {
    let set = OrientationSet::parse("fibonacci:12").unwrap();
    let partition = partition.map(|text| text.parse().unwrap());
    let layout = Layout { shard_samples: Some(3 * 347), partition };
    let (made, passed) = (AtomicU64::new(0), AtomicU64::new(0));
    let counts = |sum: &AtomicU64, sections| sum.fetch_add(sections, Ordering::Relaxed);
    let progress = |sections| _ = counts(&made, sections);
    let control = Control { progress: &progress, ..Control::quiet() };
    let passed_over = |sections| _ = counts(&passed, sections);
    let generated =
        generate_partition(folder, &scene(), &set, &Sampling::default(), &layout, control, &passed_over)
            .unwrap();
    assert_eq!(made.into_inner(), 3 * generated.made as u64);
    assert_eq!(passed.into_inner(), 3 * (generated.kept + generated.others) as u64);
    generated
}

fn contents(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    let name = |path: &Path| path.file_name().unwrap().to_string_lossy().into_owned();
    let mut files: Vec<_> = entries.map(|path| (name(&path), std::fs::read(&path).unwrap())).collect();
    files.sort();
    files
}

#[test]
fn shares_joined_are_the_dataset_made_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    make_partition(&at("whole"), None);
    assert_eq!(contents(&at("whole")).len(), 6, "manifest, obstacle, four shards");
    for (partition, name, made) in [("1/3", "a", 2), ("2/3", "b", 1), ("3/3", "c", 1)] {
        let generated = make_partition(&at(name), Some(partition));
        assert_eq!((generated.made, generated.others), (made, 4 - made));
        assert!(matches!(load(&at(name)), Err(DatasetError::Partitions { manifests: 1, .. })));
    }
    // Something is missing first, then it comes.
    let merged = merge(&at("out"), &[at("a"), at("c")], Control::quiet()).unwrap();
    assert_eq!((merged.copied, &merged.missing[..]), (3, &[1][..]));
    assert_eq!(merged.manifest.sections_of(1), [1, 5, 9]);
    assert!(matches!(load(&at("out")), Err(DatasetError::Unfinished { missing: 1, shards: 4, .. })));
    let merged = merge(&at("out"), &[at("b")], Control::quiet()).unwrap();
    assert_eq!((merged.copied, merged.kept, merged.missing.len()), (1, 3, 0));
    assert!(contents(&at("out")) == contents(&at("whole")));

    // All partitions in one folder, joined where they are.
    for partition in ["2/3", "3/3", "1/3"] {
        make_partition(&at("together"), Some(partition));
    }
    let merged = merge(&at("together"), &[], Control::quiet()).unwrap();
    assert_eq!((merged.copied, merged.kept), (0, 4));
    assert!(contents(&at("together")) == contents(&at("whole")));

    // A partition that finds an unfinished whole makes what is missing of it alone.
    std::fs::create_dir(at("rest")).unwrap();
    for (name, bytes) in contents(&at("whole")) {
        std::fs::write(at("rest").join(name), bytes).unwrap();
    }
    std::fs::remove_file(at("rest/shard-00002.safetensors")).unwrap();
    assert_eq!(make_partition(&at("rest"), Some("3/4")).made, 1);
    assert_eq!(make_partition(&at("rest"), Some("1/4")).made, 0);
}

#[test]
fn what_cannot_be_joined_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    make_partition(&at("a"), Some("1/2"));
    make_partition(&at("b"), Some("2/2"));
    make(&at("other")).unwrap();
    let join = |names: &[&str]| {
        let folders: Vec<_> = names.iter().map(|name| at(name)).collect();
        merge(&at("out"), &folders, Control::quiet())
    };
    let error = join(&["a", "other"]).unwrap_err().to_string();
    assert!(error.contains("samples in a shard differs"), "{error}");
    let error = join(&["a", "nowhere"]).unwrap_err().to_string();
    assert!(error.contains("nowhere") && error.contains("manifest.json"), "{error}");
    assert!(join(&[]).is_err());
    assert!(!at("out").exists(), "a refusal left a folder behind");

    // A damaged shard counts as missing and is named.
    let shard = at("b").join("shard-00001.safetensors");
    let bytes = std::fs::read(&shard).unwrap();
    let mut flipped = bytes.clone();
    *flipped.last_mut().unwrap() ^= 1;
    std::fs::write(&shard, &flipped).unwrap();
    let merged = join(&["a", "b"]).unwrap();
    assert_eq!(merged.missing, [1]);
    assert!(merged.damaged.len() == 1 && merged.damaged[0].contains("shard-00001"), "{:?}", merged.damaged);

    // Two machines that disagree are not averaged.
    std::fs::write(&shard, &bytes).unwrap();
    let books = at("b").join("manifest.2-of-2.json");
    let text = std::fs::read_to_string(&books).unwrap();
    join(&["a", "b"]).unwrap();
    let crc = crc32fast::hash(&bytes).to_string();
    std::fs::write(&books, sealed(&text[BEHIND_CHECKSUM..].replace(&crc, "12345"))).unwrap();
    let error = join(&["a", "b"]).unwrap_err();
    assert!(matches!(error, DatasetError::Disagree { .. }), "{error}");
}

#[test]
fn no_shard_of_another_dataset_in_the_folder_is_replaced() {
    let set = OrientationSet::parse("fibonacci:12").unwrap();
    let generated = |folder: &Path, seed, partition: Option<&str>| {
        let layout =
            Layout { shard_samples: Some(3 * 347), partition: partition.map(|p| p.parse().unwrap()) };
        let sampling = Sampling { seed, ..Sampling::default() };
        generate_partition(folder, &scene(), &set, &sampling, &layout, Control::quiet(), &|_| {})
    };
    for (first, then) in [(Some("2/2"), None), (None, Some("1/2")), (Some("1/3"), Some("1/2"))] {
        let folder = tempfile::tempdir().unwrap();
        generated(folder.path(), 0, first).unwrap();
        let made = contents(folder.path());
        let refused = generated(folder.path(), 1, then).unwrap_err();
        assert!(matches!(refused, DatasetError::Other { what: "the sampling", .. }), "{refused}");
        assert!(contents(folder.path()) == made, "{first:?} {then:?}");
        // Of the same dataset all may lie there, cut up as the first is.
        assert!(generated(folder.path(), 0, then).is_ok());
    }
}

#[test]
fn a_merge_that_was_stopped_goes_on_and_what_a_killed_one_left_is_removed() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    make_partition(&at("whole"), None);
    make_partition(&at("a"), Some("1/2"));
    make_partition(&at("b"), Some("2/2"));
    let sources = [at("a"), at("b")];
    let (joined, cancelled) = (AtomicU64::new(0), AtomicBool::new(false));
    let progress = |shards| {
        cancelled.store(joined.fetch_add(shards, Ordering::Relaxed) == 1, Ordering::Relaxed);
    };
    let control = Control { progress: &progress, cancelled: &cancelled };
    merge(&at("out"), &sources, control).unwrap_err();
    assert!(matches!(load(&at("out")), Err(DatasetError::Unfinished { missing: 2, shards: 4, .. })));
    std::fs::write(at("out/.shard-00003.safetensors.x1y2z3.part"), "half").unwrap();
    let merged = merge(&at("out"), &sources, Control::quiet()).unwrap();
    assert_eq!((merged.copied, merged.kept), (2, 2));
    assert!(contents(&at("out")) == contents(&at("whole")));
}
