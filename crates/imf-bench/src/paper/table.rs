//! The report's tables as data: what was measured beside what the paper has, and how both stand to each other.

use imf_cli::progress::show_seconds;
use imf_cli::session::show_bytes;
use imf_fields::metrics::ErrorReport;
use serde::{Deserialize, Serialize};

use super::published::Published;

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
            // Fractions of a second tell apart what takes milliseconds.
            Self::Seconds if value < 1.0 => format!("{value:.3} s"),
            Self::Seconds => show_seconds(value),
            Self::Bytes => show_bytes(value as u64),
        }
    }
}

/// One number beside the paper's.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Compared {
    pub(super) paper: Option<f64>,
    /// Nothing where it was not measured.
    pub(super) ours: Option<f64>,
    /// Ours over the paper's.
    pub(super) ratio: Option<f64>,
}

impl Compared {
    pub(super) fn new(paper: Option<f64>, ours: Option<f64>) -> Self {
        let ratio = paper.zip(ours).filter(|(paper, _)| *paper > 0.0).map(|(paper, ours)| ours / paper);
        Self { paper, ours, ratio }
    }

    /// More than the paper's, which is worse of an error, a time or a size; or nothing where the paper has something.
    pub(super) fn falls_short(&self) -> bool {
        self.paper.is_some() && self.ratio.is_none_or(|ratio| ratio > 1.0)
    }
}

/// Decisions at the threshold, as shares.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Decisions {
    pub(super) false_free: f64,
    pub(super) false_colliding: f64,
    pub(super) iou: f64,
}

/// A line of a table.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(super) struct Row {
    /// One for each of the table's labels.
    pub(super) labels: Vec<String>,
    /// One for each of the table's values.
    pub(super) values: Vec<Compared>,
    pub(super) decisions: Option<Decisions>,
}

impl Row {
    /// A row of errors.
    pub(super) fn errors(labels: Vec<String>, paper: Option<Published>, ours: &ErrorReport) -> Self {
        Self {
            labels,
            values: vec![
                Compared::new(paper.map(|p| p.mse), Some(ours.mse)),
                Compared::new(paper.map(|p| p.mpe), Some(ours.mpe)),
            ],
            decisions: Some(Decisions {
                false_free: ours.false_free,
                false_colliding: ours.false_colliding,
                iou: ours.iou,
            }),
        }
    }

    /// A row of errors of a training that diverged.
    pub(super) fn diverged(labels: Vec<String>, paper: Option<Published>) -> Self {
        let values = [paper.map(|p| p.mse), paper.map(|p| p.mpe)];
        Self { labels, values: values.map(|paper| Compared::new(paper, None)).into(), decisions: None }
    }

