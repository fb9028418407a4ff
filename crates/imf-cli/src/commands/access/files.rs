//! The fields of a run as files for other programs.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::Result;
use imf_core::field_files::{NamedField, write_npy, write_vti};
use imf_core::machine::Machine;

use super::Findings;
use super::on_machine::OnMachine;
use super::run::AccessRun;
use super::stock::Stock;
use crate::output::{element_name, write_text};

/// What a voxel of the removable field is; 0 where no stock is.
pub(super) const OUT_OF_REACH: u8 = 1;
pub(super) const REMOVABLE: u8 = 2;
pub(super) const OBSTACLE: u8 = 3;
pub(super) const UNDECIDED: u8 = 4;

/// Writes the fields and gives back the files' names.
pub(super) fn write(run: &AccessRun, findings: &Findings, folder: &Path) -> Result<Vec<String>> {
    let dims = run.query.dims;
    let many = run.tools.len() > 1;
    // 0 empty, 1 part, 2 fixture.
    let solid: Vec<u8> = run.solid.solid.iter().zip(&run.held.solid).map(|(s, h)| s + (s & h)).collect();
    let by_tool: Vec<String> = (0..run.tools.len()).map(|t| format!("imf_tool_{t}")).collect();
    let by_element: Vec<(String, &[f32])> = findings
        .elements
        .iter()
        .enumerate()
        .flat_map(|(tool, elements)| {
            let tool = if many { format!("_tool_{tool}") } else { String::new() };
            let all = elements.kinds.iter().zip(&elements.values);
            all.map(move |(&kind, values)| (format!("imf_{}{tool}", element_name(kind)), values.as_slice()))
        })
        .collect();
    let together = &findings.together;
    let mut fields = vec![
        NamedField::new("imf", &together.imf.value[..]),
        NamedField::new("best_orientation", &together.imf.best[..]),
        NamedField::new("free_orientations", &together.free[..]),
        // Which piece of space a voxel is of.
        NamedField::new("accessible_pieces", &findings.accessible.labels[..]),
        NamedField::new("inaccessible_pieces", &findings.inaccessible.labels[..]),
        NamedField::new("solid", &solid[..]),
    ];
    if many {
        fields.push(NamedField::new("best_tool", &together.tool[..]));
        for (name, access) in by_tool.iter().zip(&findings.tools) {
            fields.push(NamedField::new(name, &access.imf.value[..]));
        }
    }
    for (name, values) in &by_element {
        fields.push(NamedField::new(name, &values[..]));
    }
    // A list that `--orientations` reads again; line n + 2 is orientation n.
    let lines = run.orientations.orientations.iter().map(|o| format!("{},{},{}\n", o.theta, o.phi, o.roll));
    let list: String = std::iter::once("theta,phi,roll\n".to_owned()).chain(lines).collect();
    write_text(&folder.join("orientations.csv"), &list)?;
    let mut written = vec!["orientations.csv".to_owned()];
    if let Some(OnMachine { machine, .. }) = &run.machine {
        write_text(&folder.join("rotary_angles.csv"), &rotary_angles(run, machine))?;
        written.push("rotary_angles.csv".into());
    }
    write_vti(folder.join("imf.vti"), &run.query, &fields)?;
    written.push("imf.vti".into());
    for field in &fields {
        let file = format!("{}.npy", field.name);
        write_npy(folder.join(&file), dims, field.values)?;
        written.push(file);
    }
    if let Some(stock) = &run.stock {
        written.extend(write_removable(run, stock, findings, folder)?);
    }
    for (index, map) in findings.maps.iter().enumerate() {
        let file = named("map", "npy", index, many);
        write_npy(folder.join(&file), [1, map.cells[0], map.cells[1]], &map.values[..])?;
        written.push(file);
    }
    Ok(written)
}

/// `name.ext`, or with several tools `name_tool_N.ext`.
pub(super) fn named(name: &str, extension: &str, tool: usize, many: bool) -> String {
    if many { format!("{name}_tool_{tool}.{extension}") } else { format!("{name}.{extension}") }
}

fn write_removable(
    run: &AccessRun,
    stock: &Stock,
    findings: &Findings,
    folder: &Path,
) -> Result<Vec<String>> {
    let grid = &stock.solid.grid;
    let classes = removable_classes(run, stock, findings);
    write_npy(folder.join("removable.npy"), grid.dims, &classes[..])?;
    let by_tool: Vec<String> = (0..run.tools.len()).map(|t| format!("removable_tool_{t}")).collect();
    let mut fields = vec![NamedField::new("removable", &classes[..])];
    if run.tools.len() > 1 {
        for (name, found) in by_tool.iter().zip(&findings.removable) {
            fields.push(NamedField::new(name, &found.covered[..]));
        }
    }
    write_vti(folder.join("removable.vti"), grid, &fields)?;
    Ok(vec!["removable.npy".into(), "removable.vti".into()])
}

/// For every voxel of the stock's grid: 0 no stock, 1 stock out of reach, 2 stock that some tool removes, 3 part or fixture, 4 stock
/// of which this pitch does not decide.
pub(super) fn removable_classes(run: &AccessRun, stock: &Stock, findings: &Findings) -> Vec<u8> {
    let held = run.obstacle.whole().on(&stock.solid.grid).unwrap_or_else(|| stock.solid.clone());
    let cavities = run.cavities.as_ref().and_then(|cavities| cavities.on(&stock.solid.grid));
    let is_material = |v: usize| held.solid[v] == 1 && cavities.as_ref().is_none_or(|own| own.solid[v] == 0);
    (0..stock.solid.solid.len())
        .map(|v| {
            if is_material(v) && stock.solid.solid[v] == 0 {
                OBSTACLE
            } else if findings.removable.iter().any(|found| found.covered[v] != 0) {
                REMOVABLE
            } else if findings.removable.iter().any(|found| found.possible[v] != 0) {
                UNDECIDED
            } else {
                OUT_OF_REACH * stock.solid.solid[v]
            }
        })
        .collect()
}

/// Every pair of angles that gives the tool one of the orientations, the preferred one first; an axis that is free there is empty.
fn rotary_angles(run: &AccessRun, machine: &Machine) -> String {
    let letters = machine.rotary.iter().map(|axis| format!(",{}", axis.letter)).collect::<String>();
    let mut text = format!("orientation,i,j,k{letters}\n");
    for (index, orientation) in run.orientations.orientations.iter().enumerate() {
        let direction = orientation.direction();
        let found = machine.inverse(direction);
        // Of an axis without a limit the turn that is nearest to 0.
        let near = |angles: &&[f64; 2]| {
            let mut axes = machine.rotary.iter().zip(angles.iter());
            axes.all(|(axis, angle)| axis.range[0].is_finite() || (-180.0..=180.0).contains(angle))
        };
        for angles in found.angles.iter().filter(near) {
            let _ = write!(text, "{index},{},{},{}", direction.x, direction.y, direction.z);
            for place in 0..machine.rotary.len() {
                let _ = match found.free == Some(place) {
                    true => write!(text, ","),
                    false => write!(text, ",{}", (angles[place] * 1e6).round() / 1e6 + 0.0),
                };
            }
            text.push('\n');
        }
    }
    text
}
