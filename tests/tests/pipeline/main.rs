//! Across the crates: from a reference part to a trained field, every stage against its definition and every engine
//! against the others.

mod bits;
mod engines;
mod evaluators;
mod exactness;
mod learning;
mod scene;
mod volumes;
