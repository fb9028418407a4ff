//! What a path needs of each tool's stick-out, in words.

use imf_core::check::PathStickOut;
use imf_core::scene::Guarantee;
use imf_core::unit::LengthUnit;

use super::CheckRun;
use crate::output::{length, short};

/// A line for each tool, and what holds for all; nothing where not requested.
pub(super) fn lines(checked: &CheckRun<'_>) -> String {
    if checked.stick_outs.is_empty() {
        return String::new();
    }
    let unit = checked.record.unit;
    let lines: String = checked.stick_outs.iter().map(|found| one(found, unit) + "\n").collect();
    if checked.stick_outs.iter().all(|found| found.minimum.is_none()) {
        return lines;
    }
    let machine = if checked.machine.is_some() {
        "; the machine's head, table and travel are not checked for it"
    } else {
        ""
    };
    let stock = if checked.stock.is_some() {
        "; the stock is not considered: what is still there then may take more"
    } else {
        ""
    };
    let left_out: usize = checked.stick_outs.iter().map(|found| found.left_out).sum();
    let left_out = match left_out {
        0 => String::new(),
        count => format!(
            "; {count} motions by G53 and G28, on which the tip moves with the stick-out, are not checked"
        ),
    };
    let between = short(0.5 * checked.report.settings.step);
    let (record, settings) = (&checked.record, &checked.report.settings);
    let nearer_by = || {
        let nearer = checked.tools.iter().filter_map(|(_, tool)| {
            let pitch = record.grid.pitch;
            let guarantee = Guarantee::new(record.conservative, tool, &settings.clearance, true, pitch);
            guarantee.surface_nearer_by(pitch)
        });
        nearer.reduce(f64::max)
    };
    let (points, surface) = if settings.contact > 0.0 {
        (" and no point of a surface", String::new())
    } else {
        let nearer = |nearer| format!("; {}", length::surface_nearer(nearer, record.conservative, unit));
        ("", nearer_by().map_or_else(String::new, nearer))
    };
    format!(
        "{lines}  so set, shank and holder with their clearance and {between} {unit} more, for what lies between two poses, hold no \
         voxel's centre{points} on the whole path{machine}{stock}{left_out}{surface}\n"
    )
}

fn one(found: &PathStickOut, unit: LengthUnit) -> String {
    let PathStickOut { given, shortest, longest, .. } = *found;
    let number = found.tool.map_or_else(String::new, |number| format!("tool {number}, "));
    let tool = length::stick_out(&(number + &found.name), [given, shortest], longest, unit);
    let line = found.line.map_or_else(String::new, |line| format!(", decided by line {line}"));
    let Some(minimum) = found.minimum else {
        let on = found.line.map_or_else(String::new, |line| format!(" on line {line}"));
        return format!(
            "{tool}: none is free on the whole path: the shank is in the way{on} however far it sticks out"
        );
    };
    let takes = format!("the whole path takes {} {unit}{line}", length::at_least(minimum, unit));
    if longest.is_some_and(|longest| minimum > longest) {
        return format!("{tool}: {takes}: more than the tool has");
    }
    let margin = given - minimum;
    let so = if margin >= 0.0 {
        format!("as it is set: {} {unit} to spare", length::at_most(margin, unit))
    } else {
        format!("as it is set: {} {unit} too short", length::at_least(-margin, unit))
    };
    format!("{tool}: {takes}; {so}")
}
