//! `imf query`.

use glam::DVec3;
use imf_core::field::{ExactField, Field, LearntField, Pose};
use imf_core::model::Model;
use imf_core::orientation::Orientation;
use imf_core::siren::engine::CpuEvaluator;

use crate::folder::Folder;
use crate::model::write_model;

const POSES: &str = "name,x,y,z,phi,theta\n\
                     \"left, above\",24,70,40,6,12\nright,10.5,140,80,100,-160\nfar,500,0,0,0,0\n";

fn poses() -> [Pose; 3] {
    let pose = |position: [f64; 3], theta, phi| Pose {
        position: DVec3::from_array(position),
        orientation: Orientation::new(theta, phi),
    };
    [
        pose([24.0, 70.0, 40.0], 12.0, 6.0),
        pose([10.5, 140.0, 80.0], 200.0, 100.0),
        pose([500.0, 0.0, 0.0], 0.0, 0.0),
    ]
}

fn learnt(model: &Model) -> [f32; 3] {
    let mut engine = CpuEvaluator::new(model.shape, &model.state.parameters).unwrap();
    let mut answers = [f32::NAN; 3];
    LearntField::new(model.scene.record.grid, &mut engine).query(&poses(), &mut answers).unwrap();
    answers
}

fn exact(model: &Model) -> [f32; 3] {
    let mut answers = [f32::NAN; 3];
    ExactField::new(&model.scene).query(&poses(), &mut answers).unwrap();
    answers
}

#[test]
fn answers_stand_behind_the_columns_that_were_asked_with() {
    let folder = Folder::new();
    let model = write_model(&folder.path("m.safetensors"));
    folder.write("poses.csv", POSES);
    let run = folder.succeed(&[
        "query",
        "m.safetensors",
        "poses.csv",
        "--device",
        "cpu",
        "--exact",
        "--out",
        "a.csv",
    ]);
    assert!(run.stdout.is_empty());
    assert!(run.stderr.contains("1 of 3 poses lie outside the box"), "{}", run.stderr);
    let expected: Vec<String> = POSES
        .lines()
        .skip(1)
        .zip(learnt(&model).iter().zip(exact(&model)))
        .map(|(line, (learnt, exact))| format!("{line},{learnt},{exact}"))
        .collect();
    let expected = format!("name,x,y,z,phi,theta,overlap,overlap_exact\n{}\n", expected.join("\n"));
    assert_eq!(folder.read("a.csv"), expected);
    // From a pipe to a pipe, with the device found automatically.
    let run = folder.run_with_input(&["query", "m.safetensors", "-", "--exact"], POSES);
    assert_eq!((run.code, run.stdout), (Some(0), expected));
}

#[test]
fn directions_and_json_give_the_same_answers() {
    let folder = Folder::new();
    let model = write_model(&folder.path("m.safetensors"));
    let lines = poses().map(|Pose { position: p, orientation }| {
        let d = 3.0 * orientation.direction();
        format!("{},{},{},{},{},{}\n", d.z, d.y, d.x, p.x, p.y, p.z)
    });
    folder.write("poses.csv", format!("k,j,i,x,y,z\n{}", lines.concat()));
    let answers = folder.json(&["query", "m.safetensors", "poses.csv", "--device", "cpu", "--sharp"]);
    assert_eq!(answers.as_array().unwrap().len(), 3);
    for (answer, expected) in answers.as_array().unwrap().iter().zip(learnt(&model)) {
        // The tip is the paper's tool's only sharp point.
        assert!((answer["cmf"].as_f64().unwrap() - f64::from(expected)).abs() < 1e-5, "{answer} {expected}");
    }
    assert_eq!(answers[2]["x"], 500.0);
}

#[test]
fn more_poses_than_a_chunk_are_all_answered() {
    let folder = Folder::new();
    write_model(&folder.path("m.safetensors"));
    let count = 40_000;
    let lines: String = (0..count).map(|i| format!("{i},{},20,30,{},90\n", i % 49, i % 360)).collect();
    folder.write("poses.csv", format!("id,x,y,z,theta,phi\n{lines}"));
    folder.succeed(&["query", "m.safetensors", "poses.csv", "--device", "cpu", "--out", "a.csv", "--quiet"]);
    let answers = folder.read("a.csv");
    for (index, line) in answers.lines().skip(1).enumerate() {
        assert!(line.starts_with(&format!("{index},")), "{line}");
    }
    assert_eq!(answers.lines().count(), count + 1);
}

#[test]
fn bad_poses_are_refused_by_line_and_column() {
    let folder = Folder::new();
    write_model(&folder.path("m.safetensors"));
    for (text, expected) in [
        ("", "is empty"),
        ("x,y,z\n1,2,3\n", "no column theta"),
        ("x,y,z,theta,phi\n1,2,3,4,5\n1,NaN,3,4,5\n", "line 3, column y: 'NaN'"),
        ("x,y,z,i,j,k\n1,2,3,0,0,0\n", "line 2, columns i,j,k"),
        ("x,y,z,i,j,k\n1,2,3,0,0\n", "line 2: it has 5 columns"),
    ] {
        folder.write("poses.csv", text);
        let arguments = ["query", "m.safetensors", "poses.csv", "--device", "cpu", "--out", "a.csv"];
        folder.refuse(&arguments, &["poses.csv", expected]);
    }
    folder.refuse(&["query", "m.safetensors", "missing.csv"], &["missing.csv"]);
    folder.write("poses.csv", POSES);
    folder.refuse(&["query", "m.safetensors", "poses.csv", "--out", "poses.csv/a"], &["poses.csv/a"]);
}

#[test]
#[cfg_attr(not(target_os = "linux"), ignore = "the system brings an adapter that no variable hides")]
fn a_gpu_that_is_not_there_is_missed_with_a_remedy() {
    let folder = Folder::new();
    write_model(&folder.path("m.safetensors"));
    folder.write("poses.csv", POSES);
    let arguments = ["query", "m.safetensors", "poses.csv", "--device", "gpu", "--out", "a.csv"];
    folder.refuse(&arguments, &["--device gpu", "apt install mesa-vulkan-drivers"]);
}
