//! Tools that are not symmetric about their axis: poses, tables and exports that know how the tool is rolled.

use std::sync::Arc;

use std::fmt::Write as _;

use imf_core::field::values_on_all_threads;
use imf_core::orientation::Orientation;
use imf_core::pose::Pose;
use imf_fields::factored::file::FactoredFile;
use imf_fields::field::Field;
use imf_fields::file::FieldFile;
use imf_fields::harmonic::file::HarmonicFile;
use serde_json::Value;

use crate::binary::Workdir;
use crate::model::model;
use crate::shapes::cuboid;

const SCENE: &str = "bracket --dims 6,18,11 --tool arm.toml";
const ROLLS: [f64; 3] = [0.0, 90.0, 200.0];

/// A bar to one side, as a tool; the tip lies in it, since no definition says whether a voxel's centre on a face is inside.
pub(crate) fn write_arm(folder: &Workdir) {
    folder.write("arm.obj", cuboid([-6, -6, -2], [45, 6, 30], 0));
    folder.write("arm.toml", "name = \"arm\"\nmesh = \"arm.obj\"\n");
    let rows = ROLLS.map(|roll| format!("30,60,{roll}\n"));
    folder.write("rolled.csv", format!("theta,phi,roll\n{}", rows.concat()));
}

fn numbers(answers: &Value, column: &str) -> Vec<f32> {
    answers.as_array().unwrap().iter().map(|answer| answer[column].as_f64().unwrap() as f32).collect()
}

#[test]
fn poses_are_answered_at_their_roll_by_every_family_that_knows_it() {
    let folder = Workdir::new();
    write_arm(&folder);
    let run = folder.imf(&format!("field {SCENE} --orientations rolled.csv --out out")).done();
    // Rows of one direction are told apart.
    assert!(run.stdout.contains('ψ') && run.stdout.contains("200.0°"), "{}", run.stdout);
    let fit = "--quantity overlap --degree 2 --out arm.safetensors --no-calibrate";
    folder.imf(&format!("train harmonic {SCENE} {fit}")).done();
    folder.imf("train factored arm.safetensors --network 2x16 --steps 5 --out small").done();
    let harmonic = HarmonicFile::read(&folder.path("arm.safetensors")).unwrap();
    let factored = FactoredFile::read(&folder.path("small/field.safetensors")).unwrap();
    let mut siren = model();
    siren.scene = harmonic.scene.clone();
    siren.write(&folder.path("siren.safetensors")).unwrap();

    let grid = harmonic.scene.record.grid;
    let (mut text, mut poses) = ("roll,x,y,z,theta,phi\n".to_owned(), Vec::new());
    for roll in ROLLS {
        for index in 0..grid.len() {
            let position = grid.centre(grid.voxel(index));
            writeln!(text, "{roll},{},{},{},30,60", position.x, position.y, position.z).unwrap();
            let orientation = Orientation { roll, ..Orientation::new(30.0, 60.0) };
            poses.push(Pose::oriented(position, &orientation));
        }
    }
    folder.write("poses.csv", text);
    let ask = |field: &str| folder.json(&format!("query {field} poses.csv --device cpu --exact"));
    let values = |file: FieldFile| {
        let mut values = vec![f32::NAN; poses.len()];
        values_on_all_threads(&Field::new(file).unwrap(), &poses, &mut values).unwrap();
        values
    };

    let answers = ask("arm.safetensors");
    let exact = numbers(&answers, "overlap_exact");
    let sections: Vec<f32> =
        (0..3).flat_map(|index| folder.npy::<f32>(&format!("out/cmf-{index:05}.npy"))).collect();
    assert!(exact == sections, "counts at voxel centres are the sections'");
    let by_roll: Vec<&[f32]> = exact.chunks_exact(grid.len()).collect();
    assert!(by_roll[0] != by_roll[1] && by_roll[1] != by_roll[2]);
    assert_eq!(answers[grid.len()]["roll"], 90);
    assert!(numbers(&answers, "overlap") == values(FieldFile::Harmonic(Arc::new(harmonic))));
    let found = numbers(&ask("small/field.safetensors"), "overlap");
    assert!(found == values(FieldFile::Factored(Box::new(factored))));
    assert!(found[..grid.len()] != found[grid.len()..2 * grid.len()]);

    // The paper's network has no place for it, and says so once.
    let run = folder.imf("query siren.safetensors poses.csv --device cpu --json").done();
    let notes = run.stderr.matches("knows no roll, which counts for the tool 'arm'").count();
    assert_eq!(notes, 1, "{}", run.stderr);
    let found = numbers(&run.json(), "overlap");
    assert!(found[..grid.len()] == found[grid.len()..2 * grid.len()]);
    // Without a roll what is answered is said.
    folder.write("upright.csv", "x,y,z\n0,0,0\n");
    for field in ["arm.safetensors", "small/field.safetensors"] {
        let told = folder.imf(&format!("query {field} upright.csv")).done().stderr;
        assert!(told.contains("have no column roll: every answer is of the tool at roll 0"), "{told}");
    }

    // Only functions of directions are written for other programs; each family is refused by its name.
    for (field, family) in [("arm.safetensors", "harmonic"), ("small/field.safetensors", "factored")] {
        let named = format!("a {family} field of a tool that is not symmetric");
        folder.refuse(&format!("export {field} --out arm.onnx"), &[&named, "imf query"]);
    }
}

#[test]
fn the_roll_of_a_tool_of_revolution_is_idle() {
    let folder = Workdir::new();
    model().write(&folder.path("m.safetensors")).unwrap();
    folder.write("poses.csv", "x,y,z,theta,phi,roll\n24,70,40,12,6,0\n24,70,40,12,6,77.5\n");
    let run = folder.imf("query m.safetensors poses.csv --device cpu --exact").done();
    assert!(!run.stderr.contains("roll"), "{}", run.stderr);
    let answers: Vec<&str> =
        run.stdout.lines().skip(1).map(|line| line.splitn(7, ',').last().unwrap()).collect();
    assert!(answers[0] == answers[1] && answers[0].contains(','), "{}", run.stdout);
}
