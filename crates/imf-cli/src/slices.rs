//! Slices of fields over a grid as panels.

use imf_core::grid::Grid;
use imf_core::occupancy::Occupancy;
use ndarray::{Array2, ArrayView3, Axis};

use crate::picture::{Axes, Mask, MaskStyle, Panel, Scale};

/// The slice of a C-ordered field where the voxel index along `axis` is `index`; the other two axes in order.
pub(crate) fn slice(values: &[f32], grid: &Grid, axis: usize, index: usize) -> Array2<f32> {
    cut(values, grid, axis, index)
}

/// The same of the obstacle's voxels.
pub(crate) fn mask(obstacle: &Occupancy, axis: usize, index: usize) -> Array2<u8> {
    cut(&obstacle.solid, &obstacle.grid, axis, index)
}

fn cut<T: Copy>(values: &[T], grid: &Grid, axis: usize, index: usize) -> Array2<T> {
    let view = ArrayView3::from_shape(grid.dims, values);
    view.map_or_else(
        |_| Array2::from_shape_fn((0, 0), |_| values[0]),
        |v| v.index_axis(Axis(axis), index).to_owned(),
    )
}

/// Where a slice across `axis` lies.
pub(crate) fn axes(grid: &Grid, unit: &str, axis: usize) -> Axes {
    let rest: Vec<usize> = (0..3).filter(|&a| a != axis).collect();
    let names = [rest[0], rest[1]].map(|a| ["x", "y", "z"][a].to_owned());
    Axes { names, unit: unit.into(), start: [grid.origin[rest[0]], grid.origin[rest[1]]], pitch: grid.pitch }
}

/// A panel with the part's outline.
pub(crate) fn panel<'a>(
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
