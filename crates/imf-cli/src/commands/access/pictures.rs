//! Slices of what was found, and access maps, as PNG.

use std::path::Path;

use anyhow::Result;
use imf_core::occupancy::Occupancy;
use imf_core::orientation::repeats;
use imf_core::tool::Assembly;
use ndarray::{Array2, ArrayView2};

use super::Findings;
use super::files::{OBSTACLE, OUT_OF_REACH, REMOVABLE, UNDECIDED, named, removable_classes};
use super::run::AccessRun;
use crate::output::shortened;
use crate::picture::{Axes, Mask, MaskStyle, Panel, PanelRow, PanelSheet, Scale};
use crate::slices;

/// Draws the pictures and gives back the files' names.
pub(super) fn draw(run: &AccessRun, findings: &Findings, folder: &Path) -> Result<Vec<String>> {
    draw_slices(run, findings, &folder.join("slices.png"))?;
    let mut written = vec!["slices.png".to_owned()];
    if draw_removable(run, findings, &folder.join("removable.png"))? {
        written.push("removable.png".into());
    }
    for (index, tool) in run.tools.iter().enumerate().take(findings.maps.len()) {
        let file = named("map", "png", index, run.tools.len() > 1);
        draw_map(run, findings, index, &tool.tool().name, &folder.join(&file))?;
        written.push(file);
    }
    Ok(written)
}

fn title(run: &AccessRun) -> String {
    let tools: Vec<&str> = run.tools.iter().map(|tool| tool.tool().name.as_str()).collect();
    format!("{}, tools: {}", run.part, tools.join(", "))
}

