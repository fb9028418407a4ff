//! What a crib reaches, as a table, as CSV and as JSON.

use std::fmt::Write as _;

use imf_core::surface::Verdict;
use imf_core::unit::LengthUnit;
use serde::Serialize;

use super::super::surface::{ObstructedRow, proof, resolved};
use super::Crib;
use super::tools::{CribTool, UndecidedTool};
use crate::output::{PROGRAM, SUMMARY, length, quoted, short, shortened, show_measure};
use crate::progress::show_seconds;

/// Tools that the table lists beside the chosen ones; `crib.csv` has all.
const LISTED: usize = 10;
/// Maximum number of undecided tools that the table lists.
const LISTED_UNDECIDED: usize = 5;

/// One tool; fractions are of the surface's area.
#[derive(Debug, Serialize)]
struct ToolRow {
    #[serde(flatten)]
    tool: CribTool,
    reached: f64,
    /// Of the fewest tools, by none but this one.
    alone: Option<f64>,
    /// Fraction of the surface where it is the most rigid tool that reaches.
    most_rigid: f64,
    obstructed: f64,
    gouged: f64,
    not_faced: f64,
    /// Its place among the fewest, from 1.
    chosen: Option<usize>,
}

/// Everything in `summary.json`.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    program: String,
    files: Vec<String>,
    part: String,
    unit: LengthUnit,
    pitch: f64,
    orientations: String,
    orientation_count: usize,
    tolerance: f64,
    guarantee: String,
    /// What voxels resolve of the surface's walls.
    resolved: String,
    area: f64,
    samples: usize,
    hidden_area: f64,
    /// The fraction to cover, of what all tools reach.
    requested: f64,
    /// Names of the fewest, those that add most first.
    fewest: Vec<String>,
    proven: bool,
    at_least: usize,
    reached_by_the_fewest: f64,
    reached: f64,
    obstructed: f64,
    /// Which elements of which tools collide where none reaches.
    obstructed_by: Vec<ObstructedRow>,
    gouged: f64,
    not_faced: f64,
    /// In the order of the crib.
    tools: Vec<ToolRow>,
    undecided: Vec<UndecidedTool>,
    seconds: f64,
}

impl Report {
    pub(super) fn new(crib: &Crib, seconds: f64) -> Self {
        let samples = &crib.samples.samples;
        let total = crib.samples.area();
        let share = |holds: &dyn Fn(usize) -> bool| crib.samples.fraction(holds);
        let rigid: Vec<Option<usize>> = (0..samples.len()).map(|sample| crib.most_rigid(sample)).collect();
        let tools = crib.tools.iter().enumerate().map(|(index, tool)| {
            let of = |verdict: Verdict| share(&|sample| crib.verdicts[index][sample] == verdict);
            let place = crib.chosen.iter().position(|&chosen| chosen == index);
            let others = |sample: usize| crib.chosen.iter().any(|&o| o != index && crib.reaches(o, sample));
            ToolRow {
                tool: tool.clone(),
                reached: of(Verdict::Reached),
                alone: place.map(|_| share(&|sample| crib.reaches(index, sample) && !others(sample))),
                most_rigid: share(&|sample| rigid[sample] == Some(index)),
                obstructed: of(Verdict::Obstructed),
                gouged: of(Verdict::Gouged),
                not_faced: of(Verdict::NotFaced),
                chosen: place.map(|place| place + 1),
            }
        });
        let best: Vec<Verdict> = (0..samples.len()).map(|sample| crib.best(sample)).collect();
        let of = |verdict: Verdict| share(&|sample| best[sample] == verdict);
        Self {
            program: PROGRAM.into(),
            files: ["crib.csv", "surface.ply"].map(str::to_owned).to_vec(),
            part: crib.part.clone(),
            unit: crib.unit,
            pitch: crib.pitch,
            orientations: crib.orientations.spec.clone(),
            orientation_count: crib.orientations.len(),
            tolerance: crib.tolerance,
            guarantee: crib.guarantee.to_string(),
            resolved: resolved(crib.pitch, crib.points_apart, crib.conservative, crib.unit),
            area: total,
            samples: samples.len(),
            hidden_area: crib.samples.hidden_area,
            requested: crib.fraction,
            fewest: crib.chosen.iter().map(|&tool| crib.tools[tool].name.clone()).collect(),
            proven: crib.at_least == crib.chosen.len(),
            at_least: crib.at_least,
            reached_by_the_fewest: share(&|sample| {
                crib.chosen.iter().any(|&tool| crib.reaches(tool, sample))
            }),
            reached: of(Verdict::Reached),
            obstructed: of(Verdict::Obstructed),
            obstructed_by: crib.obstructed.clone(),
            gouged: of(Verdict::Gouged),
            not_faced: of(Verdict::NotFaced),
            tools: tools.collect(),
            undecided: crib.undecided.clone(),
            seconds,
        }
    }

