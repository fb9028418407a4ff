//! Results behind the columns of the input: as CSV, or as an array of JSON objects.

use std::io::Write;

use anyhow::{Result, ensure};
use csv::{StringRecord, Writer};
use imf_core::field::Decision;
use imf_core::pose::Pose;
use serde_json::{Map, Value, json};

use crate::output::same_digits;

/// A chunk of lines, their poses, and the results.
#[derive(Default)]
pub(super) struct ResultChunk {
    pub(super) records: Vec<StringRecord>,
    /// `None`: an invalid pose.
    pub(super) poses: Vec<Option<Pose>>,
    pub(super) values: Vec<f32>,
    /// Empty unless requested.
    pub(super) exact: Vec<f32>,
    pub(super) decisions: Vec<Decision>,
    /// Whether the pose lies outside the field's domain.
    pub(super) outside: Vec<bool>,
}

/// Titles of what stands behind the values.
const BEHIND: [&str; 2] = ["decision", "outside"];

impl ResultChunk {
    /// The fields' values for a line; NaN where its pose is invalid.
    fn of(&self, index: usize) -> impl Iterator<Item = f32> {
        let values = [Some(self.values[index]), self.exact.get(index).copied()].into_iter().flatten();
        let valid = self.poses[index].is_some();
        values.map(move |value| if valid { value } else { f32::NAN })
    }

    fn decision(&self, index: usize) -> &'static str {
        match self.decisions[index] {
            _ if self.poses[index].is_none() => "invalid",
            Decision::Free => "free",
            Decision::Colliding => "colliding",
            Decision::Undecided => "undecided",
        }
    }
}

pub(super) struct ResultWriter {
    /// Titles in JSON; `None` for CSV.
    json_titles: Option<Vec<String>>,
    columns: usize,
    begun: bool,
}

impl ResultWriter {
    /// Writes the header; the column of results is called `measure`.
    ///
    /// # Errors
    /// A column of that name that is there already, or an output that cannot be written.
    pub(super) fn start(
        header: &StringRecord,
        measure: &str,
        exact: bool,
        json: bool,
        out: &mut dyn Write,
    ) -> Result<Self> {
        let mut titles: Vec<String> = header.iter().map(str::to_owned).collect();
        let columns = titles.len();
        let values = [Some(measure.to_owned()), exact.then(|| format!("{measure}_exact"))];
        for title in values.into_iter().flatten().chain(BEHIND.map(str::to_owned)) {
            ensure!(!titles.contains(&title), "the poses have a column {title} already; rename it");
            titles.push(title);
        }
        if json {
            out.write_all(b"[")?;
        } else {
            let mut csv = Writer::from_writer(Vec::new());
            csv.write_record(&titles)?;
            out.write_all(&csv.into_inner()?)?;
        }
        Ok(Self { json_titles: json.then_some(titles), columns, begun: false })
    }

    /// Writes a chunk.
    ///
    /// # Errors
    /// An output that cannot be written; a closed pipe stays recognisable.
    pub(super) fn write(&mut self, answers: &ResultChunk, out: &mut dyn Write) -> Result<()> {
        // Through memory: the errors of the csv crate hide the system's.
        let bytes = match &self.json_titles {
            None => csv_lines(answers)?,
            Some(titles) => {
                let mut bytes = Vec::new();
                for index in 0..answers.records.len() {
                    bytes.extend_from_slice(if self.begun { b",\n" } else { b"\n" });
                    self.begun = true;
                    serde_json::to_writer(&mut bytes, &self.object(titles, answers, index))?;
                }
                bytes
            }
        };
        out.write_all(&bytes)?;
        Ok(out.flush()?)
    }

    pub(super) fn finish(self, out: &mut dyn Write) -> Result<()> {
        if self.json_titles.is_some() {
            out.write_all(b"\n]\n")?;
        }
        Ok(out.flush()?)
    }

