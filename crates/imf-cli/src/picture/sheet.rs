//! A sheet of panels in rows, all with the same pixels a voxel, and one colour bar below for each scale in use.

use std::path::Path;

use anyhow::{Result, ensure};
use image::RgbImage;

use super::axis::{Axis, NAME_SIZE, TICK_SIZE, plot};
use super::canvas::{Area, FAINT_INK, INK, Lines, MARGIN, bold, on_canvas, save, text, write};
use super::chart::TITLE_SIZE;
use super::colour::Scale;
use super::panel::{Panel, show};

/// The longest side of the largest panel in pixels, where a voxel is at least one pixel.
const FITTED_SIDE: u32 = 360;
/// Width that there is at least for lines of text and colour bars.
pub(super) const MIN_WIDTH: u32 = 420;
const GAP: u32 = 14;
const BAR_LENGTH: u32 = 360;
/// Height of a colour bar with its label and its ticks.
const BAR_HEIGHT: u32 = 62;
/// Height of a colour bar alone, and side of a class's swatch.
pub(super) const SWATCH: u32 = 14;

/// Panels side by side.
#[derive(Clone, Debug)]
pub struct PanelRow<'a> {
    /// Written above the row, for example the orientation; may be empty.
    pub title: String,
    /// From left to right.
    pub panels: Vec<Panel<'a>>,
}

/// A page of panels.
#[derive(Clone, Debug)]
pub struct PanelSheet<'a> {
    /// Written on top; may be empty.
    pub title: String,
    /// From top to bottom.
    pub rows: Vec<PanelRow<'a>>,
    /// Lines of small print at the bottom.
    pub notes: Vec<String>,
    /// Pixels a voxel; fitted to the largest panel if `None`.
    pub pixels_per_voxel: Option<u32>,
}

impl PanelSheet<'_> {
    /// Draws the sheet and writes it as a PNG file.
    ///
    /// # Errors
    /// No panels, a picture that would be too large, or a file that cannot be written; the error names the file.
    pub fn save(&self, path: &Path) -> Result<()> {
        save(self.draw(), path)
    }

    fn draw(&self) -> Result<RgbImage> {
        let panels = || self.rows.iter().flat_map(|row| &row.panels);
        ensure!(panels().next().is_some(), "a sheet without panels");
        let side = self.side();
        // A column is as wide as its widest panel.
        let mut columns: Vec<u32> = Vec::new();
        for (panel, index) in self.rows.iter().flat_map(|row| row.panels.iter().zip(0..)) {
            columns.resize(columns.len().max(index + 1), 0);
            columns[index] = columns[index].max(panel.size(side).0 + GAP);
        }
        let inside = columns.iter().sum::<u32>().max(MIN_WIDTH);
        let mut scales: Vec<&Scale> = Vec::new();
        for scale in panels().map(|panel| &panel.scale) {
            if !scales.contains(&scale) {
                scales.push(scale);
            }
        }
        let legends: Vec<Legend<'_>> = scales.iter().map(|scale| Legend::new(scale, inside)).collect();
        let bars: u32 = legends.iter().map(Legend::height).sum();

        let title = Lines::new(&self.title, bold(TITLE_SIZE), inside);
        let row_titles = self.rows.iter().map(|row| Lines::new(&row.title, bold(17.0), inside));
        let rows: Vec<(&PanelRow<'_>, Lines)> = self.rows.iter().zip(row_titles).collect();
        let not_finite = panels().map(Panel::not_finite).sum::<usize>();
        let note = |note: &str| Lines::new(note, text(TICK_SIZE, FAINT_INK), inside);
        let mut notes: Vec<Lines> = self.notes.iter().map(|text| note(text)).collect();
        if not_finite > 0 {
            notes.push(note(&format!("{not_finite} values are not finite: in magenta")));
        }
        let above = |row: &PanelRow<'_>| row.panels.iter().map(|p| p.above(side)).max().unwrap_or(0);
        let below = |row: &PanelRow<'_>| row.panels.iter().map(|p| p.size(side).1).max().unwrap_or(0) + GAP;
        let row_height = |(row, title): &(&PanelRow<'_>, Lines)| title.height() + above(row) + below(row);
        let rows_height: u32 = rows.iter().map(row_height).sum();
        let notes_height: u32 = notes.iter().map(Lines::height).sum();
        let height = title.height() + GAP + rows_height + bars + notes_height;
        on_canvas((inside + 2 * MARGIN, height + 2 * MARGIN), |area| {
            let mut top = MARGIN;
            title.draw(area, (MARGIN, top))?;
            top += title.height() + GAP;
            for (row, title) in &rows {
                title.draw(area, (MARGIN, top))?;
                top += title.height() + above(row);
                let mut left = MARGIN;
                for (panel, column) in row.panels.iter().zip(&columns) {
                    panel.draw(area, (left, top), side)?;
                    left += column;
                }
                top += below(row);
            }
            for legend in &legends {
                legend.draw(area, (MARGIN, top))?;
                top += legend.height();
            }
            for note in &notes {
                note.draw(area, (MARGIN, top))?;
                top += note.height();
            }
            Ok(())
        })
    }

    /// Pixels a voxel.
    fn side(&self) -> u32 {
        let panels = self.rows.iter().flat_map(|row| &row.panels);
        let longest = panels.map(|panel| panel.values.dim().0.max(panel.values.dim().1)).max();
        let fitted = FITTED_SIDE / longest.unwrap_or(1).clamp(1, FITTED_SIDE as usize) as u32;
        self.pixels_per_voxel.unwrap_or(fitted).max(1)
    }
}

/// A colour bar with its label and its ticks, and a swatch with its name for each class and for what is free.
struct Legend<'a> {
    scale: &'a Scale,
    /// Place of each swatch.
    swatches: Vec<((u32, u32), image::Rgb<u8>, Lines)>,
    /// Height of the swatches.
    rows: u32,
}

