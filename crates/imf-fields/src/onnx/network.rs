//! Sine networks as a graph: those of the pose and those of the point.

use super::graph::{Graph, Value};
use super::place::Place;
use crate::factored::FactoredField;
use crate::siren::output::STRETCH;
use crate::siren::stack::Stack;
use crate::siren::{Layer, SirenShape};
use imf_core::grid::Grid;

/// The last sums of a stack, or its last sines where there is no layer behind them.
fn outputs(graph: &mut Graph, stack: Stack, parameters: &[f32], input: &Value) -> Value {
    let omega = graph.number(f64::from(stack.omega));
    let mut signal = input.clone();
    for (index, layer) in stack.layers().into_iter().enumerate() {
        if layer.skip {
            signal = graph.op_with("Concat", &[&signal, input], &[("axis", 1)]);
        }
        let Layer { inputs, outputs, weights, biases, .. } = layer;
        let matrix = &parameters[weights..weights + inputs * outputs];
        let matrix = graph.weights(&format!("layers.{index}.weight"), &[outputs, inputs], matrix);
        let bias = &parameters[biases..biases + outputs];
        let bias = graph.weights(&format!("layers.{index}.bias"), &[outputs], bias);
        let sum = graph.op_with("Gemm", &[&signal, &matrix, &bias], &[("transB", 1)]);
        if index == stack.hidden {
            return sum;
        }
        let scaled = graph.mul(&sum, &omega);
        signal = graph.op("Sin", &[&scaled]);
    }
    signal
}

/// The nearest positions in the box of the voxels' centres, beyond which nothing was learnt.
pub(super) fn held(graph: &mut Graph, grid: &Grid, position: &Value) -> Value {
    let [low, high] = grid.box_of_centres().map(|corner| corner.as_vec3().to_array());
    let (low, high) = (graph.numbers(&[3], &low), graph.numbers(&[3], &high));
    let held = graph.op("Max", &[position, &low]);
    graph.op("Min", &[&held, &high])
}

/// The paper's network: from held position and angles in degrees to the overlap, `[poses, 1]`.
pub(super) fn siren(
    graph: &mut Graph,
    shape: &SirenShape,
    parameters: &[f32],
    grid: &Grid,
    position: &Value,
    angles: &Value,
) -> Value {
    let size = grid.size();
    let origin = graph.numbers(&[3], &grid.origin.as_vec3().to_array());
    let (scale, one) = (graph.numbers(&[3], &(2.0 / size).as_vec3().to_array()), graph.number(1.0));
    let degrees = graph.numbers(&[2], &[1.0 / 180.0, 1.0 / 90.0]);
    let from_corner = graph.sub(position, &origin);
    let unit = graph.mul(&from_corner, &scale);
    // Whole turns of θ change nothing.
    let ([theta, phi], circle) = ([0, 1].map(|angle| graph.column(angles, angle)), graph.number(360.0));
    let turns = graph.op("Div", &[&theta, &circle]);
    let whole = graph.op("Floor", &[&turns]);
    let whole = graph.mul(&whole, &circle);
    let theta = graph.sub(&theta, &whole);
    let angles = graph.op_with("Concat", &[&theta, &phi], &[("axis", 1)]);
    let turns = graph.mul(&angles, &degrees);
    let both = graph.op_with("Concat", &[&unit, &turns], &[("axis", 1)]);
    let named = graph.sub(&both, &one);
    // As `features`: of a vertical direction the middle θ, which is 0 here.
    let down = graph.column(&named, 4);
    let squared = graph.mul(&down, &down);
    let has_angle = graph.op("Less", &[&squared, &one]);
    let (theta, middle) = (graph.column(&named, 3), graph.number(0.0));
    let theta = graph.op("Where", &[&has_angle, &theta, &middle]);
    let others = graph.integers(&[3], &[0, 1, 2]);
    let point = graph.op_with("Gather", &[&named, &others], &[("axis", 1)]);
    let input = graph.op_with("Concat", &[&point, &theta, &down], &[("axis", 1)]);
    let output = outputs(graph, shape.stack(), parameters, &input);
    let sigmoid = graph.op("Sigmoid", &[&output]);
    let (stretch, below) = (graph.number(1.0 + STRETCH), graph.number(STRETCH));
    let stretched = graph.mul(&sigmoid, &stretch);
    let open = graph.sub(&stretched, &below);
    graph.clip(&open, 0.0, 1.0)
}

/// The network of the point over a grid in the frame of positions: from the position's place to the coefficients in its frame, `[poses, axes]`.
pub(super) fn coefficients(graph: &mut Graph, field: &FactoredField, grid: &Grid, place: &Place) -> Value {
    let size = grid.size();
    let middle = (grid.origin + 0.5 * size).as_vec3().to_array();
    let middle = graph.numbers(&[3], &middle);
    let scale = graph.number(2.0 / size.max_element());
    let from_middle = graph.sub(&place.position, &middle);
    let scaled = graph.mul(&from_middle, &scale);
    let input = place.inputs(graph, scaled);
    let outputs = outputs(graph, field.shape.stack(), &field.parameters, &input);
    let scale = graph.number(f64::from(field.scale));
    graph.mul(&outputs, &scale)
}
