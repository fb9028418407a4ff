//! Cross-crate tests live in this package's `tests` folder. The guide's Rust is compiled and run from here.
//! `readers` is what the fuzzer (`fuzz`) and the test `readers` have in common.

mod checksums;
pub mod readers;

/// A planner's example, docs/guide/planner.md.
#[cfg(doctest)]
#[doc = include_str!("../../docs/guide/planner.md")]
pub struct Planner;
