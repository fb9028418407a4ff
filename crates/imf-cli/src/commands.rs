//! One file a command.

pub(crate) mod access;
pub(crate) mod bench;
pub(crate) mod calibrate;
pub(crate) mod check;
pub(crate) mod compress;
pub(crate) mod dataset;
pub(crate) mod demo;
pub(crate) mod devices;
pub(crate) mod eval;
pub(crate) mod export;
pub(crate) mod field;
pub(crate) mod finetune;
pub(crate) mod info;
mod notes;
pub(crate) mod parts;
pub(crate) mod query;
pub(crate) mod regime;
pub(crate) mod train;
pub(crate) mod voxelize;
