//! Distillation: a network of the point is trained to a harmonic field's coefficients, or to sections as they come.

mod adapt;
mod by_sections;
mod course;
mod engine;
mod last_layer;
mod teach;

pub use by_sections::{SectionTeacher, teach_by_sections, teach_by_sections_on};
pub use engine::{optimiser_bytes, start_from};
pub use last_layer::bytes_to_solve;
pub use teach::{teach, teach_on};

use crate::training::run::Start;
use imf_fields::factored::FactoredState;

/// Where a distillation goes on.
fn start_of(state: &FactoredState) -> Start {
    Start { cursor: state.cursor, watch: state.watch }
}

#[cfg(test)]
mod tests;
