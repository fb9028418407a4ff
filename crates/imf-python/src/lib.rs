//! The native module of the Python package `imf`: it computes nothing itself.
//!
//! `python/imf` is what people import: classes with docstrings, results with names. It calls this module (`imf._imf`), which hands
//! arrays to `imf-core`, `imf-fields` and `imf-train` and theirs back. Every call that may take long goes through `work`: without
//! the interpreter's lock, ended by Ctrl-C, with progress.
//!
//! # Conventions
//! - Poses are rows of `f64`: a tip and the tool's axis (6 numbers), or a tip and a quaternion x, y, z, w (7); see `poses`.
//! - Arrays that come in are read where they lie; those that go out are the library's own memory.
//! - Errors have the library's words; `errors` says which exception each becomes.
#![allow(clippy::needless_pass_by_value, reason = "functions that Python calls take what it hands over")]

mod arrays;
mod checker;
mod crib;
mod errors;
mod field;
mod memory;
mod poses;
mod scene;
mod sections;
mod stock;
mod surface;
mod tool;
mod toolpath;
mod train;
mod work;

use pyo3::prelude::*;

/// The native module of the package `imf`.
#[pymodule]
#[pyo3(name = "_imf")]
fn native_module(native: &Bound<'_, PyModule>) -> PyResult<()> {
    native.add("__version__", env!("CARGO_PKG_VERSION"))?;
    native.add("ImfError", native.py().get_type::<errors::ImfError>())?;
    native.add("DIRECTIONS", imf_core::orientation::OrientationSet::FORMS)?;
    native.add_class::<tool::Tool>()?;
    native.add_class::<scene::Scene>()?;
    native.add_class::<checker::Checker>()?;
    native.add_class::<surface::Surface>()?;
    native.add_class::<field::Field>()?;
    native.add_function(wrap_pyfunction!(sections::sections, native)?)?;
    native.add_function(wrap_pyfunction!(sections::minimum, native)?)?;
    native.add_function(wrap_pyfunction!(surface::access, native)?)?;
    native.add_function(wrap_pyfunction!(crib::crib, native)?)?;
    native.add_function(wrap_pyfunction!(crib::fewest_sets, native)?)?;
    native.add_function(wrap_pyfunction!(stock::removable_stock, native)?)?;
    native.add_function(wrap_pyfunction!(toolpath::check, native)?)?;
    native.add_function(wrap_pyfunction!(train::train, native)?)?;
    work::at_home();
    native.add_function(wrap_pyfunction!(work::set_threads, native)?)
}
