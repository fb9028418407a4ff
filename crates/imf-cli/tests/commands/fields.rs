//! `imf field`, read back and held against the library.

use imf_core::control::Control;
use imf_core::orientation::OrientationSet;
use imf_core::section::{
    DepthPlan, DepthScratch, SectionPlan, ToolPoints, direct_element_measures, imf, sections,
};

use crate::binary::Workdir;
use crate::model::model;
use crate::shapes::{LAST_FACE, OPEN_CUBE};

/// A cube of 100 mm on ten voxels a side, which the paper's cutter is thinner than √2 of.
const BLOCK: &str = "block.obj --pitch 10 --tool paper --allow-coarse";
const BRACKET: &str = "field bracket --dims 5,15,9 --allow-coarse";

fn arguments(more: &str) -> String {
    format!("{BRACKET} {more}")
}

#[test]
fn sections_are_the_librarys_and_checked() {
    let folder = Workdir::new();
    let set = "0,0;12,6;200,100";
    let summary = folder.json(&arguments(&format!("--orientations {set} --check 20 --out out")));
    let scene = model().scene;
    let plan = SectionPlan::new(&scene.obstacle, &scene.record.tool, ToolPoints::SharpPoints).unwrap();
    let orientations = OrientationSet::parse(set).unwrap().orientations;
    let expected = sections(&plan, &orientations, Control::quiet()).unwrap();
    for (index, expected) in expected.iter().enumerate() {
        let found = folder.npy::<f32>(&format!("out/cmf-{index:05}.npy"));
        assert_eq!(found.dim(), (5, 15, 9));
        assert!(found.iter().eq(expected));
        let free = expected.iter().zip(&scene.obstacle.solid).filter(|&(&v, &s)| v == 0.0 && s == 0).count();
        assert_eq!(summary["sections"][index]["accessible_outside"], free);
    }
    assert_eq!(summary["check"]["agreed"], 60);
    assert_eq!(summary["orientations"]["count"], 3);
    assert_eq!(summary, folder.read_json("out/summary.json"));
    assert_eq!(folder.text("out/orientations.csv"), "index,theta,phi,roll\n0,0,0,0\n1,12,6,0\n2,200,100,0\n");
    let vti = folder.bytes("out/sections.vti");
    let text = String::from_utf8_lossy(&vti);
    assert!(
        ["cmf-00000", "cmf-00002", "solid"].iter().all(|name| text.contains(&format!("Name=\"{name}\"")))
    );
    folder.picture("out/slices.png");
}

#[test]
fn depths_of_a_part_are_the_librarys_and_named_with_their_unit() {
    let folder = Workdir::new();
    let set = "0,0;12,6;200,100";
    let ask = |more: &str| arguments(&format!("--orientations {set} --quantity depth {more}"));
    let summary = folder.json(&ask("--out out"));
    let scene = model().scene;
    let plan = SectionPlan::new(&scene.obstacle, &scene.record.tool, ToolPoints::SharpPoints).unwrap();
    let plan = DepthPlan::of(&plan).unwrap();
    let orientations = OrientationSet::parse(set).unwrap().orientations;
    let mut least = vec![f32::INFINITY; scene.record.grid.len()];
    for (index, orientation) in orientations.iter().enumerate() {
        let mut expected = vec![f32::NAN; least.len()];
        plan.depths(orientation, &mut DepthScratch::default(), &mut expected).unwrap();
        let found = folder.npy::<f32>(&format!("out/depth-mm-{index:05}.npy"));
        assert!(found.iter().eq(&expected) && expected.iter().any(|&depth| depth < 0.0));
        let free = expected.iter().zip(&scene.obstacle.solid).filter(|&(&v, &s)| v <= 0.0 && s == 0).count();
        assert_eq!(summary["sections"][index]["accessible_outside"], free);
        least.iter_mut().zip(&expected).for_each(|(least, &depth)| *least = least.min(depth));
    }
    assert_eq!(summary["quantity"], "depth");
    folder.json(&ask("--imf --out imf"));
    assert!(folder.npy::<f32>("imf/minimum-depth-mm.npy").iter().eq(&least));
    folder.refuse_input(&ask("--elements --out no"), &["--elements", "overlaps"]);
    folder.refuse_input(&ask("--check 3 --out no"), &["--check", "overlaps"]);
}

