//! A sheet of paper for plotters to draw on, and text on it in DejaVu Sans, which the binary carries (its free licence is
//! LICENSE-FONT), so that pictures come out the same on a machine that has no fonts.

use std::io::{Cursor, Write as _};
use std::path::Path;
use std::sync::LazyLock;

use anyhow::{Context as _, Result, ensure};
use image::{ImageFormat, Rgb, RgbImage};
use imf_core::atomic_file::write_atomically;
use plotters::backend::BitMapBackend;
use plotters::coord::Shift;
use plotters::drawing::{DrawingArea, IntoDrawingArea as _};
use plotters::style::{FontDesc, FontFamily, FontStyle, RGBColor, TextStyle, register_font};

pub(super) const BACKGROUND: RGBColor = RGBColor(255, 255, 255);
/// Text and frames.
pub(super) const INK: RGBColor = RGBColor(38, 38, 38);
/// Text of less weight: ticks, notes.
pub(super) const FAINT_INK: RGBColor = RGBColor(96, 96, 96);
/// Distance of everything from the picture's edge, in pixels.
pub(super) const MARGIN: u32 = 28;
/// Longest side of a picture in pixels: what common viewers still open.
const LONGEST_SIDE: u32 = 16_384;

pub(super) type Area<'a> = DrawingArea<BitMapBackend<'a>, Shift>;

/// A sheet of paper of some width and height with what `draw` draws on it.
pub(super) fn on_canvas(
    (width, height): (u32, u32),
    draw: impl FnOnce(&Area<'_>) -> Result<()>,
) -> Result<RgbImage> {
    ensure!(
        width <= LONGEST_SIDE && height <= LONGEST_SIDE,
        "a picture of {width}×{height} pixels is too large (at most {LONGEST_SIDE} a side)"
    );
    let mut image = RgbImage::from_pixel(width, height, pixel(BACKGROUND));
    draw(&BitMapBackend::with_buffer(&mut image, (width, height)).into_drawing_area())?;
    Ok(image)
}

/// Writes what was drawn as a PNG file.
///
/// # Errors
/// A picture that could not be drawn, or a file that cannot be written; the error names the file.
pub(super) fn save(drawn: Result<RgbImage>, path: &Path) -> Result<()> {
    let image = drawn.with_context(|| format!("cannot draw {}", path.display()))?;
    let mut bytes = Cursor::new(Vec::new());
    image.write_to(&mut bytes, ImageFormat::Png)?;
    write_atomically(path, |file| file.write_all(bytes.get_ref())).map_err(Into::into)
}

pub(super) fn pixel(RGBColor(red, green, blue): RGBColor) -> Rgb<u8> {
    Rgb([red, green, blue])
}

static FONTS: LazyLock<()> = LazyLock::new(|| {
    for (style, bytes) in
        [(FontStyle::Normal, dejavu::sans::regular()), (FontStyle::Bold, dejavu::sans::bold())]
    {
        assert!(register_font("sans-serif", style, bytes).is_ok(), "the embedded font is a font");
    }
});

/// Text of a size in pixels, from the deepest to the highest letter.
pub(super) fn text(size: f64, colour: RGBColor) -> TextStyle<'static> {
    LazyLock::force(&FONTS);
    FontDesc::new(FontFamily::SansSerif, size, FontStyle::Normal).color(&colour)
}

pub(super) fn bold(size: f64) -> TextStyle<'static> {
    LazyLock::force(&FONTS);
    FontDesc::new(FontFamily::SansSerif, size, FontStyle::Bold).color(&INK)
}

/// Width of a text in pixels.
pub(super) fn width(text: &str, style: &TextStyle<'_>) -> u32 {
    style.font.box_size(text).map_or(0, |(width, _)| width + 1)
}