    /// One result; what reads as a finite number is one, but digits that a number would change stay text.
    fn object(&self, titles: &[String], answers: &ResultChunk, index: usize) -> Value {
        let mut object = Map::new();
        for (title, text) in titles.iter().zip(&answers.records[index]) {
            object.insert(title.clone(), as_written(text));
        }
        for (title, value) in titles[self.columns..].iter().zip(answers.of(index)) {
            object.insert(title.clone(), json!(same_digits(value)));
        }
        let [decision, outside] = BEHIND.map(str::to_owned);
        object.insert(decision, json!(answers.decision(index)));
        object.insert(outside, json!(answers.outside[index]));
        Value::Object(object)
    }
}

/// Whole numbers without a fraction, other finite numbers, and everything else as text: `0` is not `0.0`, and `007`
/// not `7`.
fn as_written(text: &str) -> Value {
    if let Some(whole) = text.parse::<i64>().ok().filter(|whole| whole.to_string() == text) {
        return json!(whole);
    }
    let digits = !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
    match text.parse::<f64>() {
        Ok(number) if number.is_finite() && !digits => json!(number),
        _ => json!(text),
    }
}

fn csv_lines(answers: &ResultChunk) -> Result<Vec<u8>> {
    let mut csv = Writer::from_writer(Vec::new());
    for (index, record) in answers.records.iter().enumerate() {
        let mut line = record.clone();
        answers.of(index).for_each(|value| line.push_field(&value.to_string()));
        line.push_field(answers.decision(index));
        line.push_field(&answers.outside[index].to_string());
        csv.write_record(&line)?;
    }
    Ok(csv.into_inner()?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn written(json: bool) -> String {
        let header = StringRecord::from(vec!["name", "x"]);
        let mut answers = ResultChunk {
            records: vec![vec!["a, b", "1.5"].into(), vec!["c", "2"].into()],
            values: vec![0.25, 0.0],
            exact: vec![0.5, 1.0],
            decisions: vec![Decision::Free, Decision::Undecided],
            outside: vec![false, true],
            poses: vec![Some(Pose::along(DVec3::ZERO, DVec3::Z)), None],
        };
        let mut out = Vec::new();
        let mut writer = ResultWriter::start(&header, "overlap", true, json, &mut out).unwrap();
        writer.write(&answers, &mut out).unwrap();
        answers.records.truncate(1);
        writer.write(&answers, &mut out).unwrap();
        writer.finish(&mut out).unwrap();
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn csv_keeps_every_column() {
        let first = "\"a, b\",1.5,0.25,0.5,free,false\n";
        let header = "name,x,overlap,overlap_exact,decision,outside\n";
        let expected = format!("{header}{first}c,2,NaN,NaN,invalid,true\n{first}");
        assert_eq!(written(false), expected);
    }

    #[test]
    fn json_is_one_array_over_all_chunks() {
        let all: Value = serde_json::from_str(&written(true)).unwrap();
        assert_eq!(all.as_array().unwrap().len(), 3);
        assert_eq!(
            all[0],
            json!({
                "name": "a, b", "x": 1.5, "overlap": 0.25, "overlap_exact": 0.5, "decision": "free", "outside": false
            })
        );
        let none = json!({
            "name": "c", "x": 2, "overlap": null, "overlap_exact": null, "decision": "invalid", "outside": true
        });
        assert_eq!(all[1], none);
    }

    #[test]
    fn identifiers_in_json_are_as_they_were_written() {
        for (text, expected) in [
            ("0", "0"),
            ("-12", "-12"),
            ("9007199254740993", "9007199254740993"),
            ("007", "\"007\""),
            ("18446744073709551617", "\"18446744073709551617\""),
            ("0.5", "0.5"),
            ("-1e3", "-1000.0"),
            ("inf", "\"inf\""),
            ("", "\"\""),
        ] {
            assert_eq!(as_written(text).to_string(), expected, "{text:?}");
        }
    }

    #[test]
    fn a_column_that_is_there_already_is_not_written_twice() {
        for taken in ["overlap", "decision", "outside"] {
            let header = StringRecord::from(vec!["x", taken]);
            assert!(ResultWriter::start(&header, "overlap", false, false, &mut Vec::new()).is_err());
        }
    }
}
