//! One slice of a field: its voxels as squares, the part over them, a frame and axes in the mesh's unit.

use anyhow::{Result, ensure};
use image::{Rgb, RgbImage};
use ndarray::ArrayView2;

use super::colour::Scale;
use super::text::{Align, Pen};
use super::ticks::{label, ticks};
use super::{FAINT_INK, INK, Tally, fill, frame};

/// Room below a panel for ticks and the name of its first axis, in pixels.
pub(super) const BELOW: u32 = 42;

const TICK_SIZE: f32 = 12.0;
const NAME_SIZE: f32 = 13.0;
const TICK_LENGTH: u32 = 4;
/// Least distances of numbers along the axes, in pixels.
const APART_RIGHT: u32 = 48;
const APART_UP: u32 = 36;
const PART_COLOUR: Rgb<u8> = Rgb([158, 158, 158]);

/// Where a slice lies in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct Axes {
    /// Names of the axes to the right and upwards.
    pub names: [String; 2],
    /// Unit of the mesh, for example "mm".
    pub unit: String,
    /// Lower corner of voxel (0, 0) in `unit`.
    pub start: [f64; 2],
    /// Side of a voxel in `unit`.
    pub pitch: f64,
}

/// How a mask lies over the values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MaskStyle {
    /// Its outline; the values inside stay visible.
    Outline,
    /// A flat grey that hides the values inside, which then count in no tally.
    Fill,
}

/// Voxels to mark, the part's as a rule: those that are not 0.
#[derive(Clone, Copy, Debug)]
pub struct Mask<'a> {
    /// Same shape as the panel's values.
    pub voxels: ArrayView2<'a, u8>,
    /// How they are marked.
    pub style: MaskStyle,
}

/// One slice with what belongs to it.
#[derive(Clone, Debug)]
pub struct Panel<'a> {
    /// Written above; may be empty.
    pub title: String,
    /// Values at voxel centres: first axis to the right, second upwards.
    pub values: ArrayView2<'a, f32>,
    /// The part, if it shall be seen.
    pub mask: Option<Mask<'a>>,
    /// Colours.
    pub scale: Scale,
    /// Where the slice lies.
    pub axes: Axes,
}

