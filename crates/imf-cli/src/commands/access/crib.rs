//! `imf crib`: which tools of a crib serve which part of the surface, the fewest that cover it, and what none
//! reaches.

mod report;
mod tools;

use std::time::Instant;

use anyhow::{Result, ensure};
use imf_core::control::Cancelled;
use imf_core::field_files::write_ply;
use imf_core::machine::{AxisLimits, Machine};
use imf_core::mesh::points_memory_estimate;
use imf_core::orientation::OrientationSet;
use imf_core::scene::{Guarantee, SceneSpec};
use imf_core::set_cover::{CoverProblem, CoverSettings};
use imf_core::surface::{
    CollisionEnvironment, ObstructedAreas, SurfaceSamples, SurfaceTool, Verdict, contact_reach, crib_access,
    surface_access,
};
use imf_core::tool::Assembly;
use imf_core::unit::LengthUnit;

use super::on_machine::OnMachine;
use super::run::warn_of_tools;
use super::surface::{ObstructedRow, SAMPLES, best_tools, rgb};
use crate::arguments::access::CribArguments;
use crate::arguments::inputs::mesh_memory_estimate;
use crate::arguments::orientations::{Directions, default_for};
use crate::arguments::scene::{voxelise_with_progress, warn_of, warn_of_cavities};
use crate::output::{OutputFolder, PROGRAM, SUMMARY, print_written, short, write_text};
use crate::session::Session;

use report::Report;
use tools::{CribTool, Read, UndecidedTool};

/// The surface, and what every tool reaches of it.
struct Crib {
    part: String,
    unit: LengthUnit,
    pitch: f64,
    /// Points of the part's surface, which a cutter must not hold.
    points_apart: f64,
    orientations: OrientationSet,
    tolerance: f64,
    /// The weakest of the tools'.
    guarantee: Guarantee,
    conservative: bool,
    fixtures: Vec<String>,
    samples: SurfaceSamples,
    tools: Vec<CribTool>,
    /// By tool and sample.
    verdicts: Vec<Vec<Verdict>>,
    undecided: Vec<UndecidedTool>,
    /// Tools that cover together, those that add most first, and the number that is proven to be needed.
    chosen: Vec<usize>,
    at_least: usize,
    fraction: f64,
    /// What obstructs places where the cutter of some tool fits and none reaches.
    obstructed: Vec<ObstructedRow>,
}

pub(crate) fn run(session: &Session, arguments: &CribArguments) -> Result<()> {
    let begun = Instant::now();
    let folder = OutputFolder::check(&arguments.reach.out)?;
    let crib = Crib::find(session, arguments)?;
    let report = Report::new(&crib, begun.elapsed().as_secs_f64());
    let write = || -> Result<()> {
        folder.begin(session)?;
        write_text(&folder.file("crib.csv"), &report.csv())?;
        crib.write_surface(&folder.file("surface.ply"))?;
        folder.write_summary(&report)?;
        session.note(&format!("wrote surface.ply, crib.csv, {SUMMARY} to {}", folder.path.display()));
        Ok(())
    };
    print_written(session, &report, &report.text(), write())
}

/// The first tool that is not decided, and why.
fn first_of(undecided: &[UndecidedTool]) -> String {
    undecided.first().map_or_else(String::new, |UndecidedTool { tool, why }| format!("{tool}: {why}"))
}

