//! Settings of a training that have no option of their own: `--set KEY=VALUE`.

use anyhow::Result;
use imf_fields::recipe::{Loss, Optimiser, Precision, SoapConfig};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use serde_json::{Map, Value};

use crate::exit::WrongArgument;

/// The key and the value of one setting.
pub(super) type Setting = (String, Value);

/// Settings of a factored field's training that have no option of their own.
#[derive(Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct FactoredSettings {
    pub(super) epochs: Option<u64>,
    pub(super) batch: Option<usize>,
    pub(super) seed: Option<u64>,
    optimiser: Option<OptimiserName>,
    pub(crate) symmetry: Option<bool>,
    pub(crate) checkpoint_every: Option<f64>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
enum OptimiserName {
    Soap,
    Adam,
}

/// Those of siren5's.
#[derive(Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Siren5Settings {
    pub(crate) seed: Option<u64>,
    pub(super) schedule: Option<ScheduleName>,
    pub(super) loss: Option<Loss>,
    pub(super) precision: Option<Precision>,
    pub(super) weight_decay: Option<f32>,
    pub(super) held_out: Option<usize>,
    pub(crate) held_out_every: Option<u64>,
    pub(crate) checkpoint_every: Option<f64>,
}

#[derive(Clone, Copy, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum ScheduleName {
    Exponential,
    Cosine,
}

/// Seconds between checkpoints, where none were given.
const CHECKPOINT_EVERY: f64 = 60.0;

/// Seconds between checkpoints.
pub(crate) fn checkpoint_every(seconds: Option<f64>) -> Result<f64> {
    let seconds = seconds.unwrap_or(CHECKPOINT_EVERY);
    if seconds < 0.0 {
        let wanted = format!("--set checkpoint_every={seconds}: give seconds, at least 0");
        return Err(WrongArgument(wanted).into());
    }
    Ok(seconds)
}

/// A value is a number, true or false, else a word.
pub(super) fn parse_setting(text: &str) -> Result<Setting, String> {
    let (key, value) = text.split_once('=').ok_or("KEY=VALUE, such as seed=1")?;
    let value = serde_json::from_str(value).unwrap_or_else(|_| Value::String(value.to_owned()));
    Ok((key.to_owned(), value))
}

/// The settings of a family, each checked by itself, so that a message names the one that is wrong.
pub(super) fn read_settings<T: DeserializeOwned>(given: &[Setting]) -> Result<T> {
    for (place, (key, value)) in given.iter().enumerate() {
        if given[..place].iter().any(|(known, _)| known == key) {
            return Err(WrongArgument(format!("--set {key} stands twice: give it once")).into());
        }
        let one = Map::from_iter([(key.clone(), value.clone())]);
        let text = value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        serde_json::from_value::<T>(Value::Object(one))
            .map_err(|error| WrongArgument(format!("--set {key}={text}: {error}")))?;
    }
    Ok(serde_json::from_value(Value::Object(given.iter().cloned().collect()))?)
}

impl FactoredSettings {
    /// The optimiser, where one was given.
    pub(crate) fn optimiser(&self) -> Option<Optimiser> {
        self.optimiser.map(|name| match name {
            OptimiserName::Soap => Optimiser::Soap(SoapConfig::default()),
            OptimiserName::Adam => Optimiser::Adam,
        })
    }
}
