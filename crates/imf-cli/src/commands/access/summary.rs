//! What was found, as a table and as JSON.

use std::fmt::Write as _;

use glam::DMat4;
use imf_core::access::{Component, Components, RemovableStock};
use imf_core::mesh::MachiningDirection;
use imf_core::tool::Clearance;
use imf_core::unit::LengthUnit;
use serde::Serialize;

use super::any_direction::AnyDirectionRow;
use super::collisions::{self, CollisionRow};
use super::pictures::directions;
use super::run::AccessRun;
use super::surface::{SetupsRow, StickOutRow, Surface, SurfaceRow, UnreachedPatch, resolved};
use super::{Findings, Volume};
use crate::arguments::clearance::{clearance_text, contact_text};
use crate::arguments::orientations::suggested_lines;
use crate::output::{PROGRAM, short, shortened, show_measure};
use crate::progress::show_seconds;

/// Pieces of space that the summary lists; the label fields have them all.
const LISTED: usize = 20;
/// Width of the table's names, where no tool's name is longer.
const NAMES: usize = 32;

/// A set of voxels in its connected pieces.
#[derive(Debug, Serialize)]
struct Region {
    #[serde(flatten)]
    volume: Volume,
    components: usize,
    /// The largest, at most [`LISTED`].
    largest: Vec<Component>,
}

#[derive(Debug, Serialize)]
struct ToolRow {
    tool: String,
    /// Empty voxels that it reaches.
    accessible: Volume,
    /// Fraction of the surface that it reaches.
    #[serde(skip_serializing_if = "Option::is_none")]
    surface_reached: Option<f64>,
    /// What collides where it does not reach.
    blocked_by: Vec<CollisionRow>,
    #[serde(skip_serializing_if = "Option::is_none")]
    removable: Option<Volume>,
    /// Fraction of the directions that are free at the map's point.
    #[serde(skip_serializing_if = "Option::is_none")]
    map_free_fraction: Option<f64>,
}

#[derive(Debug, Serialize)]
struct StockRow {
    stock: String,
    /// Of the grid of removable.npy, and its lower corner.
    dims: [usize; 3],
    origin: [f64; 3],
    to_remove: Volume,
    /// A cutter covers it, the tool's tip on a voxel's centre.
    removable: Volume,
    /// The rest: what this pitch does not decide, and what is out of reach.
    stays: Volume,
    /// With its tip between voxels' centres a cutter may cover it or not.
    undecided: Volume,
    /// From these directions no cutter covers it, wherever its tip lies.
    out_of_reach: Volume,
}

/// Everything in `summary.json`.
#[derive(Debug, Serialize)]
pub(super) struct Summary {
    program: String,
    part: String,
    fixtures: Vec<String>,
    /// Set-up: where the part's own coordinates stand in the world, column-major. Every other place is in the world.
    transform: DMat4,
    unit: LengthUnit,
    dims: [usize; 3],
    origin: [f64; 3],
    pitch: f64,
    orientations: String,
    orientation_count: usize,
    /// Directions that the part suggested, with the area of flat faces and the number of cylinders that each is for.
    suggested_by_the_part: Vec<MachiningDirection>,
    tau: f64,
    clearance: Clearance,
    contact: Option<f64>,
    guarantee: String,
    /// What voxels resolve of the surface's walls.
    #[serde(skip_serializing_if = "Option::is_none")]
    resolved: Option<String>,
    solid: Volume,
    accessible: Region,
    inaccessible: Region,
    /// Of these, what any direction whatever reaches.
    #[serde(skip_serializing_if = "Option::is_none")]
    any_direction: Option<AnyDirectionRow>,
    /// Which elements of the best tool collide where none reaches.
    blocked_by: Vec<CollisionRow>,
    tools: Vec<ToolRow>,
    /// The point of the access maps, and their cells along longitude and latitude.
    #[serde(skip_serializing_if = "Option::is_none")]
    map: Option<([f64; 3], [usize; 2])>,
    /// Which directions the tools' shares are of.
    #[serde(skip)]
    map_directions: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    stock: Option<StockRow>,
    #[serde(skip_serializing_if = "Option::is_none")]
    surface: Option<SurfaceRow>,
    #[serde(skip_serializing_if = "Option::is_none")]
    setups: Option<SetupsRow>,
    /// The largest connected patches of the surface that are not reached.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub(super) unreached: Vec<UnreachedPatch>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    stick_outs: Vec<StickOutRow>,
    seconds: f64,
    /// Nothing before all of them are written.
    pub(super) files: Vec<String>,
}

