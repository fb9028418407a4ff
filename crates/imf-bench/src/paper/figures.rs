//! The figures: parts and tool, and sections and inaccessibility measures, exact, learnt and their difference in shared
//! colour scales.

use std::path::PathBuf;

use anyhow::Result;
use imf_cli::output::{prepare_folder, short};
use imf_cli::picture::{Axes, Panel, PanelRow, PanelSheet, Scale};
use imf_cli::slices;
use imf_core::occupancy::Occupancy;
use imf_core::orientation::Orientation;
use imf_core::parts::ReferencePart;
use imf_core::section::{SectionPlan, ToolPoints, imf, sections};
use imf_fields::siren::over_grid;
use ndarray::{Array2, ArrayView3, Axis};

use super::{Bench, Run};
use crate::planar::silhouette;
use crate::recipe::EvaluationSets;

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

/// The parts seen along the three axes, and the tool's cut through its axis; nothing where it is not there and none may be made.
pub(super) fn scenes(bench: &Bench<'_>) -> Result<Option<Figure>> {
    let (path, file) = bench.picture("scenes")?;
    let figure = (file, "Parts seen along the axes, and the tool in the same voxels".into());
    if bench.finished {
        return Ok(path.exists().then_some(figure));
    }
    let mut seen = Vec::new();
    for &part in &bench.parts {
        let mut settings = bench.protocol.recipe("single", None)?.recipe()?.scene;
        settings.part = part.name().into();
        let scene = bench.scene(&settings)?;
        let views = (0..3).map(|axis| thickness(&scene.obstacle, axis)).collect::<Result<Vec<_>>>()?;
        seen.push((part, scene.record, views));
    }
    let all: Vec<_> = seen.iter().flat_map(|(.., views)| views.iter().map(|array| array.view())).collect();
    let scale = Scale::measure_of(&all, "solid voxels behind each other");
    let mut rows = Vec::new();
    for (part, record, views) in &seen {
        let [x, y, z] = record.grid.dims;
        let panels = views.iter().enumerate().map(|(axis, view)| Panel {
            title: format!("along {}", ["x", "y", "z"][axis]),
            values: view.view(),
            mask: None,
            scale: scale.clone(),
            axes: slices::axes(&record.grid, record.unit, axis),
        });
        rows.push(PanelRow { title: format!("{part}, {x}×{y}×{z} voxels"), panels: panels.collect() });
    }
    let (_, record, _) = &seen[0];
    let pitch = record.grid.pitch;
    // Upright in the plane: its axis runs up.
    let pixels = silhouette(&record.tool, 90.0, pitch)?;
    let low = [0, 1].map(|axis| pixels.iter().map(|p| p[axis]).min().unwrap_or(0));
    let high = [0, 1].map(|axis| pixels.iter().map(|p| p[axis]).max().unwrap_or(0));
    let mut tool = Array2::zeros([0, 1].map(|axis| (high[axis] - low[axis] + 1) as usize));
    for [x, y] in pixels {
        tool[[(x - low[0]) as usize, (y - low[1]) as usize]] = 1.0;
    }
    let mut axes = slices::axes(&record.grid, record.unit, 2);
    axes.names = ["across".into(), "along its axis".into()];
    axes.start = low.map(|v| (f64::from(v) - 0.5) * pitch);
    rows.push(PanelRow {
        title: format!("tool {}, cut through its axis", record.tool.name),
        panels: vec![Panel {
            title: String::new(),
            values: tool.view(),
            mask: None,
            scale: Scale::measure(1.0, "tool"),
            axes,
        }],
    });
    let notes = vec!["The teapot is the paper's part, bracket and screw gear are ours in its style".into()];
    PanelSheet { title: "Parts and tool".into(), rows, notes, pixels_per_voxel: None }.save(&path)?;
    Ok(Some(figure))
}

/// Slices of the exact field and of others by name, and the differences.
pub(super) struct Slices<'a> {
    title: String,
    exact: Array2<f32>,
    others: Vec<(&'a str, Array2<f32>)>,
    differences: Vec<(String, Array2<f32>)>,
}

impl<'a> Slices<'a> {
    pub(super) fn new(title: String, exact: Array2<f32>, others: Vec<(&'a str, Array2<f32>)>) -> Self {
        let difference = |(name, values): &(&str, Array2<f32>)| (format!("{name} − exact"), values - &exact);
        Self { differences: others.iter().map(difference).collect(), title, exact, others }
    }

    /// The scale of values and that of differences which some share.
    pub(super) fn scales(rows: &[Self], what: &str) -> [Scale; 2] {
        let others = rows.iter().flat_map(|row| row.others.iter().map(|(_, values)| values.view()));
        let values: Vec<_> = others.chain(rows.iter().map(|row| row.exact.view())).collect();
        let differences = rows.iter().flat_map(|row| row.differences.iter().map(|(_, v)| v.view()));
        let differences: Vec<_> = differences.collect();
        let signed = format!("{what}: difference from exact");
        [Scale::measure_of(&values, what), Scale::difference_of(&differences, &signed)]
    }

    /// Panels of values and of differences.
    pub(super) fn panels<'p>(
        &'p self,
        [measure, signed]: &[Scale; 2],
        solid: &'p Array2<u8>,
        axes: &Axes,
    ) -> [PanelRow<'p>; 2] {
        let exact = ("exact", &self.exact);
        let values = [exact].into_iter().chain(self.others.iter().map(|(name, values)| (*name, values)));
        let differences = self.differences.iter();
        [
            values.map(|(name, values)| slices::panel(name, values, solid, measure, axes)).collect(),
            differences.map(|(name, values)| slices::panel(name, values, solid, signed, axes)).collect(),
        ]
        .map(|panels| PanelRow { title: self.title.clone(), panels })
    }
}

