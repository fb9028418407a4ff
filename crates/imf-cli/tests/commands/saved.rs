//! Saved fields over their grids: `imf field FIELD` against the library.

use imf_core::orientation::OrientationSet;
use imf_fields::file::FieldFile;
use imf_fields::siren::evaluator::CpuEvaluator;
use imf_fields::siren::over_grid;
use serde_json::json;

use crate::binary::{TRAIN, Workdir};

const SET: &str = "fibonacci:19";
pub(crate) const HARMONIC: &str =
    "train harmonic teapot --dims 15,19,31 --degree 4 --no-calibrate --out field.safetensors";

#[test]
fn options_of_a_part_are_refused_beside_a_saved_field() {
    let work = Workdir::new();
    work.imf(HARMONIC).done();
    let sections = format!("field field.safetensors --orientations {SET}");
    let summary = work.json(&format!("{sections} --out saved"));
    assert_eq!(summary["harmonic"]["report"]["functions"], 25);
    assert!(
        summary["guarantee"].as_str().unwrap().starts_with("approximate (at 64 random orientations"),
        "{summary}"
    );
    work.picture("saved/slices.png");
    work.imf(&format!("{sections} --imf --out saved")).done();
    work.picture("saved/imf.png");
    for option in ["--pitch 3", "--contact 1", "--elements", "--check 2"] {
        let name = option.split(' ').next().unwrap();
        let words = [name, "a saved field", "leave it out"];
        work.imf(&format!("{sections} --out none {option}")).bad_input(&words);
    }
    for option in ["--pitch 3", "--contact 1", "--degree 4"] {
        work.imf(&format!("train field.safetensors --out none {option}"))
            .bad_input(&["applies only to a part"]);
    }
    work.imf(&format!("{sections} --out none --memory 1KiB"))
        .refused(&["the field in field.safetensors", "--memory"]);
    work.imf("field missing.safetensors --orientations 0,0 --out none").refused(&["missing.safetensors"]);
}

#[test]
fn sections_of_networks_are_the_librarys() {
    let work = Workdir::with_dataset();
    work.imf(HARMONIC).done();
    work.imf("train factored field.safetensors --network 2x32 --steps 50 --no-calibrate --out factored")
        .done();
    work.imf(&format!("{TRAIN} --steps 50 --out siren")).done();
    let orientations = OrientationSet::parse(SET).unwrap().orientations;
    for (file, family) in [("factored/field.safetensors", "factored"), ("siren/field.safetensors", "siren5")]
    {
        let summary = work.json(&format!("field {file} --orientations {SET} --out {family}-sections"));
        assert!(summary[family].is_object() && summary["harmonic"].is_null(), "{summary}");
        work.imf(&format!("field {file} --orientations {SET} --imf --out {family}-imf")).done();
        let saved = FieldFile::read(&work.path(file)).unwrap();
        let voxels = saved.scene().record.grid.len();
        let mut expected = vec![0.0; voxels * orientations.len()];
        match &saved {
            FieldFile::Factored(file) => {
                file.field.evaluator().sections(&file.field.direction_weights(&orientations), &mut expected);
            }
            FieldFile::Siren(model) => {
                let mut engine = CpuEvaluator::new(model.shape, &model.state.parameters).unwrap();
                let grid = model.scene.record.grid;
                for (orientation, values) in orientations.iter().zip(expected.chunks_exact_mut(voxels)) {
                    over_grid::section(&mut engine, &grid, orientation.angles(), values).unwrap();
                }
            }
            FieldFile::Harmonic(_) => panic!("{file}"),
        }
        let least = work.npy::<f32>(&format!("{family}-imf/imf.npy"));
        let best = work.npy::<u32>(&format!("{family}-imf/best.npy"));
        for (index, section) in expected.chunks_exact(voxels).enumerate() {
            let found = work.npy::<f32>(&format!("{family}-sections/cmf-{index:05}.npy"));
            // The same products in blocks of other sizes.
            assert!(found.iter().zip(section).all(|(a, b)| (a - b).abs() < 1e-5), "{family} {index}");
        }
        let columns = |voxel: usize| expected.iter().skip(voxel).step_by(voxels);
        for (voxel, (&least, &best)) in least.iter().zip(&best).enumerate() {
            let lowest = columns(voxel).copied().fold(f32::INFINITY, f32::min);
            assert!((least - lowest).abs() < 1e-5, "{family} voxel {voxel}: {least}, not {lowest}");
            assert!(
                (expected[best as usize * voxels + voxel] - lowest).abs() < 1e-5,
                "{family} voxel {voxel}"
            );
        }
    }
    // What is refused leaves what was there.
    let kept = work.bytes("factored-sections/cmf-00018.npy");
    let missed = format!(
        "field factored/field.safetensors --orientations {SET} --out factored-sections --memory 30KiB"
    );
    work.imf(&missed).refused(&["at most 16 sections", "--memory"]);
    assert!(work.bytes("factored-sections/cmf-00018.npy") == kept);
    assert!(work.text("factored-sections/summary.json").contains("\"finished\": true"));
}

