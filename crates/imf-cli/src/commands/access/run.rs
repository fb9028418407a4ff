//! From arguments to everything that a run needs, checked and within the memory, before any section is computed.

use std::cell::OnceCell;

use anyhow::{Context as _, Result, ensure};
use glam::{DMat4, DVec3};
use imf_core::access::{cavities, position_grid};
use imf_core::grid::Grid;
use imf_core::machine::{AxisLimits, Machine};
use imf_core::mesh::{MachiningDirection, Mesh};
use imf_core::obstacle::Obstacle;
use imf_core::occupancy::Occupancy;
use imf_core::orientation::{Limits, OrientationSet};
use imf_core::scene::{Guarantee, SceneSpec};
use imf_core::surface::{SurfaceError, contact_reach, ways_up, with_fixed_axes, with_ways_up};
use imf_core::tool::{Assembly, Clearance, SharpPoints, Tool, ToolShape};
use imf_core::unit::LengthUnit;

use super::footprint::Footprint;
use super::on_machine::OnMachine;
use super::stock::Stock;
use super::surface::{SetupSettings, SurfaceSettings};
use crate::arguments::access::AccessArguments;
use crate::arguments::fixture::{self, StockArgument};
use crate::arguments::orientations::{Directions, default_for};
use crate::arguments::scene::{
    voxelise_with_progress, warn_of, warn_of_cavities, warn_of_fixtures_out_of_reach,
};
use crate::output::short;
use crate::session::{Session, show_bytes};

pub(super) struct AccessRun {
    pub(super) part: String,
    pub(super) unit: LengthUnit,
    pub(super) clearance: Clearance,
    /// How deep the cutter may reach.
    pub(super) contact: Option<f64>,
    /// The weakest of the tools' guarantees.
    pub(super) guarantee: Guarantee,
    /// Every voxel is solid that the surface touches.
    pub(super) conservative: bool,
    /// Where the part's own coordinates stand in the world, in which everything is.
    pub(super) transform: DMat4,
    /// The part's surface in the world.
    pub(super) mesh: Mesh,
    pub(super) fixtures: Vec<String>,
    /// In the part's unit, offset by the clearance.
    pub(super) tools: Vec<Assembly>,
    pub(super) orientations: OrientationSet,
    /// What the part suggested, where the set names it.
    pub(super) suggested: Vec<MachiningDirection>,
    pub(super) tau: f64,
    /// `None` where no tool has a cutter.
    pub(super) surface: Option<SurfaceSettings>,
    /// A point and the map's cells.
    pub(super) map: Option<(DVec3, [usize; 2])>,
    /// The machine's, where they are given: the orientations are within them.
    pub(super) limits: Option<Limits>,
    pub(super) machine: Option<OnMachine>,
    /// The voxels to be examined.
    pub(super) query: Grid,
    /// All that the tools can meet, on its own grid.
    pub(super) obstacle: Obstacle,
    /// What of the obstacle is empty but closed off on all sides; `None` where nothing is.
    pub(super) cavities: Option<Occupancy>,
    /// The obstacle on the query grid.
    pub(super) solid: Occupancy,
    /// The fixtures on the query grid.
    pub(super) held: Occupancy,
    /// The fixtures on the obstacle's grid; `None` where there are none.
    pub(super) fixtures_alone: Option<Occupancy>,
    pub(super) stock: Option<Stock>,
}

