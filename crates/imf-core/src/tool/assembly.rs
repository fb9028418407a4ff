//! A tool as it is counted: whole, and without its cutter, with or without a clearance around it.

use super::{Clearance, ClearanceError, Element, Tool, ToolShape};

/// A tool with a clearance around it. Shank and holder offset by a clearance are more than the offset tool without
/// its cutter, so both are made together, from the bare tool.
#[derive(Clone, Debug, PartialEq)]
pub struct Assembly {
    /// What stays out of what is forbidden.
    whole: Tool,
    /// What stays out of what the cutter may enter.
    noncutting: Option<Tool>,
    /// The tool without clearance, and the clearance.
    tool: Tool,
    clearance: Clearance,
}

impl Tool {
    /// The tool offset by a clearance in its own unit: the Minkowski sum of each element with a ball.
    ///
    /// # Errors
    /// A clearance that is not a length, or one around a mesh tool, which cannot be offset.
    pub fn offset(&self, clearance: &Clearance) -> Result<Assembly, ClearanceError> {
        Ok(Assembly {
            whole: self.with_clearance(clearance)?,
            noncutting: self.kept_out().map(|rest| rest.with_clearance(clearance)).transpose()?,
            tool: self.clone(),
            clearance: *clearance,
        })
    }

    /// What stays out of what a cutter may enter.
    fn kept_out(&self) -> Option<Self> {
        if self.mesh().is_some() { Some(self.clone()) } else { self.without_cutter() }
    }

    /// Every element eroded by itself: where one element stands on another, a little more is taken away than need be.
    fn eroded(&self, depth: f64) -> Option<Self> {
        let left = self.elements().iter().filter_map(|element| element.eroded(depth, true));
        let left: Vec<Element> = left.collect();
        (!left.is_empty()).then(|| Self { shape: ToolShape::Revolved(left), ..self.with_tip_only() })
    }
}

impl Assembly {
    /// The whole tool, offset.
    #[must_use]
    pub fn whole(&self) -> &Tool {
        &self.whole
    }

    /// Shank and holder, offset; `None` where there are none. All of a mesh, which does not say what part of it cuts.
    #[must_use]
    pub fn noncutting(&self) -> Option<&Tool> {
        self.noncutting.as_ref()
    }

    /// The tool as it is.
    #[must_use]
    pub fn tool(&self) -> &Tool {
        &self.tool
    }

    /// By how much it is offset.
    #[must_use]
    pub fn clearance(&self) -> &Clearance {
        &self.clearance
    }

    /// The same tool, every element offset by `more` in addition.
    ///
    /// # Errors
    /// As [`Tool::offset`].
    pub fn offset_further(&self, more: f64) -> Result<Self, ClearanceError> {
        let Clearance { holder, shank, cutter } = self.clearance;
        self.tool.offset(&Clearance { holder: holder + more, shank: shank + more, cutter: cutter + more })
    }

    /// What is left of the offset tool at least `depth` below its surface: wherever the tip moves by no more than that, none of
    /// it leaves the tool. `None` where nothing is left, and of a mesh.
    pub(crate) fn eroded(&self, depth: f64) -> Option<Self> {
        Some(Self {
            whole: self.whole.eroded(depth)?,
            noncutting: self.noncutting.as_ref().and_then(|rest| rest.eroded(depth)),
            tool: self.tool.clone(),
            clearance: self.clearance,
        })
    }
}

/// The tool as it is.
impl From<Tool> for Assembly {
    fn from(tool: Tool) -> Self {
        let noncutting = tool.kept_out();
        Self { whole: tool.clone(), noncutting, tool, clearance: Clearance::default() }
    }
}

/// The tool as it is.
impl From<&Tool> for Assembly {
    fn from(tool: &Tool) -> Self {
        tool.clone().into()
    }
}

impl From<&Self> for Assembly {
    fn from(assembly: &Self) -> Self {
        assembly.clone()
    }
}
