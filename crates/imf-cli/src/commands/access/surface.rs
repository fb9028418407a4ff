//! The part's surface: how much of its area is reached, from where, and what obstructs the rest.

mod blame;
mod cavities;
mod freed;
mod row;
mod setups;
mod shown;
mod stick_out;

use std::path::Path;

use anyhow::Result;
use glam::Vec3;
use imf_core::field_files::{NamedField, write_ply, write_vti, write_vtp};
use imf_core::mesh::Mesh;
use imf_core::scene::{Bodies, SceneSpec};
use imf_core::surface::{
    CollisionEnvironment, ObstructedAreas, SampleReach, SurfaceAccess, SurfaceSamples, SurfaceTool, Verdict,
    surface_access, surface_memory_estimate,
};

use row::{DirectionRow, edge_between_points};
pub(super) use row::{ObstructedRow, SurfaceRow, proof, resolved};
pub(super) use setups::{SetupSettings, SetupsRow};
pub(super) use shown::UnreachedPatch;
use shown::words;
pub(super) use stick_out::StickOutRow;
use stick_out::ToolStickOut;

use super::run::AccessRun;
use crate::arguments::access::AccessArguments;
use crate::output::PROGRAM;
use crate::session::Session;

/// Minimum number of samples; triangles that are halved until they are small enough make up to four times as many.
pub(super) const SAMPLES: usize = 8_000;
/// Directions that the summary lists.
const LISTED: usize = 5;

pub(super) struct SurfaceSettings {
    /// How deep a cutter may cut below the surface, in the part's unit.
    pub(super) tolerance: f64,
    /// Part and fixtures as tools meet them.
    pub(super) environment: CollisionEnvironment,
    /// The same at twice the pitch, and the tolerance there.
    pub(super) coarse: (CollisionEnvironment, f64),
    /// The fewest set-ups are searched for.
    pub(super) setups: Option<SetupSettings>,
    /// The minimum stick-outs are searched for.
    pub(super) stick_out: bool,
}

impl SurfaceSettings {
    /// Part and fixtures as tools meet them at the pitch, and at twice the pitch.
    pub(super) fn new(
        spec: &SceneSpec<'_>,
        bodies: &Bodies,
        arguments: &AccessArguments,
        setups: Option<SetupSettings>,
    ) -> Result<Self> {
        let grid = &bodies.part.grid;
        Ok(Self {
            tolerance: arguments.reach.tolerance_at(grid.pitch, spec.unit),
            environment: CollisionEnvironment::of_bodies(spec, bodies)?,
            coarse: (
                CollisionEnvironment::at_twice_the_pitch(spec, grid)?,
                arguments.reach.tolerance_at(2.0 * grid.pitch, spec.unit),
            ),
            setups,
            stick_out: arguments.stickout,
        })
    }

    /// Bytes for a mesh, `directions` directions and `tools` tools, beside the voxels: of each sample its triangle and what is written of
    /// it as well.
    pub(super) fn memory_estimate(mesh: &Mesh, directions: usize, tools: usize) -> u64 {
        let samples = SurfaceSamples::most(mesh, SAMPLES);
        surface_memory_estimate(samples, directions) * tools as u64 + 300 * samples as u64
    }
}

pub(super) struct Surface {
    samples: SurfaceSamples,
    /// By tool.
    tools: Vec<(SurfaceAccess, SurfaceTool)>,
    /// By sample: the best verdict of any tool, and whose it is: as [`best_tools`].
    best: Vec<(Verdict, usize)>,
    /// Fraction of the area that is reached at twice the pitch; the same samples.
    coarse: f64,
    tolerance: f64,
    /// Points of the part's surface, which a cutter must not hold.
    pub(super) points_apart: f64,
    /// Area that each direction reaches with any tool.
    by_direction: Vec<f64>,
    pub(super) setups: Option<setups::Setups>,
    blame: blame::Blame,
    /// For each sample that shank or holder obstruct: the minimum stick-out that frees it.
    freed: Vec<Option<f64>>,
    /// By tool, where requested.
    stick_outs: Vec<ToolStickOut>,
}