#[test]
fn many_sections_have_a_file_each() {
    let folder = Workdir::new();
    let run = folder.imf(&arguments("--orientations fibonacci:23 --out out")).done();
    assert!(!run.stdout.contains('ψ'), "{}", run.stdout);
    run.says(&["3 more", "one .vti for each"]);
    let count = |ending: &str| {
        folder.entries().iter().filter(|path| path.extension().is_some_and(|e| e == ending)).count()
    };
    assert_eq!((count("npy"), count("vti"), count("png")), (23, 23, 1));
}

#[test]
fn a_folder_used_again_holds_the_last_run_alone() {
    let folder = Workdir::new();
    folder.write("out/notes.txt", "mine");
    folder.imf(&arguments("--orientations fibonacci:20 --elements --out out")).done();
    let names = || folder.names("out");
    let listed = |own: &[&str]| {
        let summary = folder.read_json("out/summary.json");
        let files = summary["files"].as_array().unwrap().iter().map(|file| file.as_str().unwrap());
        let mut all: Vec<String> = files.chain(own.iter().copied()).map(str::to_owned).collect();
        all.sort_unstable();
        all
    };
    assert_eq!(names(), listed(&["notes.txt"]));
    let run = folder.imf(&arguments("--orientations 0,0;12,6 --out out")).done();
    run.warns(&["of an earlier run in out are replaced"]);
    let two = ["cmf-00000.npy", "cmf-00001.npy", "notes.txt", "orientations.csv", "sections.vti"];
    assert_eq!(names(), [&two[..], &["slices.png", "summary.json"]].concat());
    assert_eq!(names(), listed(&["notes.txt"]));
    folder.imf(&arguments("--orientations 0,0;12,6 --imf --elements --out out")).done();
    assert!(!names().contains(&"cmf-00000.npy".to_owned()), "{:?}", names());
    assert_eq!(names(), listed(&["notes.txt"]));
    folder.imf("access bracket --dims 7,21,13 --orientations fibonacci:5 --out out").done();
    assert!(!names().contains(&"imf-cutter.npy".to_owned()), "{:?}", names());
    assert_eq!(names(), listed(&["notes.txt"]));
    // What a killed run left unfinished goes too.
    folder.write("out/.slices.png.abcdef.part", "");
    folder.imf("voxelize bracket --dims 7,21,13 --out out").done();
    assert_eq!(names(), ["notes.txt", "slices.png", "solid.npy", "solid.vti", "summary.json"]);
    assert_eq!(names(), listed(&["notes.txt"]));
}

