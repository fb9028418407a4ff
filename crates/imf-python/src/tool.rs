//! The tool as Python holds it.

use std::path::Path;

use imf_core::tool::{self, ToolShape};
use pyo3::prelude::*;

use crate::errors::Raise;

/// A tool assembly.
#[pyclass(frozen, module = "imf._imf")]
pub(crate) struct Tool(pub(crate) tool::Tool);

#[pymethods]
impl Tool {
    /// Reads a tool file, or a tool of a library (`FILE#TOOL`).
    #[staticmethod]
    fn read(path: &str) -> PyResult<Self> {
        tool::Tool::find(path).map(Self).map_err(Raise::raise)
    }

    /// Every tool of a file; of a library the ones that cannot be used raise nothing, but are given as their error's words.
    #[staticmethod]
    fn read_all(path: &str) -> PyResult<(Vec<Self>, Vec<String>)> {
        let (mut tools, mut faults) = (Vec::new(), Vec::new());
        for tool in tool::Tool::read_all(Path::new(path)).map_err(Raise::raise)? {
            match tool {
                Ok(tool) => tools.push(Self(tool)),
                Err(fault) => faults.push(fault.to_string()),
            }
        }
        Ok((tools, faults))
    }

    /// From the text of a tool file.
    #[staticmethod]
    fn parse(text: &str, name: &str) -> PyResult<Self> {
        tool::Tool::parse(text, Path::new(name)).map(Self).map_err(Raise::raise)
    }

    /// The paper's.
    #[staticmethod]
    fn paper() -> Self {
        Self(tool::Tool::paper())
    }

    /// Its display name.
    #[getter]
    fn name(&self) -> &str {
        &self.0.name
    }

    /// Unit of its lengths.
    #[getter]
    fn unit(&self) -> String {
        self.0.unit.to_string()
    }

    /// From the tip upwards.
    #[getter]
    fn length(&self) -> f64 {
        self.0.length()
    }

    /// From the tip to its farthest point.
    #[getter]
    fn reach(&self) -> f64 {
        self.0.reach()
    }

    /// In cubic units.
    #[getter]
    fn volume(&self) -> f64 {
        self.0.volume()
    }

    /// From the tip to the holder's face; none without a holder.
    #[getter]
    fn stick_out(&self) -> Option<f64> {
        self.0.stick_out()
    }

    /// Radius of the outline at heights above the tip; an error for a mesh.
    fn radius(&self, heights: Vec<f64>) -> Option<Vec<f64>> {
        let ToolShape::Revolved(elements) = &self.0.shape else { return None };
        let at = |height: f64| {
            let mut segments = elements.iter().flat_map(|element| &element.profile);
            let own = segments.find(|segment| {
                let (from, to) = segment.range();
                from <= height && height < to
            });
            own.map_or(0.0, |segment| segment.radius(height))
        };
        Some(heights.into_iter().map(at).collect())
    }
}
