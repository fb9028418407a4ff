//! Places that no given direction reaches: proves whether any other does.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;
use glam::DVec3;
use imf_core::certificate::{Reachability, certify};
use imf_core::field_files::write_npy;
use serde::Serialize;

use super::run::AccessRun;
use super::{Findings, Volume};
use crate::output::write_text;
use crate::session::Session;

const FILE: &str = "any_direction.npy";
const EXAMPLES: &str = "any_direction.csv";

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

pub(super) struct AnyDirection {
    /// By voxel of the examined grid: 0 solid, 1 reached from a given direction, 2 from another one, 3 from no direction,
    /// 4 unknown.
    classes: Vec<u8>,
    /// Of each voxel that another direction reaches its index, one such direction and the tool.
    examples: Vec<(usize, DVec3, usize)>,
}

pub(super) fn find(session: &Session, run: &AccessRun, findings: &Findings) -> Result<AnyDirection> {
    let class = |(&value, &solid): (&f32, &u8)| match solid {
        0 if f64::from(value) <= run.tau => ASKED,
        0 => NONE,
        _ => SOLID,
    };
    let values = findings.together.imf.value.iter();
    let mut classes: Vec<u8> = values.zip(&run.solid.solid).map(class).collect();
    let mut examples = Vec::new();
    // Each tool is tried where none before it reaches.
    for (tool, assembly) in run.tools.iter().enumerate() {
        let left: Vec<usize> =
            (0..classes.len()).filter(|&voxel| matches!(classes[voxel], NONE | OPEN)).collect();
        let name = format!("any direction, {}", assembly.tool().name);
        let found = session.staged(&name, "places", left.len() as u64, |control| {
            certify(&run.obstacle, assembly, &run.query, &left, control)
        })?;
        for (&voxel, found) in left.iter().zip(found) {
            classes[voxel] = match found {
                Reachability::Reached(direction) => {
                    examples.push((voxel, direction, tool));
                    OTHER
                }
                Reachability::OutOfReach => classes[voxel],
                Reachability::Open => OPEN,
            };
        }
    }
    examples.sort_by_key(|&(voxel, ..)| voxel);
    Ok(AnyDirection { classes, examples })
}

impl AnyDirection {
    pub(super) fn row(&self, run: &AccessRun) -> AnyDirectionRow {
        let of = |class: u8| {
            let voxels = self.classes.iter().filter(|&&own| own == class).count();
            Volume::new(voxels, run.query.voxel_volume())
        };
        AnyDirectionRow { from_another: of(OTHER), from_none: of(NONE), open: of(OPEN) }
    }

    /// Writes the voxels and the examples, as poses that `imf query` reads, and gives back the files' names.
    pub(super) fn write(&self, run: &AccessRun, folder: &Path) -> Result<[String; 2]> {
        write_npy(folder.join(FILE), run.query.dims, &self.classes[..])?;
        let many = run.tools.len() > 1;
        let mut text = format!("x,y,z,i,j,k{}\n", if many { ",tool" } else { "" });
        for &(voxel, axis, tool) in &self.examples {
            let tip = run.query.centre(run.query.voxel(voxel));
            let tool = if many { format!(",{tool}") } else { String::new() };
            // Writing to a string does not fail.
            let _ = writeln!(text, "{},{},{},{},{},{}{tool}", tip.x, tip.y, tip.z, axis.x, axis.y, axis.z);
        }
        write_text(&folder.join(EXAMPLES), &text)?;
        Ok([FILE, EXAMPLES].map(String::from))
    }
}
