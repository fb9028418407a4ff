//! The report's tables as data: what was measured beside what the paper has, and how both stand to each other.

use std::iter::Sum;

use anyhow::{Context as _, Result};
use imf_cli::progress::show_seconds;
use imf_cli::session::show_bytes;
use imf_fields::metrics::ErrorReport;
use serde::{Deserialize, Serialize};

use super::published::Published;
use super::{Run, Training};
use crate::recipe::{Answer, EvaluationSets, Outcome};

/// What a number is, for people.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Kind {
    Error,
    Seconds,
    Bytes,
}

impl Kind {
    pub(super) fn show(self, value: f64) -> String {
        match self {
            Self::Error if value == 0.0 => "0".into(),
            Self::Error if value.abs() < 1e-3 => format!("{value:.2e}"),
            Self::Error => format!("{value:.4}"),
            // Fractions of a second distinguish what takes milliseconds.
            Self::Seconds if value < 1.0 => format!("{value:.3} s"),
            Self::Seconds => show_seconds(value),
            Self::Bytes => show_bytes(value as u64),
        }
    }
}

/// One number beside the paper's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct PaperComparison {
    pub(super) paper: Option<f64>,
    /// Nothing where it was not measured.
    pub(super) ours: Option<f64>,
    /// Ours over the paper's.
    pub(super) ratio: Option<f64>,
    /// Ours is the largest error at voxels that were drawn, and of all voxels it may be larger.
    #[serde(default)]
    pub(super) of_drawn: bool,
}

impl PaperComparison {
    pub(super) fn new(paper: Option<f64>, ours: Option<f64>) -> Self {
        let ratio = paper.zip(ours).filter(|(paper, _)| *paper > 0.0).map(|(paper, ours)| ours / paper);
        Self { paper, ours, ratio, of_drawn: false }
    }

    /// More than the paper's, which is worse of an error, a time or a size; or nothing where the paper has something.
    fn falls_short(&self) -> bool {
        self.paper.is_some() && self.ratio.is_none_or(|ratio| ratio > 1.0)
    }
}

/// A line of a table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Row {
    /// One for each of the table's labels.
    pub(super) labels: Vec<String>,
    /// One for each of the table's values.
    pub(super) values: Vec<PaperComparison>,
}

impl Row {
    /// MSE and MPE of a network, if it has been trained.
    fn of_answer(labels: Vec<String>, paper: Option<Published>, ours: Option<&Answer>) -> Self {
        let mut row = Self::errors(labels, paper, ours.map(|answer| &answer.errors));
        row.values[1].of_drawn = ours.is_some_and(|answer| answer.standard_error.is_some());
        row
    }

    /// MSE and MPE.
    pub(super) fn errors(labels: Vec<String>, paper: Option<Published>, ours: Option<&ErrorReport>) -> Self {
        let values = vec![
            PaperComparison::new(paper.map(|p| p.0), ours.map(|e| e.mse)),
            PaperComparison::new(paper.map(|p| p.1), ours.map(|e| e.mpe)),
        ];
        Self { labels, values }
    }

    /// In words whether it reaches the paper's values, and where not; empty where the paper has none.
    fn verdict(&self, values: &[(String, Kind)]) -> String {
        if self.values.iter().all(|value| value.paper.is_none()) {
            return String::new();
        }
        if self.values.iter().all(|value| value.ours.is_none()) {
            return "no result".into();
        }
        let short = self.values.iter().zip(values).filter(|(value, _)| value.falls_short());
        let short: Vec<&str> = short.map(|(_, (name, _))| name.as_str()).collect();
        match short.as_slice() {
            [] if self.values.iter().any(|value| value.paper.is_some() && value.of_drawn) => {
                "at or below, MPE at the voxels drawn".into()
            }
            [] => "at or below".into(),
            names => format!("**falls short**: {}", names.join(", ")),
        }
    }
}

/// Numbers of cells.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Standing {
    pub(super) all: usize,
    pub(super) met: usize,
    /// Those of the met ones that are largest errors at voxels that were drawn.
    pub(super) met_at_drawn: usize,
    /// Those of all without a result: not made yet, or diverged.
    pub(super) missing: usize,
}