impl<'a> Legend<'a> {
    fn new(scale: &'a Scale, most: u32) -> Self {
        let (mut left, mut top, mut swatches) = (0, 0, Vec::new());
        for (colour, name) in scale.swatches() {
            let name = Lines::new(&name, text(NAME_SIZE, INK), most - SWATCH - 6);
            let wide = SWATCH + 6 + name.width();
            if left > 0 && left + wide > most {
                (left, top) = (0, top + SWATCH + GAP / 2);
            }
            let high = name.height();
            swatches.push(((left, top), colour, name));
            left += wide + 2 * GAP;
            // A name of several lines has its row for itself.
            if high > SWATCH + GAP {
                (left, top) = (most, top + high - SWATCH - GAP / 2);
            }
        }
        let rows = if swatches.is_empty() { 0 } else { top + SWATCH + GAP };
        Self { scale, swatches, rows }
    }

    fn has_bar(&self) -> bool {
        self.scale.classes.is_empty()
    }

    fn height(&self) -> u32 {
        self.rows + if self.has_bar() { BAR_HEIGHT } else { 0 }
    }

    fn draw(&self, area: &Area<'_>, (left, top): (u32, u32)) -> Result<()> {
        for ((right, down), colour, name) in &self.swatches {
            let (left, top) = (left + right, top + down);
            show(area, (left, top), RgbImage::from_pixel(SWATCH, SWATCH, *colour))?;
            name.draw(area, (left + SWATCH + 6, top + 2))?;
        }
        if self.has_bar() { bar(area, self.scale, (left, top + self.rows)) } else { Ok(()) }
    }
}

/// A colour bar, its label above and its ticks below.
fn bar(area: &Area<'_>, scale: &Scale, (left, top): (u32, u32)) -> Result<()> {
    write(area, &scale.label, &text(NAME_SIZE, INK), (left, top + 2))?;
    let top = top + 20;
    let (low, high) = scale.range();
    let value = |column| low + (f64::from(column) + 0.5) / f64::from(BAR_LENGTH) * (high - low);
    let colours = RgbImage::from_fn(BAR_LENGTH, SWATCH, |column, _| scale.colour(value(column) as f32));
    let whole = area.clone().shrink((left, top), (BAR_LENGTH, SWATCH + 24));
    plot(&whole, [0, 24], [Axis::along(low, high, BAR_LENGTH), Axis::linear(0.0, 1.0, 2)], ["", ""], false)?;
    show(area, (left, top), colours)
}

