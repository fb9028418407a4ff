//! `imf check`: what it says, and the exit code it leaves.

use serde_json::Value;

use crate::folder::{Folder, Run};

/// A block of 20 mm on the floor, its middle over the origin.
const BLOCK: &str = "v -10 -10 0\nv 10 -10 0\nv 10 10 0\nv -10 10 0\nv -10 -10 20\nv 10 -10 20\nv 10 10 20\n\
                     v -10 10 20\nf 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";

/// Checks a toolpath over the block.
fn check(name: &str, toolpath: &str, more: &[&str]) -> Run {
    let folder = Folder::new();
    folder.write("block.obj", BLOCK);
    folder.write(name, toolpath);
    folder.run(
        &[&["check", "block.obj", name, "--tool", "paper", "--pitch", "1", "--margin", "2"], more].concat(),
    )
}

#[test]
fn a_finishing_pass_is_free_and_says_what_was_accepted() {
    let run = check("pass.cl", "GOTO/-12,0,19.4,0,0,1\nFIXTUR/ON\nGOTO/12,0,19.4\n", &[]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(run.stdout.starts_with("no collision: 2 lines"), "{}", run.stdout);
    assert!(
        run.stdout.contains("down to 1.0000 mm below the part's surface, by their centres"),
        "{}",
        run.stdout
    );
    assert!(run.stderr.contains("line 2: 'FIXTUR' is not understood"), "{}", run.stderr);
}

#[test]
fn a_collision_names_its_line_and_element_and_leaves_3() {
    // Beside the block, then in under the holder.
    let toolpath = "x,y,z,i,j,k\n0,0,40,0,0,1\n0,0,41,0,0,1\n-17,0,-20,0,0,1\n";
    let run = check("dive.csv", toolpath, &["--clearance", "1"]);
    assert_eq!(run.code, Some(3), "{}", run.stderr);
    assert!(run.stdout.contains("line 4: holder 1 hits the part"), "{}", run.stdout);
    let run = check("dive.csv", toolpath, &["--json", "--quiet"]);
    assert_eq!((run.code, run.stderr.as_str()), (Some(3), ""));
    let answer: Value = serde_json::from_str(&run.stdout).unwrap();
    assert_eq!(answer["collides"], true);
    assert_eq!(answer["report"]["colliding"][0]["line"], 4);
}

#[test]
fn mistakes_name_their_line() {
    let run = check("path.csv", "0,0,40,0,0,1\n0,0,40,0,0,0\n", &[]);
    run.is_refusal(&["path.csv, line 2: the tool axis must not be zero"], &["check"]);
    let run = check("path.csv", "0,0,40\n", &["--tolerance", "0"]);
    run.is_refusal(&["tolerance", "above 0"], &["check"]);
    let run = check("path.csv", "", &[]);
    run.is_refusal(&["path.csv", "no tool location"], &["check"]);
}

#[test]
fn what_would_be_overlooked_is_refused() {
    let run = check("drill.cl", "GOTO/0,0,30\nCYCLE/DRILL,29,100\nGOTO/0,0,21\nCYCLE/OFF\n", &[]);
    run.is_refusal(&["drill.cl, line 2", "CYCLE moves the tool", "GOTO/"], &["check"]);
    let folder = Folder::new();
    folder.write("block.obj", BLOCK);
    folder.write("path.csv", "0,0,40\n0,0,4\n");
    folder.write("thin.toml", "name = \"thin\"\n[cutter]\nshape = \"flat\"\ndiameter = 3.0\nlength = 30.0\n");
    let thin = ["check", "block.obj", "path.csv", "--tool", "thin.toml", "--contact", "0", "--pitch"];
    let run = |pitch: &str| folder.run(&[&thin[..], &[pitch]].concat());
    run("4").is_refusal(
        &["cutter", "3.0000 mm thick", "pitch of at most 2.1213", "--pitch, or --allow-coarse"],
        &["check"],
    );
    assert_eq!(run("2").code, Some(3));
    // Whoever insists is answered, and told in the answer.
    let coarse = folder.run(&[&thin[..], &["4", "--allow-coarse", "--json"]].concat());
    let answer: Value = serde_json::from_str(&coarse.stdout).unwrap();
    assert!(answer["warnings"][0].as_str().unwrap().contains("3.0000 mm thick"), "{answer}");
    folder.write("plate.obj", BLOCK.replace("20", "0.4"));
    let held = ["check", "block.obj", "path.csv", "--tool", "paper", "--pitch", "2", "--margin", "4"];
    folder.refuse(
        &[&held[..], &["--fixture", "plate.obj@translate:0,0,21.3"]].concat(),
        &["plate.obj", "overlooked", "smaller pitch"],
    );
}

#[test]
fn fixtures_are_hit_by_the_cutter_too_and_contact_does_not_help() {
    let post = BLOCK.replace("10", "3").replace("20", "30");
    let check = |more: &[&str]| {
        let folder = Folder::new();
        folder.write("block.obj", BLOCK);
        folder.write("post.obj", &post);
        folder.write("path.csv", "-20,0,19.6\n20,0,19.6\n");
        let asked = ["check", "block.obj", "path.csv", "--tool", "paper", "--pitch", "1", "--margin", "2"];
        folder.run(&[&asked[..], more].concat())
    };
    // The post stands on the block's edge, half of it beside the block.
    let post = ["--fixture", "post.obj@translate:10,0,0"];
    let free = check(&[]);
    assert_eq!(free.code, Some(0), "{}", free.stderr);
    // It is hit where it sticks out of the grid around the block, too.
    let hit = check(&[&post[..], &["--contact", "2", "--json"]].concat());
    assert_eq!(hit.code, Some(3), "{}", hit.stderr);
    let around = check(&[&post[..], &["--around", "all", "--contact", "2", "--json"]].concat());
    assert_eq!((around.code, &around.stdout), (Some(3), &hit.stdout));
    let answer: Value = serde_json::from_str(&hit.stdout).unwrap();
    let collisions = answer["report"]["colliding"][0]["collisions"].as_array().unwrap();
    assert!(
        collisions.iter().any(|c| c["element"] == "cutter" && c["against"] == "fixtures"),
        "{collisions:?}"
    );
    assert!(collisions.iter().all(|c| c["against"] == "fixtures"), "{collisions:?}");
    assert!(answer["guarantee"].as_str().unwrap().starts_with("exact for voxel centres"));
}

#[test]
fn the_guarantee_follows_clearance_and_voxels() {
    let run = check("pass.csv", "-12,0,24\n12,0,24\n", &["--conservative", "--clearance", "1"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(run.stdout.contains("holder and shank keep off the mesh itself"), "{}", run.stdout);
    let run = check("pass.csv", "-12,0,24\n", &["--clearance=-1"]);
    run.is_refusal(&["clearance of the holder", "not -1"], &["check"]);
}