impl Crib {
    fn find(session: &Session, arguments: &CribArguments) -> Result<Self> {
        let Read { tools, files, mut undecided } = tools::read(&arguments.reach.scene.tool)?;
        ensure!(!tools.is_empty(), "no tool of the crib can be used: {}", first_of(&undecided));
        let scene = &arguments.reach.scene;
        let inputs = scene.read_with(session, tools, true)?;
        let mesh = inputs.part.mesh.transformed(&inputs.transform);
        let text = arguments.reach.orientations.as_deref().unwrap_or_else(|| default_for(&inputs.tools));
        let mut orientations = Directions::of_part(text, || mesh.machining_directions())?.set;
        let machine = arguments.reach.machine()?;
        let reached = machine.as_ref().map(|(_, reached)| reached.limits);
        if let Some(limits) = arguments.reach.limits.or(reached) {
            orientations = orientations.within(&limits)?;
        }
        warn_of_tools(session, &inputs.tools, &orientations);
        let unit = inputs.part.unit;
        let clearance = scene.clearance.clearance();
        let fixtures = inputs.fixtures();
        let spec = scene.spec(session, &inputs, &fixtures, &inputs.tools[0]);
        let query = spec.grid()?.padded([1; 3], [1; 3])?;
        // By the grid, what is too thin or out of all proportion; the rest by its own reach.
        let (mut kept, mut files_of_kept) = (Vec::new(), Vec::new());
        for (tool, file) in inputs.tools.iter().zip(files) {
            match spec.assembly(tool, &clearance, &query) {
                Ok((assembly, warnings)) => {
                    warn_of(session, &warnings);
                    kept.push(assembly);
                    files_of_kept.push(file);
                }
                Err(error) => undecided.push(UndecidedTool::new(&tool.name, &error)),
            }
        }
        let reach =
            kept.iter().map(|tool| tool.whole().reach() + contact_reach(tool.tool())).fold(0.0, f64::max);
        // A machine's head reaches farther than the tools.
        let reach = if machine.is_some() { f64::INFINITY } else { reach };
        let grid = spec.obstacle_grid(&query, reach)?;
        let needed = 30 * grid.len() as u64
            + kept.len() as u64 * (200_000 + SurfaceSamples::most(&mesh, SAMPLES) as u64)
            + spec.placed().iter().map(|mesh| points_memory_estimate(mesh, grid.pitch)).sum::<u64>()
            + mesh_memory_estimate(&spec);
        session.require_memory(needed, || {
            format!("{} voxels and {} tools; use a larger --pitch or a coarser mesh", grid.len(), kept.len())
        })?;
        let bodies = voxelise_with_progress(session, &spec, &grid, |spec| spec.bodies(&grid))?;
        warn_of(session, &spec.warnings(&bodies)?);
        let made = |spec: &SceneSpec<'_>| CollisionEnvironment::of_bodies(spec, &bodies);
        let environment = voxelise_with_progress(session, &spec, &grid, made)?;
        let closed_off = environment.closed_off() as f64 * grid.voxel_volume();
        warn_of_cavities(session, closed_off, grid.pitch, unit);
        let tolerance = arguments.reach.tolerance_at(bodies.part.grid.pitch, unit);
        let samples = SurfaceSamples::new(&mesh, environment.part(), SAMPLES);
        let on_machine = |(machine, _): (Machine, AxisLimits)| {
            OnMachine::new(session, machine.in_unit(unit), &bodies, &kept, &orientations, false)
        };
        let machine = machine.map(on_machine).transpose()?;
        let (mut tools, mut among) = (Vec::new(), Vec::new());
        for (index, (assembly, file)) in kept.iter().zip(files_of_kept).enumerate() {
            match SurfaceTool::new(&environment, assembly, tolerance) {
                Ok(tool) => {
                    tools.push(CribTool::new(assembly.tool(), file));
                    among.push(match &machine {
                        Some(machine) => machine.limit(index, tool),
                        None => tool,
                    });
                }
                Err(error) => undecided.push(UndecidedTool::new(&assembly.tool().name, &error)),
            }
        }
        ensure!(
            !among.is_empty(),
            "no tool of the crib can be decided at a pitch of {} {unit}: {}",
            short(grid.pitch),
            first_of(&undecided)
        );
        let verdicts = session.staged("crib", "samples", samples.samples.len() as u64, |control| {
            crib_access(&among, &samples.samples, &orientations.orientations, control)
        })?;
        let guarantee =
            |tool: &Assembly| Guarantee::new(spec.conservative, tool.tool(), &clearance, false, grid.pitch);
        let weakest = kept.iter().map(guarantee).min_by_key(Guarantee::strength);
        let mut crib = Self {
            part: inputs.part.name.clone(),
            unit,
            pitch: grid.pitch,
            points_apart: environment.points_apart(),
            orientations,
            tolerance,
            guarantee: weakest.unwrap_or(Guarantee::Centres),
            conservative: spec.conservative,
            fixtures: fixtures.iter().map(|fixture| fixture.name.to_owned()).collect(),
            samples,
            tools,
            verdicts,
            undecided,
            chosen: Vec::new(),
            at_least: 0,
            fraction: 0.01 * arguments.cover,
            obstructed: Vec::new(),
        };
        crib.choose(session)?;
        crib.obstructed = crib.obstructed_rows(session, &among)?;
        Ok(crib)
    }

