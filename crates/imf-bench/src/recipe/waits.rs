//! Who waited for whom in an online stage, all its runs together: `waits.json` in the stage's folder.

use std::path::Path;

use anyhow::Result;
use imf_cli::output::write_json;
use imf_train::training::online::Waits;
use serde::{Deserialize, Serialize};

const FILE: &str = "waits.json";

/// The sums, and the steps that they are of: those of a run that was killed are missing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct SummedWaits {
    #[serde(flatten)]
    waits: Waits,
    steps: u64,
}

impl SummedWaits {
    /// Those of a stage's folder; zero where it has none.
    pub(super) fn read(folder: &Path) -> Self {
        let text = std::fs::read_to_string(folder.join(FILE)).unwrap_or_default();
        serde_json::from_str(&text).unwrap_or_default()
    }

    /// Adds a run of so many steps, which came to its end or was interrupted.
    pub(super) fn add(&mut self, folder: &Path, run: &Waits, steps: u64) -> Result<()> {
        let sum = &mut self.waits;
        sum.filling += run.filling;
        sum.trainer += run.trainer;
        sum.producer += run.producer;
        sum.sections += run.sections;
        sum.seconds += run.seconds;
        self.steps += steps;
        write_json(&folder.join(FILE), self)
    }

    /// In words, of a training of so many steps.
    pub(super) fn describe(&self, total: u64) -> String {
        let Self { waits: Waits { filling, trainer, producer, sections, seconds }, steps } = self;
        let counted = match *steps {
            all if all == total => String::new(),
            _ => format!(" ({steps} of {total} steps; runs that were killed are not counted)"),
        };
        format!(
            "{sections} sections were computed beside {seconds:.1} s of training{counted}. The trainer waited {trainer:.2} s \
             for late sections, and {filling:.2} s for its first pool; the producer waited {producer:.1} s for the trainer."
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_added_up_and_missing_steps_are_named() {
        let run = Waits { filling: 0.5, trainer: 0.25, producer: 2.0, sections: 100, seconds: 4.0 };
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        for _ in 0..2 {
            SummedWaits::read(folder).add(folder, &run, 40).unwrap();
        }
        let text = SummedWaits::read(folder).describe(80);
        assert!(text.starts_with("200 sections were computed beside 8.0 s of training. "), "{text}");
        assert!(text.contains("0.50 s for late sections, and 1.00 s for its first pool"), "{text}");
        let text = SummedWaits::read(folder).describe(100);
        assert!(text.contains("(80 of 100 steps; runs that were killed are not counted)"), "{text}");
        std::fs::write(folder.join(FILE), "{").unwrap();
        assert_eq!(SummedWaits::read(folder), SummedWaits::default());
    }
}
