//! The comparison in the plane: one rotation, 37 sections every 10°, up-sampled to 145 every 2.5° by the network and by
//! interpolations of the same sections.
//!
//! The network is `siren5` with the third coordinate in the middle of a layer and φ = 90°: both inputs are exactly 0, their
//! weights never matter, and what is left is the network of (x, y, θ).

use std::ops::ControlFlow;

use anyhow::{Context as _, Result};
use imf_cli::interrupt;
use imf_cli::picture::PanelSheet;
use imf_cli::progress::show_seconds;
use imf_cli::slices;
use imf_core::control::Cancelled;
use imf_core::occupancy::Occupancy;
use imf_core::section::{Imf, SectionPlan, SectionScratch, ToolPoints};
use imf_core::tool::Tool;
use imf_fields::metrics::{ErrorReport, Errors};
use imf_fields::recipe::{Cursor, Precision, Sampling, TrainingState};
use imf_fields::siren::over_grid;
use imf_train::samples::Samples;
use imf_train::training::run::train;
use serde::{Deserialize, Serialize};

use super::Bench;
use super::figures::Slices;
use super::published::PAPER;
use super::table::{Row, Table};
use crate::interpolation::Periodic;
use crate::measurement::seconds;
use crate::planar::{layer, section};
use crate::recipe::{Recipe, Stage};

/// Degrees between the sections that are given; 0° and 360° are both given, as in the paper's 37.
const GIVEN_EVERY: usize = 10;
/// Steps of up-sampling for each given one.
const FINER: usize = 4;
/// The part's axis that the plane is at right angles to: the teapot's silhouette with handle and spout.
const AXIS: usize = 1;

/// Results of a method.
#[derive(Clone, Serialize, Deserialize)]
struct Method {
    name: String,
    seconds: f64,
    cmf: ErrorReport,
    imf: ErrorReport,
}

#[derive(Serialize, Deserialize)]
struct PlaneResult {
    dims: [usize; 2],
    samples: usize,
    steps: u64,
    precision: Precision,
    methods: Vec<Method>,
}

/// Angles of the up-sampled sections in degrees.
fn fine_angles() -> Vec<f64> {
    let steps = 360 / GIVEN_EVERY * FINER;
    (0..=steps).map(|step| 360.0 * step as f64 / steps as f64).collect()
}

/// Exact sections, given and up-sampled; each given one is every [`FINER`]th.
struct Sections {
    part: Occupancy,
    exact: Vec<Vec<f32>>,
    least: Imf,
}

impl Sections {
    fn new(part: Occupancy, tool: &Tool) -> Result<Self> {
        let plan = SectionPlan::new(&part, tool, ToolPoints::Tip)?;
        let mut scratch = SectionScratch::default();
        let mut least = Imf::new(part.grid.len());
        let mut exact = Vec::new();
        for (index, &theta) in fine_angles().iter().enumerate() {
            if interrupt::requested() {
                return Err(Cancelled.into());
            }
            let mut values = vec![0.0; part.grid.len()];
            section(&plan, theta, &mut scratch, &mut values)?;
            least.lower_to(index, &values);
            exact.push(values);
        }
        Ok(Self { part, exact, least })
    }

    fn given(&self) -> impl Iterator<Item = &Vec<f32>> {
        self.exact.iter().step_by(FINER)
    }

    /// Errors of the sections that `field` writes, over all up-sampled angles.
    fn compare(
        &self,
        name: &str,
        threshold: f64,
        seconds: f64,
        mut field: impl FnMut(f64, &mut [f32]) -> Result<()>,
    ) -> Result<(Method, Imf)> {
        let mut least = Imf::new(self.part.grid.len());
        let mut values = vec![0.0; self.part.grid.len()];
        let mut errors = Errors::default();
        for (index, (&theta, exact)) in fine_angles().iter().zip(&self.exact).enumerate() {
            field(theta, &mut values)?;
            errors.add(exact, &values, threshold);
            least.lower_to(index, &values);
        }
        let mut least_errors = Errors::default();
        least_errors.add(&self.least.value, &least.value, threshold);
        let method = Method {
            name: name.into(),
            seconds,
            cmf: errors.report(threshold),
            imf: least_errors.report(threshold),
        };
        Ok((method, least))
    }