#[test]
fn fixtures_beside_the_grid_count_as_far_as_the_tool_reaches() {
    let folder = Workdir::new();
    folder.write("block.obj", format!("{OPEN_CUBE}{LAST_FACE}"));
    let field = |more: &str| {
        let asked = "--orientations 0,0;90,90 --out out";
        folder.json(&format!("field {BLOCK} {asked} {more}"))
    };
    // A second block 40 mm beside the first: the tool hits it lying down, never standing up.
    let fixture = "--fixture block.obj@translate:0,140,0";
    let beside = format!("{fixture} --margin 2 --check 200");
    let summary = field(&beside);
    assert_eq!(summary["check"]["agreed"], 400);
    let found: Vec<_> = (0..2).map(|index| folder.npy::<f32>(&format!("out/cmf-0000{index}.npy"))).collect();
    assert_eq!(found[0].dim(), (14, 14, 14), "the grid is the part's");
    let contact = field(&format!("{beside} --contact 15"));
    assert_eq!(contact["check"]["agreed"], 400);
    field(&format!("{beside} --around all"));
    for (index, near) in found.iter().enumerate() {
        let whole = folder.npy::<f32>(&format!("out/cmf-0000{index}.npy"));
        assert_eq!(whole.dim(), (14, 28, 14));
        assert!(near.indexed_iter().all(|((x, y, z), value)| *value == whole[[x, y, z]]), "section {index}");
    }
    let far = "--fixture block.obj@translate:0,9140,0 --orientations 0,0 --out far";
    folder.imf(&format!("field {BLOCK} {far}")).done().warns(&["block.obj is beyond the tool's reach"]);
    field("--margin 2");
    let alone: Vec<_> = (0..2).map(|index| folder.npy::<f32>(&format!("out/cmf-0000{index}.npy"))).collect();
    assert_eq!(alone[0], found[0]);
    assert!(alone[1] != found[1]);
    let dataset = format!("dataset {BLOCK} --orientations 0,0 --out set {fixture}");
    folder.refuse(&dataset, &["block.obj", "--around all"]);
}

#[test]
fn the_imf_keeps_its_best_orientation() {
    let folder = Workdir::new();
    let run = folder.imf(&arguments("--orientations fibonacci:9 --imf --check 5 --out out")).done();
    run.says(&["45 of 45 compared voxels equal"]);
    let scene = model().scene;
    let plan = SectionPlan::new(&scene.obstacle, &scene.record.tool, ToolPoints::SharpPoints).unwrap();
    let set = OrientationSet::parse("fibonacci:9").unwrap();
    let expected = imf(&plan, &set.orientations, Control::quiet()).unwrap();
    assert!(folder.npy::<f32>("out/imf.npy").iter().eq(&expected.value));
    assert!(folder.npy::<u32>("out/best.npy").iter().eq(&expected.best));
    let vti = folder.bytes("out/imf.vti");
    let text = String::from_utf8_lossy(&vti);
    for name in ["imf", "best", "theta", "phi", "solid"] {
        assert!(text.contains(&format!("Name=\"{name}\"")), "{name}");
    }
    let summary = folder.read_json("out/summary.json");
    let free =
        expected.value.iter().zip(&scene.obstacle.solid).filter(|&(&v, &s)| v == 0.0 && s == 0).count();
    assert_eq!(summary["accessible_outside"], free);
    assert!(summary["guarantee"].as_str().unwrap().starts_with("exact for voxel centres"));
    assert_eq!(folder.text("out/orientations.csv").lines().count(), 10);
}

#[test]
fn elements_sum_to_the_whole_and_contact_is_checked_by_its_definition() {
    let folder = Workdir::new();
    let more = "--orientations 0,0;40,110 --elements --contact 9 --clearance 3 --check 25";
    let summary = folder.json(&arguments(&format!("{more} --out out")));
    assert_eq!(summary["check"]["agreed"], 50);
    assert_eq!(summary["scene"]["clearance"]["holder"], 3.0);
    let solid = &model().scene.obstacle.solid;
    for index in 0..2 {
        let whole = folder.npy::<f32>(&format!("out/cmf-{index:05}.npy"));
        let parts =
            ["cutter", "holder_1"].map(|name| folder.npy::<f32>(&format!("out/cmf-{index:05}-{name}.npy")));
        for (voxel, &value) in whole.indexed_iter() {
            let sum = f64::from(parts[0][voxel]) + f64::from(parts[1][voxel]);
            // Three numbers, each rounded to f32 once.
            assert!((sum - f64::from(value)).abs() <= f64::from(f32::EPSILON) * sum, "{voxel:?}");
        }
        let hits = parts[1].iter().zip(solid).filter(|&(&v, &s)| v > 0.0 && s == 0).count();
        assert_eq!(summary["sections"][index]["elements"][1]["element"], "holder 1");
        assert_eq!(summary["sections"][index]["elements"][1]["hits"], hits);
    }
    let vti = folder.bytes("out/sections.vti");
    let text = String::from_utf8_lossy(&vti);
    assert!(text.contains("Name=\"cmf-00001-holder_1\"") && text.contains("Name=\"cmf-00000-cutter\""));
    assert!(folder.path("out/elements.png").exists());
}