#[cfg(test)]
mod tests {
    use ndarray::Array2;

    use super::*;
    use crate::picture::Axes;
    use crate::picture::canvas::{BACKGROUND, pixel};
    use crate::picture::colour::NOT_FINITE;

    /// A panel for each of the scales.
    fn row<'a>(values: &'a Array2<f32>, scales: &[&Scale]) -> PanelRow<'a> {
        let axes =
            Axes { names: ["x".into(), "z".into()], unit: "mm".into(), start: [-1.0, 0.0], pitch: 0.5 };
        let panel = |scale: &&Scale| Panel {
            title: "exact".into(),
            values: values.view(),
            mask: None,
            scale: (*scale).clone(),
            axes: axes.clone(),
        };
        PanelRow { title: String::new(), panels: scales.iter().map(panel).collect() }
    }

    fn sheet(rows: Vec<PanelRow<'_>>) -> PanelSheet<'_> {
        PanelSheet { title: String::new(), rows, notes: vec![], pixels_per_voxel: None }
    }

    #[test]
    fn pixels_a_voxel_fit_the_largest_panel_and_never_vanish() {
        let scale = Scale::measure(1.0, "CMF");
        for (voxels, expected) in [(61, 5), (29, 12), (500, 1)] {
            let values = Array2::zeros((3, voxels));
            assert_eq!(sheet(vec![row(&values, &[&scale])]).side(), expected);
        }
    }

    #[test]
    fn equal_scales_share_a_bar() {
        let values = Array2::from_elem((10, 20), 0.5);
        let measure = Scale::measure(1.0, "collision measure");
        let difference = Scale::difference_of(&[], "learnt − exact");
        let height = |scales: &[&Scale]| {
            let row = PanelRow { title: "θ = 24°".into(), ..row(&values, scales) };
            sheet(vec![row.clone(), row]).draw().unwrap().height()
        };
        let one = height(&[&measure, &measure]);
        assert_eq!(height(&[&measure, &difference, &measure]), one + BAR_HEIGHT);
    }

    #[test]
    fn a_long_title_is_broken_and_nothing_is_cut() {
        let values = Array2::from_elem((10, 20), 0.5);
        let scale = Scale::measure(1.0, "collision measure");
        let row = row(&values, &[&scale]);
        let title = "A title of more words than fit into one line of the picture ".repeat(3);
        let mut wordy = row.clone();
        wordy.panels[0].title = title.clone();
        let classes: Vec<&str> = title.split(" of ").collect();
        wordy.panels[0].scale = Scale::classes(&classes);
        let long = PanelSheet { title: title.clone(), notes: vec![title], ..sheet(vec![wordy]) };
        let (long, short) = (long.draw().unwrap(), sheet(vec![row]).draw().unwrap());
        assert_eq!(long.width(), short.width());
        let edge = |x: u32| !(MARGIN / 2..long.width() - MARGIN / 2).contains(&x);
        assert!(long.enumerate_pixels().all(|(x, _, found)| !edge(x) || *found == pixel(BACKGROUND)));
    }

    #[test]
    fn a_sheet_marks_what_is_not_finite_and_saves() {
        let mut values = Array2::from_elem((10, 20), 2.0);
        values[[3, 4]] = f32::NAN;
        let scale = Scale::measure(1.0, "");
        let row = || row(&values, &[&scale]);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sheet.png");
        sheet(vec![row(), row()]).save(&path).unwrap();
        let image = image::open(&path).unwrap().to_rgb8();
        let side = sheet(vec![row()]).side();
        let found = image.pixels().filter(|&&pixel| pixel == NOT_FINITE).count() as u32;
        assert_eq!(found, 2 * side * side);
        assert_eq!(*image.get_pixel(0, image.height() - 1), pixel(BACKGROUND));
    }

    #[test]
    fn an_empty_sheet_is_refused_with_the_file_named() {
        let message = format!("{:#}", sheet(vec![]).save(Path::new("slices.png")).unwrap_err());
        assert!(message.contains("slices.png"), "{message}");
    }
}
