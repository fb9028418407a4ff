//! The page that computes in the browser, and the npm package beside it.
//!
//! `crates/imf-web` is compiled to WebAssembly, its JavaScript and TypeScript types are made by wasm-bindgen, and everything is put
//! into one HTML file, the module compressed, so that the page works from a file as well as from any host.

use std::fs;
use std::io::Write as _;
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use flate2::Compression;
use flate2::write::GzEncoder;
use wasm_bindgen_cli_support::Bindgen;

use crate::root;
use crate::web::{TARGET, Toolchain, folder};

/// A page that is larger takes too long to load.
const MOST_BYTES: usize = 5_000_000;

/// Makes page and package.
///
/// # Errors
/// No compiler for the target; a build that fails; a page that is too large.
pub(crate) fn make() -> Result<()> {
    Toolchain::find()?.cargo(&["build", "--release", "-p", "imf-web"])?;
    let folder = folder();
    let compiled = folder.join("build").join(TARGET).join("release/imf_web.wasm");
    // For the page: a plain script, which a worker from a blob can be made of.
    let parts = folder.join("parts");
    bindgen(&compiled).no_modules(true)?.generate(&parts).context("wasm-bindgen")?;
    package(&folder.join("npm"), &compiled)?;
    let page = page(&parts)?;
    let path = folder.join("imf.html");
    fs::write(&path, &page).with_context(|| path.display().to_string())?;
    println!("{}: {:.2} MB", path.display(), page.len() as f64 / 1e6);
    ensure!(page.len() <= MOST_BYTES, "the page has {} bytes, more than {MOST_BYTES}", page.len());
    Ok(())
}

fn bindgen(compiled: &Path) -> Bindgen {
    let mut bindgen = Bindgen::new();
    bindgen.input_path(compiled).typescript(false).remove_name_section(true).remove_producers_section(true);
    bindgen
}

/// The package for npm: an ES module with its types.
fn package(folder: &Path, compiled: &Path) -> Result<()> {
    bindgen(compiled).web(true)?.typescript(true).generate(folder).context("wasm-bindgen")?;
    let text = fs::read_to_string(root().join("crates/imf-web/page/package.json"))?;
    fs::write(folder.join("package.json"), text.replace("{{version}}", env!("CARGO_PKG_VERSION")))?;
    for licence in ["LICENSE-MIT", "LICENSE-APACHE"] {
        fs::copy(root().join(licence), folder.join(licence))?;
    }
    Ok(())
}

/// The page, everything in it.
fn page(parts: &Path) -> Result<String> {
    let read = |path: PathBuf| fs::read_to_string(&path).with_context(|| path.display().to_string());
    let own = |name: &str| read(root().join("crates/imf-web/page").join(name));
    let report = |name: &str| read(root().join("crates/imf-cli/viewer").join(name));
    let module = parts.join("imf_web_bg.wasm");
    let mut packed = GzEncoder::new(Vec::new(), Compression::best());
    packed.write_all(&fs::read(&module).with_context(|| module.display().to_string())?)?;
    let worker = [read(parts.join("imf_web.js"))?, kernels()?, own("gpu.js")?, own("worker.js")?].join("\n");
    let filled = [
        ("style", report("viewer.css")? + &own("page.css")?),
        ("module", BASE64.encode(packed.finish()?)),
        // An end tag in a script would end it.
        ("worker", worker.replace("</script", "<\\/script")),
        ("three", report("three.min.js")?),
        ("page", own("page.js")?),
    ];
    let template = own("index.html")?;
    // One pass over the template: what is put in may hold braces.
    let mut pieces = template.split("{{");
    let mut page = pieces.next().unwrap_or_default().to_owned();
    for piece in pieces {
        let (name, rest) = piece.split_once("}}").context("a brace of the page's template is not closed")?;
        let (_, text) = filled.iter().find(|(own, _)| *own == name).with_context(|| format!("no {name}"))?;
        page.push_str(text);
        page.push_str(rest);
    }
    Ok(page)
}

/// The kernels of fields' networks for the page's own WebGPU, and the files that each is put together from. `imf-gpu` does the same for
/// itself; its constants stand in `prelude.wgsl`, which a test there compares.
const KERNELS: [(&str, &[&str]); 8] = [
    ("poses", &["poses"]),
    ("inputs", &["inputs"]),
    ("hidden_evaluate", &["product", "product_tiled", "sine", "forward", "hidden_evaluate"]),
    ("linear", &["product", "product_tiled", "forward", "linear"]),
    ("outputs", &["sigmoid", "outputs"]),
    ("minimum", &["minimum"]),
    ("local_frames", &["local_frames"]),
    ("row_minimum", &["row_minimum"]),
];

/// What products take their factors as: f32, not rounded.
const FACTORS: &str = "alias Factors = vec4<f32>;\nfn rounded(v: vec4<f32>) -> vec4<f32> { return v; }\n";

/// The kernels as JavaScript.
fn kernels() -> Result<String> {
    let read = |path: &str| fs::read_to_string(root().join(path)).with_context(|| path.to_owned());
    let front = read("crates/imf-web/page/prelude.wgsl")? + FACTORS + &read("shaders/uniforms.wgsl")?;
    let kernel = |(name, files): (&str, &[&str])| {
        let texts: Result<String> = files.iter().map(|file| read(&format!("shaders/{file}.wgsl"))).collect();
        Ok((name.to_owned(), (front.clone() + &texts?).into()))
    };
    let kernels: serde_json::Map<_, _> = KERNELS.into_iter().map(kernel).collect::<Result<_>>()?;
    Ok(format!("const KERNELS = {};", serde_json::Value::Object(kernels)))
}
