//! A sheet of panels in rows, all with the same pixels a voxel, and one colour bar below for each scale in use.
//!
//! ```text
//! title
//! row title
//!   panel title   panel title   panel title
//!   [ panel ]     [ panel ]     [ panel ]      a column is as wide as its widest panel
//! colour bar (under the columns that use it)
//! note
//! ```

use std::path::Path;

use anyhow::{Context as _, Result, ensure};

use super::colour::{NOT_FINITE, Scale};
use super::panel::{BELOW, Panel};
use super::text::{Align, Pen};
use super::{FAINT_INK, INK, MARGIN, Picture, Tally, blank, colour_bar, fill};

/// The longest side of the largest panel in pixels, where a voxel is at least one pixel.
const FITTED_SIDE: u32 = 360;
const COLUMN_GAP: u32 = 20;
const ROW_GAP: u32 = 12;
const TITLE_HEIGHT: u32 = 38;
const ROW_TITLE_HEIGHT: u32 = 26;
const PANEL_TITLE_HEIGHT: u32 = 20;
const BAR_GAP: u32 = 12;
const WIDEST_BAR: u32 = 460;
const NOTE_GAP: u32 = 6;
const NOTE_HEIGHT: u32 = 20;
const TITLE_SIZE: f32 = 20.0;
const ROW_TITLE_SIZE: f32 = 15.0;
const PANEL_TITLE_SIZE: f32 = 14.0;
const NOTE_SIZE: f32 = 12.5;

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

/// Where a column's panels begin and how much room they have, in pixels.
#[derive(Clone, Copy)]
struct Column {
    left: u32,
    width: u32,
}

/// A colour bar with its upper left corner, from the top of the first bar.
struct Bar<'a> {
    scale: &'a Scale,
    left: u32,
    top: u32,
    width: u32,
}

impl<'a> PanelSheet<'a> {
    /// Draws the sheet and writes it as a PNG file.
    ///
    /// # Errors
    /// A picture that cannot be drawn, or a file that cannot be written; the error names the file.
    pub fn save(&self, path: &Path) -> Result<Tally> {
        self.draw().with_context(|| format!("cannot draw {}", path.display()))?.save(path)
    }

    /// Draws the sheet.
    ///
    /// # Errors
    /// No panels, a panel that is empty or does not fit its mask, a picture that would be too large.
    pub(crate) fn draw(&self) -> Result<Picture> {
        ensure!(self.panels().next().is_some(), "a sheet without panels");
        for panel in self.panels() {
            panel.check()?;
        }
        let side = self.side();
        let columns = self.columns(side);
        let bars = self.bars(&columns);
        let rows_top = MARGIN + if self.title.is_empty() { 0 } else { TITLE_HEIGHT };
        let rows_height: u32 = self.rows.iter().map(|row| row_height(row, side)).sum();
        let bars_top = rows_top + rows_height + BAR_GAP;
        let notes_top =
            bars_top + bars.iter().map(|bar| bar.top).max().unwrap_or(0) + colour_bar::HEIGHT + NOTE_GAP;
        // One line is kept for values that are not finite.
        let height = notes_top + NOTE_HEIGHT * (self.notes.len() as u32 + 1) + MARGIN / 2;
        let mut image = blank(self.width(&columns, &bars), height)?;

        let left = i64::from(MARGIN);
        Pen::bold(TITLE_SIZE, INK).write(
            &mut image,
            (left, i64::from(MARGIN) + 16),
            Align::Start,
            &self.title,
        );
        let mut tally = Tally::default();
        let mut top = rows_top;
        for row in &self.rows {
            let at = (left, i64::from(top) + 15);
            Pen::bold(ROW_TITLE_SIZE, INK).write(&mut image, at, Align::Start, &row.title);
            let panels_top = top + titles_height(row);
            for (index, (panel, column)) in row.panels.iter().zip(&columns).enumerate() {
                let at = (i64::from(column.left), i64::from(panels_top) - 8);
                Pen::regular(PANEL_TITLE_SIZE, INK).write(&mut image, at, Align::Start, &panel.title);
                tally += panel.paint(&mut image, column.left, panels_top, side);
                panel.first_axis(&mut image, column.left, panels_top, side);
                if shows_second_axis(row, index) {
                    panel.second_axis(&mut image, column.left, panels_top, side);
                }
            }
            top += row_height(row, side);
        }
        for bar in &bars {
            colour_bar::draw(&mut image, bar.scale, bar.left, bars_top + bar.top, bar.width);
        }

        let pen = Pen::regular(NOTE_SIZE, FAINT_INK);
        let mut baseline = i64::from(notes_top) + 14;
        if tally.not_finite > 0 {
            fill(&mut image, MARGIN, notes_top + 4, 11, 11, NOT_FINITE);
            let note = format!("{} values are not finite", tally.not_finite);
            pen.write(&mut image, (left + 18, baseline), Align::Start, &note);
            baseline += i64::from(NOTE_HEIGHT);
        }
        for note in &self.notes {
            pen.write(&mut image, (left, baseline), Align::Start, note);
            baseline += i64::from(NOTE_HEIGHT);
        }
        Ok(Picture { image, tally })
    }

