//! Where a teaching begins: afresh, or from the checkpoint in its folder. What is asked is held against that before
//! anything is computed: first the settings, then the scene and what its functions are chosen by.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail, ensure};
use imf_core::scene::Scene;
use imf_fields::factored::file::FactoredFile;
use imf_fields::factored::{DistillSettings, FactoredField, FactoredState, Symmetry};
use imf_fields::harmonic::FitSettings;
use imf_fields::harmonic::coefficients::Precision;
use imf_fields::recipe::Optimiser;
use imf_fields::recipe::TrainingPlan;
use serde::Serialize;
use serde_json::Value;

use super::FIELD;
use crate::arguments::NetworkFamily;
use crate::arguments::compress::SymmetryChoice;
use crate::checkpoints::nothing_to_resume;
use crate::session::Session;

/// Where checkpoints are written; not the name of a training's on samples, which may lie in the same folder.
pub(super) fn checkpoint_in(out: &Path) -> PathBuf {
    out.join(NetworkFamily::Factored.checkpoint())
}

/// True where an earlier run left a checkpoint in `out` before its end, or no field.
pub(in crate::commands) fn is_unfinished(out: &Path) -> bool {
    let path = checkpoint_in(out);
    if !path.exists() || !out.join(FIELD).exists() {
        return path.exists();
    }
    FactoredFile::read(&path).is_ok_and(|file| file.is_unfinished())
}

/// Where a teaching begins, in a folder.
pub struct Beginning<'a> {
    /// Where checkpoint and field are written.
    pub(super) out: &'a Path,
    /// What is gone on with; nothing for a teaching afresh.
    found: Option<Box<FactoredFile>>,
}

impl<'a> Beginning<'a> {
    /// Refuses to begin where a teaching is unfinished, and to go on where there is none.
    pub fn at(out: &'a Path, resume: bool) -> Result<Self> {
        let path = checkpoint_in(out);
        if !resume {
            ensure!(
                !is_unfinished(out),
                "{} holds an unfinished training: add --resume, choose another --out, or remove it",
                path.display()
            );
            return Ok(Self { out, found: None });
        }
        if !path.exists() {
            return Err(nothing_to_resume(out, NetworkFamily::Factored));
        }
        let found = FactoredFile::read(&path)?;
        ensure!(found.state.is_some(), "{} has no optimiser's state to go on from", path.display());
        Ok(Self { out, found: Some(found.into()) })
    }

    /// Refuses a checkpoint of another network than that of `from`, which names its file.
    pub(super) fn require_network_of(&self, path: &Path, from: &FactoredFile) -> Result<()> {
        let Some(found) = &self.found else { return Ok(()) };
        let network = |settings: &DistillSettings| {
            let DistillSettings { width, hidden, omega, symmetry, .. } = settings;
            format!("{hidden} layers of {width}, ω = {omega} and {symmetry}")
        };
        let [begun, other] = [found, from].map(|file| network(&file.settings));
        ensure!(
            begun == other,
            "{} was not begun from {}: the one has {begun}, the other {other}; leave out --from, or give the field that it \
             was begun from",
            checkpoint_in(self.out).display(),
            path.display()
        );
        Ok(())
    }

    /// With the optimiser that was asked for, if any. A resumed teaching keeps its own where none was, its rates where none were
    /// asked for, which stand in `teach`, and how often it solves for the last layer.
    pub(in crate::commands) fn settled(
        &self,
        rate: Option<f32>,
        optimiser: Option<Optimiser>,
        teach: DistillSettings,
    ) -> DistillSettings {
        let begun = self.found.as_ref().map_or(teach, |found| found.settings);
        let schedule = if rate.is_some() { teach.plan.schedule } else { begun.plan.schedule };
        DistillSettings {
            plan: TrainingPlan { schedule, ..teach.plan },
            solve_every: begun.solve_every,
            optimiser: optimiser.unwrap_or(begun.optimiser),
            ..teach
        }
    }

    /// What the network is told of symmetry as far as that is settled: as the checkpoint has it, or nothing where nothing is to
    /// be told. `None` where a field is to be asked what there is.
    pub(in crate::commands) fn symmetry(&self, choice: SymmetryChoice) -> Option<Symmetry> {
        match (choice, &self.found) {
            (SymmetryChoice::None, _) => Some(Symmetry::default()),
            (SymmetryChoice::Auto, found) => found.as_ref().map(|found| found.settings.symmetry),
        }
    }

    /// Refuses a checkpoint of other settings, and says which.
    pub(in crate::commands) fn require_settings(&self, settings: &DistillSettings) -> Result<()> {
        match &self.found {
            Some(found) if found.settings != *settings => bail!(
                "{} was begun with other settings ({}): give the same ones, or choose another --out",
                checkpoint_in(self.out).display(),
                differences(&found.settings, settings)?.join("; ")
            ),
            _ => Ok(()),
        }
    }