fn draw_slices(run: &AccessRun, findings: &Findings, path: &Path) -> Result<()> {
    let own = |tool: &Assembly| {
        let again = repeats(&run.orientations.orientations, tool.tool().is_axisymmetric());
        again.iter().filter(|&&again| !again).count()
    };
    let poses = run.tools.iter().map(own).sum::<usize>() as f32;
    let share: Vec<f32> = findings.together.free.iter().map(|&n| 100.0 * n as f32 / poses).collect();
    // What collides anyway is hidden, and must not set the scale.
    let outside = |value: &dyn Fn(usize) -> f32| -> Vec<f32> {
        let solid = run.solid.solid.iter().enumerate();
        solid.map(|(voxel, &solid)| if solid == 0 { value(voxel) } else { 0.0 }).collect()
    };
    let least = outside(&|voxel| findings.together.imf.value[voxel]);
    let many = run.tools.len() > 1;
    let names: Vec<&str> = run.tools.iter().map(|tool| tool.tool().name.as_str()).collect();
    let classes = [&["no tool gets there"][..], &names[..]].concat();
    let tool = outside(&|voxel| match f64::from(findings.together.imf.value[voxel]) <= run.tau {
        true => (findings.together.tool[voxel] + 1) as f32,
        false => 0.0,
    });
    let measure = |shown: &[ArrayView2<'_, f32>]| {
        let label = "inaccessibility measure IMF: fraction of the tool that collides";
        Scale::measure_of(shown, label).with_free(run.tau)
    };
    let free = |shown: &[ArrayView2<'_, f32>]| Scale::measure_of(shown, "free poses in %");
    let tools = |_: &[ArrayView2<'_, f32>]| Scale::classes(&classes);
    let fields: [Field<'_>; 3] =
        [("minimum overlap", &least, &measure), ("freedom", &share, &free), ("best tool", &tool, &tools)];
    let (count, set, tau) = (run.orientations.len(), shortened(&run.orientations.spec), run.tau);
    let plural = if count == 1 { "" } else { "s" };
    let note = format!(
        "{count} orientation{plural} ({set}), τ = {tau}; grey: part and fixtures; slices where the minimum overlap varies most"
    );
    draw_fields(run, &run.solid, &fields[..if many { 3 } else { 2 }], note, path)
}

/// A field in slices: its name, its values, and its colours by what is shown of it.
type Field<'a> = (&'a str, &'a [f32], &'a dyn Fn(&[ArrayView2<'_, f32>]) -> Scale);

/// Slices of fields at right angles to each axis, where the first that varies at all outside the hidden voxels varies most.
fn draw_fields(
    run: &AccessRun,
    hidden: &Occupancy,
    fields: &[Field<'_>],
    note: String,
    path: &Path,
) -> Result<()> {
    let grid = &hidden.grid;
    let cuts: Vec<_> = (0..3)
        .map(|axis| {
            let varied = fields.iter().find_map(|(_, values, _)| slices::most_varied(values, hidden, axis));
            let index = varied.unwrap_or_else(|| slices::middle(grid, axis));
            let cut = fields.iter().map(|(_, values, _)| slices::slice(values, grid, axis, index));
            (axis, index, cut.collect::<Vec<_>>(), slices::mask(hidden, axis, index))
        })
        .collect();
    let scales = fields.iter().enumerate().map(|(field, (.., scale))| {
        let shown: Vec<_> = cuts.iter().map(|(_, _, cut, _)| cut[field].view()).collect();
        scale(&shown)
    });
    let scales: Vec<Scale> = scales.collect();
    let rows = cuts.iter().map(|(axis, index, cut, solid)| {
        let panels = fields.iter().zip(cut).zip(&scales).map(|(((title, ..), values), scale)| Panel {
            title: (*title).to_owned(),
            values: values.view(),
            mask: Some(Mask { voxels: solid.view(), style: MaskStyle::Fill }),
            scale: scale.clone(),
            axes: slices::axes(grid, run.unit, *axis),
        });
        let title = format!("plane {}", slices::layer_title(grid, run.unit, *axis, *index));
        PanelRow { title, panels: panels.collect() }
    });
    let (title, rows) = (title(run), rows.collect());
    PanelSheet { title, rows, notes: vec![note], pixels_per_voxel: None }.save(path)
}

/// False where there is no stock to draw.
fn draw_removable(run: &AccessRun, findings: &Findings, path: &Path) -> Result<bool> {
    let Some(stock) = &run.stock else { return Ok(false) };
    let grid = &stock.solid.grid;
    // What is left first, then by the first tool that removes it; the part hides its own voxels.
    let by_tool = |voxel: usize| findings.removable.iter().position(|found| found.covered[voxel] != 0);
    let classes = removable_classes(run, stock, findings);
    let values = classes.iter().enumerate().map(|(voxel, &class)| match (class, by_tool(voxel)) {
        (REMOVABLE, Some(tool)) => (tool + 3) as f32,
        (UNDECIDED, _) => 2.0,
        (OUT_OF_REACH, _) => 1.0,
        _ => 0.0,
    });
    let values: Vec<f32> = values.collect();
    let held =
        Occupancy { grid: *grid, solid: classes.iter().map(|&class| u8::from(class == OBSTACLE)).collect() };
    let mut names = vec!["no stock".to_owned(), "out of reach".into(), "not decided at this pitch".into()];
    match &run.tools[..] {
        [_] => names.push("a cutter removes it".into()),
        tools => names.extend(tools.iter().map(|tool| format!("removed by {}", tool.tool().name))),
    }
    let scale = Scale::classes(&names.iter().map(String::as_str).collect::<Vec<_>>());
    let note = format!("Stock: {}; grey: part and fixtures", stock.name);
    draw_fields(run, &held, &[("stock", &values, &|_| scale.clone())], note, path)?;
    Ok(true)
}

fn draw_map(run: &AccessRun, findings: &Findings, index: usize, tool: &str, path: &Path) -> Result<()> {
    let (map, Some((point, _))) = (&findings.maps[index], run.map) else { return Ok(()) };
    let values =
        Array2::from_shape_fn((map.cells[0], map.cells[1]), |(i, j)| map.values[i * map.cells[1] + j]);
    let axes = Axes {
        names: ["longitude θ".into(), "latitude 90° − φ".into()],
        unit: "°".into(),
        start: [0.0, -90.0],
        pitch: 180.0 / map.cells[1] as f64,
    };
    let label = "collision measure CMF: fraction of the tool that collides";
    let scale = Scale::measure_of(&[values.view()], label).with_free(run.tau);
    let name = format!("directions of {tool}, tip to holder");
    let outside = values.mapv(|value| u8::from(value.is_nan()));
    let mask = run.limits.map(|_| Mask { voxels: outside.view(), style: MaskStyle::Fill });
    let panel = Panel { title: name, values: values.view(), mask, scale, axes };
    let side = (720 / map.cells[0]).clamp(1, 40) as u32;
    PanelSheet {
        title: format!("{} at ({}, {}, {}) {}", run.part, point.x, point.y, point.z, run.unit),
        rows: vec![PanelRow { title: String::new(), panels: vec![panel] }],
        notes: vec![format!(
            "{:.1} % of {} are free (τ = {}){}{}",
            100.0 * map.free_fraction(run.tau),
            directions(run),
            run.tau,
            if slices::is_solid(&run.obstacle.forbidden, point) {
                "; the point lies in part or fixture, so that the tip collides at once"
            } else {
                ""
            },
            if run.limits.is_some() { "; grey: out of the machine's limits" } else { "" }
        )],
        pixels_per_voxel: Some(side),
    }
    .save(path)?;
    Ok(())
}

/// Which directions a map is of.
pub(super) fn directions(run: &AccessRun) -> &'static str {
    if run.limits.is_some() { "the directions within the machine's limits" } else { "all directions" }
}
