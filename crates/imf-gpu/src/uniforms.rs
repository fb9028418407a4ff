//! The uniform blocks of `shaders/uniforms.wgsl` in Rust: same names, same order, no padding. What each field means
//! stands there; `tests/shaders.rs` compares size and offsets with what naga makes of the WGSL.

#![expect(
    missing_docs,
    reason = "every field is documented where the kernels read it, in shaders/uniforms.wgsl"
)]

use bytemuck::{Pod, Zeroable};
use glam::Vec3;

use crate::shader::NO_AXIS;

/// The rows at hand.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Batch {
    pub rows: u32,
    pub padded_rows: u32,
    pub slice_rows: u32,
    pub slices: u32,
}

/// One dense layer.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Layer {
    pub inputs: u32,
    pub outputs: u32,
    pub weights: u32,
    pub biases: u32,
    pub stride: u32,
    pub upstream: u32,
    pub parameters: u32,
    pub omega: f32,
}

/// Where a block of network inputs goes.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Placement {
    pub stride: u32,
    pub offset: u32,
    pub columns: u32,
    pub inputs: u32,
}

/// One training step.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Step {
    pub inverse_count: f32,
    pub scale: f32,
    pub learnt: u32,
    pub loss: u32,
    pub slot: u32,
    pub first: u32,
    pub learning_rate: f32,
    pub beta1: f32,
    pub one_minus_beta1: f32,
    pub beta2: f32,
    pub one_minus_beta2: f32,
    pub correction1: f32,
    pub correction2: f32,
    pub matrix_correction: f32,
    pub epsilon: f32,
    pub weight_decay: f32,
}

/// A stretch of parameters.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Span {
    pub first: u32,
    pub end: u32,
}

/// The matrices that SOAP steps.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Between {
    pub rows: u32,
    pub columns: u32,
    pub kept: f32,
    pub one_minus_kept: f32,
}

/// One of them; an element of a storage buffer.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct MatrixPlace {
    pub weights: u32,
    pub columns: u32,
    pub length: f32,
}

/// A product of SOAP's.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Product {
    pub rows: u32,
    pub columns: u32,
    pub inner: u32,
    pub left_transposed: u32,
    pub right_transposed: u32,
    pub kept: f32,
    pub share: f32,
}

/// Some reflections of a QR decomposition.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Panel {
    pub first: u32,
    pub end: u32,
    pub behind: u32,
    pub backwards: u32,
}

/// The rows or the columns of a matrix; an element of a storage buffer.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Side {
    pub size: u32,
    pub split: u32,
    pub gap: u32,
    pub stride: u32,
}

/// One part of an evaluation.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Sweep {
    pub base: u32,
    pub points: u32,
    pub directions: u32,
    pub first_direction: u32,
}

/// The box of a field in the world.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct World {
    pub low: [f32; 4],
    pub high: [f32; 4],
    pub origin: [f32; 4],
    pub size: [f32; 4],
}

/// The weights that the network's inputs meet.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Descent {
    pub first_weights: u32,
    pub first_stride: u32,
    pub neurons: u32,
    pub skip_weights: u32,
    pub skip_stride: u32,
    pub skip_neurons: u32,
}

/// What a network is told of the obstacle's symmetry.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Symmetry {
    pub plane_x: f32,
    pub plane_y: f32,
    pub plane_z: f32,
    pub through_x: f32,
    pub through_y: f32,
    pub through_z: f32,
    pub along: u32,
    pub blunt: f32,
}

impl Symmetry {
    /// That of a network, whose slopes do not grow nearer to the axis than `blunt`.
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

/// The frame of a place, for coefficients; an element of a storage buffer.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct PlaceFrame {
    pub cosine: f32,
    pub sine: f32,
    pub mirrored: u32,
}

impl From<imf_fields::factored::Frame> for PlaceFrame {
    fn from(frame: imf_fields::factored::Frame) -> Self {
        let [cosine, sine] = frame.turn;
        let bits = frame.mirrored.iter().zip(0..).map(|(&mirrored, bit)| u32::from(mirrored) << bit);
        Self { cosine, sine, mirrored: bits.sum() }
    }
}

/// Work that is done over and over.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Turns {
    pub count: u32,
    pub factor: f32,
    pub summand: f32,
}

/// The functions of a direction.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Harmonics {
    pub degree: u32,
    pub stride: u32,
}

/// The voxels of a harmonic field.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Lattice {
    pub nx: u32,
    pub ny: u32,
    pub nz: u32,
    pub stride: u32,
    pub columns: u32,
    pub pitch: f32,
}

/// What decisions are made by.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Thresholds {
    pub free_up_to: f32,
    pub colliding_from: f32,
}

/// Jobs that count overlaps over one slab.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Counting {
    pub planes: u32,
    pub lead_bits: u32,
    pub plane_bits: u32,
    pub line_bits: u32,
    pub jobs: u32,
    pub groups: u32,
    pub lines: u32,
    pub lower_x: i32,
    pub lower_y: i32,
    pub lower_z: i32,
    pub nx: u32,
    pub ny: u32,
    pub nz: u32,
}

/// A tool in one orientation; an element of a storage buffer.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
pub struct Job {
    pub axis: u32,
    pub upwards: u32,
    pub lower_x: i32,
    pub lower_y: i32,
    pub lower_z: i32,
    pub nx: u32,
    pub ny: u32,
    pub nz: u32,
    pub differences: u32,
    pub covered_first: i32,
    pub covered_planes: u32,
    pub covered_starts: u32,
    pub uncovered_first: i32,
    pub uncovered_planes: u32,
    pub uncovered_starts: u32,
    pub shares: u32,
    pub orientation: u32,
}
