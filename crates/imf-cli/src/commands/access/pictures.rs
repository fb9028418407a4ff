//! Slices of what was found, and access maps, as PNG.

use std::path::Path;

use anyhow::Result;
use imf_core::occupancy::Occupancy;
use ndarray::Array2;

use super::Findings;
use super::files::{OBSTACLE, named, removable_classes};
use super::setup::Setup;
use crate::picture::{Axes, Mask, MaskStyle, Panel, PanelRow, PanelSheet, Scale};
use crate::slices;

/// Draws the pictures and gives back the files' names.
pub(super) fn draw(setup: &Setup, findings: &Findings, folder: &Path) -> Result<Vec<String>> {
    draw_slices(setup, findings, &folder.join("slices.png"))?;
    let mut written = vec!["slices.png".to_owned()];
    if draw_removable(setup, findings, &folder.join("removable.png"))? {
        written.push("removable.png".into());
    }
    for (index, tool) in setup.tools.iter().enumerate().take(findings.maps.len()) {
        let file = named("map", "png", index, setup.tools.len() > 1);
        draw_map(setup, findings, index, &tool.tool().name, &folder.join(&file))?;
        written.push(file);
    }
    Ok(written)
}

fn title(setup: &Setup) -> String {
    let tools: Vec<&str> = setup.tools.iter().map(|tool| tool.tool().name.as_str()).collect();
    format!("{}, tools: {}", setup.part, tools.join(", "))
}

fn draw_slices(setup: &Setup, findings: &Findings, path: &Path) -> Result<()> {
    let (grid, unit) = (&setup.query, setup.unit.to_string());
    let poses = (setup.orientations.len() * setup.tools.len()) as f32;
    let share: Vec<f32> = findings.together.free.iter().map(|&n| 100.0 * n as f32 / poses).collect();
    let middle = |axis: usize| grid.dims[axis] / 2;
    // What collides anyway is hidden, and must not set the scale.
    let around: Vec<f32> = findings
        .together
        .imf
        .value
        .iter()
        .zip(&setup.solid.solid)
        .map(|(&v, &s)| if s == 0 { v } else { 0.0 })
        .collect();
    let cuts: Vec<_> = (0..3)
        .map(|axis| {
            let cut = |values: &[f32]| slices::slice(values, grid, axis, middle(axis));
            let solid = slices::mask(&setup.solid, axis, middle(axis));
            (axis, cut(&around), cut(&share), solid)
        })
        .collect();
    let measures: Vec<_> = cuts.iter().map(|(_, imf, ..)| imf.view()).collect();
    let measure = Scale::measure_of(&measures, "inaccessibility measure IMF");
    let shares: Vec<_> = cuts.iter().map(|(_, _, share, _)| share.view()).collect();
    let free = Scale::measure_of(&shares, "free poses in %");
    let rows = cuts
        .iter()
        .map(|(axis, imf, share, solid)| {
            let axes = slices::axes(grid, setup.unit, *axis);
            PanelRow {
                title: plane(grid.centre(grid.dims.map(|n| n / 2))[*axis], *axis, &unit),
                panels: vec![
                    filled(slices::panel("least overlap", imf, solid, &measure, &axes)),
                    filled(slices::panel("freedom", share, solid, &free, &axes)),
                ],
            }
        })
        .collect();
    PanelSheet {
        title: title(setup),
        rows,
        notes: vec![format!(
            "{} ({}), τ = {}; grey: part and fixtures",
            count(setup.orientations.len(), "orientation"),
            setup.orientations.spec,
            setup.tau
        )],
        pixels_per_voxel: None,
    }
    .save(path)?;
    Ok(())
}

/// False where there is no stock to draw.
fn draw_removable(setup: &Setup, findings: &Findings, path: &Path) -> Result<bool> {
    let Some(stock) = &setup.stock else { return Ok(false) };
    let (grid, unit) = (&stock.solid.grid, setup.unit.to_string());
    // The part hides its own voxels.
    let classes = removable_classes(setup, stock, findings);
    let values: Vec<f32> = classes.iter().map(|&class| f32::from(class % OBSTACLE)).collect();
    let held =
        Occupancy { grid: *grid, solid: classes.iter().map(|&class| u8::from(class == OBSTACLE)).collect() };
    let cuts: Vec<_> = (0..3)
        .map(|axis| {
            let middle = grid.dims[axis] / 2;
            (axis, slices::slice(&values, grid, axis, middle), slices::mask(&held, axis, middle))
        })
        .collect();
    let scale = Scale::classes(&["no stock", "stays", "a cutter removes it"]);
    let rows = cuts
        .iter()
        .map(|(axis, values, solid)| {
            let panel =
                filled(slices::panel("stock", values, solid, &scale, &slices::axes(grid, setup.unit, *axis)));
            PanelRow {
                title: plane(grid.centre(grid.dims.map(|n| n / 2))[*axis], *axis, &unit),
                panels: vec![panel],
            }
        })
        .collect();
    let notes = vec![format!("Stock: {}; grey: part and fixtures", stock.name)];
    PanelSheet { title: title(setup), rows, notes, pixels_per_voxel: None }.save(path)?;
    Ok(true)
}

fn draw_map(setup: &Setup, findings: &Findings, index: usize, tool: &str, path: &Path) -> Result<()> {
    let (map, Some((point, _))) = (&findings.maps[index], setup.map) else { return Ok(()) };
    let values =
        Array2::from_shape_fn((map.cells[0], map.cells[1]), |(i, j)| map.values[i * map.cells[1] + j]);
    let axes = Axes {
        names: ["longitude θ".into(), "latitude 90° − φ".into()],
        unit: "°".into(),
        start: [0.0, -90.0],
        pitch: 180.0 / map.cells[1] as f64,
    };
    let scale = Scale::measure_of(&[values.view()], "collision measure CMF");
    let name = format!("directions of {tool}, tip to holder");
    let outside = values.mapv(|value| u8::from(value.is_nan()));
    let mask = setup.limits.map(|_| Mask { voxels: outside.view(), style: MaskStyle::Fill });
    let panel = Panel { title: name, values: values.view(), mask, scale, axes };
    let side = (720 / map.cells[0]).clamp(1, 40) as u32;
    PanelSheet {
        title: format!("{} at ({}, {}, {}) {}", setup.part, point.x, point.y, point.z, setup.unit),
        rows: vec![PanelRow { title: String::new(), panels: vec![panel] }],
        notes: vec![format!(
            "{:.1} % of {} are free (τ = {}){}",
            100.0 * map.free_share(setup.tau),
            directions(setup),
            setup.tau,
            if setup.limits.is_some() { "; grey: out of the machine's limits" } else { "" }
        )],
        pixels_per_voxel: Some(side),
    }
    .save(path)?;
    Ok(())
}

/// Which directions a map is of.
pub(super) fn directions(setup: &Setup) -> &'static str {
    if setup.limits.is_some() { "the directions within the machine's limits" } else { "all directions" }
}

/// The panel with its solid voxels in grey.
fn filled(mut panel: Panel<'_>) -> Panel<'_> {
    if let Some(mask) = &mut panel.mask {
        mask.style = MaskStyle::Fill;
    }
    panel
}

fn plane(at: f64, axis: usize, unit: &str) -> String {
    format!("plane {} = {at:.1} {unit}", ["x", "y", "z"][axis])
}

fn count(n: usize, what: &str) -> String {
    if n == 1 { format!("1 {what}") } else { format!("{n} {what}s") }
}
