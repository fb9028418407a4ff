//! What a check leaves in a folder: a table of collisions, and the whole result.

use std::fmt::Write;

use anyhow::{Context as _, Result};
use imf_core::check::{Collision, HitBody};
use serde_json::{Value, json};

use super::CheckRun;
use crate::output::{OutputFolder, SUMMARY, quoted, write_json, write_text};
use crate::session::Session;

const COLUMNS: &str = "line,tool,kind,element,against,depth,depth_in_tool,clearance,contact_x,contact_y,contact_z,x,y,z,i,j,k,roll,\
                       fraction,voxels,volume,poses,line_poses";

/// Writes `collisions.csv` and, naming all files, `summary.json`; names them in the result as well.
pub(super) fn write(
    checked: &CheckRun<'_>,
    json: &mut Value,
    written: Vec<&str>,
    folder: &OutputFolder,
    session: &Session,
) -> Result<()> {
    write_text(&folder.file("collisions.csv"), &table(checked))?;
    let files: Vec<&str> = ["collisions.csv"].into_iter().chain(written).chain([SUMMARY]).collect();
    json["program"] = json!(concat!("imf ", env!("CARGO_PKG_VERSION")));
    json["files"] = json!(files);
    write_json(&folder.file(SUMMARY), json).context(SUMMARY)?;
    session.note(&format!("wrote {} to {}", files.join(", "), folder.path.display()));
    Ok(())
}

fn table(checked: &CheckRun<'_>) -> String {
    let mut text = format!("{COLUMNS}\n");
    for line in &checked.report.colliding {
        for hit in &line.collisions {
            let tool = line.tool.map_or_else(String::new, |number| number.to_string());
            let kind = format!("{:?}", line.kind).to_lowercase();
            let against = match &hit.against {
                HitBody::Part => "part".to_owned(),
                HitBody::Stock => "stock".to_owned(),
                HitBody::Fixture(name) | HitBody::Machine(name) => quoted(name),
            };
            let places = [hit.contact, hit.position].concat();
            // In full: units differ, and near a pole the roll is counted from where the last digits of the axis point.
            let places = places.iter().map(f64::to_string);
            let numbers: Vec<String> = places.chain(hit.axis.map(|v| v.to_string())).collect();
            let roll = hit.roll.map_or_else(String::new, |roll| format!("{roll:.6}"));
            let Collision {
                element, depth, depth_in_tool, clearance, fraction, voxels, volume, poses, ..
            } = hit;
            // A solid of the machine has any name.
            let element = if element.contains([',', '"']) { &quoted(element) } else { element };
            // Writing to a string does not fail.
            let _ = writeln!(
                text,
                "{},{tool},{kind},{element},{against},{depth},{depth_in_tool},{clearance},{},{roll},{fraction},{voxels},\
                 {volume},{poses},{}",
                line.line,
                numbers.join(","),
                line.poses
            );
        }
    }
    text
}