    /// The section at θ from the given ones, by weights; within [0, 1] where `clipped`.
    fn interpolate(&self, kind: Periodic, clipped: bool, theta: f64, values: &mut [f32]) {
        // 360° is the section of 0° again: once is enough for a periodic interpolation.
        let weights = kind.weights(360 / GIVEN_EVERY, theta);
        values.fill(0.0);
        for (weight, section) in weights.iter().zip(self.given()) {
            values.iter_mut().zip(section).for_each(|(value, &s)| *value += (*weight * f64::from(s)) as f32);
        }
        if clipped {
            values.iter_mut().for_each(|value| *value = value.clamp(0.0, 1.0));
        }
    }

    /// What the network learns from: the given sections, sampled as a stage's.
    fn samples(&self, sampling: &Sampling) -> Samples {
        let mut samples = Samples::new(self.part.grid);
        for (index, section) in self.given().enumerate() {
            let voxels = imf_train::dataset::draw(section, sampling, index as u64);
            let values: Vec<f32> = voxels.iter().map(|&voxel| section[voxel as usize]).collect();
            samples.push_section([(GIVEN_EVERY * index) as f32, 90.0], &voxels, &values);
        }
        samples
    }
}

fn measure(bench: &Bench<'_>, recipe: &Recipe, stage: &Stage) -> Result<PlaneResult> {
    let scene = bench.scene(&recipe.scene)?;
    let grid = scene.record.grid;
    let sections =
        Sections::new(layer(&scene.obstacle, AXIS, slices::middle(&grid, AXIS)), &scene.record.tool)?;
    let tau = recipe.evaluation.threshold;
    let samples = sections.samples(&stage.sampling);
    let plan = stage.plan();
    let shape = recipe.network.shape();
    let state = TrainingState::new(&shape, recipe.network.seed);
    let mut engine =
        bench.device.trainer(bench.session.rank(), shape, &plan, plan.batch.min(samples.len()), state)?;
    let total = plan.total_steps(samples.len());
    let progress = bench.session.stage("training", "steps", total);
    let mut done = 0;
    let (trained_in, _) = seconds(|| {
        Ok(train(&plan, &samples, engine.as_mut(), Cursor::default(), &mut |report, _| {
            progress.advance(report.step - done);
            done = report.step;
            if interrupt::requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
        })?)
    })?;
    if done < total {
        return Err(Cancelled.into());
    }
    progress.finish("");
    let parameters = engine.state()?.parameters;
    let mut evaluator = bench.device.evaluator(shape, &parameters)?;
    let grid = sections.part.grid;
    let (network, learnt) = sections.compare("network", tau, trained_in, |theta, values| {
        Ok(over_grid::section(evaluator.as_mut(), &grid, [theta as f32, 90.0], values)?)
    })?;
    let mut methods = vec![network];
    let mut drawn = vec![("network", learnt)];
    let kinds = [
        ("trigonometric", Periodic::Trigonometric),
        ("cubic spline", Periodic::CubicSpline),
        ("linear", Periodic::Linear),
    ];
    for (name, kind) in kinds {
        for clipped in [false, true] {
            // Means of values within [0, 1] stay there.
            if clipped && kind == Periodic::Linear {
                continue;
            }
            let shown = if clipped { format!("{name}, clipped to [0, 1]") } else { name.to_owned() };
            let (time, (mut method, least)) = seconds(|| {
                sections.compare(&shown, tau, 0.0, |theta, values| {
                    sections.interpolate(kind, clipped, theta, values);
                    Ok(())
                })
            })?;
            method.seconds = time;
            methods.push(method);
            if !clipped {
                drawn.push((name, least));
            }
        }
    }
    draw(bench, &sections, &drawn)?;
    let [x, y, _] = sections.part.grid.dims;
    Ok(PlaneResult { dims: [x, y], samples: samples.len(), steps: total, precision: plan.precision, methods })
}