#[test]
fn the_imfs_elements_are_those_of_the_best_orientation() {
    let folder = Workdir::new();
    let more = "--orientations fibonacci:9 --imf --elements --out out";
    let summary = folder.json(&arguments(more));
    let imf = folder.npy::<f32>("out/imf.npy");
    let parts = ["cutter", "holder_1"].map(|name| folder.npy::<f32>(&format!("out/imf-{name}.npy")));
    let scene = model().scene;
    let set = OrientationSet::parse("fibonacci:9").unwrap().orientations;
    let best = folder.npy::<u32>("out/best.npy");
    for (index, (voxel, &value)) in imf.indexed_iter().enumerate() {
        let sum = f64::from(parts[0][voxel]) + f64::from(parts[1][voxel]);
        assert!((sum - f64::from(value)).abs() <= f64::from(f32::EPSILON) * sum, "{voxel:?}");
        if index % 50 == 0 {
            let (orientation, at) = (&set[best[voxel] as usize], [voxel.0, voxel.1, voxel.2]);
            let direct =
                direct_element_measures(&scene.obstacle, &scene.record.tool, orientation, at).unwrap();
            assert!((direct[1].1 - f64::from(parts[1][voxel])).abs() < 1e-6);
        }
    }
    assert_eq!(summary["elements"][0]["element"], "cutter");
}

#[cfg(unix)]
#[test]
fn ctrl_c_keeps_finished_sections() {
    let folder = Workdir::new();
    let line = "field bracket --orientations fibonacci:3000 --out out --threads 1";
    let run = folder.interrupted_once_there_is("out/cmf-00002.npy", line);
    let run = run.interrupted(&["of 3000 sections are finished"]);
    let last = run.stderr.lines().last().unwrap();
    assert!(last.starts_with("imf: interrupted: "), "{last}");
    let kept: usize = last.split_whitespace().nth(2).unwrap().parse().unwrap();
    let files = folder.entries().into_iter().filter(|path| path.extension().is_some_and(|e| e == "npy"));
    let files: Vec<_> = files.collect();
    assert!((3..3000).contains(&kept));
    assert_eq!(files.len(), kept);
    for file in files {
        assert_eq!(folder.npy::<f32>(file.to_str().unwrap()).dim(), (49, 147, 87));
    }
    assert!(folder.path("out/orientations.csv").exists());
    let summary = folder.read_json("out/summary.json");
    assert_eq!(summary["finished"], false);
    // The next run clears what this one left, though it did not come to its end.
    folder.imf("field bracket --orientations 0,0 --imf --out out").done();
    let left = folder.entries().into_iter().filter(|path| path.to_string_lossy().contains("cmf-")).count();
    assert_eq!(left, 0);
}

#[test]
fn a_tool_that_is_not_at_its_tip_is_said_and_so_is_how_far_depths_are_known() {
    let folder = Workdir::new();
    folder.write(
        "off.toml",
        "name = 'off'\nsharp_points = [[0, 0, -50]]\n[cutter]\nshape = 'flat'\ndiameter = 30\nlength = 60\n",
    );
    let asked = arguments("--tool off.toml --orientations 0,0;90,0 --imf --quantity depth --out out");
    let run = folder.imf(&asked).done();
    run.warns(&["another of its sharp points, is 50 mm away from it"]);
    run.says(&["largest depth ", "depths are known within 7.5 voxels"]);
    let summary = folder.read_json("out/summary.json");
    let pitch = summary["scene"]["grid"]["pitch"].as_f64().unwrap();
    assert!((summary["clamped_within"].as_f64().unwrap() / pitch - 7.5).abs() < 1e-6);
}
