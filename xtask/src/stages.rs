//! Stages that run one after another under a headline each, stop at the first that fails, and are summed up at the
//! end whatever happened.

use std::fmt::Write as _;
use std::io::Write as _;
use std::time::{Duration, Instant};

use anyhow::{Result, bail};

/// One stage: a name for its headline and what it does.
pub(crate) struct Stage {
    /// Shown in the headline and in the summary.
    pub(crate) name: &'static str,
    /// The work; its error ends the run.
    pub(crate) work: fn() -> Result<()>,
}

enum Outcome {
    Passed(Duration),
    Failed(Duration),
    NotRun,
}

/// Runs `stages` in order up to the first that fails, then prints the summary.
///
/// # Errors
/// The error of the stage that failed.
pub(crate) fn run(stages: &[Stage]) -> Result<()> {
    let mut outcomes = Vec::with_capacity(stages.len());
    let mut failure = None;
    for (index, stage) in stages.iter().enumerate() {
        if failure.is_some() {
            outcomes.push(Outcome::NotRun);
            continue;
        }
        println!("\n=== {}/{} {} ===", index + 1, stages.len(), stage.name);
        // The stage's own processes write to the same terminal: headline first.
        std::io::stdout().flush()?;
        let start = Instant::now();
        match (stage.work)() {
            Ok(()) => outcomes.push(Outcome::Passed(start.elapsed())),
            Err(error) => {
                outcomes.push(Outcome::Failed(start.elapsed()));
                failure = Some((stage.name, error));
            }
        }
    }
    print!("{}", summary(stages, &outcomes));
    match failure {
        None => Ok(()),
        Some((name, error)) => bail!("{name}: {error:#}"),
    }
}

fn summary(stages: &[Stage], outcomes: &[Outcome]) -> String {
    let width = stages.iter().map(|stage| stage.name.len()).max().unwrap_or(0);
    let mut text = String::from("\n=== summary ===\n");
    for (stage, outcome) in stages.iter().zip(outcomes) {
        let (verdict, time) = match outcome {
            Outcome::Passed(time) => ("ok", Some(time)),
            Outcome::Failed(time) => ("FAILED", Some(time)),
            Outcome::NotRun => ("not run", None),
        };
        let time = time.map_or_else(|| "-".to_owned(), |time| format!("{:.1} s", time.as_secs_f64()));
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{:width$}  {verdict:<7}  {time:>8}", stage.name);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_failure_ends_the_run_and_is_named() {
        let stages = [
            Stage { name: "first", work: || Ok(()) },
            Stage { name: "second", work: || bail!("broken") },
            Stage { name: "third", work: || panic!("a stage after a failure must not run") },
        ];
        assert_eq!(run(&stages).unwrap_err().to_string(), "second: broken");
        assert!(run(&stages[..1]).is_ok());
    }

    #[test]
    fn the_summary_has_one_line_a_stage() {
        let stages = [
            Stage { name: "format", work: || Ok(()) },
            Stage { name: "clippy", work: || Ok(()) },
            Stage { name: "tests", work: || Ok(()) },
        ];
        let outcomes = [
            Outcome::Passed(Duration::from_millis(1500)),
            Outcome::Failed(Duration::from_secs(20)),
            Outcome::NotRun,
        ];
        let text = summary(&stages, &outcomes);
        assert!(text.contains("format  ok          1.5 s\n"), "{text}");
        assert!(text.contains("clippy  FAILED     20.0 s\n"), "{text}");
        assert!(text.contains("tests   not run         -\n"), "{text}");
    }
}
