//! The fewest set-ups: candidates, the answer, and what it says to people.

use std::fmt::Write as _;

use anyhow::Result;
use glam::DVec3;
use imf_core::cover::CoverSettings;
use imf_core::mesh::MachiningDirection;
use imf_core::orientation::{Limits, Orientation};
use imf_core::surface::{ChosenSetup, PartSetup, SetupPlan, Verdict, fewest_setups};
use serde::Serialize;

use super::{Setup, Surface};
use crate::interrupt::Interrupted;
use crate::session::Session;

/// Directions this near to one another are one.
const SAME: f64 = 5e-4;

/// What set-ups are looked for.
#[derive(Clone, Copy)]
pub(in crate::commands::access) struct SetupQuestion {
    /// What the machine reaches in one set-up, its z axis up.
    pub(in crate::commands::access) range: Limits,
    /// The fraction to cover of what all candidates reach.
    pub(in crate::commands::access) fraction: f64,
    /// True where every direction of the set is a candidate, not those of axes and part alone.
    pub(in crate::commands::access) every_direction: bool,
}

const AXES: [DVec3; 6] = [DVec3::Z, DVec3::NEG_Z, DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y];

/// Ways up that a vise and the part suggest: the axes, and both ways along the part's own directions.
fn ways_up(suggested: &[MachiningDirection]) -> Vec<DVec3> {
    let of_part = suggested.iter().flat_map(|suggested| [suggested.direction, -suggested.direction]);
    let mut ways: Vec<DVec3> = Vec::new();
    for way in AXES.into_iter().chain(of_part) {
        if ways.iter().all(|known| known.distance(way) > SAME) {
            ways.push(way);
        }
    }
    ways
}

/// A set of directions, and every way up as a direction that the tool may come from.
pub(in crate::commands::access) fn with_ways_up(set: &str, suggested: &[MachiningDirection]) -> String {
    let named = |way: &DVec3| {
        let suggested = suggested.iter().map(|suggested| suggested.direction);
        AXES.into_iter().chain(suggested).any(|known| known.distance(*way) <= SAME)
    };
    let ways = ways_up(suggested).into_iter();
    let others = ways.filter(|way| !named(way)).filter_map(Orientation::from_direction);
    let others: Vec<String> = others.map(|o| format!("{},{}", o.theta, o.phi)).collect();
    let first = if set.starts_with("axes+normals") { "" } else { "axes+normals+" };
    match others.is_empty() {
        true => format!("{first}{set}"),
        false => format!("{}+{first}{set}", others.join(";")),
    }
}

/// The answer.
pub(super) struct Setups {
    plan: SetupPlan,
    candidates: Vec<PartSetup>,
    range: Limits,
    fraction: f64,
    /// By sample: the first chosen set-up that reaches it, counted from 1; 0 for none.
    pub(super) by_sample: Vec<u32>,
}

impl Setups {
    pub(super) fn find(
        session: &Session,
        setup: &Setup,
        question: &SetupQuestion,
        surface: &Surface,
    ) -> Result<Self> {
        let orientations = &setup.orientations.orientations;
        let ways: Vec<DVec3> = if question.every_direction {
            orientations.iter().map(Orientation::direction).collect()
        } else {
            ways_up(&setup.suggested)
        };
        let candidates =
            ways.into_iter().map(|up| PartSetup::new(&setup.mesh, up, orientations, &question.range));
        let mut candidates: Vec<PartSetup> = candidates.collect();
        // Of set-ups that reach the same the first is taken: one that stands by itself.
        candidates.sort_by_key(|candidate| !candidate.rests);
        let tools: Vec<_> = surface.tools.iter().map(|(access, ..)| access).collect();
        let samples = &surface.samples.samples;
        let stage = session.stage("set-ups", "candidates", candidates.len() as u64);
        let advance = |n| stage.advance(n);
        let settings = CoverSettings { fraction: question.fraction, ..CoverSettings::default() };
        let plan = fewest_setups(&tools, samples, &candidates, &settings, session.control(&advance));
        let plan =
            plan.ok_or_else(|| Interrupted("no result was written: the set-ups were not found".into()))?;
        stage.finish("");
        let first = |sample: usize| {
            let reaches = |chosen: &ChosenSetup| {
                let directions = &candidates[chosen.candidate].directions;
                tools.iter().any(|tool| tool.is_free_from_any(sample, directions))
            };
            plan.setups.iter().position(reaches).map_or(0, |at| at as u32 + 1)
        };
        let by_sample = (0..samples.len()).map(first).collect();
        Ok(Self { plan, candidates, range: question.range, fraction: question.fraction, by_sample })
    }

