//! The stock of a check: where it comes from, what the path leaves of it, and the report.

use std::fmt::Write;
use std::io;

use anyhow::{Context as _, Result, bail, ensure};
use glam::{DMat4, DVec3};
use imf_core::atomic_file::write_atomically;
use imf_core::check::{
    CheckReport, CheckSettings, Collision, HitBody, LineCollisions, LineRemoval, StockLeft, StockReport,
};
use imf_core::field_files::{NamedField, write_vti};
use imf_core::mesh::Mesh;
use imf_core::mesh::write::write_stl;
use imf_core::occupancy::Occupancy;
use imf_core::scene::SceneRecord;
use imf_core::toolpath::{MoveKind, Toolpath};
use imf_core::unit::LengthUnit;
use serde_json::{Value, json};

use super::listed::brief;
use crate::arguments::fixture::{BESIDE, BY_VOXELS, Stock, StockArgument};
use crate::output::{OutputFolder, PROGRAM, short, show_measure};
use crate::session::Session;

/// What a voxel of `stock.vti` is.
const LEFT: u8 = 1;
const PART: u8 = 2;
const CUT: u8 = 3;
const PART_CUT: u8 = 4;

/// Bytes a voxel: stock, what of it is free, part and a fixture on its grid, the line that took each, what is left, bits, and at the end the
/// distances from the part.
const BYTES: u64 = 25;

/// The stock as voxels, those of the part's grid.
pub(super) struct StockInput {
    name: String,
    pub(super) voxels: Occupancy,
}

impl StockInput {
    /// `part` is the part's mesh in the world.
    pub(super) fn read(
        session: &Session,
        argument: &StockArgument,
        record: &SceneRecord,
        part_voxels: &Occupancy,
        part: &Mesh,
    ) -> Result<Self> {
        let Some(part_box) = part.bounds() else { bail!("the part has no triangle") };
        let stock = Stock::read(argument, part_box, &record.transform, record.unit)?;
        let (lower, upper) = stock.mesh.bounds().context("the stock has no triangle")?;
        let grid = part_voxels.grid.covering(lower.min(part_box.0), upper.max(part_box.1), 0)?;
        let [x, y, z] = grid.dims;
        session.require_memory(BYTES * grid.len() as u64, || {
            format!("{x}×{y}×{z} voxels of stock; check its unit, or use a larger --pitch")
        })?;
        let stage = session.brief_stage("voxelising the stock", "rows of voxels", (x * y) as u64);
        let advance = |n| stage.advance(n);
        let mut voxels = stock.voxels(session, &grid, session.control(&advance))?;
        stage.finish("");
        ensure!(voxels.count() > 0, "the stock '{}' holds no voxel's centre", stock.name);
        let own = part_voxels.on(&grid).context("the grids of part and stock do not meet")?;
        if Stock::is_beside(&voxels, part_voxels) {
            session
                .warn(&format!("the stock '{}' {BESIDE}; the part is taken for stock as well", stock.name));
            voxels.add(&own);
            return Ok(Self { name: stock.name, voxels });
        }
        let outside = own.solid.iter().zip(&voxels.solid).filter(|(part, stock)| **part > **stock).count();
        ensure!(
            2 * outside <= own.count(),
            "most of the part lies outside the stock '{}': give it where the part is, in its frame and unit, and in its scale",
            stock.name
        );
        if outside > 0 {
            session.warn(&format!(
                "{} {}³ of the part lie outside the stock: check where it stands, and its unit",
                show_measure(outside as f64 * grid.voxel_volume()),
                record.unit
            ));
        } else {
            let beside = (voxels.count() - own.count()) as f64 * grid.voxel_volume();
            stock.compare_volumes(session, [beside, grid.voxel_volume()], part, record.unit);
        }
        Ok(Self { name: stock.name, voxels })
    }
}

pub(super) struct StockResult {
    name: String,
    unit: LengthUnit,
    pub(super) report: StockReport,
    left: StockLeft,
    settings: CheckSettings,
    /// None of the path's lines is known to be at rapid rate.
    no_rapids: bool,
    /// The part's voxels reach out of it.
    conservative: bool,
}

