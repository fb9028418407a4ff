//! The real binary, each time in a fresh folder: what the commands write, how trainings stop and go on, and what is refused.
#![expect(clippy::unwrap_used, reason = "a test ends at the first surprise, and says where")]

mod access;
mod adapters;
mod arguments;
mod binary;
mod check;
mod damage;
mod decisions;
mod demo;
mod export;
mod fields;
mod harmonic;
mod info;
mod interruption;
mod long_runs;
mod machine;
mod model;
mod page;
mod part;
mod partitions;
mod pipeline;
mod precision;
mod queries;
mod refusals;
mod rolls;
mod saved;
mod setups;
mod shapes;

mod stick_out;
mod stock;
mod streaming;
mod voxels;
mod widths;
mod writing;

use ndarray::Array3;
use ndarray_npy::{ReadNpyExt as _, ReadableElement};

/// The binary that is run.
const PROGRAM: &str = env!("CARGO_BIN_EXE_imf");

impl binary::Workdir {
    /// An array that the command wrote.
    fn npy<T: ReadableElement>(&self, name: &str) -> Array3<T> {
        Array3::read_npy(std::fs::File::open(self.path(name)).unwrap()).unwrap()
    }
}