    /// Of the chosen set-ups.
    pub(super) fn ways_up(&self) -> impl Iterator<Item = DVec3> {
        self.plan.setups.iter().map(|chosen| self.candidates[chosen.candidate].up)
    }

    pub(super) fn row(&self, surface: &Surface, suggested: &[MachiningDirection]) -> SetupsRow {
        let total = surface.samples.area();
        let rest_area = |down: DVec3| {
            let face = suggested.iter().find(|s| s.direction.distance(down) < SAME);
            face.map_or(0.0, |face| face.flat_area)
        };
        let chosen = self.plan.setups.iter().map(|chosen| {
            let candidate = &self.candidates[chosen.candidate];
            let up = Orientation::from_direction(candidate.up).unwrap_or(Orientation::new(0.0, 0.0));
            SetupRow {
                up: (candidate.up + 0.0).to_array(),
                theta: up.theta,
                phi: up.phi,
                rests: candidate.rests,
                lower_face: rest_area(-candidate.up),
                reached: chosen.area / total,
                alone: chosen.alone / total,
            }
        });
        let left = |verdict: Verdict| {
            surface.share(|sample| self.by_sample[sample] == 0 && surface.best[sample].0 == verdict)
        };
        SetupsRow {
            machine: self.range.to_string(),
            candidates: self.candidates.len(),
            asked: self.fraction,
            setups: chosen.collect(),
            proven: self.plan.is_proven(),
            at_least: self.plan.at_least,
            reached: self.plan.area / total,
            reachable: self.plan.reachable / total,
            left: LeftRow {
                reached_from_other_directions: left(Verdict::Reached),
                obstructed: left(Verdict::Obstructed),
                gouged: left(Verdict::Gouged),
                not_faced: left(Verdict::NotFaced),
            },
        }
    }
}

/// One set-up; fractions are of the surface's area.
#[derive(Debug, Serialize)]
struct SetupRow {
    /// What points up, in the world.
    up: [f64; 3],
    theta: f64,
    phi: f64,
    /// The part stands so by itself.
    rests: bool,
    /// Area of the flat faces that it stands on.
    lower_face: f64,
    reached: f64,
    /// Reached in no other of the chosen set-ups.
    alone: f64,
}

/// What no chosen set-up reaches, by the surface's verdict over all directions.
#[derive(Debug, Serialize)]
struct LeftRow {
    reached_from_other_directions: f64,
    obstructed: f64,
    gouged: f64,
    not_faced: f64,
}

/// The set-ups in the summary.
#[derive(Debug, Serialize)]
pub(in crate::commands::access) struct SetupsRow {
    machine: String,
    candidates: usize,
    /// The fraction asked for, of what all candidates reach.
    asked: f64,
    setups: Vec<SetupRow>,
    proven: bool,
    /// No fewer of the candidates do.
    at_least: usize,
    reached: f64,
    /// What all candidates together reach.
    reachable: f64,
    left: LeftRow,
}

impl SetupsRow {
    /// Lines for people.
    pub(in crate::commands::access) fn lines(&self, unit: &str) -> String {
        let percent = |share: f64| format!("{:.1} %", 100.0 * share);
        let count = self.setups.len();
        let proof = if self.proven {
            "proven: no fewer do".to_owned()
        } else {
            format!("at least {} are needed: the search for fewer was given up", self.at_least)
        };
        let machine = match self.machine.as_str() {
            "cone:0,0,1:0" => "three axes",
            range => range,
        };
        let mut text = format!(
            "set-ups ({machine}): {count} of {} candidates reach {} of the surface, of {} that all of them reach ({proof})\n",
            self.candidates,
            percent(self.reached),
            percent(self.reachable)
        );
        for (index, row) in self.setups.iter().enumerate() {
            let [i, j, k] = row.up;
            let rest = match (row.rests, row.lower_face > 0.0) {
                (true, true) => format!("stands on flat faces of {:.1} {unit}²", row.lower_face),
                (true, false) => "stands by itself".into(),
                (false, _) => "must be held: it does not stand so by itself".into(),
            };
            let _ = writeln!(
                text,
                "  {}  ({i:.3}, {j:.3}, {k:.3}) up: reaches {}, alone {}; {rest}",
                index + 1,
                percent(row.reached),
                percent(row.alone)
            );
        }
        let left = [
            ("from directions that these set-ups do not give", self.left.reached_from_other_directions),
            ("obstructed", self.left.obstructed),
            ("the cutter does not fit", self.left.gouged),
            ("no direction faces it", self.left.not_faced),
        ];
        let left = left.into_iter().filter(|(_, share)| *share > 0.0);
        let left: Vec<String> = left.map(|(why, share)| format!("{why} {}", percent(share))).collect();
        if !left.is_empty() {
            let _ = writeln!(text, "  left: {}", left.join(", "));
        }
        text
    }
}
