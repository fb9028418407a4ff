//! `imf query`.

use glam::DVec3;
use imf_core::field::{ExactField, PoseField as _};
use imf_core::orientation::Orientation;
use imf_core::pose::Pose;
use imf_fields::field::Field;
use imf_fields::file::FieldFile;
use imf_fields::model::Model;

use crate::binary::Workdir;
#[cfg(target_os = "linux")]
use crate::binary::finish;
use crate::model::write_model;

const POSES: &str = "name,x,y,z,phi,theta\n\
                     \"left, above\",24,70,40,6,12\nright,10.5,140,80,100,-160\nfar,500,0,0,0,0\n";

const ASK: &str = "query m.safetensors poses.csv --device cpu";

/// A folder with a model and poses.
fn folder_of(poses: &str) -> (Workdir, Model) {
    let folder = Workdir::new();
    let model = write_model(&folder.path("m.safetensors"));
    folder.write("poses.csv", poses);
    (folder, model)
}

fn poses() -> [Pose; 3] {
    let pose = |position: [f64; 3], theta, phi| {
        Pose::oriented(DVec3::from_array(position), &Orientation::new(theta, phi))
    };
    [
        pose([24.0, 70.0, 40.0], 12.0, 6.0),
        pose([10.5, 140.0, 80.0], 200.0, 100.0),
        pose([500.0, 0.0, 0.0], 0.0, 0.0),
    ]
}

fn learnt(model: &Model) -> [f32; 3] {
    let mut values = [f32::NAN; 3];
    let field = Field::new(FieldFile::Siren(Box::new(model.clone()))).unwrap();
    field.values(&poses(), &mut values).unwrap();
    values
}

fn exact(model: &Model) -> [f32; 3] {
    let mut values = [f32::NAN; 3];
    ExactField::new(&model.scene, &model.scene.record.tool).unwrap().values(&poses(), &mut values).unwrap();
    values
}

#[test]
fn results_follow_the_columns_of_the_input() {
    let (folder, model) = folder_of(POSES);
    let run = folder.imf(&format!("{ASK} --exact --out a.csv")).done();
    assert!(run.stdout.is_empty());
    // The rate counts what the line counts.
    run.warns(&["1 of 3 poses lie outside the box", "answering: 3 poses in "]);
    let expected: Vec<String> = POSES
        .lines()
        .skip(1)
        .zip(learnt(&model).iter().zip(exact(&model)))
        .enumerate()
        // The field was not calibrated, and the last pose is far outside.
        .map(|(row, (line, (learnt, exact)))| format!("{line},{learnt},{exact},undecided,{}", row == 2))
        .collect();
    let header = "name,x,y,z,phi,theta,overlap,overlap_exact,decision,outside";
    let expected = format!("{header}\n{}\n", expected.join("\n"));
    assert_eq!(folder.text("a.csv"), expected);
    // From a pipe to a pipe, with the device found automatically.
    let run = folder.imf_with_input("query m.safetensors - --exact", POSES);
    assert_eq!((run.code, run.stdout), (Some(0), expected));
}

#[test]
fn poses_outside_the_box_are_answered_as_the_nearest_inside() {
    let (folder, model) = folder_of("");
    let grid = model.scene.record.grid;
    let [low, high] = grid.box_of_centres();
    let room = 0.4 * grid.pitch;
    let middle = 0.5 * (low + high);
    // By half a voxel, by far, and each beside the nearest point inside.
    let points = [
        middle.with_x(low.x - room),
        middle.with_x(low.x),
        middle.with_z(high.z + 1e3),
        middle.with_z(high.z),
        low - 1e6,
        low,
    ];
    let lines = points.map(|p| format!("{},{},{},40,70\n", p.x, p.y, p.z));
    folder.write("poses.csv", format!("x,y,z,theta,phi\n{}", lines.concat()));
    let run = folder.imf(ASK).done();
    let answers: Vec<&str> =
        run.stdout.lines().skip(1).map(|line| line.rsplit(',').nth(2).unwrap()).collect();
    let outside: Vec<bool> = run.stdout.lines().skip(1).map(|line| line.ends_with(",true")).collect();
    assert_eq!(outside, [true, false, true, false, true, false], "{}", run.stdout);
    for pair in answers.chunks(2) {
        assert_eq!(pair[0], pair[1], "{}", run.stdout);
    }
    assert!(answers[0] != answers[2] && answers[2] != answers[4], "{}", run.stdout);
    run.warns(&["3 of 6 poses lie outside the box", "as the nearest point inside, without guarantee"]);
    // The tip is the only sharp point.
    folder.imf(&format!("{ASK} --sharp")).done().warns(&["3 of 6 poses"]);
}

