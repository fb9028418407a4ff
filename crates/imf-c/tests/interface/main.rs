//! The C interface from both sides: its functions against the Rust calls, its header against the sources, its example
//! compiled by a C compiler and run against the built libraries.

#![allow(clippy::unwrap_used, reason = "a test that cannot go on has failed")]
#![allow(unsafe_code, reason = "the functions under test take raw pointers")]

mod calls;
mod example;
mod files;
mod header;
mod world;
