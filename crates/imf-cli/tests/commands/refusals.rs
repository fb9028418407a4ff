//! Bad input to the commands that make fields: one message, exit code 1, nothing left behind.

use crate::binary::Workdir;
use crate::shapes::{LAST_FACE, OPEN_CUBE};

/// Both commands that read a scene.
fn refuse(folder: &Workdir, arguments: &str, expected: &[&str]) {
    runs(arguments).iter().for_each(|run| folder.refuse(run, expected));
}

/// The same of an argument that is wrong itself.
fn refuse_argument(folder: &Workdir, arguments: &str, expected: &[&str]) {
    runs(arguments).iter().for_each(|run| drop(folder.imf(run).bad_input(expected)));
}

fn runs(arguments: &str) -> [String; 2] {
    [
        format!("voxelize {arguments} --out out"),
        format!("field {arguments} --orientations fibonacci:3 --out out"),
    ]
}

#[test]
fn meshes_that_cannot_be_read() {
    let folder = Workdir::new();
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
    folder.write("empty.obj", "");
    folder.write("nan.obj", format!("{triangle}v 0 NaN 0\nf 1 2 4\n"));
    folder.write("points.obj", triangle);
    folder.write("index.obj", format!("{triangle}f 1 2 9\n"));
    folder.write("cut.obj", format!("{triangle}v 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3"));
    folder.write("cut.stl", [&[0; 80][..], &12u32.to_le_bytes(), &[0; 75]].concat());
    folder.write("part.step", "ISO-10303-21;");
    refuse(&folder, "cut.obj", &["cut.obj", "line 7", "in the middle of a line"]);
    refuse(&folder, "missing.obj", &["missing.obj", "there is no mesh file"]);
    refuse(&folder, "empty.obj", &["empty.obj", "is empty"]);
    refuse(&folder, "nan.obj", &["nan.obj", "line 4", "NaN"]);
    refuse(&folder, "points.obj", &["points.obj", "no faces"]);
    refuse(&folder, "index.obj", &["index.obj", "vertex 9"]);
    refuse(&folder, "cut.stl --unit mm", &["cut.stl", "cut short"]);
    refuse(&folder, "part.step", &["part.step"]);
}

#[test]
fn units_and_sizes() {
    let folder = Workdir::new();
    folder.write("cube.obj", format!("{OPEN_CUBE}{LAST_FACE}"));
    folder.write("cube.stl", "solid cube\nendsolid cube\n");
    refuse_argument(&folder, "cube.stl", &["cube.stl", "--unit mm"]);
    refuse(&folder, "cube.obj --unit m", &["cube.obj", "100 × 100 × 100 m", "0.1 mm to 20 m"]);
    let paper = |more: &str| format!("cube.obj --tool paper {more}");
    refuse(&folder, &paper("--pitch 1e-9"), &["too large", "larger pitch"]);
    refuse_argument(&folder, &paper("--dims 9,0,9"), &["at least 1"]);
    refuse_argument(&folder, &paper("--dims 9,9,9 --margin 5"), &["margin"]);
    let field = |more: &str| format!("field cube.obj --orientations 0,0 --out out {more}");
    // Without a tool there is no answer, and the message shows how one is described.
    folder.imf(&field("")).exits(2).warns(&["[cutter] with shape", "--tool paper"]);
    // A cube of 1 mm and a cutter of 10.
    let speck = field("--tool paper --scale 0.01");
    folder.refuse(
        &speck,
        &["cube.obj does not say its unit", "longest side is 1 mm", "10 mm thick", "in inch", "--unit"],
    );
    // With its unit named nothing is asked.
    let small = field("--tool paper --scale 0.09 --pitch 3");
    folder.imf(&format!("{small} --unit mm")).done();
    folder.refuse(&small, &["does not say its unit"]);
    // A fixture a hundred times as long as the part, in a unit that is not said, and its remedy.
    let held = |fixture: &str| field(&format!("--tool paper --around all --fixture {fixture} --pitch 7"));
    let far = "cube.obj@matrix:100,0,0,200,0,100,0,0,0,0,100,0";
    folder.refuse(&held(far), &["fixture cube.obj", "longest side would be 10000 mm", "@unit:inch"]);
    folder.imf(&held("cube.obj@unit:mm;translate:120,0,0")).done();
    let summary = folder.json(&field("--tool paper"));
    assert_eq!(summary["scene"]["grid"]["pitch"], 1.6, "{summary}");
    assert!(summary["choices"][0].as_str().unwrap().contains("a sixth of the tool's thinnest element"));
    std::fs::remove_dir_all(folder.path("out")).unwrap();
    refuse_argument(&folder, "bracket --threads 0", &["--threads"]);
    refuse_argument(&folder, "bracket --threads 100000", &["--threads 100000", "cores"]);
}