    /// In words whether it stands up to the paper, and what of it does not; empty where the paper has nothing.
    fn verdict(&self, values: &[(String, Kind)]) -> String {
        if self.values.iter().all(|value| value.paper.is_none()) {
            return String::new();
        }
        let short = self.values.iter().zip(values).filter(|(value, _)| value.falls_short());
        let short: Vec<&str> = short.map(|(_, (name, _))| name.as_str()).collect();
        match short.as_slice() {
            [] => "at or below".into(),
            names => format!("**falls short**: {}", names.join(", ")),
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
    /// What was tried where a row falls short of the paper.
    pub(super) tried: Option<String>,
    pub(super) labels: Vec<String>,
    pub(super) values: Vec<(String, Kind)>,
    pub(super) rows: Vec<Row>,
    /// Pictures: file in the report's folder, and caption.
    pub(super) figures: Vec<(String, String)>,
}

impl Table {
    /// A table of MSE and MPE.
    pub(super) fn of_errors(id: &str, title: &str, labels: &[&str]) -> Self {
        let values = [("MSE", Kind::Error), ("MPE", Kind::Error)];
        Self::new(id, title, labels, &values)
    }

    pub(super) fn new(id: &str, title: &str, labels: &[&str], values: &[(&str, Kind)]) -> Self {
        Self {
            id: id.into(),
            title: title.into(),
            judged: true,
            notes: Vec::new(),
            tried: None,
            labels: labels.iter().map(|&label| label.into()).collect(),
            values: values.iter().map(|&(name, kind)| (name.into(), kind)).collect(),
            rows: Vec::new(),
            figures: Vec::new(),
        }
    }

    /// Rows with something of the paper's, and those of them that fall short.
    pub(super) fn standing(&self) -> (usize, usize) {
        if !self.judged {
            return (0, 0);
        }
        let compared = self.rows.iter().filter(|row| row.values.iter().any(|value| value.paper.is_some()));
        compared.fold((0, 0), |(all, short), row| {
            (all + 1, short + usize::from(row.values.iter().any(Compared::falls_short)))
        })
    }

    /// Below the rows what was tried, where one of them falls short.
    pub(super) fn footnote(&self) -> Option<String> {
        let tried = self.tried.as_ref().filter(|_| self.standing().1 > 0)?;
        Some(format!("Where a row falls short, this was tried: {tried}"))
    }

    /// Head and cells as they are shown.
    pub(super) fn cells(&self) -> (Vec<String>, Vec<Vec<String>>) {
        let has_paper = |index: usize| self.rows.iter().any(|row| row.values[index].paper.is_some());
        let compared: Vec<bool> = (0..self.values.len()).map(has_paper).collect();
        let decided = self.rows.iter().any(|row| row.decisions.is_some());
        let mut head = self.labels.clone();
        for ((name, _), &compared) in self.values.iter().zip(&compared) {
            if compared {
                head.extend([format!("{name} paper"), format!("{name} ours"), "ours / paper".into()]);
            } else {
                head.push(name.clone());
            }
        }
        if decided {
            head.extend(["false-free", "false-colliding", "IoU"].map(String::from));
        }
        let judged = self.judged && compared.contains(&true);
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
            if decided {
                cells.extend(match row.decisions {
                    Some(d) => [
                        format!("{:.2} %", 100.0 * d.false_free),
                        format!("{:.2} %", 100.0 * d.false_colliding),
                        format!("{:.4}", d.iou),
                    ],
                    None => ["–"; 3].map(String::from),
                });
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
    use super::*;

    #[test]
    fn ratios_and_verdicts_follow_from_the_numbers() {
        let mut table = Table::of_errors("3d", "t", &["part"]);
        let row = |paper: Option<f64>, ours: f64| Row {
            labels: vec!["teapot".into()],
            values: vec![Compared::new(paper, Some(ours)), Compared::new(None, Some(0.5))],
            decisions: None,
        };
        table.rows = vec![row(Some(1e-6), 2e-6), row(Some(1e-6), 1e-6), row(None, 7.0)];
        assert_eq!(table.standing(), (2, 1));
        assert_eq!(table.footnote(), None, "nothing is said to have been tried");
        table.tried = Some("a wider network".into());
        assert!(table.footnote().is_some_and(|text| text.contains("a wider network")));
        let (head, cells) = table.cells();
        assert_eq!(head, ["part", "MSE paper", "MSE ours", "ours / paper", "MPE", "against the paper"]);
        assert_eq!(cells[0], ["teapot", "1.00e-6", "2.00e-6", "2.00", "0.5000", "**falls short**: MSE"]);
        assert_eq!(cells[1][5], "at or below");
        assert_eq!(cells[2], ["teapot", "–", "7.0000", "–", "0.5000", ""]);
        let none = Row::diverged(vec!["teapot".into()], Some(Published { mse: 1e-6, mpe: 0.1 }));
        assert!(
            none.verdict(&table.values).ends_with("MSE, MPE")
                && none.values.iter().all(|value| value.ours.is_none())
        );
        table.judged = false;
        assert_eq!((table.standing(), table.cells().0.len()), ((0, 0), 5));
    }
}