impl AccessRun {
    pub(super) fn new(session: &Session, arguments: &AccessArguments) -> Result<Self> {
        ensure!(
            arguments.setups.is_none() || arguments.reach.scene.fixture.is_empty(),
            "a fixture belongs to one set-up, and here it would go with the part into every one: leave --fixture out for --setups, \
             or ask for one set-up with the fixture, its directions by --limits"
        );
        let machine = arguments.reach.machine()?;
        let reached = machine.as_ref().map(|(_, limits)| *limits);
        let limits = arguments.limits(reached.map(|reached| reached.limits));
        let mut inputs = arguments.reach.scene.read(session, true)?;
        let mesh = inputs.part.mesh.transformed(&inputs.transform);
        let setups = arguments.setup_range(reached).map(|range| SetupSettings {
            range,
            fraction: 0.01 * arguments.cover,
            every_direction: arguments.reach.orientations.is_some(),
        });
        let text = arguments.reach.orientations.as_deref().unwrap_or_else(|| default_for(&inputs.tools));
        let Directions { set: orientations, suggested } =
            directions(text, &mesh, setups.as_ref(), limits.as_ref())?;
        warn_of_tools(session, &inputs.tools, &orientations);
        number_names(&mut inputs.tools);
        let unit = inputs.part.unit;
        let clearance = arguments.reach.scene.clearance.clearance();
        let depth = arguments.contact.depth(&inputs.tools)?;
        if let Some(tool) = inputs.tools.iter().find(|t| arguments.stickout && t.stick_out().is_none()) {
            return Err(SurfaceError::NoHolder(tool.name.clone()).into());
        }
        let fixtures = inputs.fixtures();
        let spec = arguments.reach.scene.spec(session, &inputs, &fixtures, &inputs.tools[0]);
        let border = [i64::try_from(arguments.border)?; 3];
        let query = spec.grid()?.padded(border, border)?;
        let mut tools = Vec::new();
        for tool in &inputs.tools {
            let (assembly, warnings) = spec.assembly(tool, &clearance, &query)?;
            warn_of(session, &warnings);
            tools.push(assembly);
        }
        let stock_mesh = (arguments.removable || arguments.stock.is_some())
            .then(|| {
                let stock = arguments.stock.as_ref().unwrap_or(&StockArgument::Box(0.0));
                fixture::Stock::read(stock, spec.part_bounds()?, &inputs.transform, unit)
            })
            .transpose()?;
        let stock_grid = stock_mesh.as_ref().map(|stock| {
            let (lower, upper) = stock.mesh.bounds().context("the stock has no triangle")?;
            anyhow::Ok(query.covering(lower, upper, 0)?)
        });
        let stock_grid = stock_grid.transpose()?;
        // Everything that can be hit from any position of any tool that is examined.
        let mut positions = query;
        for (stock, tool) in stock_grid.iter().flat_map(|stock| tools.iter().map(move |tool| (stock, tool))) {
            let around = position_grid(stock, tool.tool())?;
            let (lower, upper) = (around.origin, around.origin + around.size());
            let whole = (positions.origin, positions.origin + positions.size());
            positions = positions.covering(lower.min(whole.0), upper.max(whole.1), 0)?;
        }
        // From sharp points on the part's voxels, and from contact poses.
        let reach = tools.iter().map(|tool| {
            let whole = tool.whole();
            whole.reach_from_sharp_points(query.pitch).max(whole.reach() + contact_reach(tool.tool()))
        });
        let reach = reach.fold(0.0, f64::max);
        // A tool that sticks out farther reaches farther, and so does a machine's head.
        let seen = if arguments.stickout || machine.is_some() { f64::INFINITY } else { reach };
        let obstacle_grid = spec.obstacle_grid(&positions, seen)?;

        let grids = (&obstacle_grid, &query, stock_grid.as_ref());
        let footprint = Footprint::new(grids, &tools, orientations.len(), &spec, session.threads())?;
        // A second section is added, of shank and holder, and the layer is held separately.
        let needed = footprint.bytes(if depth.is_some() { 2 } else { 1 });
        session.require_memory(needed, || {
            let [x, y, z] = query.dims;
            format!(
                "{x}×{y}×{z} voxels, tools that reach {:.0} voxels, {} orientations, {} triangles, {} threads; use {}",
                reach / query.pitch,
                orientations.len(),
                spec.mesh.triangles.len(),
                session.threads(),
                footprint.remedies()
            )
        })?;
        session.detail(&format!("this needs about {}", show_bytes(needed)));

        warn_of_fixtures_out_of_reach(session, &spec, &obstacle_grid)?;
        let bodies =
            voxelise_with_progress(session, &spec, &obstacle_grid, |spec| spec.bodies(&obstacle_grid))?;
        warn_of(session, &spec.warnings(&bodies)?);
        let (whole, held) = (bodies.obstacle(), bodies.all_fixtures());
        let conservative = arguments.reach.scene.conservative;
        let by_centres =
            conservative.then(|| bodies.by_centres(&spec.placed(), session.control(&|_| {}))).transpose()?;
        let by_centres = by_centres.as_ref().unwrap_or(&bodies);
        // Larger voxels may close a mouth that a tool passes.
        let cavities = cavities(if conservative { &by_centres.part } else { &whole });
        warn_of_cavities(session, cavities.as_ref().map_or(0.0, Occupancy::volume), query.pitch, unit);
        let guarantee = tools
            .iter()
            .map(|tool| Guarantee::new(conservative, tool.tool(), &clearance, depth.is_some(), query.pitch))
            .min_by_key(Guarantee::strength)
            .unwrap_or(Guarantee::Centres);
        let on_query =
            |occupancy: &Occupancy| occupancy.on(&query).context("the grids of part and stock do not meet");
        let stock = match (stock_mesh, stock_grid) {
            (Some(stock), Some(grid)) => {
                // A voxel that the part only touches may hold stock.
                Some(Stock::new(session, stock, &grid, by_centres, (&mesh, unit))?)
            }
            _ => None,
        };
        let surface = if tools.iter().all(can_touch) {
            let made = |spec: &SceneSpec<'_>| SurfaceSettings::new(spec, &bodies, arguments, setups);
            Some(voxelise_with_progress(session, &spec, &obstacle_grid, made)?)
        } else {
            ensure!(
                arguments.setups.is_none(),
                "set-ups are chosen by the surface that they reach, and a tool here has no cutter"
            );
            ensure!(
                arguments.html.is_none(),
                "the page shows what is reached of the surface, and a tool here has no cutter: give it one"
            );
            ensure!(
                !arguments.stickout,
                "a stick-out is for a surface to be reached, and a tool here has no cutter"
            );
            session.warn("a tool without a cutter can touch nothing: the part's surface is left out");
            None
        };
        let on_machine = |(machine, _): (Machine, AxisLimits)| {
            let seen = if surface.is_some() { &tools[..] } else { &[] };
            OnMachine::new(session, machine.in_unit(unit), &bodies, seen, &orientations, setups.is_some())
        };
        let machine = machine.map(on_machine).transpose()?;
        let solid = on_query(&whole)?;
        let mut closed = whole;
        if let Some(cavities) = &cavities {
            closed.add(cavities);
        }
        let [x, y, z] = query.dims;
        session.note(&format!(
            "{}: {x}×{y}×{z} voxels of {} {unit}, {} solid, {} of fixtures; {}; {}",
            inputs.part.name,
            short(query.pitch),
            bodies.part.count(),
            held.count(),
            tools.iter().map(|tool| tool.tool().name.as_str()).collect::<Vec<_>>().join(", "),
            guarantee
        ));
        Ok(Self {
            part: inputs.part.name.clone(),
            unit,
            clearance,
            contact: depth,
            guarantee,
            conservative,
            transform: inputs.transform,
            mesh,
            fixtures: bodies.fixtures.iter().map(|(name, _)| name.clone()).collect(),
            solid,
            held: on_query(&held)?,
            fixtures_alone: (!fixtures.is_empty()).then_some(held),
            tools,
            orientations,
            suggested,
            tau: arguments.tau,
            surface,
            map: arguments.map.map(|point| {
                // Cells of about a step along longitude and latitude.
                let cells = (180.0 / arguments.map_step).round() as usize;
                (point, [2 * cells, cells])
            }),
            limits,
            machine,
            query,
            obstacle: match depth {
                Some(depth) => Obstacle::with_cuttable(&closed, bodies.layer(depth)),
                None => closed.into(),
            },
            cavities,
            stock,
        })
    }
}