impl StockResult {
    /// Takes the collisions over into the report of the check.
    pub(super) fn new(
        input: StockInput,
        mut report: StockReport,
        checked: &mut CheckReport,
        part: &Occupancy,
        settings: CheckSettings,
        toolpath: &Toolpath,
        record: &SceneRecord,
    ) -> Self {
        checked.add(std::mem::take(&mut report.colliding));
        let left = report.left_beside(part);
        let is_rapid = |kind| kind == MoveKind::Rapid;
        let no_rapids =
            !toolpath.states_rapids && !toolpath.locations.iter().any(|location| is_rapid(location.kind));
        let (unit, conservative) = (record.unit, record.conservative);
        Self { name: input.name, unit, report, left, settings, no_rapids, conservative }
    }

    /// Transforms places into the result's frame.
    pub(super) fn place(&mut self, into: &DMat4) {
        self.left.place = into.transform_point3(DVec3::from_array(self.left.place)).to_array();
    }

    fn volume(&self, voxels: u64) -> f64 {
        voxels as f64 * self.report.remaining.grid.voxel_volume()
    }

    fn largest(&self) -> Option<&LineRemoval> {
        // The first of equals.
        let most = self.report.removed.iter().rev().max_by_key(|line| line.voxels);
        most.filter(|line| line.voxels > 0)
    }

    fn totals(&self) -> [u64; 3] {
        let sum = |of: fn(&LineRemoval) -> u64| self.report.removed.iter().map(of).sum();
        [sum(|line| line.voxels), sum(|line| line.of_part), sum(|line| u64::from(line.voxels > 0))]
    }

    /// Voxels that go at rapid rate, and where the tool comes in: beside the part, and of the part.
    fn not_at_feed(&self) -> [u64; 2] {
        let others = self.report.removed.iter().filter(|line| line.kind != MoveKind::Feed);
        others.fold([0; 2], |[beside, of_part], line| {
            [beside + line.voxels - line.of_part, of_part + line.of_part]
        })
    }

    /// Of the row of rapids that a line ends, which is tried on the stock before it, the first line that takes something.
    fn first_of_row(&self, line: usize) -> usize {
        let removed = &self.report.removed;
        let Some(last) = removed.iter().position(|removal| removal.line == line) else { return line };
        let in_row = |removal: &&LineRemoval| removal.kind == MoveKind::Rapid || removal.voxels == 0;
        let row = removed[..=last].iter().rev().take_while(in_row);
        row.filter(|removal| removal.voxels > 0).last().map_or(line, |removal| removal.line)
    }

    pub(super) fn json(&self, checked: &CheckReport) -> Value {
        let [removed, of_part, cutting] = self.totals();
        let volume = |voxels| self.volume(voxels);
        let line = |line: &LineRemoval| json!({ "line": line.line, "tool": line.tool, "kind": line.kind, "volume": volume(line.voxels) });
        let own = |number: usize| self.report.removed.iter().find(|removal| removal.line == number);
        let rapid = first_cut(checked, MoveKind::Rapid).map(|cut| own(self.first_of_row(cut)).map(line));
        let begins = first_cut(checked, MoveKind::Start).map(|cut| own(cut).map(line));
        let aside = first_cut(checked, MoveKind::Feed).map(|cut| own(cut).map(line));
        let held = self.report.held.iter();
        let in_fixtures: Vec<_> =
            held.map(|(name, voxels)| json!({ "fixture": name, "volume": volume(*voxels) })).collect();
        json!({
            "stock": self.name, "volume": volume(self.report.voxels), "in_fixtures": in_fixtures, "removed": volume(removed), "removed_of_part": volume(of_part),
            "lines_that_cut": cutting, "lines_that_cut_nothing": self.report.removed.len() as u64 - cutting,
            "removed_not_at_feed": volume(self.not_at_feed().iter().sum()), "begins_in_stock": begins, "largest": self.largest().map(line), "first_touch": first_touch(checked).map(brief), "first_rapid_cut": rapid,
            "first_cut_aside": aside,
            "left": {
                "volume": volume(self.left.voxels), "farthest": self.left.farthest,
                "place": self.left.farthest.map(|_| self.left.place),
            },
            "accepted": self.settings.accepted_in_stock(),
            "sure_depth": self.settings.sure_depth_in_stock(self.report.remaining.grid.pitch), "rapids_are_known": !self.no_rapids,
        })
    }