    fn panels(&self) -> impl Iterator<Item = &Panel<'a>> {
        self.rows.iter().flat_map(|row| &row.panels)
    }

    /// Pixels a voxel.
    fn side(&self) -> u32 {
        let longest = self.panels().map(|panel| panel.values.dim().0.max(panel.values.dim().1)).max();
        let fitted =
            FITTED_SIDE / longest.map_or(1, |voxels| u32::try_from(voxels).unwrap_or(u32::MAX)).max(1);
        self.pixels_per_voxel.unwrap_or(fitted).max(1)
    }

    fn columns(&self, side: u32) -> Vec<Column> {
        let count = self.rows.iter().map(|row| row.panels.len()).max().unwrap_or(0);
        let mut columns = Vec::with_capacity(count);
        let mut right = MARGIN;
        for index in 0..count {
            let rows = || self.rows.iter().filter(|row| index < row.panels.len());
            let axis = rows()
                .filter(|row| shows_second_axis(row, index))
                .map(|row| row.panels[index].second_axis_room(side))
                .max();
            let width = rows().map(|row| panel_width(&row.panels[index], side)).max().unwrap_or(0);
            let gap = if index == 0 { 0 } else { COLUMN_GAP };
            let left = right + gap + axis.unwrap_or(0);
            columns.push(Column { left, width });
            right = left + width;
        }
        columns
    }

    /// One bar for each different scale, under the columns that use it; on a line of its own where it would overlap.
    fn bars(&self, columns: &[Column]) -> Vec<Bar<'_>> {
        let mut uses: Vec<(&Scale, usize, usize)> = Vec::new();
        for (index, panel) in self.rows.iter().flat_map(|row| row.panels.iter().enumerate()) {
            match uses.iter_mut().find(|(scale, ..)| **scale == panel.scale) {
                Some((_, first, last)) => {
                    *first = index.min(*first);
                    *last = index.max(*last);
                }
                None => uses.push((&panel.scale, index, index)),
            }
        }
        uses.sort_by_key(|&(_, first, _)| first);
        let mut bars: Vec<Bar<'_>> = Vec::with_capacity(uses.len());
        for (scale, first, last) in uses {
            let left = columns[first].left;
            let reach = columns[last].left + columns[last].width - left;
            let width = reach.min(WIDEST_BAR).max(colour_bar::least_width(scale));
            let top = match bars.last() {
                Some(bar) if left < bar.left + bar.width + COLUMN_GAP => bar.top + colour_bar::HEIGHT,
                Some(bar) => bar.top,
                None => 0,
            };
            bars.push(Bar { scale, left, top, width });
        }
        bars
    }

    fn width(&self, columns: &[Column], bars: &[Bar<'_>]) -> u32 {
        let columns = columns.iter().map(|column| column.left + column.width);
        // The last tick's number reaches a little beyond its bar.
        let bars = bars.iter().map(|bar| bar.left + bar.width + 12);
        let title = MARGIN + Pen::bold(TITLE_SIZE, INK).width(&self.title);
        let row_titles =
            self.rows.iter().map(|row| MARGIN + Pen::bold(ROW_TITLE_SIZE, INK).width(&row.title));
        let notes = self.notes.iter().map(|note| MARGIN + Pen::regular(NOTE_SIZE, INK).width(note));
        columns.chain(bars).chain(row_titles).chain(notes).max().unwrap_or(0).max(title) + MARGIN
    }
}

fn panel_width(panel: &Panel<'_>, side: u32) -> u32 {
    panel.size(side).0.max(Pen::regular(PANEL_TITLE_SIZE, INK).width(&panel.title))
}

