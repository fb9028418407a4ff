//! Places that no given direction reaches: proves whether any other does.

use anyhow::Result;
use imf_core::certificate::{Reachability, certify};
use serde::Serialize;

use super::run::AccessRun;
use super::{Findings, Volume};
use crate::session::Session;

pub(super) const FILE: &str = "any_direction.npy";

const SOLID: u8 = 0;
const ASKED: u8 = 1;
const OTHER: u8 = 2;
const NONE: u8 = 3;
const OPEN: u8 = 4;

#[derive(Debug, Serialize)]
pub(super) struct AnyDirectionRow {
    /// Reached from a direction that was not given.
    pub(super) from_another: Volume,
    /// Proven: from no direction whatever.
    pub(super) from_none: Volume,
    /// Neither is proven.
    pub(super) open: Volume,
}

/// By voxel of the examined grid: 0 solid, 1 reached from a given direction, 2 from another one, 3 from no direction,
/// 4 unknown.
pub(super) fn find(session: &Session, run: &AccessRun, findings: &Findings) -> Result<Vec<u8>> {
    let class = |(&value, &solid): (&f32, &u8)| match solid {
        0 if f64::from(value) <= run.tau => ASKED,
        0 => NONE,
        _ => SOLID,
    };
    let values = findings.together.imf.value.iter();
    let mut classes: Vec<u8> = values.zip(&run.solid.solid).map(class).collect();
    // Each tool is tried where none before it reaches.
    for assembly in &run.tools {
        let left: Vec<usize> =
            (0..classes.len()).filter(|&voxel| matches!(classes[voxel], NONE | OPEN)).collect();
        let name = format!("any direction, {}", assembly.tool().name);
        let found = session.staged(&name, "places", left.len() as u64, |control| {
            certify(&run.obstacle, assembly, &run.query, &left, control)
        })?;
        for (&voxel, found) in left.iter().zip(found) {
            classes[voxel] = match found {
                Reachability::Reached(_) => OTHER,
                Reachability::OutOfReach => classes[voxel],
                Reachability::Open => OPEN,
            };
        }
    }
    Ok(classes)
}

pub(super) fn row(run: &AccessRun, classes: &[u8]) -> AnyDirectionRow {
    let of = |class: u8| {
        let voxels = classes.iter().filter(|&&own| own == class).count();
        Volume::new(voxels, run.query.voxel_volume())
    };
    AnyDirectionRow { from_another: of(OTHER), from_none: of(NONE), open: of(OPEN) }
}
