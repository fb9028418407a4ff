//! Pictures: slices of fields side by side, curves and bars, as PNG files.
//!
//! Axes, curves, bars and grids are drawn by plotters into an RGB image in memory (`canvas`), arrays as one square of whole
//! pixels for each voxel, with their first axis to the right and their second upwards.

mod axis;
mod canvas;
mod chart;
mod colour;
mod panel;
mod sheet;
mod views;

pub use axis::AxisScale;
pub use chart::{Bar, BarChart, Chart, Series};
pub use colour::Scale;
pub use panel::{Axes, Mask, MaskStyle, Panel};
pub use sheet::{PanelRow, PanelSheet};
pub(crate) use views::{Swatches, ViewRow, ViewSheet};