/// Green, orange, magenta, grey: distinguishable by brightness as well.
pub(super) fn rgb(verdict: Verdict) -> [u8; 3] {
    match verdict {
        Verdict::Reached => [120, 190, 110],
        Verdict::Obstructed => [235, 140, 40],
        Verdict::Gouged => [170, 40, 130],
        Verdict::NotFaced => [90, 90, 95],
    }
}

impl Surface {
    pub(super) fn find(session: &Session, run: &AccessRun, settings: &SurfaceSettings) -> Result<Self> {
        let samples = SurfaceSamples::new(&run.mesh, settings.environment.part(), SAMPLES);
        let orientations = &run.orientations;
        let mut tools = Vec::new();
        for tool in 0..run.tools.len() {
            tools.push(one_tool(session, run, tool, &settings.environment, settings.tolerance, &samples)?);
        }
        let verdict = |tool: usize, sample: usize| -> Verdict {
            (&tools[tool] as &(SurfaceAccess, _)).0.reach[sample].verdict()
        };
        let best = best_tools(&samples, tools.len(), verdict);
        let mut by_direction = vec![0.0; orientations.len()];
        for (index, sample) in samples.samples.iter().enumerate() {
            for (direction, area) in by_direction.iter_mut().enumerate() {
                if tools.iter().any(|(access, _)| access.is_free(index, direction)) {
                    *area += sample.area;
                }
            }
        }
        let mut surface = Self {
            samples,
            tools,
            best,
            coarse: 0.0,
            tolerance: settings.tolerance,
            points_apart: settings.environment.points_apart(),
            by_direction,
            setups: None,
            blame: blame::Blame::default(),
            freed: Vec::new(),
            stick_outs: Vec::new(),
        };
        surface.coarse = surface.at_twice_the_pitch(session, run, settings)?;
        surface.blame = blame::Blame::find(session, run, &surface)?;
        surface.freed = freed::stick_outs(session, run, settings, &surface)?;
        if let Some(question) = &settings.setups {
            surface.setups = Some(setups::Setups::find(session, run, question, &surface)?);
        }
        for assembly in run.tools.iter().filter(|_| settings.stick_out) {
            let found =
                ToolStickOut::find(session, settings, assembly, &surface.samples.samples, orientations)?;
            surface.stick_outs.push(found);
        }
        Ok(surface)
    }

    /// Fraction of the area that any tool reaches among voxels twice as large.
    fn at_twice_the_pitch(
        &self,
        session: &Session,
        run: &AccessRun,
        settings: &SurfaceSettings,
    ) -> Result<f64> {
        let (environment, tolerance) = &settings.coarse;
        let mut reached = vec![false; self.samples.samples.len()];
        for tool in 0..run.tools.len() {
            let (access, _) = one_tool(session, run, tool, environment, *tolerance, &self.samples)?;
            let any =
                |(all, one): (&mut bool, &SampleReach)| *all |= matches!(one, SampleReach::Reached { .. });
            reached.iter_mut().zip(&access.reach).for_each(any);
        }
        Ok(self.samples.fraction(|sample| reached[sample]))
    }

    /// Whether any tool reaches a sample.
    fn is_reached(&self, sample: usize) -> bool {
        self.best[sample].0 == Verdict::Reached
    }

    /// Of the directions from which its best tool reaches a sample, the one that reaches most of the surface.
    fn direction(&self, sample: usize) -> Option<usize> {
        let (access, _) = &self.tools[self.best[sample].1];
        let free = |&direction: &usize| access.is_free(sample, direction);
        let area = |direction: &usize| self.by_direction[*direction];
        (0..self.by_direction.len()).filter(free).max_by(|a, b| area(a).total_cmp(&area(b)).then(b.cmp(a)))
    }

