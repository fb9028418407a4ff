//! Sections of the tool's elements by themselves: what collides, cutter, shank or which holder segment.

use super::{SectionError, SectionPlan, SectionScratch, direct_count};
use crate::occupancy::Occupancy;
use crate::orientation::Orientation;
use crate::tool::{Element, ElementKind, RotatedTool, SharpPoints, Tool, ToolError, ToolShape};

/// One plan for each element of a tool. Elements do not overlap, so their counts sum to the whole tool's.
pub struct ElementPlans {
    tool: Tool,
    obstacle: Occupancy,
    elements: Vec<Planned>,
}

struct Planned {
    kind: ElementKind,
    alone: Tool,
    /// `None` for one that holds no voxel centre upright: it is so thin that direct sums are quick.
    plan: Option<SectionPlan>,
}

impl ElementPlans {
    /// Plans sections of every element of `tool` with its tip at every voxel of the obstacle's grid; none for a mesh.
    ///
    /// # Errors
    /// A tool without volume.
    pub fn new(obstacle: &Occupancy, tool: &Tool) -> Result<Self, SectionError> {
        tool.check()?;
        let elements = match &tool.shape {
            ToolShape::Revolved(elements) => elements.as_slice(),
            ToolShape::Mesh(_) => &[],
        };
        let plan = |element: &Element| {
            let alone = Tool {
                shape: ToolShape::Revolved(vec![element.clone()]),
                sharp_points: SharpPoints::Tip,
                ..tool.clone()
            };
            match SectionPlan::new(obstacle, &alone) {
                Ok(plan) => Ok(Planned { kind: element.kind, alone, plan: Some(plan) }),
                Err(SectionError::Tool(ToolError::TooSmall { .. } | ToolError::Empty { .. })) => {
                    Ok(Planned { kind: element.kind, alone, plan: None })
                }
                Err(error) => Err(error),
            }
        };
        Ok(Self {
            tool: tool.clone(),
            obstacle: obstacle.clone(),
            elements: elements.iter().map(plan).collect::<Result<_, _>>()?,
        })
    }

    /// The elements from the tip upwards.
    pub fn elements(&self) -> impl Iterator<Item = ElementKind> {
        self.elements.iter().map(|e| e.kind)
    }

    /// The whole tool's count in an orientation, which every element's count is divided by.
    ///
    /// # Errors
    /// A tool that does not fit the grid.
    pub fn normaliser(&self, orientation: &Orientation) -> Result<u32, ToolError> {
        Ok(RotatedTool::new(&self.tool, orientation, self.obstacle.grid.pitch)?.count)
    }

    /// Voxels shared by the obstacle and element number `element` with the tool's tip at every voxel, C-ordered.
    ///
    /// # Errors
    /// As [`SectionPlan::counts`].
    ///
    /// # Panics
    /// If there is no such element, or `counts` has not the grid's length.
    pub fn counts(
        &self,
        element: usize,
        orientation: &Orientation,
        scratch: &mut SectionScratch,
        counts: &mut [u32],
    ) -> Result<(), SectionError> {
        let grid = &self.obstacle.grid;
        assert_eq!(counts.len(), grid.len(), "one count for each voxel of the grid");
        let element = &self.elements[element];
        let outcome = match &element.plan {
            Some(plan) => plan.counts(orientation, scratch, counts).map(|_| ()),
            None => {
                RotatedTool::new(&element.alone, orientation, grid.pitch).map_err(Into::into).map(|rotated| {
                    for (index, count) in counts.iter_mut().enumerate() {
                        *count = direct_count(&self.obstacle, &rotated, grid.voxel(index).map(|v| v as i64));
                    }
                })
            }
        };
        match outcome {
            // Thin elements may hold a centre in some orientations and none in others.
            Err(SectionError::Tool(ToolError::TooSmall { .. })) => {
                counts.fill(0);
                Ok(())
            }
            other => other,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Grid;
    use crate::tool::Segment;
    use glam::DVec3;

    #[test]
    fn elements_sum_to_the_whole_tool() {
        let grid = Grid { origin: DVec3::ZERO, pitch: 4.0, dims: [9, 11, 13] };
        let solid = (0..grid.len()).map(|i| u8::from(i.wrapping_mul(2_654_435_761) >> 7 & 3 == 0)).collect();
        let obstacle = Occupancy { grid, solid };
        let mut tool = Tool::paper();
        let ToolShape::Revolved(elements) = &mut tool.shape else { panic!() };
        // Between two layers of centres when upright.
        let disc = Segment::Line { from: 83.0, to: 83.9, radius_from: 9.0, radius_to: 9.0 };
        elements.push(Element { kind: ElementKind::Holder(1), profile: vec![disc] });
        let plans = ElementPlans::new(&obstacle, &tool).unwrap();
        assert_eq!(
            plans.elements().collect::<Vec<_>>(),
            [ElementKind::Cutter, ElementKind::Holder(0), ElementKind::Holder(1)]
        );
        let whole = SectionPlan::new(&obstacle, &tool).unwrap();
        let mut scratch = SectionScratch::default();
        let (mut expected, mut part) = (vec![0; grid.len()], vec![0; grid.len()]);
        for orientation in [Orientation::default(), Orientation::new(40.0, 75.0)] {
            let normaliser = whole.counts(&orientation, &mut scratch, &mut expected).unwrap();
            assert_eq!(plans.normaliser(&orientation).unwrap(), normaliser);
            let mut sum = vec![0; grid.len()];
            for element in 0..3 {
                plans.counts(element, &orientation, &mut scratch, &mut part).unwrap();
                sum.iter_mut().zip(&part).for_each(|(s, p)| *s += p);
            }
            assert_eq!(sum, expected);
        }
    }
}
