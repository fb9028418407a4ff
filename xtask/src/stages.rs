//! Stages that run one after another under a headline each, stop at the first that fails, and are summed up at the
//! end whatever happened.

use std::fmt::Write as _;
use std::io::Write as _;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};

/// One stage: its name in headline and summary, and the work, whose error ends the run.
pub(crate) type Stage<'a> = (&'static str, Box<dyn FnOnce() -> Result<()> + 'a>);

/// Runs `stages` in order up to the first that fails, then prints the summary.
///
/// # Errors
/// The error of the stage that failed.
pub(crate) fn run(stages: Vec<Stage<'_>>) -> Result<()> {
    let (names, work): (Vec<_>, Vec<_>) = stages.into_iter().unzip();
    let mut times = Vec::with_capacity(names.len());
    let mut outcome = Ok(());
    for (index, (name, work)) in names.iter().zip(work).enumerate() {
        println!("\n=== {}/{} {name} ===", index + 1, names.len());
        // The stage's own processes write to the same terminal: headline first.
        std::io::stdout().flush()?;
        let start = Instant::now();
        outcome = work().context(*name);
        times.push(start.elapsed());
        if outcome.is_err() {
            break;
        }
    }
    print!("{}", summary(&names, &times, outcome.is_err()));
    outcome
}

/// One line a stage; `times` are of those that ran, of which the last failed or not.
fn summary(names: &[&str], times: &[Duration], failed: bool) -> String {
    let width = names.iter().map(|name| name.len()).max().unwrap_or(0);
    let mut text = String::from("\n=== summary ===\n");
    for (index, name) in names.iter().enumerate() {
        let verdict = match times.len() {
            ran if index >= ran => "not run",
            ran if failed && index + 1 == ran => "FAILED",
            _ => "ok",
        };
        let time = times.get(index).map_or("-".into(), |time| format!("{:.1} s", time.as_secs_f64()));
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{name:width$}  {verdict:<7}  {time:>8}");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_failure_ends_the_run_and_is_named() {
        let stages: Vec<Stage<'_>> = vec![
            ("first", Box::new(|| Ok(()))),
            ("second", Box::new(|| anyhow::bail!("broken"))),
            ("third", Box::new(|| panic!("a stage after a failure must not run"))),
        ];
        assert_eq!(format!("{:#}", run(stages).unwrap_err()), "second: broken");
        assert!(run(vec![("first", Box::new(|| Ok(())))]).is_ok());
    }

    #[test]
    fn the_summary_has_one_line_a_stage() {
        let stages = ["format", "clippy", "tests"];
        let text = summary(&stages, &[Duration::from_millis(1500), Duration::from_secs(20)], true);
        assert!(text.contains("format  ok          1.5 s\n"), "{text}");
        assert!(text.contains("clippy  FAILED     20.0 s\n"), "{text}");
        assert!(text.contains("tests   not run         -\n"), "{text}");
    }
}
