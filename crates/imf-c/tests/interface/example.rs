//! `examples/poses.c`, compiled by the system's C compiler and run against the shared and the static library that this
//! test was built with.

use std::fmt::Write as _;
use std::io::Write as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use imf_core::field::{Best, Decision, ExactField, Gradient, PoseField};
use imf_core::glam::{DQuat, DVec3};
use imf_core::pose::Pose;
use imf_core::section::Quantity;
use imf_core::world::MotionOptions;
use imf_fields::field::Planner;

use crate::files::{harmonic, harmonic_of, scene, siren, spread};

/// Where the libraries lie: beside this test.
fn libraries() -> PathBuf {
    std::env::current_exe().unwrap().parent().unwrap().to_owned()
}

fn compile(out: &Path, link: &[String]) {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let compiler = std::env::var("CC").unwrap_or_else(|_| "cc".into());
    let output = Command::new(&compiler)
        .args(["-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-I"])
        .arg(root.join("include"))
        .arg(root.join("examples/poses.c"))
        .args(link)
        .arg("-o")
        .arg(out)
        .output()
        .unwrap_or_else(|error| {
            panic!("no C compiler: '{compiler}' does not start ({error}); install gcc or clang, or set CC")
        });
    assert!(output.status.success(), "{compiler} says\n{}", String::from_utf8_lossy(&output.stderr));
}

/// Standard output and error of the program asked about `poses`.
fn run(program: &Path, field: &Path, poses: &str) -> (bool, String, String) {
    let mut child = Command::new(program)
        .arg(field)
        // Cargo's search path may name the library of an earlier build first; the program knows where its own lies.
        .env_remove("LD_LIBRARY_PATH")
        .env_remove("DYLD_FALLBACK_LIBRARY_PATH")
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // It may end before it reads.
    let _ = child.stdin.take().unwrap().write_all(poses.as_bytes());
    let output = child.wait_with_output().unwrap();
    let text = |bytes| String::from_utf8(bytes).unwrap();
    (output.status.success(), text(output.stdout), text(output.stderr))
}

#[test]
#[cfg_attr(not(unix), ignore = "compiles as Unix compilers are called")]
fn the_example_in_c_answers_as_rust_does() {
    let folder = tempfile::tempdir().unwrap();
    let (shared, fixed) = (folder.path().join("shared"), folder.path().join("static"));
    let lib = libraries().display().to_string();
    compile(&shared, &[format!("-L{lib}"), "-limf_c".into(), format!("-Wl,-rpath,{lib}")]);
    let archive = format!("{lib}/libimf_c.a");
    compile(&fixed, &[archive, "-lpthread".into(), "-ldl".into(), "-lm".into()]);

    let scene = scene();
    let asked = spread(&scene, 100);
    let mut text = String::new();
    for (tip, axis) in &asked {
        writeln!(text, "{} {} {} {} {} {}", tip.x, tip.y, tip.z, axis.x, axis.y, axis.z).unwrap();
    }
    let poses: Vec<Pose> = asked.iter().map(|&(tip, axis)| Pose::along(tip, axis)).collect();
    for (program, field, says) in [
        (&shared, harmonic(&scene, folder.path()), "overlap 0 1\n"),
        (&fixed, siren(&scene, folder.path()), "overlap 0 1\n"),
        // 7.5 pitches: the bracket's 147 mm in 24 voxels.
        (&shared, harmonic_of(Quantity::Depth, &scene, folder.path()), "depth -45.9375 45.9375\n"),
    ] {
        let (done, answers, errors) = run(program, &field, &text);
        assert!(done, "{errors}");
        let answers =
            answers.strip_prefix(says).unwrap_or_else(|| panic!("{says} is not said by\n{answers}"));
        let expected = expected(&field, &poses);
        assert_eq!(answers.lines().count(), expected.lines().count());
        for (line, (found, expected)) in answers.lines().zip(expected.lines()).enumerate() {
            assert_eq!(normal(found), normal(expected), "line {line} of {}", field.display());
        }
        assert!(answers.contains(" free ") && answers.contains(" colliding "), "{answers}");
    }
    let missing = folder.path().join("none.safetensors");
    let (done, _, errors) = run(&shared, &missing, &text);
    assert!(!done && errors.contains("none.safetensors"), "{errors}");
}

/// What the program should write, by the Rust calls.
fn expected(field: &Path, poses: &[Pose]) -> String {
    let verified = Planner::load(field).unwrap();
    let scene = verified.model.scene();
    let exact = ExactField::new(scene, &scene.record.tool).unwrap();
    let count = poses.len();
    let (mut gradients, mut counted) = (vec![Gradient::NAN; count], vec![0.0; count]);
    let (mut decisions, mut best) = (vec![Decision::Undecided; count], vec![Best::NONE; count]);
    verified.gradients(poses, &mut gradients).unwrap();
    exact.values(poses, &mut counted).unwrap();
    verified.classify(poses, &mut decisions).unwrap();
    let points: Vec<DVec3> = poses.iter().map(|p| p.position).collect();
    let rotations: Vec<DQuat> = poses.iter().map(|p| p.rotation).collect();
    verified.best(&points, &rotations, &mut best).unwrap();
    let mut text = String::new();
    for i in 0..count {
        let Gradient { value, position: p, direction: d, .. } = gradients[i];
        for number in [value, p.x, p.y, p.z, d.x, d.y, d.z, counted[i]] {
            write!(text, "{number} ").unwrap();
        }
        let decision = format!("{:?}", decisions[i]).to_lowercase();
        writeln!(text, "{decision} {} {}", best[i].orientation, best[i].value).unwrap();
    }
    let motion =
        verified.checker.check_motion(&poses[0], &poses[count - 1], &MotionOptions::default()).unwrap();
    let kind = i32::from(!motion.is_free());
    let from = motion.last_valid.map_or(0.0, |(time, _)| time);
    let to = motion.first_colliding.map_or(1.0, |collision| collision.time);
    writeln!(text, "motion {kind} {from} {to}").unwrap();
    text
}

/// A line with every number as Rust writes it: C's digits are enough for each to be read back to the bit, those of a motion as
/// doubles.
fn normal(line: &str) -> Vec<String> {
    let number = |word: &str| match line.starts_with("motion") {
        true => word.parse::<f64>().map(|number| number.to_string()),
        false => word.parse::<f32>().map(|number| number.to_string()),
    };
    line.split_whitespace().map(|word| number(word).unwrap_or_else(|_| word.to_owned())).collect()
}
