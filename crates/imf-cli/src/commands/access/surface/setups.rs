//! The fewest set-ups: candidates, result and report.

mod lines;
mod tilts;

use anyhow::Result;
use glam::DVec3;
use imf_core::access::removable_by_orientation;
use imf_core::control::Cancelled;
use imf_core::machine::AxisLimits;
use imf_core::occupancy::Occupancy;
use imf_core::orientation::Orientation;
use imf_core::pose::Pose;
use imf_core::set_cover::{Cover, CoverProblem, CoverSettings};
use imf_core::surface::{
    PartSetup, SetupTool, SurfaceAccess, SurfaceTool, Verdict, candidate_setups, fewest_setups,
    reached_in_setups, removed_in_setups, ways_up,
};
pub(crate) use lines::SetupsRow;
use lines::{AxisRow, LeftRow, SetupRow, StockRow, axis_rows};
use tilts::Tilts;

use super::super::on_machine::OnMachine;
use super::{AccessRun, Surface};
use crate::session::Session;

/// Which set-ups are searched for.
#[derive(Clone, Copy)]
pub(crate) struct SetupSettings {
    /// What the machine reaches in one set-up, its z axis up.
    pub(crate) range: AxisLimits,
    /// The fraction to cover of what all candidates reach.
    pub(crate) fraction: f64,
    /// True where every direction of the set is a candidate, not those of axes and part alone.
    pub(crate) every_direction: bool,
}

/// Voxels of the stock that set-ups are chosen by, at most.
const STOCK: usize = 8_000;

