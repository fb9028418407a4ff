//! What runs on the adapter, against its twins on the CPU and the definitions in f64.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod devices;
mod distillation;
mod evaluation;
mod families;
mod fields;
mod grids;
mod half;
mod planner;
mod queries;
mod refusals;
mod sections;
mod soap;
mod tolerances;
mod training;
