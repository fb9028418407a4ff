//! Keeps ARCHITECTURE.md true: the order inside the crates, the core's independence, and the names of things; and the lists of
//! what the crates make public.

mod imports;
mod surface;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use imports::{Source, parse};

/// Names that say nothing about what is inside.
const EMPTY_NAMES: [&str; 8] =
    ["util", "utils", "helper", "helpers", "common", "commons", "misc", "miscellaneous"];
/// Lines of a source file.
const MOST_LINES: usize = 400;
/// What a planner that only queries must not pull in.
const NOT_IN_CORE: [&str; 7] = ["wgpu", "wgpu-core", "wgpu-hal", "naga", "ash", "clap", "imf-gpu"];

fn root() -> PathBuf {
    PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/.."))
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()))
}

/// Crates whose modules have an order of their own.
const ORDERED: [&str; 2] = ["imf-core", "imf-fields"];
/// The modules of the first fenced block below the heading "The order inside" of a crate, in order. An entry may be a
/// module of a module (`siren::reference`), which then stands at its own place.
fn order_inside(krate: &str) -> Vec<Vec<String>> {
    let text = read(&root().join("ARCHITECTURE.md"));
    let heading = format!("## The order inside {krate}\n");
    let block = text
        .split_once(&heading)
        .and_then(|(_, rest)| rest.split_once("```text\n"))
        .and_then(|(_, rest)| rest.split_once("```"))
        .unwrap_or_else(|| panic!("ARCHITECTURE.md has a fenced text block below \"{heading}\""))
        .0;
    let first_word = |line: &str| line.split_whitespace().next().map(str::to_owned);
    block.lines().filter_map(first_word).map(|name| name.split("::").map(str::to_owned).collect()).collect()
}

/// Every source file of a crate by its module's path, followed from lib.rs along `mod` lines; what is compiled for
/// tests only is left out.
fn modules(crate_folder: &Path) -> BTreeMap<Vec<String>, (PathBuf, Source)> {
    let source = crate_folder.join("src");
    let mut found = BTreeMap::new();
    let mut waiting = vec![(Vec::new(), source.join("lib.rs"))];
    while let Some((module, file)) = waiting.pop() {
        let parsed =
            parse(&read(&file), &module).unwrap_or_else(|error| panic!("{}: {error}", file.display()));
        for child in &parsed.children {
            waiting.push((child.clone(), module_file(&source, child)));
        }
        found.insert(module, (file, parsed));
    }
    found
}

/// The file of a module.
fn module_file(source: &Path, module: &[String]) -> PathBuf {
    let path = source.join(module.join("/"));
    let flat = path.with_extension("rs");
    if flat.exists() { flat } else { path.join("mod.rs") }
}

/// The place of the longest entry that `module` lies in.
fn place(order: &[Vec<String>], module: &[String]) -> Option<usize> {
    let entries = order.iter().enumerate().filter(|(_, entry)| module.starts_with(entry));
    entries.max_by_key(|(_, entry)| entry.len()).map(|(index, _)| index)
}

#[test]
fn every_module_imports_only_from_what_stands_before_it() {
    let mut violations = Vec::new();
    for krate in ORDERED {
        let order = order_inside(krate);
        for (module, (file, source)) in modules(&root().join("crates").join(krate)) {
            // The crate's root declares modules and may name any.
            let Some(here) = place(&order, &module) else { continue };
            for import in &source.imports {
                let from = format!("{}:{}", file.display(), import.line);
                match place(&order, &import.path) {
                    Some(there) if there <= here => {}
                    Some(there) => violations.push(format!(
                        "{from}: {} imports from {}, which stands after it",
                        order[here].join("::"),
                        order[there].join("::")
                    )),
                    None => violations.push(format!(
                        "{from}: crate::{} names no module of the order",
                        import.path.join("::")
                    )),
                }
            }
        }
    }
    assert!(violations.is_empty(), "\n{}\n", violations.join("\n"));
}

#[test]
fn the_orders_list_exactly_the_modules() {
    for krate in ORDERED {
        let order = order_inside(krate);
        let modules = modules(&root().join("crates").join(krate));
        let listed: BTreeSet<_> = order.iter().cloned().collect();
        assert_eq!(listed.len(), order.len(), "a module of {krate} is listed twice in ARCHITECTURE.md");
        let missing: Vec<_> =
            modules.keys().filter(|module| module.len() == 1 && !listed.contains(*module)).collect();
        assert!(missing.is_empty(), "modules of {krate} that ARCHITECTURE.md does not list: {missing:?}");
        let gone: Vec<_> = listed.iter().filter(|entry| !modules.contains_key(*entry)).collect();
        assert!(gone.is_empty(), "modules that ARCHITECTURE.md lists and {krate} does not have: {gone:?}");
    }
}

