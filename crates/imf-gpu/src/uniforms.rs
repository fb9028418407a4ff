//! The uniform blocks of `shaders/uniforms.wgsl` in Rust: same names, same order, no padding. What each block and field means
//! stands there; `shader/tests.rs` compares size and offsets with what naga makes of the WGSL.

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use crate::shader::NO_AXIS;

/// A block's name, its size, and the names and offsets of its fields.
#[cfg(test)]
pub(crate) type BlockLayout = (&'static str, usize, Vec<(&'static str, usize)>);

macro_rules! blocks {
    ($($name:ident { $($field:ident: $type:ty,)+ })+) => {
        $(
            #[repr(C)]
            #[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
            pub(crate) struct $name {
                $(pub(crate) $field: $type,)+
            }
        )+

        /// Every block.
        #[cfg(test)]
        pub(crate) fn layouts() -> Vec<BlockLayout> {
            vec![$((
                stringify!($name),
                size_of::<$name>(),
                vec![$((stringify!($field), std::mem::offset_of!($name, $field))),+],
            )),+]
        }
    };
}

blocks! {
    Batch {
        rows: u32, padded_rows: u32, slice_rows: u32, slices: u32,
    }
    Layer {
        inputs: u32, outputs: u32, weights: u32, biases: u32, stride: u32, upstream: u32, parameters: u32,
        omega: f32,
    }
    Placement {
        stride: u32, offset: u32, columns: u32, inputs: u32,
    }
    Step {
        inverse_count: f32, scale: f32, learnt: u32, loss: u32, slot: u32, first: u32, learning_rate: f32,
        beta1: f32, one_minus_beta1: f32, beta2: f32, one_minus_beta2: f32, correction1: f32,
        correction2: f32, matrix_correction: f32, epsilon: f32, weight_decay: f32,
    }
    Span {
        first: u32, end: u32,
    }
    Between {
        rows: u32, columns: u32, beta: f32, one_minus_beta: f32,
    }
    MatrixPlace {
        weights: u32, columns: u32, length: f32,
    }
    Product {
        rows: u32, columns: u32, inner: u32, left_transposed: u32, right_transposed: u32, kept: f32,
        share: f32,
    }
    Panel {
        first: u32, end: u32, behind: u32, backwards: u32,
    }
    Side {
        size: u32, split: u32, gap: u32, stride: u32,
    }
    Sweep {
        base: u32, points: u32, directions: u32, first_direction: u32,
    }
    World {
        low: [f32; 4], high: [f32; 4], origin: [f32; 4], size: [f32; 4],
    }
    Descent {
        first_weights: u32, first_stride: u32, neurons: u32, skip_weights: u32, skip_stride: u32,
        skip_neurons: u32,
    }
    Symmetry {
        plane_x: f32, plane_y: f32, plane_z: f32, through_x: f32, through_y: f32, through_z: f32,
        along: u32, blunt: f32,
    }
    PlaceFrame {
        cosine: f32, sine: f32, mirrored: u32,
    }
    Turns {
        count: u32, factor: f32, summand: f32,
    }
    Harmonics {
        degree: u32, stride: u32,
    }
    Lattice {
        nx: u32, ny: u32, nz: u32, stride: u32, columns: u32, pitch: f32,
    }
    Thresholds {
        free_up_to: f32, colliding_from: f32, along: u32, first: f32, second: f32, around: f32,
    }
    Counting {
        planes: u32, lead_bits: u32, plane_bits: u32, line_bits: u32, jobs: u32, groups: u32, lines: u32,
        lower_x: i32, lower_y: i32, lower_z: i32, nx: u32, ny: u32, nz: u32,
    }
    Job {
        axis: u32, upwards: u32, lower_x: i32, lower_y: i32, lower_z: i32, nx: u32, ny: u32, nz: u32,
        differences: u32, covered_first: i32, covered_planes: u32, covered_starts: u32,
        uncovered_first: i32, uncovered_planes: u32, uncovered_starts: u32, shares: u32, orientation: u32,
    }
}

impl Batch {
    /// A batch of `rows` rows, rounded up to the padding.
    pub(crate) fn of_rows(rows: usize, padding: usize) -> Self {
        let padded_rows = rows.next_multiple_of(padding);
        Self { rows: rows as u32, padded_rows: padded_rows as u32, ..Self::default() }
    }
}

impl Symmetry {
    /// That of a field, whose slopes do not grow nearer to the axis than `blunt`.
    pub(crate) fn new(symmetry: &imf_fields::factored::Symmetry, blunt: f64) -> Self {
        let [plane_x, plane_y, plane_z] =
            symmetry.mirrors.map(|plane| plane.map_or(NO_PLANE, |plane| plane as f32));
        let (along, through) =
            symmetry.axis.map_or((NO_AXIS, Vec3::ZERO), |axis| (axis.along as u32, axis.through.as_vec3()));
        let [through_x, through_y, through_z] = through.to_array();
        Self { plane_x, plane_y, plane_z, through_x, through_y, through_z, along, blunt: blunt as f32 }
    }
}

/// Where a mirror plane stands that there is not: no position lies below, and twice of it is finite.
const NO_PLANE: f32 = -1e30;

impl From<imf_fields::factored::Frame> for PlaceFrame {
    fn from(frame: imf_fields::factored::Frame) -> Self {
        let [cosine, sine] = frame.turn;
        let bits = frame.mirrored.iter().zip(0..).map(|(&mirrored, bit)| u32::from(mirrored) << bit);
        Self { cosine, sine, mirrored: bits.sum() }
    }
}