impl Summary {
    pub(super) fn new(
        run: &AccessRun,
        findings: &Findings,
        surface: Option<&Surface>,
        any_direction: Option<AnyDirectionRow>,
        seconds: f64,
    ) -> Self {
        let measure = |voxels: usize| Volume::new(voxels, run.query.voxel_volume());
        let region = |components: &Components| Region {
            volume: measure(components.voxels()),
            components: components.pieces.len(),
            largest: components.pieces.iter().take(LISTED).copied().collect(),
        };
        let reached = |imf: &[f32]| {
            imf.iter().zip(&run.solid.solid).filter(|&(&v, &s)| s == 0 && f64::from(v) <= run.tau).count()
        };
        let tools = run.tools.iter().enumerate().map(|(index, tool)| ToolRow {
            tool: tool.tool().name.clone(),
            accessible: measure(reached(&findings.tools[index].imf.value)),
            surface_reached: surface.map(|surface| surface.reached_by(index)),
            blocked_by: collisions::by_tool(run, findings, index),
            removable: findings
                .removable
                .get(index)
                .map(|found| measure(found.covered.iter().filter(|&&covered| covered != 0).count())),
            map_free_fraction: findings.maps.get(index).map(|map| map.free_fraction(run.tau)),
        });
        let stock = run.stock.as_ref().map(|stock| {
            let whole = stock.solid.count();
            let count = |by: fn(&RemovableStock) -> &[u8]| {
                let any = |v: &usize| findings.removable.iter().any(|found| by(found)[*v] != 0);
                (0..stock.solid.solid.len()).filter(any).count()
            };
            let (removed, possible) = (count(|found| &found.covered), count(|found| &found.possible));
            StockRow {
                stock: stock.name.clone(),
                dims: stock.solid.grid.dims,
                origin: stock.solid.grid.origin.to_array(),
                to_remove: measure(whole),
                removable: measure(removed),
                stays: measure(whole - removed),
                undecided: measure(possible - removed),
                out_of_reach: measure(whole - possible),
            }
        });
        Self {
            program: PROGRAM.into(),
            part: run.part.clone(),
            fixtures: run.fixtures.clone(),
            transform: run.transform,
            unit: run.unit,
            dims: run.query.dims,
            origin: run.query.origin.to_array(),
            pitch: run.query.pitch,
            orientations: run.orientations.spec.clone(),
            orientation_count: run.orientations.len(),
            suggested_by_the_part: run.suggested.clone(),
            tau: run.tau,
            clearance: run.clearance,
            contact: run.contact,
            guarantee: run.guarantee.to_string(),
            resolved: surface
                .map(|surface| resolved(run.query.pitch, surface.points_apart, run.conservative, run.unit)),
            solid: measure(run.solid.count()),
            accessible: region(&findings.accessible),
            inaccessible: region(&findings.inaccessible),
            any_direction,
            blocked_by: collisions::together(run, findings),
            tools: tools.collect(),
            map: run.map.map(|(point, cells)| (point.to_array(), cells)),
            map_directions: directions(run),
            stock,
            surface: surface.map(|surface| surface.row(run)),
            setups: surface.and_then(|surface| Some(surface.setups.as_ref()?.row(surface))),
            unreached: surface.map_or_else(Vec::new, |surface| surface.unreached(run)),
            stick_outs: surface.map_or_else(Vec::new, |surface| surface.stick_out_rows(run)),
            seconds,
            files: Vec::new(),
        }
    }

    /// The surface's lines, each tool's share among them where there are several.
    fn surface_lines(&self) -> String {
        let Some(surface) = &self.surface else { return String::new() };
        let unit = self.unit.to_string();
        let several = self.tools.len() > 1;
        let mut text = surface.lines(self.unit, several);
        if let Some(line) = &self.resolved {
            let _ = writeln!(text, "  {line}");
        }
        if self.tau > 0.0 || self.contact.is_some() {
            text.push_str(
                "  τ and contact are for the space and the stock below: these figures are without them\n",
            );
        }
        for tool in self.tools.iter().filter(|_| several) {
            let share = 100.0 * tool.surface_reached.unwrap_or_default();
            let _ = writeln!(text, "  {:34}{share:>8.1} %", format!("reached by {}", tool.tool));
        }
        text.push_str(&UnreachedPatch::lines(&self.unreached, self.unit, several));
        if let Some(setups) = &self.setups {
            text.push('\n');
            text.push_str(&setups.lines(&unit));
        }
        for row in &self.stick_outs {
            text.push('\n');
            text.push_str(&row.lines(self.unit));
        }
        text.push('\n');
        text
    }

