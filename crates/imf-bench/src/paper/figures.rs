//! The figures: parts and tool, and sections and inaccessibility measures, exact, learnt and their difference in shared
//! colour scales.

use std::path::PathBuf;

use anyhow::Result;
use imf_cli::output::{prepare_folder, short};
use imf_cli::picture::{Panel, PanelRow, PanelSheet, Scale};
use imf_cli::slices;
use imf_core::control::Control;
use imf_core::occupancy::Occupancy;
use imf_core::orientation::Orientation;
use imf_core::parts::ReferencePart;
use imf_core::section::{At, SectionPlan, imf, sections};
use imf_fields::siren::over_grid;
use ndarray::{Array2, ArrayView3, Axis};

use super::{Bench, Run};
use crate::planar::silhouette;
use crate::recipe::Questions;

/// A picture in the report's folder and its caption.
pub(super) type Figure = (String, String);

impl Bench<'_> {
    /// Where a picture goes: its path, and its name within the report's folder.
    pub(super) fn picture(&self, name: &str) -> Result<(PathBuf, String)> {
        prepare_folder(&self.out.join("figures"))?;
        let file = format!("figures/{name}.png");
        Ok((self.out.join(&file), file))
    }
}

/// How many solid voxels stand behind each other, seen along an axis.
fn thickness(solid: &Occupancy, axis: usize) -> Result<Array2<f32>> {
    let voxels = ArrayView3::from_shape(solid.grid.dims, &solid.solid)?;
    Ok(voxels.map(|&s| f32::from(s)).sum_axis(Axis(axis)))
}

/// The parts seen along the three axes, and the tool's cut through its axis.
pub(super) fn scenes(bench: &Bench<'_>) -> Result<Figure> {
    let mut seen = Vec::new();
    for &part in &bench.parts {
        let mut settings = bench.protocol.recipe("single", None)?.recipe()?.scene;
        settings.part = part.name().into();
        let scene = bench.scene(&settings)?;
        let views = [0, 1, 2].map(|axis| thickness(&scene.obstacle, axis));
        let [x, y, z] = views;
        seen.push((part, scene, [x?, y?, z?]));
    }
    let all: Vec<_> = seen.iter().flat_map(|(.., views)| views.iter().map(|array| array.view())).collect();
    let scale = Scale::measure_of(&all, "solid voxels behind each other");
    let mut rows: Vec<PanelRow<'_>> = seen
        .iter()
        .map(|(part, scene, views)| {
            let [x, y, z] = scene.record.grid.dims;
            PanelRow {
                title: format!("{}, {x}×{y}×{z} voxels", part.name()),
                panels: (0..3)
                    .map(|axis| Panel {
                        title: format!("along {}", ["x", "y", "z"][axis]),
                        values: views[axis].view(),
                        mask: None,
                        scale: scale.clone(),
                        axes: slices::axes(&scene.record.grid, scene.record.unit, axis),
                    })
                    .collect(),
            }
        })
        .collect();
    let (_, scene, _) = &seen[0];
    let pitch = scene.record.grid.pitch;
    // Upright in the plane: its axis runs up.
    let pixels = silhouette(&scene.record.tool, 90.0, pitch)?;
    let low = [0, 1].map(|axis| pixels.iter().map(|p| p[axis]).min().unwrap_or(0));
    let high = [0, 1].map(|axis| pixels.iter().map(|p| p[axis]).max().unwrap_or(0));
    let mut tool = Array2::zeros([0, 1].map(|axis| (high[axis] - low[axis] + 1) as usize));
    for [x, y] in pixels {
        tool[[(x - low[0]) as usize, (y - low[1]) as usize]] = 1.0;
    }
    let mut axes = slices::axes(&scene.record.grid, scene.record.unit, 2);
    axes.names = ["across".into(), "along its axis".into()];
    axes.start = low.map(|v| (f64::from(v) - 0.5) * pitch);
    rows.push(PanelRow {
        title: format!("tool {}, cut through its axis", scene.record.tool.name),
        panels: vec![Panel {
            title: String::new(),
            values: tool.view(),
            mask: None,
            scale: Scale::measure(1.0, "tool"),
            axes,
        }],
    });
    let (path, file) = bench.picture("scenes")?;
    let notes = vec!["The teapot is the paper's part, bracket and screw gear are ours in its style".into()];
    PanelSheet { title: "Parts and tool".into(), rows, notes, pixels_per_voxel: None }.save(&path)?;
    Ok((file, "Parts seen along the axes, and the tool in the same voxels".into()))
}

