//! The report as text: one line a collision, of many the first and the worst, then what was checked, what was accepted, and what voxels can show.

use std::fmt::Write;

use glam::DMat4;
use imf_core::check::{CheckSettings, Collision, LineCollisions, TravelFault};
use imf_core::machine::{MachineSolid, Side};
use imf_core::tool::ToolShape;
use imf_core::toolpath::MoveKind;
use imf_core::unit::LengthUnit;

use super::files::{COLLISIONS, TRAVEL};
use super::listed::{MOST, collisions};
use super::{CheckRun, stick_out};
use crate::arguments::check::Frame;
use crate::arguments::clearance::rooms_text;
use crate::output::{short, show_measure};

/// How many lines collide, and on a machine how many lead out of its travel.
pub(super) fn verdict(checked: &CheckRun<'_>) -> String {
    let report = &checked.report;
    let mut verdict = match report.colliding.len() {
        0 => "no collision".to_owned(),
        1 => "1 line collides".to_owned(),
        n => format!("{n} lines collide"),
    };
    if checked.machine.is_some() {
        let mut lines: Vec<_> = report.out_of_travel.iter().map(|beyond| beyond.line).collect();
        lines.dedup();
        verdict += &match lines.len() {
            0 => ", no axis out of its travel".to_owned(),
            1 => ", 1 line leads out of the machine's travel".to_owned(),
            n => format!(", {n} lines lead out of the machine's travel"),
        };
    }
    verdict
}

pub(super) fn text(checked: &CheckRun<'_>) -> String {
    let CheckRun { report, listed, record, .. } = checked;
    let (settings, unit) = (&report.settings, record.unit);
    let mut text = String::new();
    // Writing to a string does not fail.
    for line in &listed.colliding {
        for collision in &line.collisions {
            let _ = writeln!(text, "{}: {}", place(line), one(collision, line.poses, checked));
        }
    }
    let (all, half) = (collisions(report), MOST / 2);
    let chosen = format!("the first {half} and the {half} worst of the others are listed");
    text += &unlisted(all - collisions(listed), all, "collisions", &chosen, COLLISIONS, checked);
    for beyond in &listed.out_of_travel {
        let _ = writeln!(text, "{}", travel(beyond, &unit.to_string()));
    }
    let all = report.out_of_travel.len();
    let chosen = format!("the first {MOST} and the farthest of each axis are listed");
    let what = "ways out of the travel";
    text += &unlisted(all - listed.out_of_travel.len(), all, what, &chosen, TRAVEL, checked);
    let _ = writeln!(
        text,
        "{}: {} lines, {} poses, no point of the tool moving more than {} {unit} between them",
        verdict(checked),
        report.locations,
        report.poses,
        short(settings.step)
    );
    if let [first, more @ ..] = &checked.toolpath.unchecked[..] {
        let more = if more.is_empty() { String::new() } else { format!(" and {} more", more.len()) };
        let _ = writeln!(
            text,
            "not checked: the motions of line {first}{more}, where some axis was not said by then"
        );
    }
    text += &stick_out::lines(checked);
    if report.starts > 1 {
        let _ = writeln!(
            text,
            "the path begins {} times, as behind a tool change: the ways there were not checked",
            report.starts
        );
    }
    if record.transform != DMat4::IDENTITY {
        let whose = match checked.frame {
            Frame::Part => "the part's frame, which --transform sets up in the world",
            Frame::World => "the world's frame, into which --transform sets up the part",
        };
        let _ = writeln!(text, "coordinates are in {whose}");
    }
    if record.conservative && !report.colliding.is_empty() {
        let beyond = 0.5 * 3.0_f64.sqrt() * record.grid.pitch;
        let of_cutter = if settings.contact > 0.0 { ", but for a cutter's in the part," } else { "" };
        let _ = writeln!(
            text,
            "depths{of_cutter} are those in the conservative voxels, whose centres lie up to {} {unit} outside \
             the bodies: by so much the bodies themselves may be hit less deep, or not at all",
            short(beyond)
        );
    }
    let clearance = &settings.clearance;
    let deep = short(settings.contact);
    let in_cutter = checked.tools.iter().any(|(_, tool)| tool.has_cutter()) && settings.contact > 0.0;
    let may_touch = settings.contact > 0.0 && (clearance.shank == 0.0 || clearance.holder == 0.0);
    let mut accepted = Vec::new();
    if in_cutter {
        accepted.push("the part in the cutter");
    }
    if report.sure_overlap.is_some() {
        accepted.push("points of surfaces in the rest");
    }
    if may_touch && checked.tools.iter().any(|(_, tool)| matches!(tool.shape, ToolShape::Revolved(_))) {
        accepted.push("voxels' centres in a shank or holder without clearance");
    }
    let accepted = match accepted.as_slice() {
        [] => "no overlap at all".to_owned(),
        some => format!("up to {deep} {unit} deep: {}", some.join(", ")),
    };
    let _ = writeln!(text, "accepted: {accepted}; clearance: {}", rooms_text(clearance, unit));
    let within = if clearance.is_zero() { "" } else { ", and what comes nearer than its clearance by more" };
    let of_cutter = report.sure_gouge.map_or_else(String::new, |depth| {
        format!("a cutter deeper than {} {unit} in the part's surface; other ", short(depth))
    });
    let (known_by, said_by) = match report.sure_overlap.or(report.sure_gouge) {
        Some(_) => {
            ("a point of a surface or a voxel's centre", ", as far as the meshes say where surfaces are")
        }
        None => ("a voxel's centre", ""),
    };
    let _ = writeln!(
        text,
        "certain to be detected: {of_cutter}overlaps deeper than {} {unit}{within}, in walls no thinner{said_by}; shallower ones where \
         {known_by} lies in them (voxels of {} {unit}; a smaller --pitch sees more)",
        short(report.sure_overlap.unwrap_or(report.sure_depth)),
        short(record.grid.pitch)
    );
    if let Some(bodies) = checked.machine {
        let machine = bodies.machine();
        let is_moved = |solid: &&MachineSolid| solid.side == Side::Head || solid.level > 0;
        let moving = machine.solids.iter().filter(is_moved).count();
        let coarsest = bodies.coarsest_pitch().unwrap_or(0.0).max(record.grid.pitch);
        let sure = short(CheckSettings { contact: 0.0, ..*settings }.sure_depth(coarsest));
        let seen = format!(
            "; with its head or table, overlaps deeper than {sure} {unit} are certain to be detected"
        );
        let seen = if machine.solids.is_empty() { String::new() } else { seen };
        let _ = writeln!(
            text,
            "machine: {}, rotary axes: {}, solids: {}, of which {moving} move{seen}; between two lines its rotary axes turn evenly",
            machine.name,
            machine.rotary.len(),
            machine.solids.len()
        );
    }
    let _ = writeln!(text, "{}", checked.guarantee());
    if let Some(stock) = &checked.stock {
        stock.write_text(report, &mut text);
    }
    text
}

