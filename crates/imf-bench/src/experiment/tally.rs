//! Who waited for whom in an online stage, all its runs together: `waits.json` in the stage's folder.
//!
//! A run is written down when it begins and counted when it is interrupted or comes to its end. One that was killed, or
//! stopped while its first pool was filling, is never counted: then the sums are said to be the least that they can be.

use std::path::Path;

use anyhow::Result;
use imf_cli::output::write_json;
use imf_train::training::online::Waits;
use serde::{Deserialize, Serialize};

const FILE: &str = "waits.json";

/// The sums, and how many runs they are of.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Tally {
    #[serde(flatten)]
    waits: Waits,
    /// Runs of the stage; older files know of one.
    #[serde(default = "one")]
    begun: u64,
    /// Those that are in the sums; older files do not say that it was the only one.
    #[serde(default)]
    counted: u64,
}

fn one() -> u64 {
    1
}

impl Tally {
    /// What a stage's folder says, if anything.
    pub(super) fn read(folder: &Path) -> Option<Self> {
        serde_json::from_str(&std::fs::read_to_string(folder.join(FILE)).ok()?).ok()
    }

    /// Writes down that a run begins, of a training that has done `steps` steps.
    pub(super) fn begin(folder: &Path, steps: u64) -> Result<Self> {
        // Steps that nobody counted, or a file that cannot be read, are of a run at least.
        let uncounted = steps > 0 || folder.join(FILE).exists();
        let mut tally =
            Self::read(folder).unwrap_or_else(|| Self { begun: u64::from(uncounted), ..Self::default() });
        tally.begun += 1;
        write_json(&folder.join(FILE), &tally)?;
        Ok(tally)
    }

    /// Adds what the run that was begun came to.
    pub(super) fn end(&mut self, folder: &Path, run: &Waits) -> Result<()> {
        let sum = &mut self.waits;
        sum.filling += run.filling;
        sum.trainer += run.trainer;
        sum.producer += run.producer;
        sum.sections += run.sections;
        sum.seconds += run.seconds;
        self.counted += 1;
        write_json(&folder.join(FILE), self)
    }

    /// In words.
    pub(super) fn said(&self) -> String {
        let Waits { filling, trainer, producer, sections, seconds } = self.waits;
        let lost = self.begun.saturating_sub(self.counted);
        let (least, why) = match lost {
            0 => ("", String::new()),
            _ => ("at least ", format!(" ({lost} of {} runs ended without being counted)", self.begun)),
        };
        format!(
            "{least}{sections} sections were computed beside {least}{seconds:.1} s of training{why}. The trainer waited \
             {least}{trainer:.2} s for late sections, and {least}{filling:.2} s for its first pool; the producer waited \
             {least}{producer:.1} s for the trainer."
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RUN: Waits = Waits { filling: 0.5, trainer: 0.25, producer: 2.0, sections: 100, seconds: 4.0 };

    #[test]
    fn runs_are_added_up_and_a_lost_one_is_said() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        Tally::begin(folder, 0).unwrap().end(folder, &RUN).unwrap();
        let mut tally = Tally::begin(folder, 40).unwrap();
        tally.end(folder, &RUN).unwrap();
        assert_eq!(Tally::read(folder), Some(tally));
        let said = tally.said();
        assert!(said.starts_with("200 sections were computed beside 8.0 s"), "{said}");
        assert!(said.contains("0.50 s for late sections, and 1.00 s for its first pool"), "{said}");
        assert!(!said.contains("at least"), "{said}");
        // Killed: it began and never ended.
        Tally::begin(folder, 60).unwrap();
        let mut tally = Tally::begin(folder, 80).unwrap();
        tally.end(folder, &RUN).unwrap();
        let said = tally.said();
        assert!(said.contains("at least 300 sections") && said.contains("(1 of 4 runs"), "{said}");
    }

    #[test]
    fn what_an_older_program_left_is_the_least() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        write_json(&folder.join(FILE), &RUN).unwrap();
        assert!(Tally::read(folder).unwrap().said().contains("at least 100 sections"));
        std::fs::write(folder.join(FILE), "{").unwrap();
        assert!(Tally::begin(folder, 0).unwrap().said().contains("at least 0 sections"));
        std::fs::remove_file(folder.join(FILE)).unwrap();
        // Steps were done before anybody counted.
        assert!(Tally::begin(folder, 20).unwrap().said().contains("2 of 2 runs"));
    }
}
