//! Runs what the README and the guide show, page by page, each in a fresh folder with the built command on the PATH.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use rayon::prelude::*;

use crate::markdown::{Block, Page};
use crate::{guide, root};

/// Blocks of commands that nobody can repeat in a test, each with its reason on the page: a GPU, MPI, an installation, or
/// more than a minute. Look twice before this number grows.
const NOT_RUN: usize = 10;

/// Languages of blocks that are read and not run here; the tests of the Python package run its chapter.
const READ: [&str; 6] = ["text", "toml", "csv", "yaml", "python", "js"];

/// What became of the blocks of a page.
#[derive(Default)]
struct Outcome {
    faults: Vec<String>,
    ran: usize,
    left_out: usize,
}

#[test]
fn every_command_runs_and_prints_what_is_shown() {
    let others = ["README.md", "crates/imf-cli/src/lib.rs"].map(String::from);
    let pages: Vec<String> = guide().into_iter().map(|page| format!("docs/{page}")).chain(others).collect();
    let outcomes: Vec<Outcome> = pages.par_iter().with_max_len(1).map(|page| run_page(page)).collect();
    let faults: Vec<&str> = outcomes.iter().flat_map(|page| &page.faults).map(String::as_str).collect();
    assert!(faults.is_empty(), "{}", faults.join("\n\n"));
    let ran: usize = outcomes.iter().map(|page| page.ran).sum();
    assert!(ran >= 15, "only {ran} blocks were run");
    assert_eq!(outcomes.iter().map(|page| page.left_out).sum::<usize>(), NOT_RUN, "blocks that are not run");
}

/// Runs a page's blocks, one after the other in a fresh folder.
fn run_page(name: &str) -> Outcome {
    let mut outcome = Outcome::default();
    let path = root().join(name);
    let text = std::fs::read_to_string(&path).unwrap();
    let page = Page::parse(&path, &if name.ends_with(".rs") { crate_docs(&text) } else { text });
    let folder = tempfile::tempdir().unwrap();
    let mut blocks = page.blocks.iter().peekable();
    while let Some(block) = blocks.next() {
        let place = format!("{name}:{}", block.line);
        match (block.language.as_str(), comment(block)) {
            ("sh", Some(("not run", reason))) if !reason.is_empty() => outcome.left_out += 1,
            ("sh", None | Some(("exit code", _))) => {
                let code = comment(block).map_or(0, |(_, code)| code.parse().unwrap());
                let shown = blocks.next_if(|next| next.language == "text" && next.comment.is_none());
                outcome.ran += 1;
                if let Err(fault) = run(folder.path(), &block.text, code, shown) {
                    outcome.faults.push(format!("{place}: {fault}"));
                }
            }
            ("rust", None) => {
                outcome.faults.extend(not_a_doctest(name).map(|fault| format!("{place}: {fault}")));
            }
            (language, Some(("file", file))) if READ.contains(&language) => {
                std::fs::write(folder.path().join(file), &block.text).unwrap();
            }
            (language, None | Some(("read", _))) if READ.contains(&language) => {}
            (language, comment) => {
                let fault = format!("{place}: a block of '{language}' with the comment {comment:?}");
                outcome.faults.push(fault);
            }
        }
    }
    outcome
}

/// The documentation at the top of a Rust file.
fn crate_docs(text: &str) -> String {
    let lines = text.lines().map_while(|line| line.strip_prefix("//!"));
    lines.map(|line| line.strip_prefix(' ').unwrap_or(line).to_owned() + "\n").collect()
}

/// The comment before a block as key and value.
fn comment(block: &Block) -> Option<(&str, &str)> {
    block.comment.as_deref().map(|comment| comment.split_once(": ").unwrap_or((comment, "")))
}

/// Rust on a page is compiled and run as a doctest of `imf-tests`.
fn not_a_doctest(page: &str) -> Option<String> {
    let doctests = std::fs::read_to_string(root().join("tests/src/lib.rs")).unwrap();
    (!doctests.contains(page)).then(|| "Rust that no doctest runs: name the page in tests/src/lib.rs".into())
}

