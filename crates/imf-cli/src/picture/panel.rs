//! One slice of a field: its voxels as squares, the part over them, a frame and axes in the mesh's unit.

use anyhow::{Context as _, Result};
use image::{Rgb, RgbImage};
use ndarray::ArrayView2;
use plotters::element::{BitMapElement, Rectangle};

use super::axis::{Axis, BELOW, NAME_SIZE, plot};
use super::canvas::{Area, INK, Lines, text};
use super::colour::Scale;

/// Room between a panel and its title.
const ABOVE: u32 = 5;
/// Titles are broken where they are wider than their panel, but not more than that.
const MIN_TITLE: u32 = 180;
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
    /// Values that are shown and are not finite.
    pub(super) fn not_finite(&self) -> usize {
        let shown = |(at, value): &((usize, usize), &f32)| !value.is_finite() && !self.hides(*at);
        self.values.indexed_iter().filter(shown).count()
    }

    fn hides(&self, at: (usize, usize)) -> bool {
        self.mask.is_some_and(|mask| mask.style == MaskStyle::Fill && mask.voxels[at] != 0)
    }

    /// Values and mask, with `side` pixels a voxel.
    fn image(&self, side: u32) -> RgbImage {
        let (columns, rows) = self.values.dim();
        let mut image = RgbImage::new(columns as u32 * side, rows as u32 * side);
        for ((column, row), &value) in self.values.indexed_iter() {
            let hidden = self.hides((column, row));
            let colour = if hidden { PART_COLOUR } else { self.scale.colour(value) };
            let corner = corner(&image, (column, row), side);
            fill(&mut image, corner, [side, side], colour);
        }
        if let Some(Mask { voxels, style: MaskStyle::Outline }) = &self.mask {
            self.outline(&mut image, voxels, side);
        }
        image
    }

    /// Lines on those edges of marked voxels beyond which no marked voxel lies.
    fn outline(&self, image: &mut RgbImage, voxels: &ArrayView2<'_, u8>, side: u32) {
        let line = if side < 5 { 1 } else { 2 };
        let far = side - line;
        // Beside voxel 0 there is none.
        let marked = |column: usize, row: usize| voxels.get((column, row)).is_some_and(|&voxel| voxel != 0);
        for ((column, row), _) in voxels.indexed_iter().filter(|&(_, &voxel)| voxel != 0) {
            let [x, y] = corner(image, (column, row), side);
            for (beyond, corner, size) in [
                (marked(column.wrapping_sub(1), row), [x, y], [line, side]),
                (marked(column + 1, row), [x + far, y], [line, side]),
                (marked(column, row + 1), [x, y], [side, line]),
                (marked(column, row.wrapping_sub(1)), [x, y + far], [side, line]),
            ] {
                if !beyond {
                    fill(image, corner, size, self.scale.outline());
                }
            }
        }
    }

    /// The axes to the right and upwards, numbers about 48 and 36 pixels apart.
    fn axes(&self, side: u32) -> [Axis; 2] {
        [(0, 48), (1, 36)].map(|(axis, apart)| {
            let (start, voxels) = (self.axes.start[axis], self.values.shape()[axis]);
            let most = (voxels as u32 * side / apart).max(2) as usize;
            Axis::linear(start, start + self.axes.pitch * voxels as f64, most)
        })
    }

    /// Room at the left of the values for ticks, numbers and name of the second axis.
    fn room(&self, side: u32) -> u32 {
        self.axes(side)[1].room()
    }

    fn title(&self, side: u32) -> Lines {
        let most = (self.values.dim().0 as u32 * side).max(MIN_TITLE);
        Lines::new(&self.title, text(NAME_SIZE, INK), most)
    }

    /// Height of the title in pixels, with `side` pixels a voxel.
    pub(super) fn above(&self, side: u32) -> u32 {
        self.title(side).height() + ABOVE
    }

    /// Width, and height below the title, in pixels with axes.
    pub(super) fn size(&self, side: u32) -> (u32, u32) {
        let (columns, rows) = self.values.dim();
        (self.room(side) + self.title(side).width().max(columns as u32 * side), rows as u32 * side + BELOW)
    }

    /// Draws title, values, mask, frame and axes, the upper left corner of what is below the title at a point.
    pub(super) fn draw(&self, area: &Area<'_>, (left, top): (u32, u32), side: u32) -> Result<()> {
        let image = self.image(side);
        let ((width, height), room) = (image.dimensions(), self.room(side));
        self.title(side).draw(area, (left + room, top - self.above(side)))?;
        let [first, second] = [0, 1].map(|axis| format!("{} [{}]", self.axes.names[axis], self.axes.unit));
        let whole = area.clone().shrink((left, top), (room + width, height + BELOW));
        plot(&whole, [room, BELOW], self.axes(side), [&first, &second], false)?;
        show(area, (left + room, top), image)
    }
}