#[test]
fn directions_and_json_give_the_same_answers() {
    let (folder, model) = folder_of("");
    let lines = poses().map(|pose| {
        let (p, d) = (pose.position, 3.0 * pose.axis().unwrap());
        format!("{},{},{},{},{},{}\n", d.z, d.y, d.x, p.x, p.y, p.z)
    });
    folder.write("poses.csv", format!("k,j,i,x,y,z\n{}", lines.concat()));
    let answers = folder.json(&format!("{ASK} --sharp"));
    assert_eq!(answers.as_array().unwrap().len(), 3);
    for (answer, expected) in answers.as_array().unwrap().iter().zip(learnt(&model)) {
        // The tip is the paper's tool's only sharp point.
        assert!(
            (answer["overlap_sharp"].as_f64().unwrap() - f64::from(expected)).abs() < 1e-5,
            "{answer} {expected}"
        );
    }
    assert_eq!(answers[2]["x"], 500.0);
}

#[test]
fn more_poses_than_a_chunk_are_all_answered() {
    let count = 40_000;
    let lines: String = (0..count).map(|i| format!("{i},{},20,30,{},90\n", i % 49, i % 360)).collect();
    let (folder, _) = folder_of(&format!("id,x,y,z,theta,phi\n{lines}"));
    folder.imf(&format!("{ASK} --out a.csv --quiet")).done();
    let answers = folder.text("a.csv");
    for (index, line) in answers.lines().skip(1).enumerate() {
        assert!(line.starts_with(&format!("{index},")), "{line}");
    }
    assert_eq!(answers.lines().count(), count + 1);
}

#[test]
fn a_bad_line_of_a_file_is_found_before_anything_is_answered() {
    // More than are answered at a time.
    let text = format!("x,y,z,theta,phi\n{}1,2,3,4\n1,2,3,4,5\n", "1,2,3,4,5\n".repeat(600));
    let (folder, _) = folder_of(&text);
    let ask = |poses: &str| format!("query m.safetensors {poses} --device cpu --exact");
    let run = folder.imf(&ask("poses.csv")).refused(&["poses.csv, line 602: it has 4 columns"]);
    assert_eq!(run.stderr.lines().count(), 1, "no field was read: {}", run.stderr);
    // What comes through a pipe is answered as it comes.
    let run = folder.imf_with_input(&ask("-"), &text).exits(1);
    run.warns(&["line 602: it has 4 columns"]);
    assert_eq!(run.stdout.lines().count(), 513);
}

#[test]
fn a_line_that_is_no_pose_is_invalid_and_the_others_are_answered() {
    let (folder, _) = folder_of("");
    let valid = "x,y,z,i,j,k\n24,70,40,0,0,1\n10,140,80,1,0,1\n";
    folder.write("poses.csv", valid);
    let expected = folder.imf(&format!("{ASK} --exact")).done().stdout;
    let rows: Vec<&str> = expected.lines().collect();
    let text =
        "x,y,z,i,j,k\n24,70,40,0,0,0\n24,70,40,0,0,1\n24,NaN,40,0,0,1\n10,140,80,1,0,1\n24,70,,0,0,1\n";
    folder.write("poses.csv", text);
    let run = folder.imf(&format!("{ASK} --exact")).done();
    let none = |line: &str| format!("{line},NaN,NaN,invalid,true");
    let all =
        [rows[0], &none("24,70,40,0,0,0"), rows[1], &none("24,NaN,40,0,0,1"), rows[2], &none("24,70,,0,0,1")];
    assert_eq!(run.stdout.lines().collect::<Vec<_>>(), all);
    run.warns(&[
        "3 of 5 lines are invalid poses",
        "poses.csv, line 2, columns i,j,k: the direction must not be zero",
    ]);
    // From a pipe it is only known at the end that there was none.
    let run = folder.imf_with_input("query m.safetensors -", "x,y,z,i,j,k\n1,2,3,0,0,0\n").exits(1);
    run.warns(&["no line is a pose"]);
    assert!(run.stdout.ends_with("1,2,3,0,0,0,NaN,invalid,true\n"), "{}", run.stdout);
}

#[test]
#[cfg(target_os = "linux")]
fn a_full_disk_is_named_with_the_file_and_the_remedy() {
    let (folder, _) = folder_of(&format!("x,y,z,theta,phi\n{}", "1,2,3,4,5\n".repeat(9000)));
    let full = std::fs::File::options().write(true).open("/dev/full").unwrap();
    let run = finish(ASK, folder.command(ASK).stdout(full));
    run.refused(&["cannot write to standard output: the disk is full", "free some space"]);
    // A limit on the size of files, met by the file of answers alone.
    folder.imf_in_blocks(64, &format!("{ASK} --out a.csv")).refused(&["cannot write a.csv: "]);
    assert!(!folder.path("a.csv").exists());
}

#[test]
fn bad_poses_are_refused_by_line_and_column() {
    let (folder, _) = folder_of("");
    folder.write("poses.csv", "x,y,z,i,j,k\n1,2,3,0,0\n");
    folder.refuse(&format!("{ASK} --out a.csv"), &["poses.csv", "line 2: it has 5 columns"]);
    folder.refuse("query m.safetensors missing.csv", &["missing.csv"]);
    folder.write("poses.csv", POSES);
    folder.refuse("query m.safetensors poses.csv --out poses.csv/a", &["poses.csv/a"]);
}