    /// Refuses a checkpoint of another scene, or of functions that were chosen otherwise.
    pub(in crate::commands) fn require_teacher(&self, scene: &Scene, fit: &FitSettings) -> Result<()> {
        let Some(found) = &self.found else { return Ok(()) };
        let checkpoint = checkpoint_in(self.out);
        ensure!(
            found.scene.record == scene.record,
            "{} is of another scene: give its part, tool and grid, or choose another --out",
            checkpoint.display()
        );
        ensure!(
            found.fit == *fit,
            "{} was taught by another harmonic field or other sections ({}): resume with these, or choose another --out",
            checkpoint.display(),
            differences(&found.fit, fit)?.join("; ")
        );
        Ok(())
    }

    /// Refuses a checkpoint of a network along other functions than `field`'s, though they were chosen by the same settings.
    pub(super) fn require_functions(&self, field: &FactoredField) -> Result<()> {
        let Some(found) = &self.found else { return Ok(()) };
        // Axes are of length 1; means are shares of the tool, or depths. Rounding moves either by far less.
        let near = |there: &[f32], here: &[f32]| {
            let scale = there.iter().fold(1e-3, |most: f32, v| most.max(v.abs()));
            there.len() == here.len() && there.iter().zip(here).all(|(a, b)| (a - b).abs() < 1e-3 * scale)
        };
        ensure!(
            near(&found.field.axes, &field.axes) && near(&found.field.mean, &field.mean),
            "{} was taught along other functions, which another limit of memory or another version chose by the same \
             settings: resume as it was begun (--memory), or choose another --out",
            checkpoint_in(self.out).display()
        );
        Ok(())
    }

    /// The field of a teaching that is finished, kept in so many bits: as it lies in the folder, else written there from the
    /// checkpoint. Nothing where steps are left.
    pub(in crate::commands) fn finished(
        &self,
        session: &Session,
        precision: Precision,
    ) -> Result<Option<FactoredFile>> {
        let Some(found) = self.found.as_deref().filter(|found| !found.is_unfinished()) else {
            return Ok(None);
        };
        let result = found.clone().finished(precision);
        let path = self.out.join(FIELD);
        // Of these very weights, which a field of an earlier teaching is not.
        let kept = FactoredFile::read(&path).ok().filter(|kept| {
            let uncalibrated = FactoredFile { calibration: None, ..kept.clone() };
            uncalibrated == result.clone().as_kept()
        });
        let checkpoint = checkpoint_in(self.out);
        let steps = found.state.as_ref().map_or(0, |state| state.training.step);
        let said = format!("{} is finished after {steps} steps: nothing is left to do", checkpoint.display());
        if kept.is_some() {
            session.note(&said);
            return Ok(kept);
        }
        result.write(&path)?;
        session.note(&format!("{said}; wrote {}", path.display()));
        Ok(Some(result))
    }

    /// The state to go on from.
    pub(super) fn state(&self) -> Option<FactoredState> {
        self.found.as_ref().and_then(|found| found.state.clone())
    }
}

/// What differs between settings, by name: what was given there, and what here.
fn differences<T: Serialize>(there: &T, here: &T) -> Result<Vec<String>> {
    // By way of text, where a number has the digits that it was given with.
    let value =
        |settings: &T| -> Result<Value> { Ok(serde_json::from_str(&serde_json::to_string(settings)?)?) };
    let mut found = Vec::new();
    compare("", &value(there)?, &value(here)?, &mut found);
    Ok(found)
}

fn compare(name: &str, there: &Value, here: &Value, found: &mut Vec<String>) {
    let said = |value: &Value| match value {
        Value::Null => "none".to_owned(),
        // As many as there are.
        value if value.as_u64() == Some(usize::MAX as u64) => "all".to_owned(),
        value => value.to_string(),
    };
    match (there, here) {
        // Those of other names within are lengths, schedules, optimisers of another kind: they are told as they are.
        (Value::Object(there_all), Value::Object(here_all))
            if there_all.keys().eq(here_all.keys()) || name.is_empty() =>
        {
            let new = here_all.keys().filter(|&key| !there_all.contains_key(key));
            for key in there_all.keys().chain(new) {
                compare(key, &there[key], &here[key], found);
            }
        }
        _ if there != here => found.push(format!("{name}: {}, not {}", said(there), said(here))),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use imf_fields::recipe::OnlineSettings;
    use imf_fields::recipe::{Length, TrainingPlan};

    use super::*;

    #[test]
    fn settings_that_differ_are_named_with_both_values() {
        let there = DistillSettings { omega: 30.0, ..DistillSettings::of_length(Length::Epochs(40)) };
        assert!(differences(&there, &there).unwrap().is_empty());
        let plan = TrainingPlan { seed: 3, length: Length::Steps(7), ..there.plan };
        let here = DistillSettings { omega: 0.1, plan, online: Some(OnlineSettings::default()), ..there };
        let mut found = differences(&there, &here).unwrap();
        let online = found.pop().unwrap();
        assert!(online.starts_with("online: none, not {") && online.contains("\"pool\":225"), "{online}");
        found.sort();
        let expected =
            [r#"length: {"epochs":40}, not {"steps":7}"#, "omega: 30.0, not 0.1", "seed: 0, not 3"];
        assert_eq!(found, expected);
        let fit = FitSettings { axes: usize::MAX, ..FitSettings::default() };
        let some = differences(&fit, &FitSettings { axes: 81, ..fit }).unwrap();
        assert_eq!(some, ["axes: all, not 81"]);
    }
}
