//! The command `imf`.
fn main() {}
