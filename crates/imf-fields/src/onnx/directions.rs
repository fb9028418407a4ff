//! The harmonics of a direction as a graph, by the recurrences of [`SphereBasis`], and their product with a point's
//! coefficients.

use std::f64::consts::{PI, SQRT_2};

use super::graph::{Graph, Value};
use crate::harmonic::sphere::SphereBasis;

/// A direction of any length but 0 as a unit vector.
pub(super) fn unit(graph: &mut Graph, direction: &Value) -> Value {
    let squares = graph.mul(direction, direction);
    let squared = graph.sum_of_columns(&squares);
    let length = graph.op("Sqrt", &[&squared]);
    graph.op("Div", &[direction, &length])
}

/// 0 in the rows of directions, NaN in those of what has none; `[poses, 1]`.
pub(super) fn nothing_of(graph: &mut Graph, direction: &Value) -> Value {
    let unit = unit(graph, direction);
    graph.nothing_of(&unit)
}

/// All functions of unit vectors, of mean square 1: `[poses, functions]`.
fn functions(graph: &mut Graph, direction: &Value, degree: usize) -> Value {
    let basis = SphereBasis::new(degree);
    let (x, y, z) = (graph.column(direction, 0), graph.column(direction, 1), graph.column(direction, 2));
    let zero = graph.number(0.0);
    // A column of ones.
    let nothing = graph.mul(&z, &zero);
    let one = graph.number(1.0);
    let ones = graph.add(&nothing, &one);
    let mut places: Vec<Option<Value>> = vec![None; basis.len()];
    // Re and Im of (x + iy)^m.
    let mut turned: Option<(Value, Value)> = None;
    for m in 0..=degree {
        if m == 1 {
            turned = Some((x.clone(), y.clone()));
        } else if let Some((cosine, sine)) = &turned {
            let (xc, ys) = (graph.mul(&x, cosine), graph.mul(&y, sine));
            let (xs, yc) = (graph.mul(&x, sine), graph.mul(&y, cosine));
            turned = Some((graph.sub(&xc, &ys), graph.add(&xs, &yc)));
        }
        // √4π makes the mean square 1, √2 belongs to m > 0.
        let scale = (4.0 * PI).sqrt() * if m == 0 { 1.0 } else { SQRT_2 };
        let start = graph.number(scale * basis.sectoral(m));
        let mut value = graph.mul(&ones, &start);
        let mut before: Option<Value> = None;
        for l in m..=degree {
            if l > m {
                let (a, b) = basis.step(l, m);
                let factor = graph.number(a);
                let raised = graph.mul(&z, &value);
                let next = match &before {
                    Some(before) => {
                        let less = graph.number(b);
                        let less = graph.mul(before, &less);
                        graph.sub(&raised, &less)
                    }
                    None => raised,
                };
                let next = graph.mul(&next, &factor);
                before = Some(std::mem::replace(&mut value, next));
            }
            let middle = l * l + l;
            match &turned {
                Some((cosine, sine)) if m > 0 => {
                    places[middle + m] = Some(graph.mul(&value, cosine));
                    places[middle - m] = Some(graph.mul(&value, sine));
                }
                _ => places[middle] = Some(value.clone()),
            }
        }
    }
    let columns: Vec<&Value> = places.iter().flatten().collect();
    graph.op_with("Concat", &columns, &[("axis", 1)])
}

/// `μ·b(d) + ⟨z, Uᵀ b(d)⟩` of coefficients z `[poses, components]`: `[poses, 1]`. `components` is U `[functions][components]`, `mean` μ.
pub(super) fn value(
    graph: &mut Graph,
    direction: &Value,
    degree: usize,
    components: &[f32],
    mean: &[f32],
    z: &Value,
) -> Value {
    let direction = unit(graph, direction);
    let values = functions(graph, &direction, degree);
    let width = components.len() / mean.len();
    let components = graph.weights("components", &[mean.len(), width], components);
    let mean = graph.weights("mean", &[mean.len(), 1], mean);
    let along = graph.op("MatMul", &[&values, &components]);
    let constant = graph.op("MatMul", &[&values, &mean]);
    let product = graph.mul(z, &along);
    let sum = graph.sum_of_columns(&product);
    graph.add(&sum, &constant)
}