    pub(super) fn table(&self) -> String {
        let Self { part, dims: [x, y, z], pitch, unit, orientation_count, tau, .. } = self;
        let orientations = shortened(&self.orientations);
        let accessible_to = |tool: &ToolRow| format!("  accessible to {}", tool.tool);
        let names =
            self.tools.iter().filter(|_| self.tools.len() > 1).map(|t| accessible_to(t).chars().count());
        let wide = names.max().unwrap_or(0).max(NAMES);
        let mut text = format!(
            "{part}: {x}×{y}×{z} voxels of {} {unit}, {orientation_count} orientations ({orientations}), τ = {tau}\n{}\n\
             {}{:wide$}{:>12}{:>16}   pieces\n",
            short(*pitch),
            suggested_lines(&self.suggested_by_the_part, &unit.to_string()),
            self.surface_lines(),
            "",
            "voxels",
            format!("volume {unit}³")
        );
        let mut row = |name: &str, volume: Volume, rest: &str| {
            let measure = show_measure(volume.volume);
            let _ = writeln!(text, "{name:wide$}{:>12}{measure:>16}   {rest}", volume.voxels);
        };
        row("part and fixtures", self.solid, "");
        row("accessible around it", self.accessible.volume, &self.accessible.pieces());
        row("inaccessible around it", self.inaccessible.volume, &self.inaccessible.pieces());
        if let Some(any) = &self.any_direction {
            row(
                "  another direction reaches",
                any.from_another,
                "that was not given; one for each place in any_direction.csv",
            );
            row("  no direction reaches", any.from_none, "proven, whatever the direction");
            row("  not known", any.open, "");
        }
        for blocked in &self.blocked_by {
            let alone = show_measure(blocked.alone.volume);
            let mut alone = format!("alone {} voxels, {alone} {unit}³", blocked.alone.voxels);
            if let Some([part, fixtures]) = blocked.part_and_fixtures {
                let _ = write!(alone, "; part {}, fixtures {} voxels", part.voxels, fixtures.voxels);
            }
            row(&format!("  the {} hits", blocked.element), blocked.hits, &alone);
        }
        if self.tools.len() > 1 {
            for tool in &self.tools {
                row(&accessible_to(tool), tool.accessible, "");
                for blocked in &tool.blocked_by {
                    row(&format!("    else the {} hits", blocked.element), blocked.hits, "");
                }
            }
        }
        if let Some(stock) = &self.stock {
            row("stock to remove", stock.to_remove, "");
            row("  a cutter reaches", stock.removable, "");
            row(
                "  this pitch does not decide",
                stock.undecided,
                "near part and fixtures; less at a smaller --pitch",
            );
            row("  out of reach", stock.out_of_reach, "from these directions, at any pitch");
            if self.tools.len() > 1 {
                for tool in &self.tools {
                    row(&format!("  {} reaches", tool.tool), tool.removable.unwrap_or_default(), "");
                }
            }
        }
        for tool in &self.tools {
            if let Some(share) = tool.map_free_fraction {
                let (name, share, of) = (&tool.tool, 100.0 * share, self.map_directions);
                let _ = writeln!(text, "\n{name}: {share:.1} % of {of} are free at the point");
            }
        }
        if let Some(clearance) = clearance_text(&self.clearance, self.unit) {
            let _ = writeln!(text, "\nclearance: {clearance}");
        }
        if let Some(depth) = self.contact {
            let _ = writeln!(text, "\n{}", contact_text(depth, self.pitch, self.unit));
        }
        let _ = write!(text, "\n{}; {}.", show_seconds(self.seconds), self.guarantee);
        text
    }
}

impl Region {
    fn pieces(&self) -> String {
        match self.largest.first() {
            Some(first) => format!("{}, the largest {} voxels", self.components, first.voxels),
            None => "none".into(),
        }
    }
}
