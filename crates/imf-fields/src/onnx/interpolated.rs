//! Coefficients of voxels, trilinear between their centres, as a graph.

use super::graph::{Graph, Value};
use super::messages::{FLOAT, INT64};
use crate::harmonic::coefficients::Coefficients;
use imf_core::grid::Grid;

/// The coefficients at every position: `[poses, components]`. Positions outside the box of the voxels' centres are taken as the
/// nearest inside.
pub(super) fn coefficients(
    graph: &mut Graph,
    coefficients: &Coefficients,
    grid: &Grid,
    position: &Value,
) -> Value {
    let dims = [grid.len(), coefficients.len() / grid.len()];
    let table = match coefficients {
        Coefficients::F32(values) => graph.weights("coefficients", &dims, values),
        Coefficients::F16(values) => graph.halves("coefficients", &dims, values),
    };
    let first = graph.numbers(&[3], &grid.centre([0; 3]).as_vec3().to_array());
    let scale = graph.number(1.0 / grid.pitch);
    let from_first = graph.sub(position, &first);
    let place = graph.mul(&from_first, &scale);
    // Between the centres, by axis; the cell begins at a whole number below the last.
    let lowest = graph.numbers(&[3], &[0.0; 3]);
    let last = grid.dims.map(|n| n as f32 - 1.0);
    let last = graph.numbers(&[3], &last);
    let inside = graph.op("Max", &[&place, &lowest]);
    let inside = graph.op("Min", &[&inside, &last]);
    // What is not a number is no row of the table either, and would fail the whole batch.
    let unknown = graph.op("IsNaN", &[&inside]);
    let inside = graph.op("Where", &[&unknown, &lowest, &inside]);
    let cells = grid.dims.map(|n| (n as f32 - 2.0).max(0.0));
    let cells = graph.numbers(&[3], &cells);
    let cell = graph.op("Floor", &[&inside]);
    let cell = graph.op("Min", &[&cell, &cells]);
    let upper = graph.sub(&inside, &cell);
    let one = graph.number(1.0);
    let lower = graph.sub(&one, &upper);
    let cell = graph.op_with("Cast", &[&cell], &[("to", i64::from(INT64))]);
    let [_, y, z] = grid.dims.map(|n| n as i64);
    let strides = graph.integers(&[3], &[y * z, z, 1]);
    let weights: Vec<[Value; 2]> =
        (0..3).map(|axis| [graph.column(&lower, axis), graph.column(&upper, axis)]).collect();
    let cell = graph.mul(&cell, &strides);
    let base = graph.sum_of_columns(&cell);
    let mut sum: Option<Value> = None;
    for corner in 0..8 {
        let side = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
        // A grid of one voxel along an axis has no other side; its weight is 0.
        let offset = grid.index([0, 1, 2].map(|axis| side[axis].min(grid.dims[axis] - 1)));
        let offset = graph.integers(&[1], &[offset as i64]);
        let voxel = graph.add(&base, &offset);
        let flat = graph.integers(&[1], &[-1]);
        let voxel = graph.op("Reshape", &[&voxel, &flat]);
        let found = graph.op_with("Gather", &[&table, &voxel], &[("axis", 0)]);
        let found = graph.op_with("Cast", &[&found], &[("to", i64::from(FLOAT))]);
        let weight = graph.mul(&weights[0][side[0]], &weights[1][side[1]]);
        let weight = graph.mul(&weight, &weights[2][side[2]]);
        let part = graph.mul(&found, &weight);
        sum = Some(match &sum {
            Some(sum) => graph.add(sum, &part),
            None => part,
        });
    }
    // There are eight corners.
    sum.unwrap_or(table)
}