/// Writes a line with the upper left corner of its capitals at a point.
pub(super) fn write(area: &Area<'_>, text: &str, style: &TextStyle<'_>, at: (u32, u32)) -> Result<()> {
    // plotters writes an eighth of the size too high.
    let lower = style.font.get_size() / 8.0;
    Ok(area.draw_text(text, style, (at.0 as i32, at.1 as i32 + lower.round() as i32))?)
}

/// Text in as many lines as it needs to be no wider than its place.
pub(super) struct Lines {
    lines: Vec<String>,
    style: TextStyle<'static>,
}

impl Lines {
    /// Breaks a text between words, and a word that is wider than a line wherever it must.
    pub(super) fn new(text: &str, style: TextStyle<'static>, most: u32) -> Self {
        let mut lines: Vec<String> = Vec::new();
        for word in text.split_whitespace() {
            match lines.last_mut() {
                Some(line) if width(&format!("{line} {word}"), &style) <= most => {
                    line.push(' ');
                    line.push_str(word);
                }
                _ => lines.push(String::new()),
            }
            let Some(line) = lines.last_mut().filter(|line| line.is_empty()) else { continue };
            line.push_str(word);
            while let Some(line) = lines.last_mut().filter(|line| width(line, &style) > most) {
                let places = || line.char_indices().map(|(place, _)| place).skip(1);
                let fits = |&place: &usize| width(&line[..place], &style) <= most;
                // At least one letter goes on every line.
                let Some(place) = places().filter(fits).last().or_else(|| places().next()) else { break };
                let rest = line.split_off(place);
                lines.push(rest);
            }
        }
        Self { lines, style }
    }

    /// Width of the longest line in pixels; 0 of none.
    pub(super) fn width(&self) -> u32 {
        self.lines.iter().map(|line| width(line, &self.style)).max().unwrap_or(0)
    }

    fn line_height(&self) -> u32 {
        (1.2 * self.style.font.get_size()).round() as u32
    }

    /// Height of all lines in pixels; 0 of none.
    pub(super) fn height(&self) -> u32 {
        self.lines.len() as u32 * self.line_height()
    }

    /// Writes the lines with the upper left corner at a point.
    pub(super) fn draw(&self, area: &Area<'_>, (left, top): (u32, u32)) -> Result<()> {
        let mut rows = self.lines.iter().zip(0..);
        rows.try_for_each(|(line, row)| {
            write(area, line, &self.style, (left, top + row * self.line_height()))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_saved_picture_decodes_to_the_same_pixels_and_an_unwritable_file_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture.png");
        let draw = |area: &Area<'_>| write(area, "0.25", &bold(20.0), (2, 1));
        let image = on_canvas((90, 30), draw).unwrap();
        save(Ok(image.clone()), &path).unwrap();
        assert_eq!(image::open(&path).unwrap().to_rgb8(), image);
        assert!(image.pixels().any(|&found| found == pixel(INK)));
        assert_eq!(*image.get_pixel(0, 0), pixel(BACKGROUND));
        let missing = folder.path().join("missing").join("picture.png");
        let message = format!("{:#}", save(Ok(image), &missing).unwrap_err());
        assert!(message.contains("picture.png"), "{message}");
        assert!(on_canvas((LONGEST_SIDE + 1, 1), |_| Ok(())).is_err());
    }

    #[test]
    fn long_text_is_broken_between_words() {
        let title = "minimum overlap over ten thousand orientations of a bracket with a long name";
        let lines = Lines::new(title, bold(20.0), 200);
        assert!(lines.lines.len() > 2 && lines.lines.iter().all(|line| width(line, &lines.style) <= 200));
        assert_eq!(lines.lines.join(" "), title);
        assert_eq!(Lines::new("", bold(20.0), 200).height(), 0);
        let lines =
            Lines::new("of bracket_revision_17_without_any_space_in_its_name.obj again", bold(20.0), 200);
        assert!(lines.width() <= 200 && lines.lines.len() > 3, "{:?}", lines.lines);
    }
}