/// The set of this text within the limits; for set-ups with every way up, from which a tool may come, and where it was not given with what
/// a fixed axis leaves.
fn directions(
    text: &str,
    mesh: &Mesh,
    setups: Option<&SetupSettings>,
    limits: Option<&Limits>,
) -> Result<Directions> {
    let found = OnceCell::new();
    let suggests = || found.get_or_init(|| mesh.machining_directions()).clone();
    let text = if setups.is_some() { with_ways_up(text, &suggests()) } else { text.to_owned() };
    let Directions { mut set, mut suggested } = Directions::of_part(&text, suggests)?;
    if let Some(setups) = setups.filter(|setups| !setups.every_direction) {
        set = with_fixed_axes(set, &ways_up(&suggested), &setups.range.limits);
    }
    if let Some(limits) = limits {
        set = set.within(limits)?;
        suggested.retain(|suggested| limits.reach(suggested.direction));
    }
    Ok(Directions { set, suggested })
}

pub(super) fn warn_of_tools(session: &Session, tools: &[Tool], orientations: &OrientationSet) {
    for tool in tools.iter().filter(|tool| matches!(tool.shape, ToolShape::Mesh(_))) {
        if !matches!(tool.sharp_points, SharpPoints::Points(_)) {
            session.warn(&format!(
                "{} is a mesh that does not say what of it cuts: whatever touches the surface first counts as touching it, the \
                 housing too; write sharp_points = {{ within = LENGTH }} into its file, the distance from the tip to the farthest \
                 point that cuts",
                tool.name
            ));
        }
    }
    let all_round = tools.iter().all(Tool::is_axisymmetric);
    let some_roll = orientations.orientations.iter().any(|o| o.roll != 0.0);
    if all_round && some_roll {
        session.warn("these tools look the same at every roll: rolled orientations only repeat directions");
    }
    if !all_round && !some_roll {
        session.note("a tool is not round, and no orientation rolls it: see so3:N");
    }
}

fn can_touch(assembly: &Assembly) -> bool {
    let tool = assembly.tool();
    tool.has_cutter() || matches!(tool.shape, ToolShape::Mesh(_))
}

/// Adds to the name of each of several tools its place in the list, as their files and `best_tool` count it: from 0.
fn number_names(tools: &mut [Tool]) {
    if tools.len() > 1 {
        for (index, tool) in tools.iter_mut().enumerate() {
            tool.name = format!("{} (tool {index})", tool.name);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn several_tools_are_numbered_as_their_files_are() {
        let named = |name: &str| Tool { name: name.into(), ..Tool::paper() };
        let mut tools = [named("mill"), named("drill"), named("mill")];
        number_names(&mut tools);
        assert_eq!(tools.map(|tool| tool.name), ["mill (tool 0)", "drill (tool 1)", "mill (tool 2)"]);
        let mut alone = [named("mill")];
        number_names(&mut alone);
        assert_eq!(alone[0].name, "mill");
    }
}
