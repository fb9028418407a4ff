//! The Python that rivals run in: whether it runs at all, and has what they need.

use std::process::Command;

/// Why a rival cannot be asked in `python`, and what would help: the command does not run, is no Python, or cannot run `needs`,
/// which `remedy` installs.
pub(crate) fn lacks(python: &str, needs: &str, remedy: &str) -> Option<String> {
    let run = |code: &str| Command::new(python).args(["-c", code]).output();
    let another = "name a Python by --python";
    match run("print(6 * 7)") {
        Err(error) => return Some(format!("{python} cannot be run ({error}): {another}")),
        Ok(output) if !output.status.success() => {
            return Some(format!("{python} cannot be run as Python ({}): {another}", output.status));
        }
        Ok(output) if output.stdout.trim_ascii() != b"42" => {
            return Some(format!("{python} is no Python: {another}"));
        }
        Ok(_) => {}
    }
    let found = run(needs).is_ok_and(|output| output.status.success());
    (!found).then(|| format!("{python} has none. Install it: {remedy}"))
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn a_command_that_is_no_python_is_told_from_one_that_lacks_a_module() {
        let why = |python: &str| lacks(python, "import torch", "by pip").unwrap_or_default();
        assert!(
            why("no-such-python").contains("no-such-python cannot be run ("),
            "{}",
            why("no-such-python")
        );
        assert!(why("false").contains("false cannot be run as Python (exit status: 1)"), "{}", why("false"));
        assert!(why("true").contains("true is no Python"), "{}", why("true"));
        // A shell that stands in for a Python without the module.
        let folder = tempfile::tempdir().expect("a folder");
        let script = folder.path().join("python");
        std::fs::write(&script, "#!/bin/sh\n[ \"$2\" = 'print(6 * 7)' ] && echo 42\n").expect("a script");
        let executable = std::os::unix::fs::PermissionsExt::from_mode(0o755);
        std::fs::set_permissions(&script, executable).expect("a mode");
        let said = why(&script.display().to_string());
        assert!(said.contains("has none. Install it: by pip"), "{said}");
    }
}