/// Puts an image on the paper, with a frame around it.
pub(super) fn show(area: &Area<'_>, (left, top): (u32, u32), image: RgbImage) -> Result<()> {
    let ((left, top), (width, height)) = ((left as i32, top as i32), image.dimensions());
    let bitmap = BitMapElement::with_owned_buffer((left, top), (width, height), image.into_raw());
    area.draw(&bitmap.context("an image of another size")?)?;
    let corners = [(left - 1, top - 1), (left + width as i32, top + height as i32)];
    Ok(area.draw(&Rectangle::new(corners, INK))?)
}

/// Upper left corner of a voxel.
fn corner(image: &RgbImage, (column, row): (usize, usize), side: u32) -> [u32; 2] {
    [column as u32 * side, image.height() - (row as u32 + 1) * side]
}

fn fill(image: &mut RgbImage, [left, top]: [u32; 2], [width, height]: [u32; 2], colour: Rgb<u8>) {
    for y in top..top + height {
        for x in left..left + width {
            image.put_pixel(x, y, colour);
        }
    }
}

#[cfg(test)]
mod tests {
    use ndarray::{Array2, array};

    use super::*;
    use crate::picture::canvas::{on_canvas, pixel};

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
        let image = panel.image(4);
        assert_eq!(image.dimensions(), (12, 8));
        for ((column, row), &value) in values.indexed_iter() {
            let expected = panel.scale.colour(value);
            let (left, top) = (4 * column as u32, 4 - 4 * row as u32);
            for (x, y) in [(left, top), (left + 3, top), (left, top + 3), (left + 3, top + 3)] {
                assert_eq!(*image.get_pixel(x, y), expected, "voxel {column}, {row}");
            }
        }
        let (room, above, (width, height)) = (panel.room(4), panel.above(4), panel.size(4));
        let drawn = on_canvas((width, above + height), |area| panel.draw(area, (0, above), 4)).unwrap();
        assert_eq!(image::imageops::crop_imm(&drawn, room, above, 12, 8).to_image(), image);
        assert_eq!(*drawn.get_pixel(room - 1, above + 2), pixel(INK), "frame");
    }

    #[test]
    fn a_filled_mask_hides_values() {
        let (values, voxels) = (array![[f32::NAN, 9.0], [0.5, 0.5]], array![[1u8, 0], [0, 0]]);
        let mut panel = panel(&values);
        panel.mask = Some(Mask { voxels: voxels.view(), style: MaskStyle::Fill });
        let image = panel.image(3);
        assert_eq!(panel.not_finite(), 0);
        assert_eq!(*image.get_pixel(1, 4), PART_COLOUR);
    }

    #[test]
    fn an_outline_follows_the_edge_of_the_mask() {
        let values = Array2::<f32>::zeros((4, 4));
        let mut voxels = Array2::<u8>::zeros((4, 4));
        voxels.slice_mut(ndarray::s![1..4, 1..3]).fill(1);
        let mut panel = panel(&values);
        panel.mask = Some(Mask { voxels: voxels.view(), style: MaskStyle::Outline });
        let image = panel.image(6);
        let (line, inside) = (panel.scale.outline(), panel.scale.colour(0.0));
        assert_eq!(*image.get_pixel(6, 9), line, "left edge of the mask");
        assert_eq!(*image.get_pixel(5, 9), inside, "outside of it");
        assert_eq!(*image.get_pixel(12, 11), inside, "no line between marked voxels");
        assert_eq!(*image.get_pixel(23, 9), line, "right edge, on the edge of the slice");
    }
}