#[test]
fn what_was_made_before_is_kept_and_no_source_is_replaced() {
    let work = Workdir::new();
    let small = "--network 2x16 --steps 5 --set batch=64 --no-calibrate";
    work.imf("train harmonic teapot --dims 9,11,17 --degree 2 --out own/field.safetensors --no-calibrate")
        .done();
    let source = work.bytes("own/field.safetensors");
    let refused = ["would be replaced", "another --out"];
    work.imf(&format!("train factored own/field.safetensors {small} --out own")).refused(&refused);
    assert!(work.bytes("own/field.safetensors") == source);
    work.imf(&format!("train factored own/field.safetensors {small} --out network")).done();
    let first = work.bytes("network/field.safetensors");
    let from =
        "train factored own/field.safetensors --from network/field.safetensors --steps 5 --no-calibrate";
    work.imf(&format!("{from} --out network")).refused(&refused);
    assert!(work.bytes("network/field.safetensors") == first);
    // Another run's result gives way, and stays.
    let again =
        work.imf(&format!("train factored own/field.safetensors {small} --set seed=7 --out network")).done();
    again.warns(&["network/field.former.safetensors"]);
    assert!(work.bytes("network/field.former.safetensors") == first);
    let second = work.bytes("network/field.safetensors");
    assert!(second != first);
    // Beside the checkpoint of an unfinished run stands no field of another.
    let longer = format!("train factored own/field.safetensors {small} --set seed=8 --out network");
    let longer = work.interrupted_after(1, &longer.replace("--steps 5", "--steps 60"));
    assert_eq!(longer.code, Some(130));
    assert!(!work.path("network/field.safetensors").exists());
    assert!(work.bytes("network/field.former.safetensors") == second);
}

#[test]
fn networks_reach_what_they_nearly_take_for_free() {
    let work = Workdir::with_dataset();
    work.imf("train siren5 data --network 2x16 --epochs 1 --out siren").done();
    let sections = "field siren/field.safetensors --orientations fibonacci:5";
    let text = work.imf(&format!("{sections} --imf --out least")).done().stdout;
    let summary = work.read_json("least/summary.json");
    let values = work.npy::<f32>("least/imf.npy");
    let scene = FieldFile::read(&work.path("siren/field.safetensors")).unwrap().scene().clone();
    let free = values.iter().zip(&scene.obstacle.solid);
    let file = FieldFile::read(&work.path("siren/field.safetensors")).unwrap();
    // Training measured error rates of the decisions: its threshold counts, and is said.
    let tau = file.calibration().unwrap().free_up_to.unwrap();
    let free = free.filter(|&(&value, &solid)| solid == 0 && value <= tau).count();
    assert_eq!(summary["accessible_outside"], json!(free));
    assert_eq!(summary["tau"].as_f64().unwrap() as f32, tau);
    for said in
        [format!("at most {tau:.3e} counts as free, the field's calibrated threshold"), "verdict ".into()]
    {
        assert!(text.contains(&said), "{text}");
    }
    let table = work.imf(&format!("{sections} --out sections")).done().stdout;
    assert!(table.contains("called free outside the part") && table.contains("approximate"), "{table}");
    // Without a calibration nothing is called free.
    work.imf("train siren5 data --network 2x16 --epochs 1 --no-calibrate --out plain").done();
    let plain = "field plain/field.safetensors --orientations fibonacci:5 --imf --out plainly";
    let text = work.imf(plain).done().stdout;
    assert!(text.contains("not calibrated, so that nothing is called accessible"), "{text}");
    let summary = work.read_json("plainly/summary.json");
    assert_eq!((&summary["accessible_outside"], &summary["tau"]), (&json!(null), &json!(null)));
    let info = work.imf("info siren/field.safetensors").done().stdout;
    assert!(info.contains("none by its own values"), "{info}");
}

#[test]
fn fields_of_depth_and_of_contact_are_served() {
    let work = Workdir::new();
    let field = "train harmonic teapot --dims 9,11,17 --degree 2 --no-calibrate";
    work.imf(&format!("{field} --quantity depth --out depth.safetensors")).done();
    let sections = work.json("field depth.safetensors --orientations 0,0 --out depths");
    assert_eq!((&sections["quantity"], &sections["tau"]), (&json!("depth"), &json!(null)));
    assert!(work.npy::<f32>("depths/depth-mm-00000.npy").iter().any(|&depth| depth < 0.0));
    work.imf(&format!("{field} --contact 1 --out contact.safetensors")).done();
    let contact = "field contact.safetensors --orientations fibonacci:5 --imf";
    work.imf(&format!("{contact} --out least")).done();
}

#[test]
fn many_orientations_are_met_in_batches_and_can_be_interrupted() {
    let work = Workdir::new();
    work.imf("train harmonic teapot --dims 15,19,31 --degree 8 --out field.safetensors --no-calibrate")
        .done();
    let minimum = "field field.safetensors --imf --out least";
    // What a million orientations are worth would take more than a gigabyte at once.
    work.interrupted_once_it_says(
        "minimum of the field",
        &format!("{minimum} --orientations fibonacci:1000000 --memory 128MiB"),
    )
    .interrupted(&["nothing was finished"]);
    assert!(!work.path("least").exists());
}

#[test]
fn what_a_saved_field_is_of_is_printed() {
    let work = Workdir::with_dataset();
    work.imf(&format!("{TRAIN} --steps 50 --out siren --set checkpoint_every=0")).done();
    let field = "train harmonic teapot --dims 9,11,17 --degree 2 --no-calibrate --clearance 2";
    work.imf(&format!("{field} --out grown.safetensors")).done();
    let told = work.imf("field grown.safetensors --orientations 0,0 --out grown").done();
    told.warns(&["offset by a clearance"]);
    let tool = "name = \"side\"\nunit = \"mm\"\nstick_out = 35.0\nsharp_points = [[5.0, 0.0, 20.0]]\n[cutter]\n\
                shape = \"ball\"\ndiameter = 10.0\nlength = 35.0\n";
    work.write("side.toml", tool);
    work.imf("train harmonic teapot --dims 9,11,17 --degree 2 --no-calibrate --quantity overlap --tool side.toml --out side.safetensors")
        .done();
    let summary = work.json("field side.safetensors --orientations 0,0 --out side");
    assert!(summary["guarantee"].as_str().unwrap().contains("its tip at the voxel"), "{summary}");
}