    /// Which element of which tool hits which body, with the fraction of the surface that this obstructs; several may obstruct one
    /// place.
    fn obstructed_by(&self, fixtures: &[String]) -> Vec<ObstructedRow> {
        let rows = self.tools.iter().enumerate().flat_map(|(tool, (access, surface_tool))| {
            let places = self.best.iter().zip(&self.samples.samples).enumerate();
            let own = places.filter(|(_, (best, _))| best.1 == tool);
            let own = own.map(|(index, (_, sample))| (surface_tool, access.reach[index], sample.area));
            ObstructedRow::all(surface_tool.name(), &ObstructedAreas::new(own), fixtures, self.samples.area())
        });
        rows.collect()
    }

    /// The number of directions from which its best tool reaches a sample, where it does.
    fn reached_from(&self, sample: usize) -> Option<f32> {
        match self.tools[self.best[sample].1].0.reach[sample] {
            SampleReach::Reached { directions } => Some(directions as f32),
            _ => None,
        }
    }

    /// Those that reach most of the surface.
    fn best_directions(&self) -> impl Iterator<Item = usize> {
        let mut directions: Vec<usize> = (0..self.by_direction.len()).collect();
        directions.sort_by(|&a, &b| self.by_direction[b].total_cmp(&self.by_direction[a]).then(a.cmp(&b)));
        directions.into_iter().take(LISTED)
    }

    pub(super) fn row(&self, run: &AccessRun) -> SurfaceRow {
        let orientations = &run.orientations;
        let of = |verdict: Verdict| self.samples.fraction(|sample| self.best[sample].0 == verdict);
        let listed = self.best_directions().map(|direction| DirectionRow {
            direction: orientations.orientations[direction].direction().to_array(),
            fraction: self.by_direction[direction] / self.samples.area(),
        });
        let reached = of(Verdict::Reached);
        SurfaceRow {
            area: self.samples.area(),
            samples: self.samples.samples.len(),
            hidden_area: self.samples.hidden_area,
            tolerance: self.tolerance,
            reached,
            border: self.samples.border(|sample| self.is_reached(sample)),
            reached_at_twice_the_pitch: self.coarse,
            difference: reached - self.coarse,
            obstructed: of(Verdict::Obstructed),
            obstructed_by: self.obstructed_by(&run.fixtures),
            gouged: of(Verdict::Gouged),
            not_faced: of(Verdict::NotFaced),
            best_directions: listed.collect(),
            other_directions: self.by_direction.len().saturating_sub(LISTED),
        }
    }

    /// How much deeper than said a holder's edge may stand in a surface; `None` where it does not.
    pub(super) fn surface_nearer_by(&self, run: &AccessRun) -> Option<f64> {
        run.guarantee
            .surface_nearer_by(run.query.pitch)
            .map(|nearer| nearer.min(edge_between_points(self.points_apart)))
    }

    pub(super) fn stick_out_rows(&self, run: &AccessRun) -> Vec<StickOutRow> {
        let nearer = self.surface_nearer_by(run);
        self.stick_outs.iter().map(|found| found.row(&self.samples, &run.orientations, nearer)).collect()
    }

    pub(super) fn reached_by(&self, tool: usize) -> f64 {
        self.samples
            .fraction(|sample| matches!(self.tools[tool].0.reach[sample], SampleReach::Reached { .. }))
    }