/// A panel whose left neighbour has the same second axis needs none of its own.
fn shows_second_axis(row: &PanelRow<'_>, index: usize) -> bool {
    index == 0 || !row.panels[index].shares_second_axis(&row.panels[index - 1])
}

fn titles_height(row: &PanelRow<'_>) -> u32 {
    let row_title = if row.title.is_empty() { 0 } else { ROW_TITLE_HEIGHT };
    let panel_titles = row.panels.iter().any(|panel| !panel.title.is_empty());
    row_title + if panel_titles { PANEL_TITLE_HEIGHT } else { 0 }
}

fn row_height(row: &PanelRow<'_>, side: u32) -> u32 {
    let panels = row.panels.iter().map(|panel| panel.size(side).1).max().unwrap_or(0);
    titles_height(row) + panels + BELOW + ROW_GAP
}

#[cfg(test)]
mod tests {
    use ndarray::Array2;

    use super::*;
    use crate::picture::{Axes, PAPER};

    fn axes(second: &str) -> Axes {
        Axes { names: ["x".into(), second.into()], unit: "mm".into(), start: [-1.0, 0.0], pitch: 0.5 }
    }

    fn panel<'a>(values: &'a Array2<f32>, scale: &Scale, second: &str) -> Panel<'a> {
        let (title, values) = ("exact".into(), values.view());
        Panel { title, values, mask: None, scale: scale.clone(), axes: axes(second) }
    }

    fn sheet(rows: Vec<PanelRow<'_>>) -> PanelSheet<'_> {
        PanelSheet { title: String::new(), rows, notes: vec![], pixels_per_voxel: None }
    }

    #[test]
    fn pixels_a_voxel_fit_the_largest_panel_and_never_vanish() {
        let scale = Scale::measure(1.0, "CMF");
        for (voxels, expected) in [(61, 5), (29, 12), (500, 1)] {
            let values = Array2::zeros((3, voxels));
            let row = PanelRow { title: String::new(), panels: vec![panel(&values, &scale, "z")] };
            assert_eq!(sheet(vec![row]).side(), expected);
        }
    }

    #[test]
    fn equal_scales_share_a_bar_and_bars_do_not_overlap() {
        let values = Array2::from_elem((10, 20), 0.5);
        let measure = Scale::measure(1.0, "collision measure");
        let difference = Scale::difference(0.1, "learnt − exact");
        let row = || PanelRow {
            title: "θ = 24°".into(),
            panels: [&measure, &measure, &difference].map(|scale| panel(&values, scale, "z")).into(),
        };
        let sheet = sheet(vec![row(), row()]);
        let columns = sheet.columns(sheet.side());
        let bars = sheet.bars(&columns);
        assert_eq!(bars.len(), 2);
        assert!(bars[0].left + bars[0].width < bars[1].left || bars[0].top < bars[1].top);
        assert_eq!(bars[1].left, columns[2].left);
        assert!(columns[1].left - columns[0].left == columns[0].width + COLUMN_GAP, "one second axis a row");
    }

    #[test]
    fn another_second_axis_is_written_again() {
        let values = Array2::zeros((10, 20));
        let scale = Scale::measure(1.0, "");
        let panels = vec![panel(&values, &scale, "z"), panel(&values, &scale, "y")];
        let row = PanelRow { title: String::new(), panels };
        assert!(shows_second_axis(&row, 1));
    }

    #[test]
    fn a_sheet_counts_over_all_panels_and_saves() {
        let mut values = Array2::from_elem((10, 20), 2.0);
        values[[3, 4]] = f32::NAN;
        let scale = Scale::measure(1.0, "");
        let row = || PanelRow { title: String::new(), panels: vec![panel(&values, &scale, "z")] };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sheet.png");
        let tally = sheet(vec![row(), row()]).save(&path).unwrap();
        assert_eq!(tally, Tally { not_finite: 2, out_of_range: 2 * 199 });
        let image = image::open(&path).unwrap().to_rgb8();
        // Two voxels and the swatch of the note.
        let side = sheet(vec![row()]).side();
        let found = image.pixels().filter(|&&pixel| pixel == NOT_FINITE).count() as u32;
        assert_eq!(found, 2 * side * side + 121);
        assert_eq!(*image.get_pixel(0, image.height() - 1), PAPER);
    }

    #[test]
    fn an_empty_sheet_is_refused_with_the_file_named() {
        let message = format!("{:#}", sheet(vec![]).save(Path::new("slices.png")).unwrap_err());
        assert!(message.contains("slices.png"), "{message}");
    }
}
