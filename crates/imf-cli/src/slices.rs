//! Slices of fields over a grid as pictures: where they are cut, the part in them, and sheets of mid-planes.
//!
//! A slice at right angles to an axis has the other two in their order: the first runs right, the second up.

use std::path::Path;

use anyhow::Result;
use glam::DVec3;
use imf_core::grid::Grid;
use imf_core::occupancy::Occupancy;
use imf_core::unit::LengthUnit;
use ndarray::{Array2, ArrayView3, Axis};

use crate::picture::{Axes, Mask, MaskStyle, Panel, PanelRow, PanelSheet, Scale};

/// Names of the world's axes.
const NAMES: [&str; 3] = ["x", "y", "z"];
/// By axis, those of a slice at right angles to it.
const OTHERS: [[usize; 2]; 3] = [[1, 2], [0, 2], [0, 1]];

/// Values that vary by less, summed over a layer, are equal but for rounding.
const NOISE: f64 = 1e-9;

/// The values (C-ordered over the grid) of the layer `index` at right angles to `axis`.
///
/// # Panics
/// If `values` has not the grid's length, or the layer does not exist.
pub fn slice(values: &[f32], grid: &Grid, axis: usize, index: usize) -> Array2<f32> {
    cut(values, grid, axis, index)
}

/// The solid voxels of a layer, for a panel's mask.
///
/// # Panics
/// If the layer does not exist.
pub fn mask(occupancy: &Occupancy, axis: usize, index: usize) -> Array2<u8> {
    cut(&occupancy.solid, &occupancy.grid, axis, index)
}

/// True where the voxel that holds a point of the world is solid.
pub(crate) fn is_solid(body: &Occupancy, point: DVec3) -> bool {
    body.grid.index_at(body.grid.continuous(point)).is_some_and(|voxel| body.solid[voxel] != 0)
}

/// Where a slice at right angles to `axis` lies in the world.
pub fn axes(grid: &Grid, unit: LengthUnit, axis: usize) -> Axes {
    let [first, second] = OTHERS[axis];
    Axes {
        names: [NAMES[first].into(), NAMES[second].into()],
        unit: unit.to_string(),
        start: [grid.origin[first], grid.origin[second]],
        pitch: grid.pitch,
    }
}

/// A panel of a slice with the part's outline.
pub fn panel<'a>(
    title: &str,
    values: &'a Array2<f32>,
    solid: &'a Array2<u8>,
    scale: &Scale,
    axes: &Axes,
) -> Panel<'a> {
    Panel {
        title: title.into(),
        values: values.view(),
        mask: Some(Mask { voxels: solid.view(), style: MaskStyle::Outline }),
        scale: scale.clone(),
        axes: axes.clone(),
    }
}

/// The layer in the middle of the grid.
pub fn middle(grid: &Grid, axis: usize) -> usize {
    grid.dims[axis] / 2
}

/// The layer at right angles to `axis` in which `values` outside the `hidden` voxels vary most: the sum of their distances from
/// their mean, first of the layers that have such voxels; `None` where they do not vary in any.
///
/// # Panics
/// If `values` has not the grid's length.
pub(crate) fn most_varied(values: &[f32], hidden: &Occupancy, axis: usize) -> Option<usize> {
    let grid = &hidden.grid;
    let spread = |index: usize| {
        let (layer, mask) = (slice(values, grid, axis, index), mask(hidden, axis, index));
        let shown =
            || layer.iter().zip(&mask).filter(|(_, hidden)| **hidden == 0).map(|(&v, _)| f64::from(v));
        let mean = shown().sum::<f64>() / shown().count().max(1) as f64;
        let spread = shown().map(|value| (value - mean).abs()).sum::<f64>();
        (spread > NOISE && mask.iter().any(|&hidden| hidden != 0), spread)
    };
    // Of equal ones that next to the middle.
    let from_middle = |index: &usize| index.abs_diff(middle(grid, axis));
    let layers = (0..grid.dims[axis]).map(|index| (index, spread(index)));
    let best = layers.max_by(|(a, (cut_a, spread_a)), (b, (cut_b, spread_b))| {
        cut_a.cmp(cut_b).then(spread_a.total_cmp(spread_b)).then(from_middle(b).cmp(&from_middle(a)))
    });
    best.filter(|(_, (_, spread))| *spread > NOISE).map(|(index, _)| index)
}

/// A layer in words: `y = 8.50 mm`, the height of its voxels' centres.
pub fn layer_title(grid: &Grid, unit: LengthUnit, axis: usize, index: usize) -> String {
    let mut voxel = [0; 3];
    voxel[axis] = index;
    let height = grid.centre(voxel)[axis];
    // A hundredth of a voxel is near enough.
    let decimals = (2.0 - grid.pitch.log10().floor()).clamp(0.0, 6.0) as usize;
    // No minus sign before zero.
    let height = if height.abs() < grid.pitch * 1e-3 { 0.0 } else { height };
    format!("{} = {height:.decimals$} {unit}", NAMES[axis])
}

/// The three mid-planes of one field, retained when the field itself is not.
#[derive(Clone, Debug)]
pub(crate) struct MidPlanes {
    /// Written above the row of the sheet; may be empty.
    pub(crate) title: String,
    slices: [Array2<f32>; 3],
}

