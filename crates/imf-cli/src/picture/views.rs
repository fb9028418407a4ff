//! A sheet of pictures in rows, each with its name, and swatches below a row.

use std::path::Path;

use anyhow::Result;
use image::{Rgb, RgbImage};

use super::axis::{NAME_SIZE, TICK_SIZE};
use super::canvas::{FAINT_INK, INK, Lines, MARGIN, bold, on_canvas, save, text, write};
use super::chart::TITLE_SIZE;
use super::panel::show;
use super::sheet::{MIN_WIDTH, SWATCH};

const GAP: u32 = 16;
/// Room for a picture's name.
const MIN_COLUMN: u32 = 90;

pub(crate) type Swatches = Vec<(Rgb<u8>, String)>;

/// Pictures side by side.
pub(crate) struct ViewRow {
    /// Written above; may be empty.
    pub(crate) title: String,
    /// From left to right, each with its name.
    pub(crate) views: Vec<(String, RgbImage)>,
    /// Below, one to a line.
    pub(crate) swatches: Swatches,
}

/// A page of pictures.
pub(crate) struct ViewSheet {
    pub(crate) title: String,
    /// From top to bottom.
    pub(crate) rows: Vec<ViewRow>,
}

impl ViewSheet {
    /// Draws the sheet and writes it as a PNG file.
    pub(crate) fn save(&self, path: &Path) -> Result<()> {
        save(self.draw(), path)
    }

    fn draw(&self) -> Result<RgbImage> {
        // A column is as wide as its widest picture.
        let mut columns: Vec<u32> = Vec::new();
        for ((_, image), at) in self.rows.iter().flat_map(|row| row.views.iter().zip(0..)) {
            columns.resize(columns.len().max(at + 1), MIN_COLUMN);
            columns[at] = columns[at].max(image.width() + GAP);
        }
        let inside = columns.iter().sum::<u32>().max(MIN_WIDTH);
        let title = Lines::new(&self.title, bold(TITLE_SIZE), inside);
        let heads: Vec<Lines> =
            self.rows.iter().map(|row| Lines::new(&row.title, bold(17.0), inside)).collect();
        let name_height = TICK_SIZE as u32 + 6;
        let tall = |row: &ViewRow| row.views.iter().map(|(_, image)| image.height()).max().unwrap_or(0);
        let below = |row: &ViewRow| {
            row.swatches.len() as u32 * (SWATCH + 6) + if row.swatches.is_empty() { 0 } else { GAP }
        };
        let rows = self
            .rows
            .iter()
            .zip(&heads)
            .map(|(row, head)| head.height() + name_height + tall(row) + GAP + below(row));
        let height = title.height() + GAP + rows.sum::<u32>();
        on_canvas((inside + 2 * MARGIN, height + 2 * MARGIN), |area| {
            let mut top = MARGIN;
            title.draw(area, (MARGIN, top))?;
            top += title.height() + GAP;
            for (row, head) in self.rows.iter().zip(&heads) {
                head.draw(area, (MARGIN, top))?;
                top += head.height();
                let mut left = MARGIN;
                for ((name, image), column) in row.views.iter().zip(&columns) {
                    write(area, name, &text(TICK_SIZE, FAINT_INK), (left, top))?;
                    show(area, (left, top + name_height), image.clone())?;
                    left += column;
                }
                top += name_height + tall(row) + GAP;
                for (colour, name) in &row.swatches {
                    show(area, (MARGIN, top), RgbImage::from_pixel(SWATCH, SWATCH, *colour))?;
                    write(area, name, &text(NAME_SIZE, INK), (MARGIN + SWATCH + 6, top + 2))?;
                    top += SWATCH + 6;
                }
                top += if row.swatches.is_empty() { 0 } else { GAP };
            }
            Ok(())
        })
    }
}