impl Panel<'_> {
    /// Checks what drawing relies on.
    ///
    /// # Errors
    /// An empty slice, a mask of another shape, a pitch that is not positive.
    pub(super) fn check(&self) -> Result<()> {
        let (title, shape) = (&self.title, self.values.dim());
        ensure!(!self.values.is_empty(), "panel \"{title}\" has no values ({}×{})", shape.0, shape.1);
        if let Some(mask) = &self.mask {
            let other = mask.voxels.dim();
            ensure!(
                other == shape,
                "panel \"{title}\": the mask has {}×{} voxels, the values {}×{}",
                other.0,
                other.1,
                shape.0,
                shape.1
            );
        }
        ensure!(
            self.axes.pitch.is_finite() && self.axes.pitch > 0.0,
            "panel \"{title}\": pitch {}",
            self.axes.pitch
        );
        Ok(())
    }

    /// True if the second axis reads the same as that of `other`.
    pub(super) fn shares_second_axis(&self, other: &Self) -> bool {
        let (one, two) = (&self.axes, &other.axes);
        self.values.dim().1 == other.values.dim().1
            && one.names[1] == two.names[1]
            && one.unit == two.unit
            && one.start[1] == two.start[1]
            && one.pitch == two.pitch
    }

    /// Width and height in pixels, without axes, with `side` pixels a voxel.
    pub(super) fn size(&self, side: u32) -> (u32, u32) {
        let (columns, rows) = self.values.dim();
        (columns as u32 * side, rows as u32 * side)
    }

    /// Draws values, mask and frame with the upper left corner at (`left`, `top`).
    pub(super) fn paint(&self, image: &mut RgbImage, left: u32, top: u32, side: u32) -> Tally {
        let (width, height) = self.size(side);
        let corner =
            |column: usize, row: usize| (left + column as u32 * side, top + height - (row as u32 + 1) * side);
        let hidden = |column, row| {
            self.mask.is_some_and(|mask| mask.style == MaskStyle::Fill && mask.voxels[[column, row]] != 0)
        };
        let mut tally = Tally::default();
        for ((column, row), &value) in self.values.indexed_iter() {
            let (x, y) = corner(column, row);
            let colour = if hidden(column, row) {
                PART_COLOUR
            } else {
                let (colour, counted) = self.scale.colour(value);
                tally += counted;
                colour
            };
            fill(image, x, y, side, side, colour);
        }
        if let Some(Mask { voxels, style: MaskStyle::Outline }) = &self.mask {
            self.outline(image, voxels, side, corner);
        }
        frame(image, left, top, width, height, INK);
        tally
    }

    /// Lines on those edges of marked voxels beyond which no marked voxel lies.
    fn outline(
        &self,
        image: &mut RgbImage,
        voxels: &ArrayView2<'_, u8>,
        side: u32,
        corner: impl Fn(usize, usize) -> (u32, u32),
    ) {
        let line = if side < 5 { 1 } else { 2 };
        let colour = self.scale.outline();
        let marked = |column: Option<usize>, row: Option<usize>| {
            column.zip(row).and_then(|at| voxels.get(at)).is_some_and(|&voxel| voxel != 0)
        };
        for ((column, row), _) in voxels.indexed_iter().filter(|&(_, &voxel)| voxel != 0) {
            let (x, y) = corner(column, row);
            let (here, there) = (Some(column), Some(row));
            if !marked(column.checked_sub(1), there) {
                fill(image, x, y, line, side, colour);
            }
            if !marked(Some(column + 1), there) {
                fill(image, x + side - line, y, line, side, colour);
            }
            if !marked(here, Some(row + 1)) {
                fill(image, x, y, side, line, colour);
            }
            if !marked(here, row.checked_sub(1)) {
                fill(image, x, y + side - line, side, line, colour);
            }
        }
    }

    /// Ticks, numbers and name of the first axis, below a panel painted at (`left`, `top`).
    pub(super) fn first_axis(&self, image: &mut RgbImage, left: u32, top: u32, side: u32) {
        let (width, height) = self.size(side);
        let bottom = top + height;
        let pen = Pen::regular(TICK_SIZE, FAINT_INK);
        let (values, decimals) = self.axis_ticks(0, width, APART_RIGHT);
        for (value, offset) in values {
            let x = left + offset;
            fill(image, x, bottom + 1, 1, TICK_LENGTH, INK);
            let at = (i64::from(x), i64::from(bottom + TICK_LENGTH) + 13);
            pen.write(image, at, Align::Middle, &label(value, decimals));
        }
        let at = (i64::from(left + width / 2), i64::from(bottom + BELOW) - 7);
        Pen::regular(NAME_SIZE, INK).write(image, at, Align::Middle, &self.axis_name(0));
    }

    /// Room at the left of a panel for ticks, numbers and name of its second axis, in pixels.
    pub(super) fn second_axis_room(&self, side: u32) -> u32 {
        let pen = Pen::regular(TICK_SIZE, FAINT_INK);
        let (values, decimals) = self.axis_ticks(1, self.size(side).1, APART_UP);
        let numbers = values.into_iter().map(|(value, _)| pen.width(&label(value, decimals)));
        numbers.max().unwrap_or(0) + TICK_LENGTH + 28
    }

    /// Ticks, numbers and name of the second axis, at the left of a panel painted at (`left`, `top`).
    pub(super) fn second_axis(&self, image: &mut RgbImage, left: u32, top: u32, side: u32) {
        let (_, height) = self.size(side);
        let pen = Pen::regular(TICK_SIZE, FAINT_INK);
        let lower = (pen.digit_height() / 2.0).round() as i64;
        let (values, decimals) = self.axis_ticks(1, height, APART_UP);
        for (value, offset) in values {
            let y = top + height - 1 - offset;
            fill(image, left - 1 - TICK_LENGTH, y, TICK_LENGTH, 1, INK);
            let at = (i64::from(left - TICK_LENGTH) - 4, i64::from(y) + lower);
            pen.write(image, at, Align::End, &label(value, decimals));
        }
        let at = (i64::from(left - self.second_axis_room(side)) + 14, i64::from(top + height / 2));
        Pen::regular(NAME_SIZE, INK).write_upwards(image, at, Align::Middle, &self.axis_name(1));
    }

    /// Values with their pixels from the axis' start, about one every `apart` pixels.
    fn axis_ticks(&self, axis: usize, length: u32, apart: u32) -> (Vec<(f64, u32)>, usize) {
        let low = self.axes.start[axis];
        let span = self.axes.pitch * self.values.shape()[axis] as f64;
        let (values, decimals) = ticks(low, low + span, (length / apart).max(2) as usize);
        let offset = |value: f64| ((value - low) / span * f64::from(length - 1)).round() as u32;
        (values.into_iter().map(|value| (value, offset(value))).collect(), decimals)
    }

    fn axis_name(&self, axis: usize) -> String {
        format!("{} [{}]", self.axes.names[axis], self.axes.unit)
    }
}