/// How many of something are not listed, and the table that has all; nothing where none is left out.
fn unlisted(
    left_out: usize,
    all: usize,
    what: &str,
    chosen: &str,
    table: &str,
    checked: &CheckRun<'_>,
) -> String {
    if left_out == 0 {
        return String::new();
    }
    let place = match &checked.arguments.out {
        Some(folder) => format!("all {all} are in {}", folder.join(table).display()),
        None => format!("--out FOLDER writes all {all} to {table}"),
    };
    format!("… and {left_out} more {what}: {chosen}; {place}\n")
}

/// Which axis would have to be where.
fn travel(beyond: &TravelFault, unit: &str) -> String {
    let TravelFault { line, axis, value, farthest, range: [low, high], .. } = beyond;
    let unit = if "XYZ".contains(*axis) { format!(" {unit}") } else { "°".into() };
    let end =
        |end: Option<f64>| end.map_or_else(|| "no limit".to_owned(), |end| format!("{}{unit}", short(end)));
    let most =
        if farthest == value { String::new() } else { format!(", at the farthest at {farthest:.3}{unit}") };
    format!(
        "line {line}: {axis} would have to be at {value:.3}{unit}{most}, and goes from {} to {}",
        end(*low),
        end(*high)
    )
}

/// `line 4`, and with which tool.
pub(super) fn place(line: &LineCollisions) -> String {
    let tool = line.tool.map_or_else(String::new, |number| format!(", tool {number}"));
    let rapid = if line.kind == MoveKind::Rapid { ", rapid" } else { "" };
    format!("line {}{tool}{rapid}", line.line)
}

/// How much of its clearance is left where an element does not touch, from its depth below the offset surface.
fn left_of_clearance(collision: &Collision) -> Option<f64> {
    let within = collision.clearance - collision.depth;
    (collision.clearance > 0.0 && within >= 0.0).then_some(within)
}

/// What an element does to a body: how deep it is in it, or how near it comes where that is nearer than its clearance.
pub(super) fn what(collision: &Collision, unit: LengthUnit) -> String {
    let (element, against) = (&collision.element, &collision.against);
    if let Some(within) = left_of_clearance(collision) {
        let clearance = collision.clearance;
        return format!(
            "{element} comes within {} {unit} of the {against}, {clearance} {unit} required",
            short(within)
        );
    }
    let offset = if collision.clearance > 0.0 { " with its clearance" } else { "" };
    format!("{element}{offset} is {} {unit} deep in the {against}", short(collision.depth))
}

fn one(collision: &Collision, poses: u64, checked: &CheckRun<'_>) -> String {
    let unit = checked.record.unit;
    let what = what(collision, unit);
    let comma = if left_of_clearance(collision).is_some() { "," } else { "" };
    let point = |place: [f64; 3]| place.map(short).join(",");
    // No minus sign before zero.
    let [i, j, k] = collision.axis.map(|c| if c.abs() < 5e-5 { 0.0 } else { c });
    let roll = collision.roll.map_or_else(String::new, |roll| format!(", roll {roll:.1}°"));
    let size = match collision.voxels {
        0 => "a point of its surface, no voxel's centre".to_owned(),
        voxels => format!("{voxels} voxels, {} {unit}³", show_measure(collision.volume)),
    };
    format!(
        "{what}{comma} at {}: {size}, at worst with the tip at {} and the axis {i:.4},{j:.4},{k:.4}{roll}; {} of {poses} poses",
        point(collision.contact),
        point(collision.position),
        collision.poses
    )
}