/// A row of the picture of fields: a slice of the exact one and of every network's.
struct Slices {
    title: String,
    exact: Array2<f32>,
    learnt: Vec<Array2<f32>>,
    differences: Vec<Array2<f32>>,
}

/// Sections and the inaccessibility measure of a part, exact and by each recipe's network.
pub(super) fn fields(
    bench: &Bench<'_>,
    part: ReferencePart,
    questions: &Questions,
    runs: &[(&str, Run)],
) -> Result<Figure> {
    let models = runs.iter().map(|(_, run)| run.model()).collect::<Result<Vec<_>>>()?;
    let scene = &models[0].scene;
    let grid = scene.record.grid;
    let (axis, middle) = (1, slices::middle(&grid, 1));
    let cut = |values: &[f32]| slices::slice(values, &grid, axis, middle);
    let plan = SectionPlan::of_scene(scene, At::Tip)?;
    let set = &questions.imf[0];
    let stage = bench.session.stage("drawing", "sections", set.len() as u64 + 2);
    let advance = |n| stage.advance(n);
    let control: Control<'_> = bench.session.control(&advance);
    let asked = [questions.in_sample, questions.out_of_sample];
    let exact = sections(&plan, &asked, control)?;
    let least = imf(&plan, &set.orientations, control)?;
    let mut rows: Vec<Slices> = asked
        .iter()
        .zip(&exact)
        .zip(["in-sample", "out-of-sample"])
        .map(|((o, section), kind)| Slices {
            title: format!("section θ = {}°, φ = {}°, {kind}", short(o.theta), short(o.phi)),
            exact: cut(section),
            learnt: Vec::new(),
            differences: Vec::new(),
        })
        .collect();
    rows.push(Slices {
        title: format!("inaccessibility measure over {}", set.len()),
        exact: cut(&least.value),
        learnt: Vec::new(),
        differences: Vec::new(),
    });
    let directions: Vec<[f32; 2]> = set.orientations.iter().map(Orientation::angles).collect();
    for model in &models {
        let mut engine = bench.device.evaluator(model.shape, &model.state.parameters)?;
        let mut values = vec![0.0; grid.len()];
        for (orientation, row) in asked.iter().zip(&mut rows) {
            over_grid::section(engine.as_mut(), &grid, orientation.angles(), &mut values)?;
            row.learnt.push(cut(&values));
        }
        let control = bench.session.control(&|_| {});
        rows[2].learnt.push(cut(&over_grid::minimum(engine.as_mut(), &grid, &directions, control)?.value));
    }
    for row in &mut rows {
        row.differences = row.learnt.iter().map(|learnt| learnt - &row.exact).collect();
    }
    stage.finish("");

    let solid = slices::mask(&scene.obstacle, axis, middle);
    let axes = slices::axes(&grid, scene.record.unit, axis);
    // Sections share their scales; the measure is far smaller and has its own.
    let (sections, least) = rows.split_at(2);
    let scales = |rows: &[Slices], what: &str| {
        let fields: Vec<_> =
            rows.iter().flat_map(|r| r.learnt.iter().chain([&r.exact])).map(|array| array.view()).collect();
        let differences: Vec<_> =
            rows.iter().flat_map(|r| &r.differences).map(|array| array.view()).collect();
        (
            Scale::measure_of(&fields, what),
            Scale::difference_of(&differences, &format!("{what}: learnt − exact")),
        )
    };
    let of_sections = scales(sections, "sections CMF");
    let of_least = scales(least, "measure IMF");
    let sheet = PanelSheet {
        title: format!("{}: exact field and networks", part.name()),
        rows: rows
            .iter()
            .enumerate()
            .map(|(index, row)| {
                let (measure, signed) = if index < sections.len() { &of_sections } else { &of_least };
                let mut panels = vec![slices::panel("exact", &row.exact, &solid, measure, &axes)];
                for ((name, _), learnt) in runs.iter().zip(&row.learnt) {
                    panels.push(slices::panel(name, learnt, &solid, measure, &axes));
                }
                for ((name, _), difference) in runs.iter().zip(&row.differences) {
                    let title = format!("{name} − exact");
                    panels.push(slices::panel(&title, difference, &solid, signed, &axes));
                }
                PanelRow { title: row.title.clone(), panels }
            })
            .collect(),
        notes: vec![format!(
            "Plane {}; outline: the part",
            slices::layer_title(&grid, scene.record.unit, axis, middle)
        )],
        pixels_per_voxel: None,
    };
    let (path, file) = bench.picture(&format!("fields-{}", part.name()))?;
    sheet.save(&path)?;
    let caption = format!(
        "{}: sections and inaccessibility measure, exact, learnt and their difference, in shared scales",
        part.name()
    );
    Ok((file, caption))
}
