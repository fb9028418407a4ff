//! The frame of a place as a graph, for symmetry-reduced fields: what [`Symmetry`] does with a position,
//! and with directions there.

use super::graph::{Graph, Value};
use crate::factored::{ANGLE, Axis, Symmetry};

/// Positions in the frames of their places; a row each.
pub(super) struct Place {
    /// On the far side of every mirror: `[poses, 3]`.
    pub position: Value,
    /// −1 along what was mirrored, 1 elsewhere: `[poses, 3]`.
    signs: Option<Value>,
    angle: Option<Angle>,
}

/// The angle about an axis.
struct Angle {
    /// The world's axes in the order that ends with this one.
    order: [i64; 3],
    /// `[poses, 1]`
    cosine: Value,
    sine: Value,
}

impl Place {
    /// That of a position.
    pub(super) fn new(graph: &mut Graph, symmetry: &Symmetry, position: &Value) -> Self {
        let (position, signs) = if symmetry.mirrors == [None; 3] {
            (position.clone(), None)
        } else {
            let (position, signs) = folded(graph, symmetry.mirrors, position);
            (position, Some(signs))
        };
        let angle = symmetry.axis.map(|axis| Angle::new(graph, axis, &position));
        Self { position, signs, angle }
    }

    /// The network's inputs, from the folded position in its units.
    pub(super) fn inputs(&self, graph: &mut Graph, scaled: Value) -> Value {
        let Some(Angle { cosine, sine, .. }) = &self.angle else { return scaled };
        let factor = graph.number(ANGLE);
        let (cosine, sine) = (graph.mul(cosine, &factor), graph.mul(sine, &factor));
        graph.op_with("Concat", &[&scaled, &cosine, &sine], &[("axis", 1)])
    }

    /// Directions of the world in the place's frame.
    pub(super) fn to_local(&self, graph: &mut Graph, direction: &Value) -> Value {
        let mirrored = match &self.signs {
            Some(signs) => graph.mul(direction, signs),
            None => direction.clone(),
        };
        let Some(Angle { order, cosine, sine }) = &self.angle else { return mirrored };
        let [x, y, z] = order.map(|axis| graph.column(&mirrored, axis));
        let (xc, ys) = (graph.mul(&x, cosine), graph.mul(&y, sine));
        let (yc, xs) = (graph.mul(&y, cosine), graph.mul(&x, sine));
        let (x, y) = (graph.add(&xc, &ys), graph.sub(&yc, &xs));
        graph.op_with("Concat", &[&x, &y, &z], &[("axis", 1)])
    }
}

/// Positions folded to the far side of mirror planes, and the signs that show which were.
fn folded(graph: &mut Graph, mirrors: [Option<f64>; 3], position: &Value) -> (Value, Value) {
    // Nothing is below the planes that there are not.
    let planes = graph.numbers(&[3], &mirrors.map(|plane| plane.map_or(f32::MIN, |plane| plane as f32)));
    let twice = graph.numbers(&[3], &mirrors.map(|plane| plane.map_or(0.0, |plane| (2.0 * plane) as f32)));
    let (one, minus_one) = (graph.number(1.0), graph.number(-1.0));
    let mirrored = graph.op("Less", &[position, &planes]);
    let image = graph.sub(&twice, position);
    let folded = graph.op("Where", &[&mirrored, &image, position]);
    (folded, graph.op("Where", &[&mirrored, &minus_one, &one]))
}

impl Angle {
    /// Of folded positions; on the axis it is 0.
    fn new(graph: &mut Graph, Axis { along, through }: Axis, position: &Value) -> Self {
        let through = graph.numbers(&[3], &through.as_vec3().to_array());
        let (zero, one) = (graph.number(0.0), graph.number(1.0));
        let from_axis = graph.sub(position, &through);
        let order = Axis::order(along).map(|axis| axis as i64);
        let [x, y] = [order[0], order[1]].map(|axis| graph.column(&from_axis, axis));
        let (xx, yy) = (graph.mul(&x, &x), graph.mul(&y, &y));
        let squared = graph.add(&xx, &yy);
        let distance = graph.op("Sqrt", &[&squared]);
        let is_off = graph.op("Less", &[&zero, &distance]);
        let x = graph.op("Where", &[&is_off, &x, &one]);
        let y = graph.op("Where", &[&is_off, &y, &zero]);
        let distance = graph.op("Where", &[&is_off, &distance, &one]);
        let (cosine, sine) = (graph.op("Div", &[&x, &distance]), graph.op("Div", &[&y, &distance]));
        Self { order, cosine, sine }
    }
}
