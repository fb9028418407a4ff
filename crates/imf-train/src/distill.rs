//! Distillation: a network of the point is trained to a harmonic field's coefficients.

mod output_layer;
mod train;
mod voxels;
mod warm_start;

pub use output_layer::bytes_to_solve;
pub use train::{cpu_distiller, distil, distil_on, optimiser_bytes, train_to};
pub use warm_start::start_from;

#[cfg(test)]
mod tests;
