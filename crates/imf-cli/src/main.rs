//! The command `imf`.
#![allow(dead_code, unused_imports, reason = "the commands that draw pictures are not written yet")]

mod picture;

fn main() {}