pub(crate) struct Setups {
    /// Of the candidates.
    chosen: Cover,
    candidates: Vec<PartSetup>,
    /// What each candidate reaches of the samples.
    surface: CoverProblem,
    /// Where a stock is given.
    stock: Option<StockCover>,
    /// What reaches these directions, for people.
    machine: String,
    fraction: f64,
    /// By sample: the first chosen set-up that reaches it, counted from 1; 0 for none.
    pub(super) by_sample: Vec<u32>,
    /// By chosen set-up, where the machine has rotary axes.
    rotary: Vec<Vec<AxisRow>>,
    /// By chosen set-up where the part stands on the machine, where one is given.
    places: Vec<Option<Pose>>,
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
        let machine = run.machine.as_ref();
        let candidates =
            candidate_setups(&run.mesh, &ways, orientations, &question.range.limits, machine.is_some())?;
        let samples = &surface.samples.samples;
        let own = |setup: &PartSetup| -> Vec<Orientation> {
            setup.directions.iter().map(|&direction| orientations[direction]).collect()
        };
        let brought = |tool: usize, setup: &PartSetup| {
            let reach = machine?.in_setup(tool, &setup.place(&run.mesh), &own(setup));
            Some((OnMachine::limited(surface.tools[tool].1.clone(), reach.clone()), reach))
        };
        let by_tool: Vec<_> = (0..surface.tools.len())
            .map(|tool| {
                move |setup: &PartSetup| {
                    brought(tool, setup).map_or_else(|| surface.tools[tool].1.clone(), |(tool, _)| tool)
                }
            })
            .collect();
        let tools = surface.tools.iter().zip(&by_tool).map(|((access, _), brought)| SetupTool {
            access,
            brought: machine.map(|_| brought as &(dyn Fn(&PartSetup) -> SurfaceTool + Sync)),
        });
        let tools: Vec<SetupTool<'_>> = tools.collect();
        let stage = session.stage("set-ups", "candidates", candidates.len() as u64);
        let advance = |n| stage.advance(n);
        let control = session.control(&advance);
        let reached = reached_in_setups(&tools, samples, orientations, &candidates, control);
        let reached = reached.ok_or(Cancelled)?;
        let stock = run.stock.as_ref().map(|stock| removed(session, run, &stock.solid, &candidates));
        let stock = stock.transpose()?;
        let settings = CoverSettings { fraction: question.fraction, ..CoverSettings::default() };
        let both = stock.as_ref().map(|stock| reached.beside(&stock.at_most));
        let chosen = fewest_setups(&candidates, both.as_ref().unwrap_or(&reached), &settings, control);
        let chosen = chosen.ok_or(Cancelled)?;
        let first = |sample: usize| {
            let reaches = |&set: &usize| reached.contains(set, sample);
            chosen.sets.iter().position(reaches).map_or(0, |at| at as u32 + 1)
        };
        let by_sample: Vec<u32> = (0..samples.len()).map(first).collect();
        let search = Tilts { tools: &tools, samples, orientations, limits: &question.range.limits };
        let rotary = chosen.sets.iter().enumerate().map(|(at, &set)| {
            let candidate = &candidates[set];
            let tilts = search.of(candidate);
            let mine = (0..samples.len()).filter(|&sample| by_sample[sample] == at as u32 + 1);
            let Some(machine) = machine else {
                return axis_rows(
                    question.range.axes,
                    mine.filter_map(|sample| search.angles(sample, &tilts)),
                );
            };
            let brought: Vec<_> = (0..tools.len()).filter_map(|tool| brought(tool, candidate)).collect();
            let angles = mine.filter_map(|sample| search.on_machine(sample, &tilts, &brought));
            axis_rows(machine.axes(), angles)
        });
        let rotary = rotary.collect();
        stage.finish("");
        let place = |&set: &usize| machine.map(|_| candidates[set].place(&run.mesh));
        let places = chosen.sets.iter().map(place).collect();
        let own = machine.map(|own| &own.machine).filter(|own| own.limits() == Some(question.range));
        let machine = own.map_or_else(|| question.range.limits.to_string(), |own| own.name.clone());
        let (surface, fraction) = (reached, question.fraction);
        Ok(Self { chosen, candidates, surface, stock, machine, fraction, by_sample, rotary, places })
    }

    /// Of the chosen set-ups.
    pub(super) fn ways_up(&self) -> impl Iterator<Item = DVec3> {
        self.chosen.sets.iter().map(|&set| self.candidates[set].up)
    }

    pub(crate) fn row(&self, surface: &Surface) -> SetupsRow {
        let total = surface.samples.area();
        let sets = &self.chosen.sets;
        let all: Vec<usize> = (0..self.candidates.len()).collect();
        let alone = self.surface.covered_alone(sets);
        let of_stock = |stock: &CoverProblem, sets: &[usize]| stock.covered(sets) / stock.weight();
        let chosen = sets.iter().enumerate().map(|(at, &index)| {
            let candidate = &self.candidates[index];
            let up = Orientation::from_direction(candidate.up).unwrap_or(Orientation::new(0.0, 0.0));
            SetupRow {
                up: (candidate.up + 0.0).to_array(),
                theta: up.theta,
                phi: up.phi,
                transform: transform(candidate, self.places[at].as_ref()),
                rests: candidate.rests,
                lower_face: candidate.floor_area,
                rotary: self.rotary[at].clone(),
                reached: self.surface.covered(&[index]) / total,
                alone: alone[at] / total,
                removed: self.stock.as_ref().map(|stock| of_stock(&stock.certain, &[index])),
                removed_at_most: self.stock.as_ref().map(|stock| of_stock(&stock.at_most, &[index])),
                removed_alone: self.stock.as_ref().map(|stock| stock.alone(sets, at)),
            }
        });
        let reachable = |sample: usize| all.iter().any(|&set| self.surface.contains(set, sample));
        let left = |holds: &dyn Fn(usize, Verdict) -> bool| {
            surface
                .samples
                .fraction(|sample| self.by_sample[sample] == 0 && holds(sample, surface.best[sample].0))
        };
        let of = |verdict: Verdict| left(&|_, own| own == verdict);
        let stands_on = |setup: &PartSetup, sample: usize| setup.stands_on(&surface.samples.samples[sample]);
        let given = |sample: usize| {
            let reaches = |setup: &PartSetup| {
                let free =
                    |tool: &(SurfaceAccess, SurfaceTool)| tool.0.is_free_from_any(sample, &setup.directions);
                !stands_on(setup, sample) && surface.tools.iter().any(free)
            };
            self.candidates.iter().any(reaches)
        };
        let by_machine = self.places.iter().any(Option::is_some);
        let is_kept = |sample: usize| by_machine && !reachable(sample) && given(sample);
        let kept = left(&|sample, own| own == Verdict::Reached && is_kept(sample));
        let stood_on = left(&|sample, own| {
            let of_chosen = || sets.iter().any(|&set| stands_on(&self.candidates[set], sample));
            own == Verdict::Reached && of_chosen() && !is_kept(sample)
        });
        SetupsRow {
            machine: self.machine.clone(),
            candidates: self.candidates.len(),
            requested: self.fraction,
            setups: chosen.collect(),
            proven: self.chosen.is_proven(),
            at_least: self.chosen.at_least,
            reached: self.surface.covered(sets) / total,
            reachable: self.surface.covered(&all) / total,
            stock: self.stock.as_ref().map(|stock| StockRow {
                removed: of_stock(&stock.certain, sets),
                undecided: of_stock(&stock.at_most, sets) - of_stock(&stock.certain, sets),
                removable: of_stock(&stock.certain, &all),
                voxels: stock.certain.elements(),
            }),
            left: LeftRow {
                reached_from_other_directions: of(Verdict::Reached) - kept - stood_on,
                stood_on,
                kept_away_by_the_machine: kept,
                obstructed: of(Verdict::Obstructed),
                gouged: of(Verdict::Gouged),
                not_faced: of(Verdict::NotFaced),
            },
        }
    }
}

