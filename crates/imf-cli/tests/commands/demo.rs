//! `imf demo`, cut short: everything is there, and the verdict follows from the numbers.

#[cfg(unix)]
use imf_fields::factored::file::FactoredFile;
use serde_json::json;

use crate::binary::{Finished, Workdir};
use crate::pipeline::honest;

/// The page is honest and shows its pictures, and each stage had its line, with a rate.
fn complete(work: &Workdir, demo: &Finished, pictures: &[&str], stages: [&str; 3]) {
    let page = work.text("demo/report.md");
    honest(&work.read_json("demo/report.json"), &page);
    for picture in pictures {
        work.picture(&format!("demo/{picture}"));
        assert!(page.contains(picture), "{picture}");
    }
    for stage in stages {
        let line = demo.stderr.lines().find(|line| line.starts_with(stage));
        assert!(line.is_some_and(|line| line.contains("/s)")), "{stage} in\n{}", demo.stderr);
    }
}

#[test]
fn a_short_demo_fits_distils_and_says_what_the_network_is_worth() {
    let work = Workdir::new();
    let demo = work.imf("demo --steps 60 --device cpu --out demo").done();
    let report = work.read_json("demo/report.json");
    assert_eq!((&report["part"], &report["family"]), (&json!("teapot"), &json!("factored")));
    assert_eq!(report["dims"], json!([58, 76, 121]));
    assert!(honest(&report, &demo.stdout), "sixty steps are enough to steer:\n{}", demo.stdout);
    let stages = ["sections to fit: 464 sections in", "training: 60 steps in", "evaluating: 354 sections in"];
    complete(&work, &demo, &["sections.png", "imf.png", "errors.png"], stages);
    // The field is there to be asked.
    std::fs::write(work.path("poses.csv"), "x,y,z,i,j,k\n0,0,0,0,0,1\n").unwrap();
    work.imf("query demo/field.safetensors poses.csv").done();
    #[cfg(unix)]
    goes_on(&work);
}

/// What is finished in the folder is begun anew; what is not goes on, though an older field lies beside it.
#[cfg(unix)]
fn goes_on(work: &Workdir) {
    let demo = "demo --steps 100000 --device cpu --out demo";
    let interrupted = || {
        // The teapot has an axis, so the network five inputs.
        let run = work.interrupted_once_it_says("training 5→", demo);
        let file = FactoredFile::read(&work.path("demo/checkpoint.safetensors")).unwrap();
        (run, file.state.unwrap().training.step)
    };
    let (run, first) = interrupted();
    run.interrupted(&["is saved in demo/checkpoint.safetensors", "same command"]);
    assert!((1..100_000).contains(&first), "{first} steps");
    // Another demo does not throw it away.
    let saved = work.bytes("demo/checkpoint.safetensors");
    work.imf(&demo.replace("100000", "99999")).refused(&["demo/checkpoint.safetensors", "other settings"]);
    assert!(work.bytes("demo/checkpoint.safetensors") == saved);
    let (run, then) = interrupted();
    run.interrupted(&["same command"]);
    assert!(then > first, "{then} steps after {first}");
}
