//! `imf parts` and `imf voxelize`.

use imf_core::mesh::read::read_mesh_file;
use imf_core::parts::ReferencePart;

use crate::binary::Workdir;
use crate::shapes::{LAST_FACE, OPEN_CUBE};

#[test]
fn parts_are_written_as_obj_with_what_they_are() {
    let folder = Workdir::new();
    folder.write("all/.teapot.obj.abcdef.part", "");
    let table = folder.imf("parts all").done().stdout;
    assert_eq!(folder.names("all").len(), ReferencePart::ALL.len(), "{:?}", folder.names("all"));
    for part in ReferencePart::ALL {
        let name = format!("all/{part}.obj");
        let read = read_mesh_file(folder.path(&name)).unwrap().mesh;
        assert_eq!(read.triangles.len(), part.mesh().triangles.len());
        let text = folder.text(&name);
        let [x, y, z] = part.dims();
        assert!(text.starts_with(&format!("# {part}: ")), "{name}");
        assert!(text.contains("unit: mm") && text.contains(&format!("{x} x {y} x {z}")), "{name}");
        let line = table.lines().find(|line| line.contains(&name)).unwrap();
        assert_eq!(line.contains("the paper's own"), part.is_papers_own(), "{line}");
    }
    let one = folder.json("parts one --only bracket");
    assert_eq!(one.as_array().unwrap().len(), 1);
    assert_eq!(one[0]["mesh"]["closed"], true);
    assert_eq!(folder.names("one").len(), 1);
}

#[test]
fn voxels_are_written_whatever_the_tool() {
    let folder = Workdir::new();
    // Sections with this tool would need terabytes.
    folder.write("huge.toml", "[cutter]\nshape = \"flat\"\ndiameter = 9000.0\nlength = 15000.0\n");
    let line = "voxelize bracket --dims 5,15,9 --tool huge.toml --memory 1GiB --out a/b";
    let run = folder.imf(line).done();
    // What is of a tool alone does nothing here.
    for option in ["--clearance 2", "--allow-coarse"] {
        let name = option.split(' ').next().unwrap();
        folder.imf(&format!("voxelize bracket --dims 5,15,9 {option} --out c")).bad_input(&[name]);
    }
    run.says(&["5×15×9"]);
    let summary = folder.json(line);
    let solid = folder.npy::<u8>("a/b/solid.npy");
    assert_eq!(solid.dim(), (5, 15, 9));
    let count = solid.iter().filter(|&&s| s == 1).count();
    assert_eq!(summary["solid_voxels"], count);
    let pitch = summary["grid"]["pitch"].as_f64().unwrap();
    assert!((summary["volume"].as_f64().unwrap() - count as f64 * pitch.powi(3)).abs() < 1e-6);
    assert!(folder.bytes("a/b/solid.vti").starts_with(b"<?xml"));
    folder.picture("a/b/slices.png");
}

#[test]
fn an_open_mesh_works_and_is_warned_about() {
    let folder = Workdir::new();
    folder.write("open.obj", OPEN_CUBE);
    folder.write("closed.obj", format!("{OPEN_CUBE}{LAST_FACE}"));
    let solid = |name: &str| {
        let run = folder.imf(&format!("voxelize {name} --pitch 10 --out out")).done();
        (
            run.stderr.contains("imf: warning: "),
            folder.npy::<u8>("out/solid.npy").iter().filter(|&&s| s == 1).count(),
        )
    };
    let (warned, count) = solid("open.obj");
    assert!(warned && count > 700, "{count}");
    assert_eq!(solid("closed.obj"), (false, 1000));
}

#[test]
fn fixtures_are_voxels_as_a_whole_or_refused() {
    let folder = Workdir::new();
    folder.write("cube.obj", format!("{OPEN_CUBE}{LAST_FACE}"));
    folder.write("jaw.obj", format!("{OPEN_CUBE}{LAST_FACE}").replace("100", "50"));
    let voxels = |at: &str, more: &str| {
        let usual = "voxelize cube.obj --unit mm --pitch 10 --out out";
        folder.imf(&format!("{usual} --fixture jaw.obj@translate:{at} {more}"))
    };
    let (beside, through) = ("100,0,0", "75,0,0");
    for at in [beside, through] {
        voxels(at, "").exits(1).warns(&["sticks out of the grid"]);
    }
    let whole = voxels(beside, "--around all --json").json();
    assert_eq!((&whole["part_voxels"], &whole["solid_voxels"]), (&1000.into(), &1125.into()));
    // Nothing is wrong with a mesh whose conservative voxels hold more.
    let conservative = folder.imf("voxelize cube.obj --unit mm --pitch 7 --conservative --out out").done();
    assert!(!conservative.stdout.contains("crosses itself"), "{}", conservative.stdout);
}
