//! The set-ups in the summary, for files and for people.

use std::fmt::{self, Write as _};

use serde::Serialize;

use super::super::row::{left, proof};
use crate::output::show_measure;

/// What a set-up needs of one of the machine's rotary axes, in degrees: the range of its angles when each point is
/// machined with the smallest tilt.
#[derive(Clone, Copy, Debug, Serialize)]
pub(super) struct AxisRow {
    pub(super) axis: char,
    pub(super) range: [f64; 2],
}

/// One of each of the axes that there are: their letters, and what the angles are to be multiplied by to be the machine's.
pub(super) fn axis_rows(
    axes: [Option<(char, f64)>; 2],
    angles: impl Iterator<Item = [f64; 2]>,
) -> Vec<AxisRow> {
    let wider = |range: Option<[[f64; 2]; 2]>, angles: [f64; 2]| {
        let known = range.unwrap_or(angles.map(|angle| [angle; 2]));
        Some([0, 1].map(|axis| [known[axis][0].min(angles[axis]), known[axis][1].max(angles[axis])]))
    };
    let found = angles.fold(None, wider).unwrap_or_default();
    let named = axes.into_iter().zip(found).filter_map(|(axis, found)| {
        let (axis, sign) = axis?;
        let [one, other] = found.map(|angle| sign * angle + 0.0);
        Some(AxisRow { axis, range: [one.min(other), one.max(other)] })
    });
    named.collect()
}

impl fmt::Display for AxisRow {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [low, high] = self.range.map(|angle| (10.0 * angle).round() / 10.0 + 0.0);
        write!(f, "{} from {low}° to {high}°", self.axis)
    }
}

/// One set-up; fractions are of the surface's area.
#[derive(Debug, Serialize)]
pub(super) struct SetupRow {
    /// What points up, in the world.
    pub(super) up: [f64; 3],
    pub(super) theta: f64,
    pub(super) phi: f64,
    /// What turns the part so.
    pub(super) transform: String,
    /// The part stands so by itself.
    pub(super) rests: bool,
    /// Area of the surface that it stands on.
    pub(super) lower_face: f64,
    /// Of a machine with rotary axes.
    pub(super) rotary: Vec<AxisRow>,
    pub(super) reached: f64,
    /// Reached in no other of the chosen set-ups.
    pub(super) alone: f64,
    /// The fraction of the stock that is certainly removed, where one is given.
    pub(super) removed: Option<f64>,
    /// Beside that what it may remove, and some candidate removes for certain.
    pub(super) removed_at_most: Option<f64>,
    /// The fraction of it that no other of the chosen set-ups can remove.
    pub(super) removed_alone: Option<f64>,
}

/// What is removed of the stock, as fractions of it.
#[derive(Debug, Serialize)]
pub(super) struct StockRow {
    /// Certainly.
    pub(super) removed: f64,
    /// Beside that what some candidate removes, and these may with the tip between voxels' centres: this pitch does not decide it.
    pub(super) undecided: f64,
    /// In any of the candidates.
    pub(super) removable: f64,
    /// The number of voxels that the fractions refer to.
    pub(super) voxels: usize,
}

/// What no chosen set-up reaches, by the surface's verdict over all directions.
#[derive(Debug, Serialize)]
pub(super) struct LeftRow {
    pub(super) reached_from_other_directions: f64,
    /// Reached from some direction of all, and a chosen set-up stands on it.
    pub(super) stood_on: f64,
    /// Reached by direction in some candidate, but obstructed by the machine's travel, head or table.
    pub(super) kept_away_by_the_machine: f64,
    pub(super) obstructed: f64,
    pub(super) gouged: f64,
    pub(super) not_faced: f64,
}

#[derive(Debug, Serialize)]
pub(crate) struct SetupsRow {
    pub(super) machine: String,
    pub(super) candidates: usize,
    /// The fraction required, of what all candidates reach.
    pub(super) requested: f64,
    pub(super) setups: Vec<SetupRow>,
    pub(super) proven: bool,
    /// No fewer of the candidates do.
    pub(super) at_least: usize,
    pub(super) reached: f64,
    /// What all candidates together reach.
    pub(super) reachable: f64,
    /// Where a stock is given.
    pub(super) stock: Option<StockRow>,
    pub(super) left: LeftRow,
}

impl SetupRow {
    fn of_stock(&self, percent: &dyn Fn(f64) -> String) -> String {
        let (Some(removed), Some(at_most), Some(alone)) =
            (self.removed, self.removed_at_most, self.removed_alone)
        else {
            return String::new();
        };
        let [removed, at_most, alone] = [removed, at_most, alone].map(percent);
        let range = if at_most == removed { removed } else { format!("{removed} (to {at_most})") };
        format!(", removes {range}, alone {alone}")
    }
}

impl SetupsRow {
    pub(crate) fn lines(&self, unit: &str) -> String {
        let percent = |share: f64| format!("{:.1} %", 100.0 * share);
        let count = self.setups.len();
        let proof = proof(self.proven, self.at_least);
        let machine = match self.machine.as_str() {
            "cone:0,0,1:0" => "three axes",
            range => range,
        };
        let mut text = format!(
            "set-ups ({machine}): {count} of {} candidates reach {} of the surface, of {} that all of them reach{} ({proof})\n",
            self.candidates,
            percent(self.reached),
            percent(self.reachable),
            self.stock.as_ref().map_or_else(String::new, |stock| format!(
                ", and remove {} of the stock, of {}{}",
                percent(stock.removed),
                percent(stock.removable),
                if stock.undecided > 0.0 {
                    format!("; {} more are not decided at this pitch", percent(stock.undecided))
                } else {
                    String::new()
                }
            ))
        );
        for (index, row) in self.setups.iter().enumerate() {
            let [i, j, k] = row.up;
            let rest = match (row.rests, row.lower_face > 0.0) {
                (true, true) => format!("stands on flat faces of {} {unit}²", show_measure(row.lower_face)),
                (true, false) => "stands by itself".into(),
                (false, _) => "must be held: it does not stand so by itself".into(),
            };
            let _ = writeln!(
                text,
                "  {}  ({i:.3}, {j:.3}, {k:.3}) up, {}: reaches {}, alone {}{}; {rest}",
                index + 1,
                row.transform,
                percent(row.reached),
                percent(row.alone),
                row.of_stock(&percent)
            );
            if !row.rotary.is_empty() {
                let axes: Vec<String> = row.rotary.iter().map(AxisRow::to_string).collect();
                let left = if index > 0 { ", for what the set-ups above do not reach" } else { "" };
                let _ = writeln!(text, "     {}{left}", axes.join(", "));
            }
        }
        text += &left(&[
            ("from directions that these set-ups do not give", self.left.reached_from_other_directions),
            ("the faces that it stands on", self.left.stood_on),
            ("the machine's travel, head or table is in the way", self.left.kept_away_by_the_machine),
            ("obstructed", self.left.obstructed),
            ("the cutter does not fit", self.left.gouged),
            ("no direction faces it", self.left.not_faced),
        ]);
        text
    }
}
