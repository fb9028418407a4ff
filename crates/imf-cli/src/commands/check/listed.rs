//! What a result lists of a long path: the first places and the worst. Tables in a folder have all.

use std::collections::{BTreeMap, HashSet};
use std::ptr;

use imf_core::check::{CheckReport, Collision, LineCollisions, TravelFault};
use serde_json::{Value, json};

/// Collisions that are listed at most, half of them the first, half the worst of the others; ways out of the travel but for the farthest
/// of each axis.
pub(super) const MOST: usize = 100;

/// The report with what is listed of it, in the order of the path.
pub(super) fn listed(report: &CheckReport) -> CheckReport {
    let mut chosen: HashSet<*const Collision> =
        report.colliding.iter().flat_map(|line| &line.collisions).take(MOST / 2).map(ptr::from_ref).collect();
    let worst = report.worst().into_iter().map(|(_, hit)| ptr::from_ref(hit));
    let others: Vec<_> = worst.filter(|hit| !chosen.contains(hit)).take(MOST / 2).collect();
    chosen.extend(others);
    let of_line = |line: &LineCollisions| {
        let hits = line.collisions.iter().filter(|hit| chosen.contains(&ptr::from_ref(*hit)));
        LineCollisions { collisions: hits.cloned().collect(), ..*line }
    };
    let lines = report.colliding.iter().map(of_line).filter(|line| !line.collisions.is_empty());
    let mut farthest: BTreeMap<char, &TravelFault> = BTreeMap::new();
    for fault in &report.out_of_travel {
        let known = farthest.entry(fault.axis).or_insert(fault);
        if fault.excess() > known.excess() {
            *known = fault;
        }
    }
    let faults = report.out_of_travel.iter().enumerate();
    let faults = faults.filter(|&(place, fault)| place < MOST || ptr::eq(farthest[&fault.axis], fault));
    CheckReport {
        colliding: lines.collect(),
        out_of_travel: faults.map(|(_, fault)| *fault).collect(),
        ..*report
    }
}

/// How many collisions a report has.
pub(super) fn collisions(report: &CheckReport) -> usize {
    report.colliding.iter().map(|line| line.collisions.len()).sum()
}

/// A collision in few words.
pub(super) fn brief((line, hit): (&LineCollisions, &Collision)) -> Value {
    json!({ "line": line.line, "tool": line.tool, "element": hit.element, "against": hit.against, "depth": hit.depth })
}
