//! What a check leaves in a folder: tables of everything that was found, and the result that lists some of it.

use std::io::{self, Write};

use anyhow::Result;
use imf_core::atomic_file::write_atomically;
use imf_core::check::{CheckReport, Collision, HitBody, TravelFault};
use imf_core::occupancy::Occupancy;
use serde_json::Value;

use super::CheckRun;
use crate::output::{OutputFolder, SUMMARY, quoted};
use crate::session::Session;

const COLUMNS: &str = "line,tool,kind,element,against,depth,depth_in_tool,clearance,contact_x,contact_y,contact_z,x,y,z,i,j,k,roll,\
                       fraction,voxels,volume,poses,line_poses";

/// Every collision.
pub(super) const COLLISIONS: &str = "collisions.csv";
/// Every way out of a machine's travel.
pub(super) const TRAVEL: &str = "travel.csv";

/// The picture of the worst collision.
pub(super) const WORST: &str = "worst.png";

/// Writes the tables, what is left of the stock and, naming all files, `summary.json`; names them in the result as well. The largest
/// files come late: a disk that they fill has the others.
pub(super) fn write(
    checked: &CheckRun<'_>,
    json: &mut Value,
    pictured: bool,
    part: &Occupancy,
    folder: &OutputFolder,
    session: &Session,
) -> Result<()> {
    write_atomically(folder.file(COLLISIONS), |out| write_collisions(&checked.report, out))?;
    let mut files = vec![COLLISIONS];
    if checked.machine.is_some() {
        write_atomically(folder.file(TRAVEL), |out| write_travel(&checked.report, out))?;
        files.push(TRAVEL);
    }
    files.extend(pictured.then_some(WORST));
    if let Some(stock) = &checked.stock {
        files.extend(stock.write_files(part, &checked.record.transform.inverse(), folder)?);
    }
    files.push(SUMMARY);
    folder.write_summary_of(json, &files)?;
    session.note(&format!("wrote {} to {}", files.join(", "), folder.path.display()));
    Ok(())
}

fn write_collisions(report: &CheckReport, out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "{COLUMNS}")?;
    for line in &report.colliding {
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
            writeln!(
                out,
                "{},{tool},{kind},{element},{against},{depth},{depth_in_tool},{clearance},{},{roll},{fraction},{voxels},\
                 {volume},{poses},{}",
                line.line,
                numbers.join(","),
                line.poses
            )?;
        }
    }
    Ok(())
}

/// An end without a limit is empty.
fn write_travel(report: &CheckReport, out: &mut impl Write) -> io::Result<()> {
    writeln!(out, "line,axis,value,farthest,low,high,fraction")?;
    for TravelFault { line, axis, value, farthest, range, fraction } in &report.out_of_travel {
        let [low, high] = range.map(|end| end.map_or_else(String::new, |end| end.to_string()));
        writeln!(out, "{line},{axis},{value},{farthest},{low},{high},{fraction}")?;
    }
    Ok(())
}