/// Runs commands in a folder; what they print must have what is shown.
fn run(folder: &Path, commands: &str, code: i32, shown: Option<&Block>) -> Result<(), String> {
    let command = Path::new(env!("CARGO_BIN_EXE_imf")).parent().unwrap();
    let path = std::env::var_os("PATH").unwrap_or_default();
    let path: Vec<PathBuf> = [command.to_owned()].into_iter().chain(std::env::split_paths(&path)).collect();
    let output = Command::new("sh")
        .args(["-c", &format!("exec 2>&1\nset -eu\n{commands}")])
        .current_dir(folder)
        .env("PATH", std::env::join_paths(path).unwrap())
        // The same devices everywhere: none but the CPU.
        .env("VK_DRIVER_FILES", "/nonexistent")
        .env("VK_ICD_FILENAMES", "/nonexistent")
        .stdin(Stdio::null())
        .output()
        .unwrap();
    let printed = String::from_utf8(output.stdout).unwrap();
    if output.status.code() != Some(code) {
        return Err(format!("ended with {}, not {code}:\n{commands}\n{printed}", output.status));
    }
    let Some(shown) = shown else { return Ok(()) };
    shows(&printed, &shown.text)
        .map_err(|line| format!("'{line}' is not printed by\n{commands}\nbut\n{printed}"))
}

/// Finds the shown lines among the printed ones: a line `…` stands for any lines, `…` in a line for any text, and blanks
/// count as one. The error is the first line of what is missing.
fn shows(printed: &str, shown: &str) -> Result<(), String> {
    let single = |line: &str| line.split_whitespace().collect::<Vec<_>>().join(" ");
    let printed: Vec<String> = printed.lines().map(single).collect();
    let shown: Vec<String> = shown.lines().map(single).collect();
    let mut from = 0;
    for run in shown.split(|line| line == "…").filter(|run| !run.is_empty()) {
        let fits = |at: &usize| {
            printed[*at..].len() >= run.len() && run.iter().zip(&printed[*at..]).all(|(s, p)| line_fits(p, s))
        };
        let found = (from..printed.len()).find(fits).ok_or_else(|| {
            let missing = run.iter().find(|s| !printed[from..].iter().any(|p| line_fits(p, s)));
            missing.unwrap_or(&run[0]).clone()
        })?;
        from = found + run.len();
    }
    Ok(())
}

fn line_fits(printed: &str, shown: &str) -> bool {
    let pieces: Vec<&str> = shown.split('…').collect();
    let (first, last) = (pieces[0], pieces[pieces.len() - 1]);
    if pieces.len() == 1 {
        return printed == shown;
    }
    let Some(mut rest) = printed.strip_prefix(first).and_then(|rest| rest.strip_suffix(last)) else {
        return false;
    };
    pieces[1..pieces.len() - 1].iter().all(|piece| match rest.split_once(piece) {
        Some((_, after)) => {
            rest = after;
            true
        }
        None => false,
    })
}

#[test]
fn what_is_shown_is_found_and_what_is_not_printed_is_missed() {
    let printed = "a: 1 voxels\n\nb  2\nc: 0.3 s (4.1/s)\nd\n";
    for shown in ["a: 1 voxels", "…\nb 2\nc: … s (…/s)\n…", "b 2\n…\nd", "a: 1 voxels\n\nb 2", "c:…s)\nd"]
    {
        assert_eq!(shows(printed, shown), Ok(()), "{shown}");
    }
    for (shown, missing) in [
        ("a: 2 voxels", "a: 2 voxels"),
        ("d\n…\nb 2", "b 2"),
        ("b 2\nd", "b 2"),
        ("c: … s (…/min)", "c: … s (…/min)"),
        ("a…voxels…voxels", "a…voxels…voxels"),
    ] {
        assert_eq!(shows(printed, shown), Err(missing.to_owned()), "{shown}");
    }
}

#[test]
fn commands_that_fail_or_print_something_else_are_faults() {
    let folder = tempfile::tempdir().unwrap();
    let block = |text: &str| Block { language: "text".into(), text: text.into(), line: 1, comment: None };
    let ask = |commands: &str, code, shown| run(folder.path(), commands, code, Some(&block(shown)));
    assert_eq!(ask("echo one; imf --version >&2", 0, "one\nimf …"), Ok(()));
    assert!(ask("echo one", 0, "two").unwrap_err().contains("'two' is not printed"));
    assert!(ask("imf no-such-command\necho late", 0, "").unwrap_err().contains("not 0"));
    assert_eq!(ask("imf no-such-command", 2, "error: …"), Ok(()));
}