    fn reaches(&self, tool: usize, sample: usize) -> bool {
        self.verdicts[tool][sample] == Verdict::Reached
    }

    /// The fewest tools; where as few do in several ways, those whose least rigid is the most rigid.
    fn choose(&mut self, session: &Session) -> Result<()> {
        let mut problem = CoverProblem::new(self.samples.samples.iter().map(|sample| sample.area).collect());
        let mut order: Vec<usize> = (0..self.tools.len()).collect();
        order.sort_by(|&a, &b| self.tools[a].by_rigidity(&self.tools[b]));
        for &tool in &order {
            problem.add((0..self.samples.samples.len()).filter(|&sample| self.reaches(tool, sample)));
        }
        let settings = CoverSettings { fraction: self.fraction, ..CoverSettings::default() };
        let control = session.control(&|_| {});
        let cover = problem.fewest(&settings, control).ok_or(Cancelled)?;
        let cover = problem.among_first(cover, &settings, control).ok_or(Cancelled)?;
        self.chosen = cover.sets.into_iter().map(|set| order[set]).collect();
        self.at_least = cover.at_least;
        Ok(())
    }

    /// The best verdict of any tool.
    fn best(&self, sample: usize) -> Verdict {
        self.verdicts.iter().map(|verdicts| verdicts[sample]).min().unwrap_or(Verdict::NotFaced)
    }

    fn most_rigid(&self, sample: usize) -> Option<usize> {
        let serving = (0..self.tools.len()).filter(|&tool| self.reaches(tool, sample));
        // The first of equals.
        serving.min_by(|&a, &b| self.tools[a].by_rigidity(&self.tools[b]))
    }

    /// What the tool hits that reaches most of those whose cutter fits, where none reaches.
    fn obstructed_rows(&self, session: &Session, among: &[SurfaceTool]) -> Result<Vec<ObstructedRow>> {
        let best = best_tools(&self.samples, among.len(), |tool, sample| self.verdicts[tool][sample]);
        let mut rows = Vec::new();
        for (index, tool) in among.iter().enumerate() {
            let samples = best.iter().zip(&self.samples.samples);
            let samples: Vec<_> = samples
                .filter(|(best, _)| **best == (Verdict::Obstructed, index))
                .map(|(_, sample)| *sample)
                .collect();
            if samples.is_empty() {
                continue;
            }
            let control = session.control(&|_| {});
            let access = surface_access(tool, &samples, &self.orientations.orientations, control)?;
            let found = access.reach.into_iter().zip(&samples);
            let found = ObstructedAreas::new(found.map(|(reach, sample)| (tool, reach, sample.area)));
            rows.extend(ObstructedRow::all(tool.name(), &found, &self.fixtures, self.samples.area()));
        }
        Ok(rows)
    }

    fn write_surface(&self, path: &std::path::Path) -> Result<()> {
        let each = |value: &dyn Fn(usize) -> f32| -> Vec<f32> {
            (0..self.samples.samples.len()).flat_map(|sample| [value(sample); 3]).collect()
        };
        let verdict = each(&|sample| f32::from(self.best(sample) as u8));
        let tools = each(&|sample| (0..self.tools.len()).filter(|&t| self.reaches(t, sample)).count() as f32);
        let rigid = each(&|sample| self.most_rigid(sample).map_or(-1.0, |tool| tool as f32));
        let chosen = each(&|sample| {
            let first = self.chosen.iter().position(|&tool| self.reaches(tool, sample));
            first.map_or(0.0, |place| (place + 1) as f32)
        });
        let values = [
            ("verdict", &verdict[..]),
            ("tools", &tools[..]),
            ("most_rigid", &rigid[..]),
            ("chosen", &chosen[..]),
        ];
        let samples = 0..self.samples.samples.len();
        let colours: Vec<[u8; 3]> = samples.flat_map(|sample| [rgb(self.best(sample)); 3]).collect();
        let comments = [
            format!("{PROGRAM}: {} in {}", self.part, self.unit),
            "verdict of the best tool: 0 reached, 1 obstructed by shank, holder or fixture, 2 no cutter fits, 3 no direction faces it"
                .into(),
            "tools: number that reach it; most_rigid: of these, by its line in crib.csv, from 0, else -1; chosen: the first of the \
             fewest, from 1, else 0"
                .into(),
        ];
        Ok(write_ply(path, &self.samples.mesh, &values, &colours, &comments)?)
    }
}
