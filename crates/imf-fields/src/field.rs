//! Fields from files as planners query them, and what planners need beside them.

#[cfg(feature = "calibration")]
pub mod calibrate;
mod families;
mod fitted;
mod planner;

#[cfg(test)]
pub(crate) mod scenes;

pub use fitted::Field;
pub use planner::Planner;

use imf_core::field::EngineError;
use imf_core::tool::ClearanceError;
use thiserror::Error;

use crate::file::FieldFileError;

/// Why a file gives no field for planners.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum LoadError {
    /// The file.
    #[error(transparent)]
    File(#[from] FieldFileError),
    /// Weights that do not fit the network.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// A tool that cannot be offset.
    #[error(transparent)]
    Clearance(#[from] ClearanceError),
}

#[cfg(test)]
mod allocation_tests;
#[cfg(test)]
mod calibrate_tests;
#[cfg(test)]
mod planner_tests;
#[cfg(test)]
mod tests;
