//! `imf info`.

use std::io::Write as _;

use imf_core::control::Control;
use imf_core::field::ExactField;
use imf_core::glam::DVec3;
use imf_core::obstacle::Obstacle;
use imf_core::orientation::OrientationSet;
use imf_core::pose::Pose;
use imf_fields::recipe::Sampling;
use imf_train::dataset::generate;

use crate::binary::Workdir;
use crate::model::{model, write_model};
use crate::shapes::OPEN_CUBE;

const MILL: &str = "name = \"mill\"\nsharp_points = 12\n[cutter]\nshape = \"bull\"\ndiameter = 10.0\nlength = 30.0\n\
                    corner_radius = 2.0\n[shank]\ndiameter = 8.0\nlength = 10.0\n[[holder]]\ndiameter = 20.0\n\
                    top_diameter = 40.0\nlength = 25.0\n";

#[test]
fn meshes_and_parts_are_described() {
    let folder = Workdir::new();
    let part = folder.json("info screw-gear");
    assert_eq!((&part["kind"], &part["dims"][0]), (&"reference part".into(), &99.into()));
    folder.write("open.obj", OPEN_CUBE);
    let mesh = folder.json("info open.obj");
    assert_eq!((&mesh["mesh"]["closed"], &mesh["mesh"]["boundary_edges"]), (&false.into(), &3.into()));
    for what in ["", "bracket", "paper"] {
        folder.imf(&format!("info {what} --unit inch")).bad_input(&["--unit applies only to the files"]);
    }
    let run = folder.imf("info open.obj --unit m").done();
    run.warns(&["imf: warning: ", "in mm it would be"]);
    run.says(&["100 × 100 × 100 m"]);
    // A file that states its unit.
    let model = r#"<model unit="meter" xmlns="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><resources><object id="1"><mesh>
        <vertices><vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/><vertex x="0" y="1" z="0"/><vertex x="0" y="0" z="1"/></vertices>
        <triangles><triangle v1="0" v2="2" v3="1"/><triangle v1="0" v2="1" v3="3"/><triangle v1="1" v2="2" v3="3"/>
        <triangle v1="2" v2="0" v3="3"/></triangles></mesh></object></resources><build><item objectid="1"/></build></model>"#;
    let relationships = r#"<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships"><Relationship Id="r"
        Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel" Target="/3D/part.model"/></Relationships>"#;
    let mut archive = zip::ZipWriter::new(std::fs::File::create(folder.path("metre.3mf")).unwrap());
    for (name, text) in [("_rels/.rels", relationships), ("3D/part.model", model)] {
        archive.start_file(name, zip::write::SimpleFileOptions::default()).unwrap();
        archive.write_all(text.as_bytes()).unwrap();
    }
    archive.finish().unwrap();
    for (unit, overruled) in [("m", false), ("mm", true)] {
        let run = folder.imf(&format!("info metre.3mf --unit {unit}")).done();
        let text = format!("says that it is in m; --unit {unit} overrules it");
        assert_eq!(run.stderr.contains(&text), overruled, "{}", run.stderr);
    }
}

#[test]
fn tools_are_described_by_their_elements() {
    let folder = Workdir::new();
    folder.write("mill.toml", MILL);
    let tool = folder.json("info mill.toml");
    let kinds: Vec<_> = tool["elements"].as_array().unwrap().iter().map(|e| &e["kind"]).collect();
    assert_eq!(kinds.len(), 3);
    assert_eq!((kinds[0], kinds[1]), (&"cutter".into(), &"shank".into()));
    assert_eq!(tool["length"], 65.0);
    assert_eq!(tool["elements"][2]["largest_radius"], 20.0);
    assert_eq!(tool["sharp_points"].as_array().unwrap().len(), 12);
    assert_eq!(tool["axisymmetric"], true);
    let text = folder.imf("info mill.toml").done().stdout;
    assert!(text.contains("40 to 65 mm above the tip, radius 10 to 20 mm"), "{text}");
}

#[test]
fn datasets_are_described_with_what_is_missing() {
    let folder = Workdir::new();
    let scene = model().scene;
    let set = OrientationSet::parse("fibonacci:5").unwrap();
    let sampling = Sampling::default();
    let made = generate(&folder.path("data"), &scene, &set, &sampling, Control::quiet()).unwrap();
    let dataset = folder.json("info data");
    assert_eq!(dataset["samples"], made.samples);
    assert_eq!((&dataset["shards_missing"], &dataset["scene"]["part"]), (&0.into(), &"bracket".into()));
    std::fs::remove_file(folder.path("data/shard-00000.safetensors")).unwrap();
    assert_eq!(folder.json("info data")["shards_missing"], 1);
    std::fs::create_dir(folder.path("empty")).unwrap();
    folder.refuse("info empty", &["empty", "not a dataset"]);
}

