//! Text in pictures: DejaVu Sans, carried in the binary (its free licence is LICENSE-FONT), with subpixel positions along
//! the line and baselines on whole pixels.

use std::sync::LazyLock;

use ab_glyph::{Font as _, FontRef, GlyphId, PxScale, ScaleFont as _, point};
use image::{Rgb, RgbImage};

static REGULAR: LazyLock<FontRef<'static>> = LazyLock::new(|| {
    FontRef::try_from_slice(dejavu::sans::regular()).expect("the embedded regular font is a font")
});
static BOLD: LazyLock<FontRef<'static>> = LazyLock::new(|| {
    FontRef::try_from_slice(dejavu::sans::bold()).expect("the embedded bold font is a font")
});

/// Where the given point lies along the text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Align {
    Start,
    Middle,
    End,
}

/// A face, a size and a colour.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pen {
    bold: bool,
    /// Size of the em square in pixels.
    size: f32,
    colour: Rgb<u8>,
}

impl Pen {
    /// The regular face.
    pub(super) fn regular(size: f32, colour: Rgb<u8>) -> Self {
        Self { bold: false, size, colour }
    }

    /// The bold face.
    pub(super) fn bold(size: f32, colour: Rgb<u8>) -> Self {
        Self { bold: true, size, colour }
    }

    /// Height of a digit in pixels: half of it below its middle puts text level with a tick.
    pub(super) fn digit_height(&self) -> f32 {
        // DejaVu Sans: 1493 of 2048 units.
        0.729 * self.size
    }

    /// Width of `text` in whole pixels.
    pub(super) fn width(&self, text: &str) -> u32 {
        self.place(text).1.ceil() as u32
    }

    /// Writes from left to right; `at` is on the baseline, in pixels from the upper left corner.
    pub(super) fn write(&self, image: &mut RgbImage, at: (i64, i64), align: Align, text: &str) {
        self.each_pixel(text, align, |along, below, coverage| {
            self.blend(image, at.0 + along, at.1 + below, coverage);
        });
    }

    /// Writes from the bottom upwards; `at` is on the baseline, which runs up at the text's right.
    pub(super) fn write_upwards(&self, image: &mut RgbImage, at: (i64, i64), align: Align, text: &str) {
        self.each_pixel(text, align, |along, below, coverage| {
            self.blend(image, at.0 + below, at.1 - along, coverage);
        });
    }

    fn font(&self) -> &'static FontRef<'static> {
        if self.bold { &BOLD } else { &REGULAR }
    }

    /// Glyphs with their offsets along the line, and the line's length.
    fn place(&self, text: &str) -> (Vec<(GlyphId, f32)>, f32) {
        let font = self.font().as_scaled(self.scale());
        let mut glyphs = Vec::with_capacity(text.len());
        let mut along = 0.0;
        let mut previous = None;
        for letter in text.chars() {
            let glyph = font.glyph_id(letter);
            if let Some(previous) = previous {
                along += font.kern(previous, glyph);
            }
            glyphs.push((glyph, along));
            along += font.h_advance(glyph);
            previous = Some(glyph);
        }
        (glyphs, along)
    }

    /// The library's scale is the height from descent to ascent, not the em square.
    fn scale(&self) -> PxScale {
        let font = self.font();
        let units = font.units_per_em().unwrap_or(2048.0);
        PxScale::from(self.size * font.height_unscaled() / units)
    }

    /// Calls `pixel` with the offset along and below the baseline and the coverage in (0, 1].
    fn each_pixel(&self, text: &str, align: Align, mut pixel: impl FnMut(i64, i64, f32)) {
        let (glyphs, length) = self.place(text);
        let start = match align {
            Align::Start => 0.0,
            Align::Middle => -length / 2.0,
            Align::End => -length,
        };
        for (id, along) in glyphs {
            let glyph = id.with_scale_and_position(self.scale(), point(start + along, 0.0));
            if let Some(outline) = self.font().outline_glyph(glyph) {
                let corner = outline.px_bounds().min;
                outline.draw(|x, y, coverage| {
                    if coverage > 0.0 {
                        let (x, y) = (i64::from(x), i64::from(y));
                        pixel(corner.x as i64 + x, corner.y as i64 + y, coverage.min(1.0));
                    }
                });
            }
        }
    }

    fn blend(&self, image: &mut RgbImage, x: i64, y: i64, coverage: f32) {
        let (Ok(x), Ok(y)) = (u32::try_from(x), u32::try_from(y)) else { return };
        if x >= image.width() || y >= image.height() {
            return;
        }
        let pixel = image.get_pixel_mut(x, y);
        for (channel, ink) in pixel.0.iter_mut().zip(self.colour.0) {
            let mixed = f32::from(*channel) + coverage * (f32::from(ink) - f32::from(*channel));
            *channel = mixed.round() as u8;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::{INK, PAPER};

    /// Columns and rows that hold ink: (left, right, top, bottom).
    fn inked(image: &RgbImage) -> (u32, u32, u32, u32) {
        let dark: Vec<_> = image.enumerate_pixels().filter(|(_, _, pixel)| pixel.0[0] < 128).collect();
        (
            dark.iter().map(|pixel| pixel.0).min().unwrap(),
            dark.iter().map(|pixel| pixel.0).max().unwrap(),
            dark.iter().map(|pixel| pixel.1).min().unwrap(),
            dark.iter().map(|pixel| pixel.1).max().unwrap(),
        )
    }

    #[test]
    fn alignment_places_the_text_about_its_point() {
        let pen = Pen::regular(20.0, INK);
        // Digits are as wide as each other: up to a fifth of the em square beside them is free.
        let bearing = 4;
        let width = i64::from(pen.width("0.25"));
        for (align, left) in
            [(Align::Start, 100), (Align::Middle, 100 - width / 2), (Align::End, 100 - width)]
        {
            let mut image = RgbImage::from_pixel(200, 60, PAPER);
            pen.write(&mut image, (100, 40), align, "0.25");
            let (first, last, top, bottom) = inked(&image);
            assert!((i64::from(first) - left).abs() <= bearing, "{align:?}: {first} for {left}");
            assert!((i64::from(last) - (left + width)).abs() <= bearing, "{align:?}: {last}");
            assert!(
                bottom < 41 && top.abs_diff(40 - pen.digit_height() as u32) <= 1,
                "{align:?}: {top}..{bottom}"
            );
        }
    }

    #[test]
    fn upward_text_is_the_same_text_turned() {
        let pen = Pen::bold(16.0, INK);
        let mut level = RgbImage::from_pixel(80, 80, PAPER);
        let mut upright = level.clone();
        pen.write(&mut level, (10, 40), Align::Start, "z [mm]");
        pen.write_upwards(&mut upright, (40, 69), Align::Start, "z [mm]");
        assert_eq!(image::imageops::rotate270(&level), upright);
    }

    #[test]
    fn every_letter_the_pictures_use_is_in_the_font() {
        for letter in "θφτ°−×³⁰¹²⁴⁵⁶⁷⁸⁹⁻·≤".chars() {
            for font in [&REGULAR, &BOLD] {
                assert_ne!(font.glyph_id(letter).0, 0, "{letter}");
            }
        }
    }

    #[test]
    fn text_beyond_the_edge_is_cut_off() {
        let mut image = RgbImage::from_pixel(10, 10, PAPER);
        Pen::regular(30.0, INK).write(&mut image, (-5, 3), Align::Start, "wide");
    }
}