#[test]
fn meshes_that_do_not_say_what_is_inside() {
    let folder = Workdir::new();
    // The cube of twelve triangles, none of which shares a corner with another, half of them turned.
    let cube = format!("{OPEN_CUBE}{LAST_FACE}");
    let vertices: Vec<&str> = cube.lines().filter(|line| line.starts_with("v ")).collect();
    let faces: Vec<[usize; 3]> = cube
        .lines()
        .filter_map(|line| line.strip_prefix("f "))
        .map(|line| {
            let corners: Vec<usize> = line.split(' ').map(|corner| corner.parse().unwrap()).collect();
            [corners[0], corners[1], corners[2]]
        })
        .collect();
    // Corners lie apart by the last digits.
    let soup = |zeros: &str| {
        let mut soup = String::new();
        for (index, &[a, b, c]) in faces.iter().enumerate() {
            let corners = if index % 2 == 0 { [a, b, c] } else { [a, c, b] };
            for corner in corners {
                soup += &format!("{}.{zeros}{index:02}1\n", vertices[corner - 1]);
            }
            soup += &format!("f {} {} {}\n", 3 * index + 1, 3 * index + 2, 3 * index + 3);
        }
        soup
    };
    // By less than anyone would see they are joined.
    folder.write("near.obj", soup("000"));
    let answer = folder.json("voxelize near.obj --dims 10,10,10 --out near");
    assert_eq!((&answer["solid_voxels"], &answer["undecided_fraction"]), (&1000.into(), &0.0.into()));
    assert!(answer["warnings"][0].as_str().unwrap().contains("28 corners lay within"), "{answer}");
    folder.write("soup.obj", soup(""));
    let soup = "soup.obj --pitch 7 --tool paper";
    refuse(&folder, soup, &["soup.obj", "cannot be told apart", "winding number"]);
    // On shared corners the same triangles say it by themselves.
    let turned: String = faces
        .iter()
        .enumerate()
        .map(
            |(index, &[a, b, c])| {
                if index % 2 == 0 { format!("f {a} {b} {c}\n") } else { format!("f {a} {c} {b}\n") }
            },
        )
        .collect();
    folder.write("turned.obj", vertices.join("\n") + "\n" + &turned);
    let answer = folder.json("voxelize turned.obj --pitch 10 --out out");
    assert_eq!((&answer["solid_voxels"], &answer["undecided_fraction"]), (&1000.into(), &0.0.into()));
    assert_eq!(answer["warnings"][0], "turned.obj: 6 of 12 triangles faced the wrong way and were flipped");
}

#[test]
fn work_larger_than_memory_is_refused_with_the_estimate() {
    let folder = Workdir::new();
    let field = |more: &str| format!("field bracket --orientations fibonacci:3 --out out {more}");
    folder.refuse(&field("--memory 1MiB"), &["MiB of memory, and 1 MiB may be used", "--memory"]);
    folder.write("long.toml", "[cutter]\nshape = \"flat\"\ndiameter = 5.0\nlength = 9000.0\n");
    // What reaches beyond the part takes none.
    folder.imf(&field("--tool long.toml --memory 1GiB")).done();
    let huge = field("--tool long.toml --pitch 0.15 --memory 2GiB");
    folder
        .refuse(&huge, &["GiB of memory, and 2.0 GiB may be used", "reaches 60000 voxels", "larger --pitch"]);
    let voxels = "voxelize bracket --pitch 0.2 --memory 1MiB --out out";
    folder.refuse(voxels, &["and 1 MiB may be used", "245×735×435 voxels"]);
    let few_voxels = "bracket --dims 5,15,9 --memory 2MiB --out out";
    for command in ["voxelize", "field --allow-coarse --orientations 0,0"] {
        let fine_mesh = format!("{command} {few_voxels}");
        folder.refuse(&fine_mesh, &["and 2 MiB may be used", "29536 triangles", "coarser mesh"]);
    }
    let dense =
        "dataset bracket --dims 12,36,22 --orientations fibonacci:600 --density 1 --memory 60MiB --out out";
    folder.refuse(dense, &["and 60 MiB may be used", "a shard of samples", "--shard-samples"]);
}

