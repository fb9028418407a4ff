//! The page in a headless Chromium against the same functions on this machine: `cargo xtask test --browser`.
#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

use std::io::{BufRead as _, BufReader};
use std::path::PathBuf;
use std::process::{Command, Stdio};

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use imf_core::control::Control;
use imf_core::field::GridField as _;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_fields::field::Field;
use imf_web::{Part, PartScene, SurfaceAccess};
use serde_json::{Value, json};

mod fields;

use fields::Case;

const TOOL: &str = "name = \"ball\"\nunit = \"mm\"\n[cutter]\nshape = \"ball\"\ndiameter = 10.0\nlength = 35.0\n[[holder]]\ndiameter = 29.0\n\
                    length = 48.0\n";

/// The page that `cargo xtask test --browser` names.
fn page() -> PathBuf {
    let named = std::env::var_os("IMF_WEB_PAGE").expect("cargo xtask test --browser names the page");
    std::fs::canonicalize(named).unwrap()
}

/// So many answers of a page, in its words, and nothing else on its console.
fn answers(address: &str, flags: &[&str], count: usize) -> Vec<Value> {
    let browser = std::env::var("IMF_BROWSER").expect("cargo xtask test --browser names the browser");
    let profile = tempfile::tempdir().unwrap();
    let mut chromium = Command::new(browser)
        .args(["--headless", "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-sync"])
        .args(["--disable-background-networking", "--disable-component-update", "--disable-extensions"])
        // WebGL without a graphics card.
        .args(["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--enable-logging=stderr"])
        // It stays until it is ended: a worker takes its time.
        .args(["--remote-debugging-port=0", &format!("--user-data-dir={}", profile.path().display())])
        .args(flags)
        .arg(address)
        .stdout(Stdio::null())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let (mut said, mut found) = (Vec::new(), Vec::new());
    for line in BufReader::new(chromium.stderr.take().unwrap()).lines() {
        let line = line.unwrap();
        if let Some((_, rest)) = line.split_once("imf answers ") {
            let (text, _) = rest.rsplit_once(" .").unwrap();
            found.push(serde_json::from_str(text).unwrap());
        } else if line.contains("CONSOLE") && !line.contains("No available adapters") {
            // That one is the browser's own, where it has WebGPU and no graphics card.
            said.push(line);
        }
        if !said.is_empty() || found.len() == count {
            break;
        }
    }
    chromium.kill().unwrap();
    chromium.wait().unwrap();
    assert!(said.is_empty(), "the page's console: {said:?}");
    assert_eq!(found.len(), count, "the page answers");
    found
}

/// What the page says to a question.
fn answer(question: &Value) -> Value {
    let hash: String = question.to_string().bytes().map(|byte| format!("%{byte:02x}")).collect();
    answers(&format!("file://{}#check={hash}", page().display()), &[], 1).remove(0)
}

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|number| number.as_f64().unwrap()).collect()
}

#[test]
#[ignore = "needs the page and Chromium: cargo xtask test --browser"]
fn the_page_counts_what_this_machine_counts() {
    for (part, pitch, directions) in
        [("bracket", Some(3.0), "axes+fibonacci:20"), ("teapot", None, "fibonacci:225")]
    {
        let question = json!({ "part": part, "tool": TOOL, "pitch": pitch, "directions": directions });
        let found = answer(&question);
        println!("{part}: {} s for {directions}, {} µs a verdict", found["seconds"], found["micro"]);
        let mut scene = PartScene::new(&Part::reference(part).ok().unwrap(), TOOL, pitch).ok().unwrap();
        assert_eq!(found["dims"], json!(scene.dims()), "{part}");
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

/// How far a value on a graphics card, or in the page, may be from the library's: `crates/imf-gpu/tests/gpu/tolerances.rs` says why, and
/// the sums of WebAssembly have another order too.
const WITHIN: f64 = 2e-5;
/// Of the values this many are one apart in what the page answers: a prime, so that they are of all rows and columns.
const APART: usize = 29;

/// Asks the page for a section and a minimum of every field.
const QUESTIONS: &str = "<script>(async () => {
    await imf.ready;
    for (const [name, minimum, packed] of FIELDS) {
        const file = Uint8Array.from(atob(packed), c => c.charCodeAt(0)).buffer;
        await imf.ask('field', { name, file, software: SOFTWARE });
        for (const over of ['', minimum]) {
            const { field, engine, mse, seconds } = await imf.ask('compare', { theta: 30, phi: 50, over });
            const values = [...field].filter((_, place) => place % APART === 0);
            console.info(`imf answers ${JSON.stringify({ name, over, engine, mse, seconds, values })} .`);
        }
    }
})().catch(error => console.error(error.message));</script></body>";

#[test]
#[ignore = "needs the page and Chromium: cargo xtask test --browser"]
fn fields_are_the_librarys_by_webgpu_and_by_webassembly() {
    let fields = fields::all();
    let packed: Vec<_> =
        fields.iter().map(|case| json!([case.name, case.over, BASE64.encode(&case.bytes)])).collect();
    let text = std::fs::read_to_string(page()).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let expected: Vec<[Vec<f32>; 2]> = fields
        .iter()
        .map(|case| {
            let field = Field::from_bytes(&case.bytes, case.name).unwrap();
            let mut section = vec![0.0; field.grid().len()];
            field.section(&Orientation::new(30.0, 50.0), &mut section).unwrap();
            let set = OrientationSet::parse(case.over).unwrap();
            [section, field.minimum(&set.orientations, Control::quiet()).unwrap().value]
        })
        .collect();
    // The browser's own software adapter; then what a browser without a graphics card does.
    for (software, flags) in
        [(true, &["--enable-unsafe-webgpu"][..]), (false, &["--enable-unsafe-webgpu"]), (false, &[])]
    {
        let questions = QUESTIONS
            .replace("FIELDS", &json!(packed).to_string())
            .replace("SOFTWARE", &software.to_string())
            .replace("APART", &APART.to_string());
        let copy = folder.path().join("page.html");
        std::fs::write(&copy, text.replace("</body>", &questions)).unwrap();
        let found = answers(&format!("file://{}", copy.display()), flags, 2 * fields.len());
        let cases = fields.iter().zip(&expected);
        let asked = cases.flat_map(|(case, both)| both.iter().map(move |values| (case, values)));
        for ((Case { name, has_network, .. }, expected), found) in asked.zip(&found) {
            let engine = found["engine"].as_str().unwrap();
            println!("{name}, {:?}: {engine}, {} s", found["over"], found["seconds"]);
            let begins = if software && *has_network { "WebGPU (" } else { "WebAssembly (" };
            assert!(engine.starts_with(begins), "{name}: {engine}");
            let values = numbers(&found["values"]);
            let expected: Vec<f64> = expected.iter().step_by(APART).map(|&value| value.into()).collect();
            assert_eq!(values.len(), expected.len());
            let apart =
                values.iter().zip(&expected).map(|(one, other)| (one - other).abs()).fold(0.0, f64::max);
            assert!(apart <= WITHIN, "{name} by {engine}: {apart} apart");
            let spread = expected.iter().fold(0.0, |most: f64, &value| most.max(value));
            assert!(spread > 100.0 * WITHIN, "{name}: values say nothing, at most {spread}");
        }
    }
}
