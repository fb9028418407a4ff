//! A level colour bar with ticks below and its label above.

use image::RgbImage;

use super::colour::Scale;
use super::text::{Align, Pen};
use super::ticks::{label, ticks};
use super::{FAINT_INK, INK, fill, frame};

/// Height of a bar with its label and its ticks, in pixels.
pub(super) const HEIGHT: u32 = 58;
/// The least width of a bar at which its ticks are legible, in pixels.
pub(super) const LEAST_WIDTH: u32 = 170;

const LABEL_SIZE: f32 = 13.0;
const TICK_SIZE: f32 = 12.0;
const BAR_TOP: u32 = 20;
const BAR_HEIGHT: u32 = 14;

/// Width a bar needs for its label.
pub(super) fn least_width(scale: &Scale) -> u32 {
    LEAST_WIDTH.max(Pen::regular(LABEL_SIZE, INK).width(scale.label()))
}

/// Draws the bar of `scale` with its upper left corner at (`left`, `top`).
pub(super) fn draw(image: &mut RgbImage, scale: &Scale, left: u32, top: u32, width: u32) {
    Pen::regular(LABEL_SIZE, INK).write(
        image,
        (i64::from(left), i64::from(top) + 13),
        Align::Start,
        scale.label(),
    );
    let (low, high) = scale.range();
    let bar_top = top + BAR_TOP;
    for column in 0..width {
        let place = (f64::from(column) + 0.5) / f64::from(width);
        let (colour, _) = scale.colour((low + place * (high - low)) as f32);
        fill(image, left + column, bar_top, 1, BAR_HEIGHT, colour);
    }
    frame(image, left, bar_top, width, BAR_HEIGHT, INK);

    let pen = Pen::regular(TICK_SIZE, FAINT_INK);
    let (values, decimals) = ticks(low, high, (width / 55).max(2) as usize);
    for value in values {
        let x = left + ((value - low) / (high - low) * f64::from(width - 1)).round() as u32;
        let bottom = bar_top + BAR_HEIGHT;
        fill(image, x, bottom + 1, 1, 4, INK);
        pen.write(image, (i64::from(x), i64::from(bottom) + 18), Align::Middle, &label(value, decimals));
    }
}