/// What each candidate removes of the stock.
struct StockCover {
    /// The tips on voxels' centres.
    certain: CoverProblem,
    /// The same, and of what some candidate certainly removes what this one may with its tip anywhere: by it set-ups are chosen, as what a
    /// pitch does not decide needs none of its own.
    at_most: CoverProblem,
}

impl StockCover {
    /// The fraction that one of these sets certainly removes, and no other of them can.
    fn alone(&self, sets: &[usize], at: usize) -> f64 {
        let others = || sets.iter().enumerate().filter(|(other, _)| *other != at);
        let is_alone = |&voxel: &usize| {
            self.certain.contains(sets[at], voxel)
                && !others().any(|(_, &set)| self.at_most.contains(set, voxel))
        };
        (0..self.certain.elements()).filter(is_alone).count() as f64 / self.certain.elements() as f64
    }
}

/// What each candidate removes of the stock with any of the tools, by voxels drawn evenly from it.
fn removed(
    session: &Session,
    run: &AccessRun,
    stock: &Occupancy,
    candidates: &[PartSetup],
) -> Result<StockCover> {
    let mut held: Vec<usize> = (0..stock.solid.len()).filter(|&voxel| stock.solid[voxel] == 1).collect();
    // In an order that follows no row of voxels.
    held.sort_by_key(|&voxel| (voxel as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15));
    let mut drawn = Occupancy::empty(stock.grid);
    held.iter().take(STOCK).for_each(|&voxel| drawn.solid[voxel] = 1);
    let orientations = &run.orientations.orientations;
    let none = vec![Vec::new(); orientations.len()];
    let (mut certain, mut at_most) = (none.clone(), none);
    for tool in run.tools.iter().filter(|tool| tool.tool().has_cutter()) {
        let name = format!("set-ups, stock, {}", tool.tool().name);
        let found = session.staged(&name, "sections", 2 * orientations.len() as u64, |control| {
            removable_by_orientation(&run.obstacle, tool, &drawn, orientations, run.tau, control)
        })?;
        for ((certain, at_most), found) in certain.iter_mut().zip(&mut at_most).zip(found) {
            certain.extend(found.covered);
            at_most.extend(found.undecided);
        }
    }
    let mut by_any = vec![false; drawn.solid.len()];
    let given = candidates.iter().flat_map(|candidate| &candidate.directions);
    given.flat_map(|&direction| &certain[direction]).for_each(|&voxel| by_any[voxel as usize] = true);
    for (certain, at_most) in certain.iter().zip(&mut at_most) {
        at_most.retain(|&voxel| by_any[voxel as usize]);
        at_most.extend(certain);
    }
    let cover = |removed: &[Vec<u32>]| removed_in_setups(removed, &drawn, candidates);
    Ok(StockCover { certain: cover(&certain), at_most: cover(&at_most) })
}

/// How the part is moved from where it is into a set-up, as `--transform` reads it: onto the zero of G54 where a machine is given.
fn transform(setup: &PartSetup, place: Option<&Pose>) -> String {
    let (axis, angle) = setup.rotation().to_axis_angle();
    // With the digits that keep a direction at a machine's limit within it.
    let number = |value: f64| (1e10 * value).round() / 1e10 + 0.0;
    let [x, y, z] = axis.to_array().map(number);
    let turned = match number(angle.to_degrees()) {
        0.0 => "rotate:0,0,1:0".into(),
        angle => format!("rotate:{x},{y},{z}:{angle}"),
    };
    match place.map(|place| place.position.to_array().map(number)) {
        Some([x, y, z]) => format!("{turned}; translate:{x},{y},{z}"),
        None => turned,
    }
}