/// The inaccessibility measure, exact and by every method.
fn draw(bench: &Bench<'_>, sections: &Sections, methods: &[(&str, Imf)]) -> Result<()> {
    let grid = sections.part.grid;
    let cut = |values: &[f32]| slices::slice(values, &grid, 2, 0);
    let found = methods.iter().map(|(name, least)| (*name, cut(&least.value))).collect();
    let title = format!("IMF over {}", fine_angles().len());
    let rows = [Slices::new(title, cut(&sections.least.value), found)];
    let scales = Slices::scales(&rows, "inaccessibility measure IMF");
    let solid = slices::mask(&sections.part, 2, 0);
    let mut axes = slices::axes(&grid, imf_core::unit::LengthUnit::Mm, 2);
    axes.names = ["x".into(), "z".into()];
    let sheet = PanelSheet {
        title: "One rotation in the plane".into(),
        rows: rows[0].panels(&scales, &solid, &axes).into(),
        notes: vec!["Outline: the teapot's middle plane".into()],
        pixels_per_voxel: None,
    };
    sheet.save(&bench.picture("plane")?.0)?;
    Ok(())
}

/// The comparison that the paper has.
const MINIMA: &str = "IMF over 145";

pub(super) fn table(bench: &Bench<'_>) -> Result<Table> {
    let mut recipe = bench.protocol.plane()?.recipe()?;
    // A plane is small: its resolution is the paper's at every scale. All pixels of the few sections are learnt from: the
    // interpolations know them too.
    recipe.scene.scale = 1.0;
    let stage = recipe.stages.first_mut().context("single has no stage")?;
    stage.sampling.density = 1.0;
    let stage = stage.clone();
    let key = (&recipe.scene, &recipe.network, &stage);
    let mut here = stage.clone();
    here.training.precision = bench.protocol.precision;
    let mut table = Table::of_errors("2d", "One rotation in the plane", &["method", "compared"]);
    let Some(cell) = bench.cell("plane", &key, || measure(bench, &recipe, &here))? else {
        table.notes.push("Not measured yet.".into());
        let missing = PAPER
            .plane
            .iter()
            .map(|(method, paper)| Row::errors(vec![method.clone(), MINIMA.into()], Some(*paper), None));
        table.rows.extend(missing);
        return Ok(table);
    };
    let measured = cell.value;
    let [x, y] = measured.dims;
    table.notes.push(format!(
        "The teapot's middle plane ({x}×{y} pixels, the full resolution at every scale) and the tool's cut through its axis, not the paper's 2D part: 37 exact \
         sections every 10°, {} samples, {} steps; up-sampled to 145 every 2.5°. Splines and trigonometric polynomials are \
         periodic, and are shown as they come and clipped. The paper has the IMF alone, which hides how an interpolation \
         errs between its sections: a minimum of means is no lower than the least of the sections.",
        measured.samples, measured.steps
    ));
    for method in &measured.methods {
        let labels = |what: &str| vec![method.name.clone(), what.to_owned()];
        table.rows.push(Row::errors(labels("CMF, 145 sections"), None, Some(&method.cmf)));
        let paper = PAPER.plane.get(&method.name).copied();
        table.rows.push(Row::errors(labels(MINIMA), paper, Some(&method.imf)));
    }
    if let Some(network) = measured.methods.first() {
        table.notes.push(format!(
            "The network was trained in {} on {}, {}.",
            show_seconds(network.seconds),
            cell.made_on,
            measured.precision
        ));
    }
    let (path, file) = bench.picture("plane")?;
    if path.exists() {
        table
            .figures
            .push((file, "Inaccessibility measure of the plane by every method, and its error".into()));
    }
    Ok(table)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_37_sections_and_145_of_them_after_up_sampling() {
        let fine = fine_angles();
        assert_eq!((fine.len(), fine[1], fine[144]), (145, 2.5, 360.0));
        assert_eq!(fine.iter().step_by(FINER).count(), 37);
    }
}