impl Standing {
    fn of(value: &PaperComparison) -> Self {
        let met = !value.falls_short();
        Self {
            all: 1,
            met: met.into(),
            met_at_drawn: (met && value.of_drawn).into(),
            missing: value.ours.is_none().into(),
        }
    }
}

impl Sum for Standing {
    fn sum<I: Iterator<Item = Self>>(all: I) -> Self {
        all.fold(Self::default(), |sum, own| Self {
            all: sum.all + own.all,
            met: sum.met + own.met,
            met_at_drawn: sum.met_at_drawn + own.met_at_drawn,
            missing: sum.missing + own.missing,
        })
    }
}

/// A field that rows of a table are of: what it takes to make it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct FieldCost {
    /// As its rows begin.
    pub(super) labels: Vec<String>,
    /// Bytes of what is saved.
    pub(super) bytes: u64,
    pub(super) steps: Option<u64>,
    pub(super) seconds: f64,
    pub(super) paper_seconds: Option<f64>,
    /// Seconds for 225 sections.
    pub(super) sections: Option<f64>,
    /// The machine.
    pub(super) on: String,
    /// Largest standard error of an MSE, as a fraction of it, where voxels were drawn.
    pub(super) standard_error: Option<f64>,
}

impl FieldCost {
    /// A network by its training, whose steps and time are those of a stage alone where one is named.
    fn trained(labels: &[&str], run: &Run, outcome: &Outcome, stage: Option<&str>) -> Self {
        let (on, run) = (run.made_on.clone(), &run.summary);
        let shares = outcome.answers.iter().filter_map(|a| Some(a.standard_error? / a.errors.mse));
        let of_stage = run.stages.iter().find(|own| stage == Some(&own.name));
        let (steps, seconds) =
            of_stage.map_or_else(|| (run.steps(), run.seconds()), |own| (own.steps, own.seconds));
        Self {
            labels: labels.iter().copied().map(String::from).collect(),
            bytes: 4 * outcome.parameters as u64,
            steps: Some(steps),
            seconds,
            on,
            standard_error: shares.filter(|share| share.is_finite()).reduce(f64::max),
            ..Self::default()
        }
    }
}

/// A table of the report.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Table {
    /// As on the command line.
    pub(super) id: String,
    pub(super) title: String,
    /// False where ours and the paper's cannot be held against each other, such as times at another resolution.
    pub(super) judged: bool,
    /// What must be known to read it.
    pub(super) notes: Vec<String>,
    /// What its rows are of.
    pub(super) made: Vec<FieldCost>,
    pub(super) labels: Vec<String>,
    pub(super) values: Vec<(String, Kind)>,
    pub(super) rows: Vec<Row>,
    /// Pictures: file in the report's folder, and caption.
    pub(super) figures: Vec<(String, String)>,
}

impl Table {
    /// A table of MSE and MPE.
    pub(super) fn of_errors(id: &str, title: &str, labels: &[&str]) -> Self {
        Self::new(id, title, labels, &[("MSE", Kind::Error), ("MPE", Kind::Error)])
    }

    pub(super) fn new(id: &str, title: &str, labels: &[&str], values: &[(&str, Kind)]) -> Self {
        Self {
            id: id.into(),
            title: title.into(),
            judged: true,
            notes: Vec::new(),
            made: Vec::new(),
            labels: labels.iter().map(|&label| label.into()).collect(),
            values: values.iter().map(|&(name, kind)| (name.into(), kind)).collect(),
            rows: Vec::new(),
            figures: Vec::new(),
        }
    }