#[test]
fn core_and_fields_need_no_gpu_and_no_command_line() {
    let lock: toml::Table = read(&root().join("Cargo.lock")).parse().unwrap();
    let packages = lock["package"].as_array().unwrap();
    let mut needs: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for package in packages {
        let dependencies = package.get("dependencies").and_then(toml::Value::as_array).into_iter().flatten();
        // An entry is a name, followed by a version where there are several.
        let names = dependencies.filter_map(|entry| entry.as_str()?.split(' ').next());
        needs.entry(package["name"].as_str().unwrap()).or_default().extend(names);
    }
    let mut reached = BTreeSet::new();
    let mut waiting = vec!["imf-fields"];
    while let Some(name) = waiting.pop() {
        if reached.insert(name) {
            waiting.extend(&needs[name]);
        }
    }
    assert!(reached.contains("imf-core"), "the walk through Cargo.lock reaches what fields do need");
    let unwanted: Vec<_> = NOT_IN_CORE.iter().filter(|name| reached.contains(**name)).collect();
    assert!(unwanted.is_empty(), "imf-core or imf-fields depends on {unwanted:?}");
}

/// The project's crates that each of them may import.
const IMPORTS: [(&str, &[&str]); 9] = [
    ("imf-core", &[]),
    ("imf-fields", &["imf-core"]),
    ("imf-train", &["imf-core", "imf-fields"]),
    ("imf-gpu", &["imf-core", "imf-fields", "imf-train"]),
    ("imf-cli", &["imf-core", "imf-fields", "imf-train", "imf-gpu"]),
    ("imf-bench", &["imf-core", "imf-fields", "imf-train", "imf-gpu", "imf-cli"]),
    ("imf-c", &["imf-core", "imf-fields"]),
    ("imf-python", &["imf-core", "imf-fields", "imf-train"]),
    ("imf-web", &["imf-core", "imf-fields"]),
];

#[test]
fn crates_import_those_to_their_right_alone() {
    let folders = fs::read_dir(root().join("crates")).unwrap();
    let there: BTreeSet<String> =
        folders.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    let known: BTreeSet<String> = IMPORTS.iter().map(|(name, _)| (*name).to_owned()).collect();
    assert_eq!(there, known, "crates, and those whose imports are said here");
    for (name, allowed) in IMPORTS {
        let manifest: toml::Table =
            read(&root().join("crates").join(name).join("Cargo.toml")).parse().unwrap();
        let own = manifest.get("dependencies").and_then(toml::Value::as_table).unwrap();
        let wrong: Vec<_> =
            own.keys().filter(|key| key.starts_with("imf-") && !allowed.contains(&key.as_str())).collect();
        assert!(wrong.is_empty(), "{name} imports {wrong:?}");
    }
}

#[test]
fn mpi_comes_only_where_it_is_asked_for() {
    let mut users = Vec::new();
    let workspace: toml::Table = read(&root().join("Cargo.toml")).parse().unwrap();
    for folder in workspace["workspace"]["members"].as_array().unwrap() {
        let folder = folder.as_str().unwrap();
        let manifest: toml::Table = read(&root().join(folder).join("Cargo.toml")).parse().unwrap();
        let tables = ["dependencies", "dev-dependencies", "build-dependencies"];
        let dependency = tables.iter().find_map(|table| manifest.get(*table)?.get("mpi"));
        if let Some(dependency) = dependency {
            users.push(folder.to_owned());
            assert_eq!(dependency.get("optional"), Some(&toml::Value::Boolean(true)), "{folder}");
            assert!(manifest["features"].get("default").is_none(), "{folder} turns features on by default");
        }
    }
    assert_eq!(users, ["crates/imf-cli"]);
}

#[test]
fn no_folder_file_or_module_has_an_empty_name_and_no_file_is_long() {
    let mut found = Vec::new();
    let mut waiting = vec![root()];
    while let Some(folder) = waiting.pop() {
        for entry in fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            let name = path.file_name().unwrap().to_string_lossy().into_owned();
            if name.starts_with('.') || name == "target" {
                continue;
            }
            let stem = path.file_stem().unwrap().to_string_lossy().to_lowercase();
            if EMPTY_NAMES.contains(&stem.as_str()) {
                found.push(path.display().to_string());
            }
            match path.extension().and_then(|extension| extension.to_str()) {
                _ if path.is_dir() => waiting.push(path),
                Some("rs") => {
                    let text = read(&path);
                    let lines = text.lines().count();
                    if lines > MOST_LINES {
                        found.push(format!("{}: {lines} lines, more than {MOST_LINES}", path.display()));
                    }
                    let source = parse(&text, &[]).unwrap_or_default();
                    let empty =
                        source.inline_modules.iter().filter(|name| EMPTY_NAMES.contains(&name.as_str()));
                    found.extend(empty.map(|name| format!("{}: mod {name}", path.display())));
                }
                _ => {}
            }
        }
    }
    assert!(found.is_empty(), "names that say nothing, or files that are long:\n{}\n", found.join("\n"));
}
