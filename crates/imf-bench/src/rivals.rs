//! Rivals in programs of their own, which print what they found as JSON.

use std::process::Command;

use serde::de::DeserializeOwned;

/// What a rival's program printed; or why there is nothing, and what would help.
pub(crate) fn ask<T: DeserializeOwned>(who: &str, command: &mut Command, remedy: &str) -> Result<T, String> {
    let program = command.get_program().display().to_string();
    let failed = |why: String| format!("{who} was not compared: {why}. {remedy}");
    let output = command.output().map_err(|error| failed(format!("{program} cannot be run ({error})")))?;
    if !output.status.success() {
        let text = String::from_utf8_lossy(&output.stderr);
        let last = text.trim().lines().last().unwrap_or("no word of why");
        return Err(failed(format!("{program} ended with {}, {last}", output.status)));
    }
    serde_json::from_slice(&output.stdout)
        .map_err(|error| failed(format!("{program} answered no JSON ({error})")))
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn a_program_that_has_no_answer_is_named_with_the_reason_and_the_remedy() {
        let why =
            |script: &str| ask::<u32>("It", Command::new("sh").args(["-c", script]), "By pip").unwrap_err();
        let none = ask::<u32>("It", &mut Command::new("no-such-python"), "By pip").unwrap_err();
        assert!(none.contains("no-such-python cannot be run (") && none.ends_with("By pip"), "{none}");
        assert!(
            why("echo first >&2; echo no module >&2; exit 1").contains("exit status: 1, no module. By pip")
        );
        assert!(why("exit 3").contains("exit status: 3"));
        assert!(why("true").contains("It was not compared: sh answered no JSON"));
        assert_eq!(ask("It", Command::new("echo").arg("42"), ""), Ok(42));
    }
}