    pub(super) fn write_text(&self, checked: &CheckReport, text: &mut String) {
        let (unit, pitch) = (self.unit, self.report.remaining.grid.pitch);
        let [removed, of_part, cutting] = self.totals();
        let show = |voxels| format!("{} {unit}³", show_measure(self.volume(voxels)));
        let lines =
            |count: u64| if count == 1 { "1 line cuts".to_owned() } else { format!("{count} lines cut") };
        let share = 100.0 * removed as f64 / self.report.voxels.max(1) as f64;
        let idle = self.report.removed.len() as u64 - cutting;
        let most = self
            .largest()
            .map_or_else(String::new, |line| format!(", line {} most: {}", line.line, show(line.voxels)));
        // Writing to a string does not fail.
        let _ = writeln!(
            text,
            "stock ({}): {}, of which {} {} ({share:.1} %){most}; {} nothing",
            self.name,
            show(self.report.voxels),
            lines(cutting),
            show(removed),
            lines(idle)
        );
        let touched = first_touch(checked).map_or_else(
            || "nothing but the cutter touches it".to_owned(),
            |(line, hit)| format!("it is touched first by the {} on line {}", hit.element, line.line),
        );
        let mut rapids = Vec::new();
        if let Some(line) = first_cut(checked, MoveKind::Start) {
            rapids.push(format!("the cutter is in it where the path begins, on line {line}"));
        }
        if let Some(line) = first_cut(checked, MoveKind::Rapid) {
            let line = self.first_of_row(line);
            rapids.push(format!("line {line} is the first that cuts it at rapid rate"));
        } else if self.no_rapids {
            rapids.push(
                "no line but where the path begins is said to be at rapid rate (in CSV a column rapid says so, in APT RAPID), and all are \
                 taken to cut at feed rate"
                    .to_owned(),
            );
        }
        let [brushed, of_part_brushed] = self.not_at_feed();
        match brushed {
            brushed if rapids.len() == usize::from(self.no_rapids) && brushed > 0 => rapids.push(format!(
                "at rapid rate and where the path begins {} go, as far as the voxels show less deep in the cutter than is accepted",
                show(brushed)
            )),
            _ if rapids.is_empty() && of_part_brushed == 0 => {
                rapids.push("no line is seen to cut it at rapid rate".to_owned());
            }
            _ => {}
        }
        if of_part_brushed > 0 {
            rapids.push(format!(
                "{} of the part go at rapid rate or where the path begins",
                show(of_part_brushed)
            ));
        }
        if let Some(line) = first_cut(checked, MoveKind::Feed) {
            rapids.push(format!(
                "line {line} is the first on which a tool that cuts along its axis alone moves aside in it, or one that does not cut with its back \
                 goes back into it"
            ));
        }
        let rapid = rapids.join("; ");
        let _ = writeln!(text, "  {touched}; {rapid}");
        if of_part > 0 {
            let whose = if self.conservative {
                "the part's voxels, which reach out of it,"
            } else {
                "the part itself"
            };
            let _ = writeln!(text, "  of {whose} {} are cut away", show(of_part));
        }
        let far = self.left.farthest.map_or_else(String::new, |farthest| {
            let at = self.left.place.map(short).join(",");
            format!(", up to {} {unit} from it, at {at}", short(farthest))
        });
        let _ = writeln!(text, "  left beside the part: {}{far}", show(self.left.voxels));
        let _ = writeln!(
            text,
            "  accepted: stock up to {} {unit} deep in the cutter at rapid rate, and in a shank where the cutter's flank has passed; \
             by voxels a rapid is certain to be told from {} {unit} on; \
             certain to be detected in holder and head: overlaps deeper than {} {unit}",
            short(self.settings.accepted_in_stock()),
            short(self.settings.sure_depth_of_rapids(pitch)),
            short(self.settings.sure_depth_in_stock(pitch))
        );
    }