/// Sections and the inaccessibility measure of a part, exact and by each recipe's network: drawn once, for which the networks must be
/// here.
pub(super) fn fields(
    bench: &Bench<'_>,
    part: ReferencePart,
    evaluation_sets: &EvaluationSets,
    runs: &[(&str, Run)],
) -> Result<Option<Figure>> {
    let name = format!("fields-{part}");
    let (path, file) = bench.picture(&name)?;
    let what = "sections and inaccessibility measure, exact, learnt and their difference, in shared scales";
    let figure = (file, format!("{part}: {what}"));
    let sources = runs.iter().map(|(recipe, _)| bench.protocol.recipe(recipe, Some(part.name())));
    let key = sources.collect::<Result<Vec<_>>>()?;
    if path.exists() && bench.cells.find::<()>(&name, &key)?.is_some() {
        return Ok(Some(figure));
    }
    let models = runs.iter().map(|(_, run)| run.model()).collect::<Result<Option<Vec<_>>>>()?;
    let Some(models) = models.filter(|_| !bench.finished) else { return Ok(None) };
    let scene = &models[0].scene;
    let grid = scene.record.grid;
    let (axis, middle) = (1, slices::middle(&grid, 1));
    let cut = |values: &[f32]| slices::slice(values, &grid, axis, middle);
    let plan = SectionPlan::of_scene(scene, ToolPoints::Tip)?;
    let set = &evaluation_sets.imf[0];
    let pairs = [evaluation_sets.in_sample, evaluation_sets.out_of_sample];
    let exact = bench.session.staged("drawing", "sections", set.len() as u64 + 2, |control| {
        let mut exact: Vec<_> = sections(&plan, &pairs, control)?.iter().map(|values| cut(values)).collect();
        exact.push(cut(&imf(&plan, &set.orientations, control)?.value));
        anyhow::Ok(exact)
    })?;
    let directions: Vec<[f32; 2]> = set.orientations.iter().map(Orientation::angles).collect();
    // Of the measure only the picture's plane.
    let indices: Vec<f32> = (0..grid.len()).map(|index| index as f32).collect();
    let shown = cut(&indices);
    let points = over_grid::points(&grid, shown.iter().map(|&index| index as usize));
    let mut learnt = [const { Vec::new() }; 3];
    for ((name, _), model) in runs.iter().zip(&models) {
        let mut engine = bench.device.evaluator(model.shape, &model.state.parameters)?;
        let mut values = vec![0.0; grid.len()];
        for (orientation, row) in pairs.iter().zip(&mut learnt) {
            over_grid::section(engine.as_mut(), &grid, orientation.angles(), &mut values)?;
            row.push((*name, cut(&values)));
        }
        let control = bench.session.control(&|_| {});
        let minimum = over_grid::minimum_at(engine.as_mut(), &points, &directions, control)?;
        learnt[2].push((*name, Array2::from_shape_vec(shown.raw_dim(), minimum.value)?));
    }
    let section = |o: &Orientation| format!("section θ = {}°, φ = {}°", short(o.theta), short(o.phi));
    let titles =
        [section(&pairs[0]), section(&pairs[1]), format!("inaccessibility measure over {}", set.len())];
    let rows = titles.into_iter().zip(exact).zip(learnt);
    let rows: Vec<Slices<'_>> =
        rows.map(|((title, exact), learnt)| Slices::new(title, exact, learnt)).collect();

    let solid = slices::mask(&scene.obstacle, axis, middle);
    let axes = slices::axes(&grid, scene.record.unit, axis);
    // Sections share their scales; the measure is far smaller and has its own.
    let scales = [Slices::scales(&rows[..2], "sections CMF"), Slices::scales(&rows[2..], "measure IMF")];
    let whole = rows.iter().enumerate().map(|(index, row)| {
        let [mut values, differences] = row.panels(&scales[index / 2], &solid, &axes);
        values.panels.extend(differences.panels);
        values
    });
    let plane = slices::layer_title(&grid, scene.record.unit, axis, middle);
    let sheet = PanelSheet {
        title: format!("{part}: exact field and networks"),
        rows: whole.collect(),
        notes: vec![format!("Plane {plane}; outline: the part")],
        pixels_per_voxel: None,
    };
    sheet.save(&path)?;
    bench.cells.keep(&name, &key, ())?;
    Ok(Some(figure))
}
