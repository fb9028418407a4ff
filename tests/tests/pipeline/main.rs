//! Across the crates: from a reference part to a trained field, every stage against its definition.
#![expect(clippy::unwrap_used, reason = "a test ends at the first surprise, and says where")]

mod evaluators;
mod exactness;
mod learning;
mod scene;
mod volumes;