    /// Writes `surface.ply`, `surface.vtp` and what each voxel is to blame for, and gives back the files' names.
    pub(super) fn write(&self, run: &AccessRun, folder: &Path) -> Result<Vec<&'static str>> {
        let each = |value: &dyn Fn(usize) -> f32| -> Vec<f32> { (0..self.best.len()).map(value).collect() };
        let mut values = vec![
            ("verdict".to_owned(), each(&|sample| f32::from(self.best[sample].0 as u8))),
            ("directions".to_owned(), each(&|sample| self.reached_from(sample).unwrap_or(0.0))),
            (
                "tool".to_owned(),
                each(&|sample| if self.is_reached(sample) { self.best[sample].1 as f32 } else { -1.0 }),
            ),
        ];
        let directions: Vec<Vec3> = (0..self.best.len())
            .map(|sample| match self.direction(sample) {
                Some(at) => run.orientations.orientations[at].direction().as_vec3(),
                None => Vec3::ZERO,
            })
            .collect();
        for (axis, name) in ["best_i", "best_j", "best_k"].into_iter().enumerate() {
            values.push((name.to_owned(), each(&|sample| directions[sample][axis])));
        }
        let many = self.stick_outs.len() > 1;
        for (index, found) in self.stick_outs.iter().enumerate() {
            let name = if many { format!("stick_out_tool_{index}") } else { "stick_out".into() };
            values.push((name, each(&|sample| found.value(sample))));
        }
        if let Some(setups) = &self.setups {
            values.push(("setup".to_owned(), each(&|sample| setups.by_sample[sample] as f32)));
        }
        let colours: Vec<[u8; 3]> = self.best.iter().flat_map(|(verdict, _)| [rgb(*verdict); 3]).collect();
        let comments = [
            format!("{PROGRAM}: {} in {}", run.part, run.unit),
            "verdict: 0 reached, 1 obstructed by shank, holder or fixture, 2 the cutter does not fit, 3 no direction faces it"
                .into(),
            "tool: the first that reaches it as well as any, from 0, or −1; directions: number from which that tool reaches it; best: the one that reaches most of the surface, from tip to holder".into(),
            format!("the cutter may cut {} {} below the surface", self.tolerance, run.unit),
        ];
        let mesh: &Mesh = &self.samples.mesh;
        // One value for each triangle, and for each of its three corners.
        let of_corners: Vec<Vec<f32>> =
            values.iter().map(|(_, values)| values.iter().flat_map(|&value| [value; 3]).collect()).collect();
        let named: Vec<(&str, &[f32])> =
            values.iter().zip(&of_corners).map(|((name, _), values)| (name.as_str(), &values[..])).collect();
        write_ply(folder.join("surface.ply"), mesh, &named, &colours, &comments)?;
        let fields: Vec<NamedField<'_>> =
            values.iter().map(|(name, values)| NamedField::new(name, &values[..])).collect();
        write_vtp(folder.join("surface.vtp"), mesh, &fields)?;
        let mut written = vec!["surface.ply", "surface.vtp"];
        if let Some((grid, area)) = &self.blame.voxels {
            write_vti(folder.join("culprits.vti"), grid, &[NamedField::new("area", &area[..])])?;
            written.push("culprits.vti");
        }
        Ok(written)
    }
}

/// By sample the best verdict of any tool, and of the tools that have it the one that reaches most of the surface, whatever their
/// order; of those that reach alike the first.
pub(super) fn best_tools(
    samples: &SurfaceSamples,
    tools: usize,
    verdict: impl Fn(usize, usize) -> Verdict,
) -> Vec<(Verdict, usize)> {
    let reached = |tool: usize| samples.fraction(|sample| verdict(tool, sample) == Verdict::Reached);
    let mut ranked: Vec<(usize, f64)> = (0..tools).map(|tool| (tool, reached(tool))).collect();
    ranked.sort_by(|a, b| b.1.total_cmp(&a.1));
    let best = |sample: usize| {
        let verdicts = ranked.iter().map(|&(tool, _)| (verdict(tool, sample), tool));
        verdicts.min_by_key(|(verdict, _)| *verdict).unwrap_or((Verdict::NotFaced, 0))
    };
    (0..samples.samples.len()).map(best).collect()
}

/// One tool among its surroundings.
fn one_tool(
    session: &Session,
    run: &AccessRun,
    index: usize,
    environment: &CollisionEnvironment,
    tolerance: f64,
    samples: &SurfaceSamples,
) -> Result<(SurfaceAccess, SurfaceTool)> {
    let mut tool = SurfaceTool::new(environment, &run.tools[index], tolerance)?;
    if let Some(machine) = &run.machine {
        tool = machine.limit(index, tool);
    }
    let name = format!("surface, {}, pitch {}", tool.name(), environment.pitch());
    let access = session.staged(&name, "samples", samples.samples.len() as u64, |control| {
        surface_access(&tool, &samples.samples, &run.orientations.orientations, control)
    })?;
    Ok((access, tool))
}