#[cfg(test)]
mod tests {
    use ndarray::{Array2, array};

    use super::*;
    use crate::picture::blank;

    fn panel(values: &Array2<f32>) -> Panel<'_> {
        Panel {
            title: "section".into(),
            values: values.view(),
            mask: None,
            scale: Scale::measure(1.0, ""),
            axes: Axes { names: ["x".into(), "z".into()], unit: "mm".into(), start: [0.0; 2], pitch: 0.5 },
        }
    }

    #[test]
    fn the_first_axis_runs_right_and_the_second_up() {
        let values = array![[0.0f32, 0.25], [0.5, 0.75], [1.0, f32::NAN]];
        let panel = panel(&values);
        let mut image = blank(40, 40).unwrap();
        let tally = panel.paint(&mut image, 10, 20, 4);
        assert_eq!(panel.size(4), (12, 8));
        assert_eq!(tally, Tally { not_finite: 1, out_of_range: 0 });
        for ((column, row), &value) in values.indexed_iter() {
            let expected = panel.scale.colour(value).0;
            let (left, top) = (10 + 4 * column as u32, 24 - 4 * row as u32);
            for (x, y) in [(left, top), (left + 3, top), (left, top + 3), (left + 3, top + 3)] {
                assert_eq!(*image.get_pixel(x, y), expected, "voxel {column}, {row}");
            }
        }
        assert_eq!(*image.get_pixel(9, 22), INK, "frame");
    }

    #[test]
    fn a_filled_mask_hides_values_and_their_tally() {
        let (values, voxels) = (array![[f32::NAN, 9.0], [0.5, 0.5]], array![[1u8, 0], [0, 0]]);
        let mut panel = panel(&values);
        panel.mask = Some(Mask { voxels: voxels.view(), style: MaskStyle::Fill });
        let mut image = blank(20, 20).unwrap();
        assert_eq!(panel.paint(&mut image, 2, 2, 3), Tally { not_finite: 0, out_of_range: 1 });
        assert_eq!(*image.get_pixel(3, 6), PART_COLOUR);
    }

    #[test]
    fn an_outline_follows_the_edge_of_the_mask() {
        let values = Array2::<f32>::zeros((4, 4));
        let mut voxels = Array2::<u8>::zeros((4, 4));
        voxels.slice_mut(ndarray::s![1..4, 1..3]).fill(1);
        let mut panel = panel(&values);
        panel.mask = Some(Mask { voxels: voxels.view(), style: MaskStyle::Outline });
        let mut image = blank(30, 30).unwrap();
        panel.paint(&mut image, 1, 1, 6);
        let (line, inside) = (panel.scale.outline(), panel.scale.colour(0.0).0);
        assert_eq!(*image.get_pixel(7, 10), line, "left edge of the mask");
        assert_eq!(*image.get_pixel(6, 10), inside, "outside of it");
        assert_eq!(*image.get_pixel(13, 12), inside, "no line between marked voxels");
        assert_eq!(*image.get_pixel(24, 10), line, "right edge, on the edge of the slice");
    }

    #[test]
    fn what_does_not_fit_is_refused_by_name() {
        let (values, voxels) = (Array2::<f32>::zeros((3, 2)), Array2::<u8>::zeros((2, 3)));
        let mut panel = panel(&values);
        panel.mask = Some(Mask { voxels: voxels.view(), style: MaskStyle::Fill });
        let message = panel.check().unwrap_err().to_string();
        assert!(message.contains("2×3") && message.contains("section"), "{message}");
        panel.mask = None;
        panel.axes.pitch = 0.0;
        assert!(panel.check().is_err());
        let empty = Array2::<f32>::zeros((0, 2));
        assert!(Panel { values: empty.view(), ..panel }.check().is_err());
    }
}
