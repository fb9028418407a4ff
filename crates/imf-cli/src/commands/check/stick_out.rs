//! What a path needs of each tool's stick-out, in words.

use imf_core::check::PathStickOut;

use super::CheckRun;
use crate::output::short;

/// A line for each tool, and what holds for all; nothing where none was looked for.
pub(super) fn lines(checked: &CheckRun<'_>) -> String {
    if checked.stick_outs.is_empty() {
        return String::new();
    }
    let unit = checked.record.unit.to_string();
    let lines: String = checked.stick_outs.iter().map(|found| one(found, &unit) + "\n").collect();
    if checked.stick_outs.iter().all(|found| found.least.is_none()) {
        return lines;
    }
    let machine = if checked.machine.is_some() {
        "; the machine's head, table and travel are not looked at for it"
    } else {
        ""
    };
    let between = short(0.5 * checked.report.settings.step);
    let surface = match checked.record.conservative {
        true => String::new(),
        false => format!(
            "; the surface lies up to a voxel nearer than its centres: set it {} {unit} longer, or ask with --conservative",
            short(checked.record.grid.pitch)
        ),
    };
    format!(
        "{lines}  so set, shank and holder with their clearance and {between} {unit} more, for what lies between two poses, hold no \
         voxel's centre on the whole path{machine}{surface}\n"
    )
}

fn one(found: &PathStickOut, unit: &str) -> String {
    let PathStickOut { given, shortest, .. } = found;
    let number = found.tool.map_or_else(String::new, |number| format!("tool {number}, "));
    let longest = found.longest.map_or_else(String::new, |longest| format!(", overall length {longest:.1}"));
    let tool = format!(
        "stick-out of {number}{} (set to {given:.1} {unit}, shortest {shortest:.1}{longest})",
        found.name
    );
    let line = found.line.map_or_else(String::new, |line| format!(", decided by line {line}"));
    let Some(least) = found.least else {
        let on = found.line.map_or_else(String::new, |line| format!(" on line {line}"));
        return format!(
            "{tool}: none is free on the whole path: the shank is in the way{on} however far it sticks out"
        );
    };
    if found.longest.is_some_and(|longest| least > longest) {
        return format!("{tool}: the whole path takes {least:.1} {unit}{line}: more than the tool has");
    }
    let margin = given - least;
    let so = if margin >= 0.0 {
        format!("as it is set: {margin:.1} {unit} to spare")
    } else {
        format!("as it is set: {:.1} {unit} too short", -margin)
    };
    format!("{tool}: the whole path takes {least:.1} {unit}{line}; {so}")
}
