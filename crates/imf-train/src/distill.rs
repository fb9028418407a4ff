//! Distillation: a network of the point is trained to a harmonic field's coefficients, or to sections as they come.

mod output_layer;
mod sections;
mod target;
mod voxels;
mod warm_start;

pub use output_layer::bytes_to_solve;
pub use sections::SectionSource;
pub use target::{Target, distil, distil_on, optimiser_bytes};
pub use warm_start::start_from;

#[cfg(test)]
mod tests;