#[test]
fn tool_files_are_refused_by_line_and_key() {
    let folder = Workdir::new();
    for (text, expected) in [
        ("[cutter]\nshape = \"flat\"\ndiameter = -5.0\nlength = 9.0\n", ["line 3", "cutter.diameter"]),
        ("[cutter]\nshape = \"flat\"\ndiameter = 5.0\nlenght = 9.0\n", ["line 4", "lenght"]),
        ("[cutter]\nshape = \"round\"\ndiameter = 5.0\nlength = 9.0\n", ["line 2", "round"]),
        ("name = \"x\"\n[cutter\n", ["line 2", "tool.toml"]),
        ("name = \"none\"\n", ["line 1", "[cutter]"]),
    ] {
        folder.write("tool.toml", text);
        refuse(&folder, "bracket --dims 5,15,9 --tool tool.toml", &expected);
        folder.refuse("info tool.toml", &expected);
    }
    refuse(&folder, "bracket --tool missing.toml", &["missing.toml"]);
    folder.write("tiny.toml", "[cutter]\nshape = \"flat\"\ndiameter = 0.01\nlength = 0.01\n");
    let tiny = "field bracket --dims 5,15,9 --orientations 12,6 --tool tiny.toml --out out";
    folder.refuse(tiny, &["cutter", "0.01 mm thick", "--pitch, or --allow-coarse"]);
    // The tip's own voxel centre is in every tool.
    folder.imf(&format!("{tiny} --allow-coarse")).done();
}

#[test]
fn orientation_sets_and_parts_that_are_none() {
    let folder = Workdir::new();
    folder.write("o.csv", "theta,phi\n0,0\n10,north\n");
    for (set, words) in [
        ("ring:5", ["'ring:5' is not an orientation set", "fibonacci:N"]),
        ("grid:0", ["grid:0", "'0' is not a number of orientations"]),
        ("0,200", ["0,200", "φ must be from 0 to 180"]),
        ("random:5", ["'random:5' is not an orientation set", "random:N:SEED"]),
        ("random:3:x", ["random:3:x", "'x' is not a seed"]),
        ("o.csv", ["o.csv", "line 3"]),
    ] {
        folder.refuse_input(&format!("field bracket --orientations {set} --out out"), &words);
    }
    folder.refuse("field bracket --orientations missing.csv --out out", &["missing.csv", "cannot read"]);
    let dataset = |set| format!("dataset bracket --orientations {set} --out data");
    folder.refuse_input(&dataset("ring:5"), &["ring:5", "fibonacci:N"]);
    folder.refuse(&dataset("so3:8"), &["so3:8", "rolls"]);
    folder.refuse_input("parts out --only kettle", &["no reference part 'kettle'", "bracket-raw"]);
    folder.refuse_input(
        "field bracket --unit inch --orientations 0,0 --out out",
        &["bracket is in mm: leave --unit out"],
    );
}

#[test]
fn wrong_arguments_exit_with_2() {
    let folder = Workdir::new();
    let missing = "arguments were not provided:\n  --out <";
    for (line, expected) in [
        ("polish the-part", "error: unrecognized subcommand 'polish'"),
        ("info teapot --unit furlong", "mm, cm, m and inch"),
        ("voxelize bracket", missing),
        ("voxelize bracket --out out --dims 5,15", "three whole numbers"),
        ("voxelize bracket --out out --dims 5,15,9 --pitch 2", "--pitch"),
        ("voxelize bracket --out out --pitch 0", "a positive length"),
        ("voxelize bracket --out out --pitch NaN", "a positive length"),
        ("voxelize bracket --out out --pitch 1,1,2", "cubes"),
        ("voxelize bracket --out out --unit furlong", "furlong"),
        ("voxelize bracket --out out --transform rotate:0,0,0:90", "0,0,0:90': the axis must not be zero"),
        ("voxelize bracket --out out --fixture clamp.obj@turn:1", "clamp.obj@turn:1"),
        ("voxelize bracket --out out --fixture vice.stl@scale:2", "scale:2"),
        ("field bracket --out out", "--orientations"),
        ("field bracket --orientations 0,0 --out out --memory plenty", "plenty"),
        ("dataset bracket --dims 7,21 --orientations grid:2 --out data", "three whole numbers"),
        ("train siren5 data", missing),
        ("train harmonic bracket", missing),
        ("train siren5 data --out model --epochs 3 --steps 3", "cannot be used with '--steps <N>'"),
        ("eval model --in-sample grid:2", "one pair"),
    ] {
        let run = folder.imf(line).exits(2);
        assert!(run.stdout.is_empty() && run.stderr.starts_with("error: "), "`imf {line}`: {}", run.stderr);
        run.warns(&[expected]);
    }
    let alone = folder.imf("").exits(2);
    assert!(alone.stdout.is_empty() && alone.stderr.contains("Usage: imf"), "{}", alone.stderr);
    assert!(folder.entries().is_empty());
}
