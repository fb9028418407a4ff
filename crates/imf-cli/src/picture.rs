//! Pictures: slices of fields side by side, curves and bars, as PNG files.
//!
//! Everything is drawn into an RGB image in memory by this process alone: the font is part of the binary, so pictures
//! come out the same on a machine that has no fonts. Arrays are drawn with their first axis to the right and their
//! second upwards, one square of whole pixels for each voxel.

mod axis;
mod bars;
mod chart;
mod colour;
mod colour_bar;
mod panel;
mod sheet;
mod text;
mod ticks;

use std::io::Cursor;
use std::path::Path;

use anyhow::{Context as _, Result, ensure};
use image::{ImageFormat, Rgb, RgbImage};

pub use axis::AxisScale;
pub use bars::{Bar, BarChart};
pub use chart::{Chart, Series};
pub use colour::Scale;
pub use panel::{Axes, Mask, MaskStyle, Panel};
pub use sheet::{PanelRow, PanelSheet};

/// Background of every picture.
const PAPER: Rgb<u8> = Rgb([255, 255, 255]);
/// Text and frames.
const INK: Rgb<u8> = Rgb([38, 38, 38]);
/// Text of less weight: ticks, notes.
const FAINT_INK: Rgb<u8> = Rgb([96, 96, 96]);
/// Distance of everything from the picture's edge, in pixels.
const MARGIN: u32 = 28;
/// Longest side of a picture in pixels: what common viewers still open.
const LONGEST_SIDE: u32 = 16_384;

/// What a picture could not show as it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Values that are not finite: drawn in a colour of their own, or left out of a curve.
    pub(crate) not_finite: usize,
    /// Values outside the scale, drawn in the colour at its end, or without a place on a logarithmic axis.
    pub(crate) out_of_range: usize,
}

impl std::ops::AddAssign for Tally {
    fn add_assign(&mut self, other: Self) {
        self.not_finite += other.not_finite;
        self.out_of_range += other.out_of_range;
    }
}

/// An image in memory before it is written.
#[derive(Clone, Debug)]
pub(crate) struct Picture {
    /// The pixels.
    pub(crate) image: RgbImage,
    /// What is not shown as it is.
    pub(crate) tally: Tally,
}

impl Picture {
    /// Writes a PNG file and gives back the tally.
    ///
    /// # Errors
    /// A file that cannot be written; the error names it.
    pub(crate) fn save(&self, path: &Path) -> Result<Tally> {
        let mut bytes = Cursor::new(Vec::new());
        self.image
            .write_to(&mut bytes, ImageFormat::Png)
            .with_context(|| format!("cannot encode the picture {}", path.display()))?;
        std::fs::write(path, bytes.into_inner())
            .with_context(|| format!("cannot write the picture {}", path.display()))?;
        Ok(self.tally)
    }
}

/// An empty sheet of paper.
///
/// # Errors
/// A side longer than [`LONGEST_SIDE`].
fn blank(width: u32, height: u32) -> Result<RgbImage> {
    ensure!(
        width <= LONGEST_SIDE && height <= LONGEST_SIDE,
        "a picture of {width}×{height} pixels is too large (at most {LONGEST_SIDE} a side)"
    );
    Ok(RgbImage::from_pixel(width, height, PAPER))
}

/// Fills the part of a rectangle that lies on the image.
fn fill(image: &mut RgbImage, left: u32, top: u32, width: u32, height: u32, colour: Rgb<u8>) {
    for y in top..(top + height).min(image.height()) {
        for x in left..(left + width).min(image.width()) {
            image.put_pixel(x, y, colour);
        }
    }
}

/// Draws a frame of one pixel around, not over, a rectangle.
fn frame(image: &mut RgbImage, left: u32, top: u32, width: u32, height: u32, colour: Rgb<u8>) {
    fill(image, left - 1, top - 1, width + 2, 1, colour);
    fill(image, left - 1, top + height, width + 2, 1, colour);
    fill(image, left - 1, top, 1, height, colour);
    fill(image, left + width, top, 1, height, colour);
}

#[cfg(test)]
mod examples;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_saved_picture_decodes_to_the_same_pixels() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture.png");
        let mut image = blank(7, 5).unwrap();
        fill(&mut image, 2, 1, 9, 2, INK);
        Picture { image: image.clone(), tally: Tally::default() }.save(&path).unwrap();
        assert_eq!(image::open(&path).unwrap().to_rgb8(), image);
        assert_eq!(*image.get_pixel(6, 2), INK);
        assert_eq!(*image.get_pixel(1, 1), PAPER);
    }

    #[test]
    fn an_unwritable_file_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("missing").join("picture.png");
        let picture = Picture { image: blank(1, 1).unwrap(), tally: Tally::default() };
        let message = format!("{:#}", picture.save(&path).unwrap_err());
        assert!(message.contains("picture.png"), "{message}");
    }

    #[test]
    fn an_absurd_size_is_refused() {
        assert!(blank(LONGEST_SIDE + 1, 1).is_err());
    }
}
