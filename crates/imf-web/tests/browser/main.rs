//! The page in a headless Chromium against the same functions on this machine: `cargo xtask test --browser`.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::io::{BufRead as _, BufReader};
use std::process::{Command, Stdio};

use imf_web::{Part, PartScene, SurfaceAccess};
use serde_json::{Value, json};

const TOOL: &str = "name = \"ball\"\nunit = \"mm\"\n[cutter]\nshape = \"ball\"\ndiameter = 10.0\nlength = 35.0\n[[holder]]\ndiameter = 29.0\n\
                    length = 48.0\n";

/// What the page says to a question, and what else its console says before.
fn answer(question: &Value) -> (Value, Vec<String>) {
    let [browser, page] = ["IMF_BROWSER", "IMF_WEB_PAGE"]
        .map(|name| std::env::var(name).expect("cargo xtask test --browser names browser and page"));
    let page = std::fs::canonicalize(page).unwrap();
    let profile = tempfile::tempdir().unwrap();
    let hash: String = question.to_string().bytes().map(|byte| format!("%{byte:02x}")).collect();
    let mut chromium = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-sync"])
        .args(["--disable-background-networking", "--disable-component-update", "--disable-extensions"])
        // WebGL without a graphics card.
        .args(["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--enable-logging=stderr"])
        // It stays until it is ended: a worker takes its time.
        .args(["--remote-debugging-port=0", &format!("--user-data-dir={}", profile.path().display())])
        .arg(format!("file://{}#check={hash}", page.display()))
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let (mut said, mut found) = (Vec::new(), None);
    for line in BufReader::new(chromium.stderr.take().unwrap()).lines() {
        let line = line.unwrap();
        if let Some((_, rest)) = line.split_once("imf answers ") {
            let (text, _) = rest.rsplit_once(" .").unwrap();
            found = Some(serde_json::from_str(text).unwrap());
            break;
        }
        if line.contains("CONSOLE") {
            said.push(line);
        }
        assert!(said.is_empty(), "the page's console: {said:?}");
    }
    chromium.kill().unwrap();
    chromium.wait().unwrap();
    (found.expect("the page answers"), said)
}

#[test]
#[ignore = "needs the page and Chromium: cargo xtask test --browser"]
fn the_page_counts_what_this_machine_counts() {
    for (part, pitch, directions) in
        [("bracket", Some(3.0), "axes+fibonacci:20"), ("teapot", None, "fibonacci:225")]
    {
        let question = json!({ "part": part, "tool": TOOL, "pitch": pitch, "directions": directions });
        let (found, said) = answer(&question);
        assert!(said.is_empty(), "{said:?}");
        println!("{part}: {} s for {directions}, {} µs a verdict", found["seconds"], found["micro"]);
        let mut scene = PartScene::new(&Part::reference(part).ok().unwrap(), TOOL, pitch).ok().unwrap();
        assert_eq!(found["dims"], json!(scene.dims()), "{part}");
        let numbers = |value: &Value| -> Vec<f64> {
            value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
        };
        let sums = scene.section_sums(directions).ok().unwrap();
        assert!(sums.len() > 20 && sums.iter().any(|&sum| sum > 0.0));
        assert_eq!(numbers(&found["sums"]), sums, "{part}");
        let mut access = SurfaceAccess::new(&scene, directions, 1000).ok().unwrap();
        while access.advance(10_000).ok().unwrap() > 0 {}
        assert_eq!(found["triangles"], json!(access.triangles()), "{part}");
        for (one, other) in numbers(&found["areas"]).iter().zip(access.areas()) {
            assert!((one - other).abs() < 1e-6 * access.areas().iter().sum::<f64>(), "{part}: {one} {other}");
        }
    }
}