    /// Writes the table of lines and what is left: as voxels in the world, and as a surface where `back` leads from there.
    pub(super) fn write_files(
        &self,
        part: &Occupancy,
        back: &DMat4,
        folder: &OutputFolder,
    ) -> Result<[&'static str; 3]> {
        write_atomically(folder.file("removed.csv"), |out| self.write_table(out))?;
        let StockReport { remaining, removed_by, .. } = &self.report;
        let part = part.on(&remaining.grid).context("the grids of part and stock do not meet")?;
        let class = |v: usize| match (remaining.solid[v], part.solid[v], removed_by[v]) {
            (1, 0, _) => LEFT,
            (1, _, _) => PART,
            (_, _, 0) => 0,
            (_, 0, _) => CUT,
            _ => PART_CUT,
        };
        let classes: Vec<u8> = (0..remaining.grid.len()).map(class).collect();
        let fields =
            [NamedField::new("stock", &classes[..]), NamedField::new("removed_by_line", &removed_by[..])];
        write_vti(folder.file("stock.vti"), &remaining.grid, &fields)?;
        // In the part's frame, which a transform may have scaled.
        let pitch = short(remaining.grid.pitch * back.x_axis.truncate().length());
        let comment = format!("{PROGRAM}: stock that is left {BY_VOXELS}{pitch} {}", self.unit);
        write_stl(&self.surface(back), folder.file("stock.stl"), &comment)?;
        Ok(["removed.csv", "stock.vti", "stock.stl"])
    }

    /// The surface of what is left beside the part, by voxels, where `back` leads from the world.
    pub(super) fn surface_beside(&self, part: &Occupancy, back: &DMat4) -> Option<Mesh> {
        let mut beside = self.report.remaining.clone();
        let part = part.on(&beside.grid)?;
        beside.solid.iter_mut().zip(&part.solid).for_each(|(left, part)| *left &= 1 - part);
        Some(beside.faces().transformed(back))
    }

    /// The surface of what is left, by voxels, where `back` leads from the world.
    pub(super) fn surface(&self, back: &DMat4) -> Mesh {
        self.report.remaining.faces().transformed(back)
    }

    fn write_table(&self, out: &mut impl io::Write) -> io::Result<()> {
        writeln!(out, "line,tool,kind,volume,of_part")?;
        for line in &self.report.removed {
            let tool = line.tool.map_or_else(String::new, |number| number.to_string());
            let kind = format!("{:?}", line.kind).to_lowercase();
            let (volume, of_part) = (self.volume(line.voxels), self.volume(line.of_part));
            writeln!(out, "{},{tool},{kind},{volume},{of_part}", line.line)?;
        }
        Ok(())
    }

    /// Whether stock was at a place in the world when a line began, or a little later.
    pub(super) fn is_there(&self, line: usize, point: DVec3) -> bool {
        let StockReport { remaining, removed_by, .. } = &self.report;
        let voxel = remaining.grid.index_at(remaining.grid.continuous(point));
        voxel.is_some_and(|voxel| remaining.solid[voxel] == 1 || removed_by[voxel] as usize >= line.max(1))
    }
}

type Hit<'a> = (&'a LineCollisions, &'a Collision);

/// What hits the stock, in order of the lines.
fn hits(checked: &CheckReport) -> impl Iterator<Item = Hit<'_>> {
    let hits = checked.colliding.iter().flat_map(|line| line.collisions.iter().map(move |hit| (line, hit)));
    hits.filter(|(_, hit)| hit.against == HitBody::Stock)
}

/// The first hit by anything but the cutter.
fn first_touch(checked: &CheckReport) -> Option<Hit<'_>> {
    hits(checked).find(|(_, hit)| hit.element != "cutter")
}

/// The first line with such a move in which the cutter hits the stock. At feed that is a tool that cuts along its axis alone and
/// moves otherwise, or one that does not cut with its back and goes back.
fn first_cut(checked: &CheckReport, kind: MoveKind) -> Option<usize> {
    let mut cuts = hits(checked).filter(|(_, hit)| hit.element == "cutter");
    cuts.find(|(line, _)| line.kind == kind).map(|(line, _)| line.line)
}