    /// A row for each evaluation of a training's result, the first one's where no stage is named, and what it took.
    pub(super) fn add_training(
        &mut self,
        begin: &[&str],
        (training, stage): (&Training, Option<&str>),
        evaluation_sets: &EvaluationSets,
        paper: impl Fn(usize) -> Option<Published>,
        paper_seconds: Option<f64>,
    ) -> Result<()> {
        let name = begin.join(", ");
        let labels = |asked: &str| begin.iter().copied().chain([asked]).map(String::from).collect();
        match training {
            Training::Missing | Training::Diverged(_) => {
                let rows = evaluation_sets.names().into_iter().enumerate();
                self.rows
                    .extend(rows.map(|(index, asked)| Row::of_answer(labels(&asked), paper(index), None)));
                self.notes.push(match training {
                    Training::Diverged(what) => format!("{name}: no result. {what}"),
                    _ => format!("{name}: not trained yet."),
                });
            }
            Training::Finished(run) => {
                let results = &run.summary.results;
                let of_stage = |o: &&Outcome| stage.is_none_or(|stage| o.stage == stage);
                let outcome =
                    results.iter().find(of_stage).with_context(|| format!("{name} has no result"))?;
                // After the evaluations comes the nearest section, which the baselines have too.
                for (index, (asked, answer)) in
                    evaluation_sets.names().iter().zip(&outcome.answers).enumerate()
                {
                    self.rows.push(Row::of_answer(labels(asked), paper(index), Some(answer)));
                }
                let made = FieldCost::trained(begin, run, outcome, stage);
                self.made.push(FieldCost { paper_seconds, ..made });
            }
        }
        Ok(())
    }

    /// How its cells stand that have something of the paper's; none where it is not judged.
    pub(super) fn standing(&self) -> Standing {
        let compared = self.rows.iter().flat_map(|row| &row.values).filter(|value| value.paper.is_some());
        compared.filter(|_| self.judged).map(Standing::of).sum()
    }

    /// Head and cells of what its rows took to make; columns that say nothing are left out.
    pub(super) fn cells_of_made(&self) -> (Vec<String>, Vec<Vec<String>>) {
        let seconds = |value: Option<f64>| value.map(|seconds| Kind::Seconds.show(seconds));
        type Column<'a> = (&'a str, &'a dyn Fn(&FieldCost) -> Option<String>);
        let columns: [Column<'_>; 7] = [
            ("file", &|made| Some(Kind::Bytes.show(made.bytes as f64))),
            ("steps", &|made| made.steps.map(|steps| steps.to_string())),
            ("made in", &|made| seconds(Some(made.seconds))),
            ("the paper's in", &|made| seconds(made.paper_seconds)),
            ("225 sections in", &|made| seconds(made.sections)),
            ("on", &|made| Some(made.on.clone()).filter(|on| !on.is_empty())),
            ("standard error of the MSE, at most", &|made| {
                made.standard_error.map(|share| format!("{:.1} %", 100.0 * share))
            }),
        ];
        let columns = columns.iter().filter(|(_, cell)| self.made.iter().any(|made| cell(made).is_some()));
        let columns: Vec<&Column<'_>> = columns.collect();
        let begin = self.made.first().map_or(0, |made| made.labels.len());
        let names = columns.iter().map(|(name, _)| (*name).to_owned());
        let head = self.labels.iter().take(begin).cloned().chain(names).collect();
        let row = |made: &FieldCost| {
            let cells = columns.iter().map(|(_, cell)| cell(made).unwrap_or_else(|| "–".into()));
            made.labels.iter().cloned().chain(cells).collect()
        };
        (head, self.made.iter().map(row).collect())
    }

    /// Head and cells as they are shown.
    pub(super) fn cells(&self) -> (Vec<String>, Vec<Vec<String>>) {
        let has_paper = |index: usize| self.rows.iter().any(|row| row.values[index].paper.is_some());
        let compared: Vec<bool> = (0..self.values.len()).map(has_paper).collect();
        let judged = self.judged && compared.contains(&true);
        let mut head = self.labels.clone();
        for ((name, _), &compared) in self.values.iter().zip(&compared) {
            if compared {
                head.extend([format!("{name} paper"), format!("{name} ours"), "ours / paper".into()]);
            } else {
                head.push(name.clone());
            }
        }
        if judged {
            head.push("against the paper".into());
        }
        let row = |row: &Row| {
            let mut cells = row.labels.clone();
            for ((value, (_, kind)), &compared) in row.values.iter().zip(&self.values).zip(&compared) {
                let show = |number: Option<f64>| number.map_or_else(|| "–".into(), |v| kind.show(v));
                if compared {
                    let ratio = value.ratio.map_or_else(|| "–".into(), show_ratio);
                    cells.extend([show(value.paper), show(value.ours), ratio]);
                } else {
                    cells.push(show(value.ours));
                }
            }
            if judged {
                cells.push(row.verdict(&self.values));
            }
            cells
        };
        (head, self.rows.iter().map(row).collect())
    }
}