impl MidPlanes {
    /// Cuts a field (C-ordered over the grid) in the middle of each axis.
    ///
    /// # Panics
    /// If `values` has not the grid's length.
    pub(crate) fn new(title: String, values: &[f32], grid: &Grid) -> Self {
        Self { title, slices: [0, 1, 2].map(|axis| slice(values, grid, axis, middle(grid, axis))) }
    }
}

/// A sheet of mid-planes: one row for each field, all in one scale.
pub(crate) struct MidPlaneSheet<'a> {
    pub(crate) title: String,
    /// Words beside the colour bar.
    pub(crate) label: &'a str,
    /// The part, on the grid of all fields.
    pub(crate) part: &'a Occupancy,
    /// How the part is marked; `None` leaves it out.
    pub(crate) style: Option<MaskStyle>,
    pub(crate) unit: LengthUnit,
    /// Whether 0 is free, and has a colour of its own.
    pub(crate) free: bool,
    /// Small print.
    pub(crate) notes: Vec<String>,
}

impl MidPlaneSheet<'_> {
    /// Draws the fields and writes a PNG file.
    pub(crate) fn save(&self, fields: &[MidPlanes], path: &Path) -> Result<()> {
        let grid = &self.part.grid;
        let masks = [0, 1, 2].map(|axis| mask(self.part, axis, middle(grid, axis)));
        let views: Vec<_> = fields.iter().flat_map(|f| &f.slices).map(|slice| slice.view()).collect();
        let scale = Scale::of_values(&views, self.label);
        let scale = if self.free { scale.with_free(0.0) } else { scale };
        let panel = |values, axis: usize| Panel {
            title: layer_title(grid, self.unit, axis, middle(grid, axis)),
            values,
            mask: self.style.map(|style| Mask { voxels: masks[axis].view(), style }),
            scale: scale.clone(),
            axes: axes(grid, self.unit, axis),
        };
        let rows = fields.iter().map(|field| PanelRow {
            title: field.title.clone(),
            // Slices with y or x to the right first: they share z upwards.
            panels: [0, 1, 2].map(|axis| panel(field.slices[axis].view(), axis)).into(),
        });
        PanelSheet {
            title: self.title.clone(),
            rows: rows.collect(),
            notes: self.notes.clone(),
            pixels_per_voxel: None,
        }
        .save(path)
    }
}

fn cut<T: Copy>(values: &[T], grid: &Grid, axis: usize, index: usize) -> Array2<T> {
    match ArrayView3::from_shape(grid.dims, values) {
        Ok(all) => all.index_axis(Axis(axis), index).to_owned(),
        Err(error) => panic!("one value for each voxel of the grid: {error}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid() -> Grid {
        Grid { origin: DVec3::new(-1.0, 10.0, 100.0), pitch: 0.5, dims: [3, 4, 5] }
    }

    #[test]
    fn slices_keep_the_other_axes_in_order() {
        let grid = grid();
        let values: Vec<f32> = (0..grid.len()).map(|i| i as f32).collect();
        let solid = (0..grid.len()).map(|i| (i % 7 == 0).into()).collect();
        let part = Occupancy { grid, solid };
        for axis in 0..3 {
            let [first, second] = OTHERS[axis];
            let (values, solid) = (slice(&values, &grid, axis, 2), mask(&part, axis, 2));
            assert_eq!(values.dim(), (grid.dims[first], grid.dims[second]));
            for ((a, b), &value) in values.indexed_iter() {
                let mut voxel = [2; 3];
                (voxel[first], voxel[second]) = (a, b);
                assert_eq!(value, grid.index(voxel) as f32);
                assert_eq!(solid[[a, b]], part.solid[grid.index(voxel)]);
            }
        }
    }

    #[test]
    fn the_most_varied_layer_is_found_outside_what_is_hidden() {
        let grid = grid();
        let mut hidden = Occupancy::empty(grid);
        let mut values = vec![0.5; grid.len()];
        assert_eq!(most_varied(&values, &hidden, 2), None);
        values[grid.index([1, 2, 0])] = 0.0;
        assert_eq!([0, 1, 2].map(|axis| most_varied(&values, &hidden, axis)), [Some(1), Some(2), Some(0)]);
        let loud = grid.index([0, 0, 4]);
        (values[loud], hidden.solid[loud]) = (9.0, 1);
        assert_eq!(most_varied(&values, &hidden, 2), Some(0));
    }

    #[test]
    fn axes_and_titles_follow_the_grid() {
        let y = axes(&grid(), LengthUnit::Inch, 1);
        assert_eq!((y.names, y.start), (["x".to_owned(), "z".to_owned()], [-1.0, 100.0]));
        assert_eq!((y.unit.as_str(), y.pitch), ("inch", 0.5));
        assert_eq!(layer_title(&grid(), LengthUnit::Mm, 1, middle(&grid(), 1)), "y = 11.250 mm");
    }

    #[test]
    fn a_sheet_of_mid_planes_is_written() {
        let grid = grid();
        let part = Occupancy { grid, solid: (0..grid.len()).map(|i| u8::from(i % 3 == 0)).collect() };
        let sheet = MidPlaneSheet {
            title: "field".into(),
            label: "CMF",
            part: &part,
            style: Some(MaskStyle::Outline),
            unit: LengthUnit::Mm,
            free: true,
            notes: vec![],
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("sheet.png");
        let field = MidPlanes::new("row".into(), &vec![0.25; grid.len()], &grid);
        sheet.save(&[field.clone(), field], &path).unwrap();
        assert!(image::open(&path).unwrap().width() > 100);
        assert!(sheet.save(&[], &path).is_err());
    }
}