    pub(super) fn csv(&self) -> String {
        let mut text =
            "tool,diameter,stick_out,rigidity,reached,most_rigid,obstructed,gouged,not_faced,chosen,file\n"
                .to_owned();
        for ToolRow { tool, reached, most_rigid, obstructed, gouged, not_faced, chosen, .. } in &self.tools {
            let CribTool { name, diameter, stick_out, rigidity, file } = tool;
            let [name, file] = [name, file].map(|text| quoted(text));
            let [diameter, stick_out, rigidity] = [diameter, stick_out, rigidity]
                .map(|value| value.map_or(String::new(), |value| value.to_string()));
            let chosen = chosen.map_or(String::new(), |place| place.to_string());
            let _ = writeln!(
                text,
                "{name},{diameter},{stick_out},{rigidity},{reached},{most_rigid},{obstructed},{gouged},{not_faced},{chosen},{file}"
            );
        }
        text
    }

    pub(super) fn text(&self) -> String {
        let percent = |share: f64| format!("{:.1} %", 100.0 * share);
        let Self { part, unit, pitch, orientation_count, .. } = self;
        let orientations = shortened(&self.orientations);
        let mut text = format!(
            "{part}: {} tools, {orientation_count} directions ({orientations}), pitch {} {unit}\n\n\
             surface, {} {unit}² (a cutter may cut {} {unit} below it)\n",
            self.tools.len(),
            short(*pitch),
            show_measure(self.area),
            length::finer(self.tolerance, *unit, 2)
        );
        let mut row = |name: &str, share: f64, rest: &str| {
            let _ = writeln!(text, "  {name:34}{:>8}   {rest}", percent(share));
        };
        row("some tool reaches", self.reached, "");
        row(
            "none: something is in the way",
            self.obstructed,
            &ObstructedRow::text(&self.obstructed_by, self.tools.len() > 1),
        );
        row("none: no cutter fits", self.gouged, "");
        row("none: no direction faces it", self.not_faced, "");
        let _ = writeln!(text, "  {}", self.resolved);
        let proof = proof(self.proven, self.at_least);
        let _ = writeln!(
            text,
            "\nthe fewest tools: {} reach {} of the surface, of {} that all of them reach ({proof})",
            self.fewest.len(),
            percent(self.reached_by_the_fewest),
            percent(self.reached)
        );
        let head = |text: &mut String, last: &str| {
            let _ = writeln!(
                text,
                "  {:>10}{:>10}{:>14}{:>10}{last:>12}",
                "⌀", "stick-out", "⌀/stick-out", "reaches"
            );
        };
        let line = |text: &mut String, tool: &ToolRow, last: f64| {
            let CribTool { name, diameter, stick_out, rigidity, .. } = &tool.tool;
            let diameter = diameter.map_or("mesh".into(), |diameter| length::finer(diameter, *unit, 1));
            let stick_out =
                stick_out.map_or("no holder".into(), |stick_out| length::nearest(stick_out, *unit));
            let rigidity = rigidity.map_or("–".into(), |rigidity| format!("{rigidity:.2}"));
            let (reached, last) = (percent(tool.reached), percent(last));
            let _ = writeln!(
                text,
                "  {diameter:>10}{stick_out:>10}{rigidity:>14}{reached:>10}{last:>12}   {name}"
            );
        };
        head(&mut text, "alone");
        let mut chosen: Vec<&ToolRow> = self.tools.iter().filter(|tool| tool.chosen.is_some()).collect();
        chosen.sort_by_key(|tool| tool.chosen);
        for tool in chosen {
            line(&mut text, tool, tool.alone.unwrap_or_default());
        }
        let mut ranked: Vec<&ToolRow> = self.tools.iter().collect();
        ranked.sort_by(|a, b| b.reached.total_cmp(&a.reached).then(a.tool.by_rigidity(&b.tool)));
        let _ = writeln!(text, "\nby area, of equal ones the more rigid first; all in crib.csv");
        head(&mut text, "most rigid");
        for tool in ranked.into_iter().take(LISTED) {
            line(&mut text, tool, tool.most_rigid);
        }
        if !self.undecided.is_empty() {
            let _ = writeln!(text, "\nnot decided: {}", self.undecided.len());
            for UndecidedTool { tool, why } in self.undecided.iter().take(LISTED_UNDECIDED) {
                let _ = writeln!(text, "  {tool}: {why}");
            }
            if self.undecided.len() > LISTED_UNDECIDED {
                let more = self.undecided.len() - LISTED_UNDECIDED;
                let _ = writeln!(text, "  and {more} more, see {SUMMARY}");
            }
        }
        let _ = write!(text, "\n{}; {}.", show_seconds(self.seconds), self.guarantee);
        text
    }
}
