//! Results that cannot be written, or that nobody reads any more.
#![cfg(target_os = "linux")]

use crate::access::{arguments, crib_arguments, workshop};
use crate::binary::{FEW_POSES, Workdir, finish};
use crate::check::BLOCK;
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

#[test]
fn what_is_read_is_not_written_over() {
    let folder = Workdir::new();
    folder.write("block.obj", BLOCK);
    folder.write("pass.csv", "x,y,z\n0,0,30\n0,0,25\n");
    let asked = "check block.obj pass.csv --pitch 1 --tool paper";
    for (page, read) in [("block.obj", BLOCK), ("./pass.csv", "x,y,z\n0,0,30\n0,0,25\n")] {
        folder.refuse(&format!("{asked} --html {page}"), &[page, "also read"]);
        assert_eq!(folder.text(page), read);
    }
    // Also where steps or signs stand about its name.
    std::fs::create_dir(folder.path("a=b@c")).unwrap();
    folder.write("a=b@c/vise.obj", BLOCK);
    for fixture in ["a=b@c/vise.obj", "a=b@c/vise.obj@translate:0,0,-50"] {
        folder.refuse(&format!("{asked} --fixture {fixture} --html a=b@c/vise.obj"), &["also read"]);
        folder.imf(&format!("{asked} --fixture {fixture}")).done();
    }
    // The stock that an earlier run left in the folder.
    let cut = |stock: &str| format!("{asked} --stock {stock} --out out");
    folder.imf(&cut("box:5")).done();
    let left = folder.text("out/summary.json");
    for stock in ["out/stock.stl", "out/stock.stl@translate:0,0,-1"] {
        folder.refuse(&cut(stock), &["stock.stl is read", "another --out"]);
    }
    // A page replaces nothing beside it.
    folder.imf(&format!("{asked} --stock out/stock.stl --html out/page.html")).done();
    assert_eq!(folder.text("out/summary.json"), left);
}

#[test]
fn a_name_that_is_not_utf_8_is_a_name() {
    use std::os::unix::ffi::OsStringExt as _;
    let folder = Workdir::new();
    let name = |end: &str| std::ffi::OsString::from_vec([b"b\xff", end.as_bytes()].concat());
    std::fs::write(folder.path("x").with_file_name(name(".obj")), BLOCK).unwrap();
    std::fs::write(folder.path("x").with_file_name(name(".csv")), "x,y,z\n0,0,30\n0,0,25\n").unwrap();
    folder.write("block.obj", BLOCK);
    finish("info", folder.command("info --json --unit mm").arg(name(".obj"))).done().json();
    let mut check = folder.command("check block.obj --pitch 1 --tool paper --json --html p.html --out");
    finish("check", check.arg(name("")).arg(name(".csv"))).done().json();
}
