//! In what the settings of two trainings differ.

use anyhow::Result;
use serde::Serialize;
use serde_json::Value;

/// What differs between settings, by name: what was given there, and what here.
pub(super) fn differences<T: Serialize>(there: &T, here: &T) -> Result<Vec<String>> {
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
        // Those of other names within are lengths, schedules, optimisers of another kind: they are shown as they are.
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
    use imf_fields::factored::DistillSettings;
    use imf_fields::harmonic::FitSettings;
    use imf_fields::recipe::{TrainingLength, TrainingPlan};

    use super::*;

    #[test]
    fn settings_that_differ_are_named_with_both_values() {
        let there = DistillSettings { omega: 30.0, ..DistillSettings::of_length(TrainingLength::Epochs(40)) };
        assert!(differences(&there, &there).unwrap().is_empty());
        let plan = TrainingPlan { seed: 3, length: TrainingLength::Steps(7), ..there.plan };
        let here = DistillSettings { omega: 0.1, plan, from: Some(3), ..there };
        let mut found = differences(&there, &here).unwrap();
        found.sort();
        let expected = [
            "from: none, not 3",
            r#"length: {"epochs":40}, not {"steps":7}"#,
            "omega: 30.0, not 0.1",
            "seed: 0, not 3",
        ];
        assert_eq!(found, expected);
        let fit = FitSettings { components: usize::MAX, ..FitSettings::default() };
        let some = differences(&fit, &FitSettings { components: 81, ..fit }).unwrap();
        assert_eq!(some, ["components: all, not 81"]);
    }
}
