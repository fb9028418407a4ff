//! A level colour bar with ticks below and its label above; of classes, a swatch each with its name.

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

/// Side of a class's swatch, and the room between it, its name and the next.
const SWATCH: u32 = 14;
const SWATCH_GAP: u32 = 6;

/// Width a bar needs for its label, or for the names of its classes.
pub(super) fn least_width(scale: &Scale) -> u32 {
    let pen = Pen::regular(LABEL_SIZE, INK);
    let classes = scale.class_names().iter().map(|name| SWATCH + 3 * SWATCH_GAP + pen.width(name)).sum();
    LEAST_WIDTH.max(classes).max(Pen::regular(LABEL_SIZE, INK).width(scale.label()))
}

/// Draws the bar of `scale` with its upper left corner at (`left`, `top`).
pub(super) fn draw(image: &mut RgbImage, scale: &Scale, left: u32, top: u32, width: u32) {
    if !scale.class_names().is_empty() {
        return draw_classes(image, scale, left, top);
    }
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

fn draw_classes(image: &mut RgbImage, scale: &Scale, mut left: u32, top: u32) {
    let pen = Pen::regular(LABEL_SIZE, INK);
    for (class, name) in scale.class_names().iter().enumerate() {
        fill(image, left, top + BAR_TOP, SWATCH, SWATCH, scale.colour(class as f32).0);
        frame(image, left, top + BAR_TOP, SWATCH, SWATCH, INK);
        left += SWATCH + SWATCH_GAP;
        pen.write(image, (i64::from(left), i64::from(top + BAR_TOP) + 12), Align::Start, name);
        left += pen.width(name) + 2 * SWATCH_GAP;
    }
}