fn show_ratio(ratio: f64) -> String {
    match ratio {
        r if r >= 100.0 => format!("{r:.0}"),
        r if r >= 0.01 => format!("{r:.2}"),
        r => format!("{r:.1e}"),
    }
}

#[cfg(test)]
mod tests {
    use imf_fields::metrics::Errors;

    use super::*;

    #[test]
    fn ratios_and_verdicts_follow_from_the_numbers() {
        let mut table = Table::of_errors("3d", "t", &["part"]);
        let row = |paper: Option<f64>, ours: f64| Row {
            labels: vec!["teapot".into()],
            values: vec![PaperComparison::new(paper, Some(ours)), PaperComparison::new(None, Some(0.5))],
        };
        table.rows = vec![row(Some(1e-6), 2e-6), row(Some(1e-6), 1e-6), row(None, 7.0)];
        assert_eq!(table.standing(), Standing { all: 2, met: 1, ..Standing::default() });
        let (head, cells) = table.cells();
        assert_eq!(head, ["part", "MSE paper", "MSE ours", "ours / paper", "MPE", "against the paper"]);
        assert_eq!(cells[0], ["teapot", "1.00e-6", "2.00e-6", "2.00", "0.5000", "**falls short**: MSE"]);
        assert_eq!(cells[1][5], "at or below");
        assert_eq!(cells[2], ["teapot", "–", "7.0000", "–", "0.5000", ""]);
        let none = Row::errors(vec!["teapot".into()], Some((1e-6, 0.1)), None);
        assert_eq!(none.verdict(&table.values), "no result");
        table.rows.push(none);
        let standing = Standing { all: 4, met: 1, missing: 2, ..Standing::default() };
        assert_eq!(table.standing(), standing, "it counts as one that is not met");
        let mut errors = ErrorReport { mse: 1e-7, ..Errors::default().report(0.0) };
        let mut of_drawn = |mpe| {
            errors.mpe = mpe;
            let answer = Answer { name: "IMF".into(), errors, standard_error: Some(1e-9) };
            Row::of_answer(vec!["teapot".into()], Some((1e-6, 0.1)), Some(&answer))
        };
        let row = of_drawn(0.05);
        assert_eq!(row.verdict(&table.values), "at or below, MPE at the voxels drawn");
        table.rows = vec![row, of_drawn(0.2)];
        assert_eq!(table.standing(), Standing { all: 4, met: 3, met_at_drawn: 1, missing: 0 });
        table.judged = false;
        assert_eq!((table.standing(), table.cells().0.len()), (Standing::default(), 7));
    }

    #[test]
    fn what_a_field_took_is_shown_where_it_is_known() {
        let mut table = Table::of_errors("3d", "t", &["part", "field", "compared"]);
        let made = |field: &str, steps| FieldCost {
            labels: ["teapot", field].map(String::from).into(),
            bytes: 2048,
            steps,
            seconds: 0.25,
            on: if steps.is_some() { "elsewhere".into() } else { String::new() },
            ..FieldCost::default()
        };
        table.made = vec![made("network", Some(10)), made("table", None)];
        let (head, cells) = table.cells_of_made();
        assert_eq!(head, ["part", "field", "file", "steps", "made in", "on"]);
        assert_eq!(cells[0], ["teapot", "network", "2 KiB", "10", "0.250 s", "elsewhere"]);
        assert_eq!(cells[1][3], "–");
    }
}
