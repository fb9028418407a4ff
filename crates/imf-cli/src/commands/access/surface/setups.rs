//! The fewest set-ups: candidates, result and report.

use std::fmt::{self, Write as _};

use anyhow::Result;
use glam::DVec3;
use imf_core::machine::AxisLimits;
use imf_core::orientation::Orientation;
use imf_core::set_cover::CoverSettings;
use imf_core::surface::{
    ChosenSetup, PartSetup, SetupPlan, Verdict, candidate_setups, fewest_setups, ways_up,
};
use serde::Serialize;

use super::{AccessRun, Surface};
use crate::interrupt::Interrupted;
use crate::session::Session;

/// Degrees by which a direction may lie beyond the end of a range.
const SLACK: f64 = 1e-5;

/// What set-ups are looked for.
#[derive(Clone, Copy)]
pub(in crate::commands::access) struct SetupSettings {
    /// What the machine reaches in one set-up, its z axis up.
    pub(in crate::commands::access) range: AxisLimits,
    /// The fraction to cover of what all candidates reach.
    pub(in crate::commands::access) fraction: f64,
    /// True where every direction of the set is a candidate, not those of axes and part alone.
    pub(in crate::commands::access) every_direction: bool,
}

/// The answer.
pub(super) struct Setups {
    plan: SetupPlan,
    candidates: Vec<PartSetup>,
    /// What reaches these directions, for people.
    machine: String,
    fraction: f64,
    /// By sample: the first chosen set-up that reaches it, counted from 1; 0 for none.
    pub(super) by_sample: Vec<u32>,
    /// By chosen set-up, where the machine has rotary axes.
    rotary: Vec<Vec<AxisRow>>,
}

impl Setups {
    pub(super) fn find(
        session: &Session,
        run: &AccessRun,
        question: &SetupSettings,
        surface: &Surface,
    ) -> Result<Self> {
        let orientations = &run.orientations.orientations;
        let ways: Vec<DVec3> = if question.every_direction {
            orientations.iter().map(Orientation::direction).collect()
        } else {
            ways_up(&run.suggested)
        };
        let candidates = candidate_setups(&run.mesh, &ways, orientations, &question.range.limits)?;
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
        let by_sample: Vec<u32> = (0..samples.len()).map(first).collect();
        let rotary = plan.setups.iter().enumerate().map(|(at, chosen)| {
            let candidate = &candidates[chosen.candidate];
            let angles = |&index: &usize| {
                let direction = candidate.rotation() * orientations[index].direction();
                Some((index, question.range.limits.angles(direction.normalize(), SLACK)?))
            };
            let mut angles: Vec<(usize, [f64; 2])> = candidate.directions.iter().filter_map(angles).collect();
            angles.sort_by(|(_, a), (_, b)| {
                a[0].abs().total_cmp(&b[0].abs()).then(a[1].abs().total_cmp(&b[1].abs()))
            });
            // Each sample by the direction that tilts least.
            let own = (0..samples.len()).filter(|&sample| by_sample[sample] == at as u32 + 1);
            let needed = own.filter_map(|sample| {
                let free = |direction: usize| tools.iter().any(|tool| tool.is_free(sample, direction));
                angles.iter().find(|(direction, _)| free(*direction)).map(|(_, angles)| *angles)
            });
            axis_rows(&question.range, needed)
        });
        let rotary = rotary.collect();
        let own = run.machine.as_ref().map(|own| &own.machine);
        let own = own.filter(|machine| machine.limits() == Some(question.range));
        let machine = own.map_or_else(|| question.range.limits.to_string(), |machine| machine.name.clone());
        Ok(Self { plan, candidates, machine, fraction: question.fraction, by_sample, rotary })
    }

    /// Of the chosen set-ups.
    pub(super) fn ways_up(&self) -> impl Iterator<Item = DVec3> {
        self.plan.setups.iter().map(|chosen| self.candidates[chosen.candidate].up)
    }

    pub(super) fn row(&self, surface: &Surface) -> SetupsRow {
        let total = surface.samples.area();
        let chosen = self.plan.setups.iter().zip(&self.rotary).map(|(chosen, rotary)| {
            let candidate = &self.candidates[chosen.candidate];
            let up = Orientation::from_direction(candidate.up).unwrap_or(Orientation::new(0.0, 0.0));
            SetupRow {
                up: (candidate.up + 0.0).to_array(),
                theta: up.theta,
                phi: up.phi,
                transform: rotation(candidate),
                rests: candidate.rests,
                lower_face: candidate.floor_area,
                rotary: rotary.clone(),
                reached: chosen.area / total,
                alone: chosen.alone / total,
            }
        });
        let left = |verdict: Verdict| {
            surface.share(|sample| self.by_sample[sample] == 0 && surface.best[sample].0 == verdict)
        };
        SetupsRow {
            machine: self.machine.clone(),
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

/// How the part is turned from where it is into a set-up, as `--transform` reads it.
fn rotation(run: &PartSetup) -> String {
    let (axis, angle) = run.rotation().to_axis_angle();
    let number = |value: f64| (1e6 * value).round() / 1e6 + 0.0;
    let [x, y, z] = axis.to_array().map(number);
    match number(angle.to_degrees()) {
        0.0 => "rotate:0,0,1:0".into(),
        angle => format!("rotate:{x},{y},{z}:{angle}"),
    }
}

/// What a set-up needs of one of the machine's rotary axes, in degrees: the range of its angles when each point is machined with the
/// least tilt.
#[derive(Clone, Copy, Debug, Serialize)]
struct AxisRow {
    axis: char,
    range: [f64; 2],
}

/// The tilting axis, then the turning one; none of those that the machine has not.
fn axis_rows(range: &AxisLimits, angles: impl Iterator<Item = [f64; 2]>) -> Vec<AxisRow> {
    let wider = |range: Option<[[f64; 2]; 2]>, angles: [f64; 2]| {
        let known = range.unwrap_or(angles.map(|angle| [angle; 2]));
        Some([0, 1].map(|axis| [known[axis][0].min(angles[axis]), known[axis][1].max(angles[axis])]))
    };
    let found = angles.fold(None, wider).unwrap_or_default();
    let named = range.axes.iter().zip(found).filter_map(|(axis, found)| {
        let (axis, sign) = (*axis)?;
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
struct SetupRow {
    /// What points up, in the world.
    up: [f64; 3],
    theta: f64,
    phi: f64,
    /// What turns the part so.
    transform: String,
    /// The part stands so by itself.
    rests: bool,
    /// Area of the surface that it stands on.
    lower_face: f64,
    /// Of a machine with rotary axes.
    rotary: Vec<AxisRow>,
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
    /// The fraction required, of what all candidates reach.
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
    /// The report's lines.
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
                "  {}  ({i:.3}, {j:.3}, {k:.3}) up, {}: reaches {}, alone {}; {rest}",
                index + 1,
                row.transform,
                percent(row.reached),
                percent(row.alone)
            );
            if !row.rotary.is_empty() {
                let axes: Vec<String> = row.rotary.iter().map(AxisRow::to_string).collect();
                let _ = writeln!(text, "     {}", axes.join(", "));
            }
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