#[test]
fn models_are_described() {
    let folder = Workdir::new();
    let model = write_model(&folder.path("m.safetensors"));
    let info = folder.json("info m.safetensors");
    assert_eq!(info["parameters"], model.shape.parameter_count());
    assert_eq!(info["resumable"], true);
    assert_eq!(info["training"]["orientations"]["count"], 3);
    let small = model.without_moments();
    small.write(&folder.path("small.safetensors")).unwrap();
    let scene = &small.scene;
    let solid = format!("{} voxels, checksum {:08x}", scene.obstacle.count(), scene.record.obstacle_crc32);
    let tool = "largest diameters 10 mm (cutter), 29 mm (holder 1)";
    folder.imf("info small.safetensors").done().says(&["weights alone", &solid, tool]);
}

#[test]
fn what_is_nothing_is_said_to_be_nothing() {
    let folder = Workdir::new();
    folder.refuse("info kettle", &["kettle", "bracket-raw"]);
    folder.refuse("info part.step", &["part.step"]);
}

#[test]
fn devices_are_listed_and_none_is_no_failure() {
    let folder = Workdir::new();
    let run = folder.imf("info --threads 1").done();
    run.says(&["CPU engine, 1 threads"]);
    let devices = folder.json("info");
    assert!(devices["cpu"]["threads"].as_u64().unwrap() >= 1);
    assert!(run.stdout.contains("bracket-raw") && devices["parts"][0] == "teapot", "{devices}");
    if cfg!(target_os = "linux") {
        run.says(&["apt install mesa-vulkan-drivers"]);
        assert_eq!((&devices["auto"], &devices["adapters"]), (&"cpu".into(), &serde_json::json!([])));
    }
}

#[test]
fn a_clearance_is_recorded_in_datasets_and_models_and_said() {
    let folder = Workdir::new();
    let data = "dataset bracket --dims 5,15,9 --allow-coarse --orientations fibonacci:2 --clearance 4";
    folder.imf(&format!("{data} --clearance-cutter 1 --out data")).done();
    let dataset = folder.json("info data");
    let clearance = serde_json::json!({ "holder": 4.0, "shank": 4.0, "cutter": 1.0 });
    assert_eq!(dataset["scene"]["clearance"], clearance);
    folder.imf("info data").done().says(&["holder 4, shank 4, cutter 1 mm"]);
    // The samples are the offset tool's, and so is the scene that a model takes over.
    let (manifest, scene, _) = imf_train::dataset::load(&folder.path("data")).unwrap();
    assert_eq!(manifest.scene.bare_tool(), &imf_core::tool::Tool::paper());
    assert_eq!(scene.record.tool, scene.record.bare_tool().with_clearance(&scene.record.clearance).unwrap());
    // The same folder is refused for another clearance.
    let run = folder.imf(&format!("{data} --out data"));
    run.refused(&["another dataset", "the scene differs"]);
    let mut model = model();
    model.scene = scene;
    model.write(&folder.path("m.safetensors")).unwrap();
    assert_eq!(folder.json("info m.safetensors")["scene"]["clearance"], clearance);
    folder.write("poses.csv", "x,y,z,theta,phi\n1,2,3,40,50\n");
    let run = folder.imf("query m.safetensors poses.csv --exact").done();
    run.warns(&["offset by a clearance (holder 4, shank 4, cutter 1 mm)"]);
}

#[test]
fn contact_is_recorded_with_its_layer_and_exact_answers_know_it() {
    let folder = Workdir::new();
    let data = "dataset bracket --dims 15,45,27 --allow-coarse --orientations fibonacci:2";
    folder.imf(&format!("{data} --contact 4 --out data")).done();
    assert_eq!(folder.json("info data")["scene"]["contact"], 4.0);
    folder.imf("info data").done().says(&["lie no deeper than 4 mm below its surface"]);
    let (_, scene, _) = imf_train::dataset::load(&folder.path("data")).unwrap();
    assert!(scene.layer.as_ref().unwrap().count() > 0);
    let cuttable = Obstacle::from(&scene).cuttable.unwrap();
    let mut model = model();
    let mut plain = scene.clone();
    (plain.layer, plain.record.contact) = (None, None);
    model.scene = scene;
    model.write(&folder.path("m.safetensors")).unwrap();
    assert_eq!(imf_fields::model::Model::read(&folder.path("m.safetensors")).unwrap(), model);
    // The tip stands in a voxel of the layer: the cutter collides with the part, and touches it by contact.
    let grid = plain.record.grid;
    let voxel = cuttable.solid.iter().position(|&s| s != 0).unwrap();
    let [x, y, z] = grid.centre(grid.voxel(voxel)).to_array();
    folder.write("poses.csv", format!("x,y,z,theta,phi\n{x},{y},{z},0,0\n"));
    let run = folder.json("query m.safetensors poses.csv --exact");
    let pose = Pose::along([x, y, z].into(), DVec3::Z);
    let clearance = &model.scene.record.clearance;
    let field = ExactField::of_scene(&model.scene, clearance).unwrap();
    let whole = ExactField::of_scene(&plain, clearance).unwrap();
    let expected = field.overlap(&pose).unwrap();
    assert!((run[0]["overlap_exact"].as_f64().unwrap() - expected).abs() < 1e-6, "{run}");
    assert!(field.count(&pose) < whole.count(&pose));
}
