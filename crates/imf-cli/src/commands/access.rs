//! `imf access`: what tools reach around a part among its fixtures, in one run over the orientations.

mod any_direction;
mod collisions;
pub(crate) mod crib;
mod files;
mod footprint;
mod on_machine;
mod pictures;
mod run;
mod stock;
mod summary;
mod surface;

use std::time::Instant;

use anyhow::Result;
use imf_core::access::{
    AccessMap, CombinedAccess, Components, RemovableStock, ToolAccess, access_map, components, removable,
    tool_access,
};
use imf_core::section::{ElementMeasures, ElementPlans, elements_at_best};
use serde::Serialize;

use crate::arguments::access::AccessArguments;
use crate::output::{OutputFile, OutputFolder, SUMMARY, print_written};
use crate::session::Session;

use run::AccessRun;
use summary::Summary;

struct Findings {
    /// By tool, in the order given.
    tools: Vec<ToolAccess>,
    /// By tool: its elements' measures at its best orientation of every voxel; none of a mesh.
    elements: Vec<ElementMeasures>,
    /// By tool: the same against the fixtures alone; nothing where there are none, or where more than the tip is sharp: the
    /// elements are then read at the sharp point that is best for all that is solid.
    at_fixtures: Vec<Option<ElementMeasures>>,
    together: CombinedAccess,
    /// The empty voxels that some pose reaches.
    accessible: Components,
    /// Those that none reaches.
    inaccessible: Components,
    /// By tool, on the stock's grid: what its cutter can remove.
    removable: Vec<RemovableStock>,
    /// By tool.
    maps: Vec<AccessMap>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
struct Volume {
    voxels: usize,
    /// In cubic units of the grid.
    volume: f64,
}

impl Volume {
    fn new(voxels: usize, voxel_volume: f64) -> Self {
        Self { voxels, volume: voxels as f64 * voxel_volume }
    }
}

pub(crate) fn run(session: &Session, arguments: &AccessArguments) -> Result<()> {
    let begun = Instant::now();
    let run = AccessRun::new(session, arguments)?;
    let folder = OutputFolder::check(&arguments.reach.out)?;
    let page = arguments.html.as_deref().map(OutputFile::check).transpose()?;
    let surface =
        run.surface.as_ref().map(|settings| surface::Surface::find(session, &run, settings)).transpose()?;
    let findings = find(session, &run)?;
    let any_direction =
        arguments.certify.then(|| any_direction::find(session, &run, &findings)).transpose()?;
    let row = any_direction.as_ref().map(|any| any.row(&run));
    let seconds = begun.elapsed().as_secs_f64();
    let mut summary = Summary::new(&run, &findings, surface.as_ref(), row, seconds);
    let out = &folder.path;
    let mut write = || -> Result<()> {
        folder.begin(session)?;
        // The largest files come last: a disk that they fill has the others.
        let mut written = pictures::draw(&run, &findings, out)?;
        if let Some(surface) = &surface {
            let view = surface.view(&run, &summary.unreached, summary.table());
            view.draw_sides(&out.join("surface.png"))?;
            written.push("surface.png".into());
            if let Some(page) = &page {
                let path = page.begin()?;
                view.write_page(path)?;
                session.note(&format!("wrote {}: open it in a browser", path.display()));
            }
        }
        if let Some(any) = &any_direction {
            written.extend(any.write(&run, out)?);
        }
        written.extend(files::write(&run, &findings, out)?);
        if let Some(surface) = &surface {
            written.extend(surface.write(&run, out)?.into_iter().map(String::from));
        }
        written.push(SUMMARY.into());
        summary.files = written;
        folder.write_summary(&summary)?;
        session.note(&format!("wrote {} to {}", summary.files.join(", "), out.display()));
        Ok(())
    };
    let written = write();
    print_written(session, &summary, &summary.table(), written)
}

fn find(session: &Session, run: &AccessRun) -> Result<Findings> {
    let orientations = &run.orientations.orientations;
    let count = orientations.len() as u64;
    let mut together = CombinedAccess::new(run.query.len());
    let (mut tools, mut elements, mut at_fixtures) = (Vec::new(), Vec::new(), Vec::new());
    let (mut swept, mut maps) = (Vec::new(), Vec::new());
    for (index, assembly) in run.tools.iter().enumerate() {
        let plans = ElementPlans::new(&run.obstacle, assembly, &run.query)?;
        let plan = plans.whole();
        let tool = assembly.whole();
        session.detail(&format!("{}: {}", tool.name, plan.describe()));
        let access =
            session.staged(&format!("sections, {}", tool.name), "orientations", count, |control| {
                tool_access(plan, orientations, run.tau, control)
            })?;
        together.take(index, &access);
        let measures = |of: &str, plans: &ElementPlans| {
            session.staged(&format!("{of}, {}", tool.name), "orientations", count, |control| {
                elements_at_best(plans, orientations, &access.imf, control)
            })
        };
        elements.push(measures("elements", &plans)?);
        let tip_alone = plan.tip_alone();
        drop(plans);
        let fixtures = run.fixtures_alone.as_ref().filter(|_| tip_alone);
        let found = fixtures.map(|fixtures| -> Result<ElementMeasures> {
            Ok(measures("fixtures", &ElementPlans::new(fixtures, assembly, &run.query)?)?)
        });
        at_fixtures.push(found.transpose()?);
        tools.push(access);
        if let Some(stock) = &run.stock {
            // Each orientation twice: tips on voxel centres, and anywhere.
            let name = format!("removable, {}", tool.name);
            swept.push(session.staged(&name, "sections", 2 * count, |control| {
                removable(&run.obstacle, assembly, &stock.solid, orientations, run.tau, control)
            })?);
        }
        if let Some((point, cells)) = run.map {
            let name = format!("map, {}", tool.name);
            let map = session.staged(&name, "directions", (cells[0] * cells[1]) as u64, |control| {
                access_map(&run.obstacle, assembly, point, cells, control)
            })?;
            maps.push(match &run.limits {
                Some(limits) => map.within(limits),
                None => map,
            });
        }
    }
    let empty = |v: usize| run.solid.solid[v] == 0;
    let reached = |v: usize| f64::from(together.imf.value[v]) <= run.tau;
    let accessible = components(&run.query, |v| empty(v) && reached(v));
    let inaccessible = components(&run.query, |v| empty(v) && !reached(v));
    Ok(Findings { tools, elements, at_fixtures, together, accessible, inaccessible, removable: swept, maps })
}
