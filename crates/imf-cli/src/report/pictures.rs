//! The pictures of an evaluation: sections and minima beside the exact ones, and errors as bars.

use std::path::Path;

use anyhow::Result;
use imf_core::control::Control;
use imf_core::grid::Grid;
use imf_core::section::Quantity;
use imf_core::unit::LengthUnit;
use imf_fields::evaluation::ExactReference;
use ndarray::Array2;

use super::Evaluation;
use crate::arguments::clearance::title;
use crate::picture::{Bar, BarChart, PanelRow, PanelSheet, Scale};
use crate::slices;

/// Planes of the exact field and of another one.
struct Comparison {
    title: String,
    /// At right angles to the plane.
    axis: usize,
    exact: Array2<f32>,
    other: Array2<f32>,
    difference: Array2<f32>,
}

impl Comparison {
    /// The planes in the middle of an axis.
    fn new(title: String, grid: &Grid, axis: usize, exact: &[f32], other: &[f32]) -> Self {
        let [exact, other] =
            [exact, other].map(|values| slices::slice(values, grid, axis, slices::middle(grid, axis)));
        Self { title, axis, difference: &other - &exact, exact, other }
    }
}

impl Evaluation<'_> {
    fn unit(&self) -> LengthUnit {
        self.subject.scene.record.unit
    }

    pub(super) fn draw_sections(&self, folder: &Path) -> Result<()> {
        let (grid, axis) = (self.plan.grid(), 1);
        let random = &self.settings.random.orientations;
        let shown = &random[..random.len().min(3)];
        let quantity = self.field.quantity();
        let exact = ExactReference::new(&self.plan, quantity, None)?.sections(shown, Control::quiet())?;
        let mut planes = Vec::new();
        for (orientation, section) in shown.iter().zip(&exact) {
            let mut learnt = vec![0.0; grid.len()];
            self.field.section(orientation, &mut learnt)?;
            let title = format!("θ = {:.1}°, φ = {:.1}°", orientation.theta, orientation.phi);
            planes.push(Comparison::new(title, grid, axis, section, &learnt));
        }
        let plane = slices::layer_title(grid, self.unit(), axis, slices::middle(grid, axis));
        let title = title(&self.subject.scene.record);
        let note =
            format!("Random orientations that the field was not made from; plane {plane}; outline: the part");
        let measure = match quantity {
            Quantity::Overlap => "overlap, fraction of the tool's volume".to_owned(),
            Quantity::Depth => format!("signed penetration depth, {}", self.report.unit),
        };
        self.compare(title, &planes, &measure, note, &folder.join("sections.png"))
    }

    pub(super) fn draw_imf(&self, folder: &Path) -> Result<()> {
        let grid = self.plan.grid();
        let planes = [0, 1, 2].map(|axis| {
            let middle = slices::middle(grid, axis);
            let title = slices::layer_title(grid, self.unit(), axis, middle);
            Comparison::new(title, grid, axis, &self.imf.exact.value, &self.imf.learnt.value)
        });
        let title = format!("{}: minimum over {} orientations", self.report.part, self.settings.imf.len());
        let measure = match self.report.quantity {
            Quantity::Overlap => "inaccessibility measure IMF".to_owned(),
            Quantity::Depth => format!("minimum of the depth, {}", self.report.unit),
        };
        let note = "Outline: the part".into();
        self.compare(title, &planes, &measure, note, &folder.join("imf.png"))
    }

    /// A sheet of planes: exact, of the field, and their difference in a scale of its own.
    fn compare(
        &self,
        title: String,
        planes: &[Comparison],
        measure: &str,
        note: String,
        path: &Path,
    ) -> Result<()> {
        let (grid, unit) = (self.plan.grid(), self.unit());
        let shown_as = self.report.made.shown_as;
        let values: Vec<_> = planes.iter().flat_map(|p| [p.exact.view(), p.other.view()]).collect();
        let measure = Scale::of_values(&values, measure);
        let differences: Vec<_> = planes.iter().map(|plane| plane.difference.view()).collect();
        let signed = Scale::difference_of(&differences, &format!("{shown_as} − exact"));
        let solid = |plane: &Comparison| {
            slices::mask(&self.subject.scene.obstacle, plane.axis, slices::middle(grid, plane.axis))
        };
        let solids: Vec<_> = planes.iter().map(solid).collect();
        let rows = planes.iter().zip(&solids).map(|(plane, solid)| {
            let axes = slices::axes(grid, unit, plane.axis);
            PanelRow {
                title: plane.title.clone(),
                panels: vec![
                    slices::panel("exact", &plane.exact, solid, &measure, &axes),
                    slices::panel(shown_as, &plane.other, solid, &measure, &axes),
                    slices::panel("difference", &plane.difference, solid, &signed, &axes),
                ],
            }
        });
        PanelSheet { title, rows: rows.collect(), notes: vec![note], pixels_per_voxel: None }.save(path)
    }

    pub(super) fn error_bars(&self) -> BarChart {
        let errors = |name: &str| self.report.rows.iter().find(|r| r.name.ends_with(name)).map(|r| r.errors);
        let made = &self.report.made;
        let nearest = format!("nearest {} section", made.participle);
        let bar = |name: &str, value, marked| Bar { name: name.into(), value, marked };
        let bars = errors("random sections").zip(errors(&nearest)).map(|(learnt, others)| {
            vec![
                bar(&format!("{} field", made.shown_as), learnt.mse, true),
                bar(&nearest, others.mse, false),
                bar("constant (variance)", learnt.variance, false),
            ]
        });
        BarChart {
            title: format!(
                "{}: error at {} random orientations",
                self.report.part,
                self.settings.random.len()
            ),
            value_name: match self.report.quantity {
                Quantity::Overlap => "mean squared error".into(),
                Quantity::Depth => format!("mean squared error, {}²", self.report.unit),
            },
            bars: bars.unwrap_or_default(),
        }
    }
}
