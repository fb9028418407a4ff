//! Results that cannot be written, or that nobody reads any more.
#![cfg(target_os = "linux")]

use crate::access::{arguments, crib_arguments, workshop};
use crate::binary::{FEW_POSES, Workdir};
use crate::model::write_model;

/// Down into the bracket.
const DIVE: &str = "x,y,z\n24.5,73.5,95\n24.5,73.5,6\n";

#[test]
fn a_reader_that_has_gone_away_changes_no_exit_code() {
    let work = Workdir::new();
    work.write("dive.csv", DIVE);
    let check = "check bracket dive.csv --pitch 6";
    for line in [check, &format!("{check} --json")] {
        let run = work.imf_unread(line).exits(3);
        assert!(!run.stderr.contains("error"), "{}", run.stderr);
    }
    work.imf_unread("parts all").done();
    write_model(&work.path("m.safetensors"));
    work.write("poses.csv", "x,y,z\n1,2,3\n");
    work.imf_unread("query m.safetensors poses.csv --device cpu").done();
}

#[test]
fn what_was_found_is_printed_where_its_files_can_not_be_written() {
    let work = workshop();
    write_model(&work.path("m.safetensors"));
    work.calibrate_quickly("m.safetensors");
    // An older report is not left beside a newer picture.
    work.write("report/report.md", "older");
    work.write("report/.imf.png.abcdef.part", "");
    let tools = "--tool short.toml --orientations axes";
    let field = "field bracket --pitch 6 --orientations 0,0 --out field";
    let eval = "eval m.safetensors --device cpu --random 2 --imf fibonacci:2 --out report";
    for (blocks, line, found) in [
        (0, arguments(tools), "accessible around it"),
        (0, crib_arguments(tools), "some tool reaches"),
        (0, "voxelize bracket --pitch 6 --out voxels".into(), "solid where"),
        (0, format!("{field} --imf"), "largest IMF"),
        // All sections are there, and not the file that has them together.
        (30, field.into(), "accessible outside the part"),
        (0, format!("calibrate m.safetensors {FEW_POSES}"), "Verdict: "),
        (0, eval.into(), "2 random sections"),
    ] {
        let run = work.imf_in_blocks(blocks, &line).exits(1);
        run.says(&[found]);
        run.warns(&["imf: error: ", "cannot write"]);
        assert!(!run.stdout.contains("written to"), "{}", run.stdout);
    }
    assert_eq!(work.names("report"), [""; 0]);

    // The stock's voxels alone are too many.
    work.write("dive.csv", DIVE);
    let check = "check bracket dive.csv --pitch 2 --tool paper --stock box --out path";
    let run = work.imf_in_blocks(200, check).exits(1);
    run.says(&["line 3: ", "collide"]);
    run.warns(&["cannot write path/stock.vti"]);
    assert_eq!(work.names("path"), ["collisions.csv", "removed.csv", "worst.png"]);
}
