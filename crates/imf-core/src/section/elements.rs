//! Sections of the tool's elements by themselves: what collides, cutter, shank or which holder segment.
//!
//! An element's measure is its fraction of the collision measure: its voxels over the *whole* tool's count, at the sharp
//! point that makes the whole minimal. Elements do not overlap, so their measures sum to the collision measure.

use std::sync::{Arc, Mutex, PoisonError};

use super::direct::kinds_of;
use super::overlap::OverlapCounter;
use super::reading::{Line, SharpPointReader, mean};
use super::{
    Imf, SectionError, SectionPlan, SectionScratch, ToolPoints, cuttable_and_noncutting, query_box,
    stream_orientations,
};
use crate::control::Control;
use crate::grid::Grid;
use crate::obstacle::Obstacle;
use crate::occupancy::Occupancy;
use crate::orientation::Orientation;
use crate::tool::{Assembly, Element, ElementKind, SharpPoints, Tool, ToolShape};

/// One plan for each element of a tool, and one for the whole.
///
/// Of a tool offset by a clearance ([`Tool::with_clearance`]) each piece belongs to the element that reaches farthest out there;
/// pieces of one element are one. Lists of orientations, grids and errors are those of [`SectionPlan`].
pub struct ElementPlans {
    whole: SectionPlan,
    elements: Vec<PlannedElement>,
}

struct PlannedElement {
    kind: ElementKind,
    /// The element against what is forbidden; none where clearances leave nothing of it.
    whole: Option<OverlapCounter>,
    /// Its part of shank and holder against what the cutter may enter.
    noncutting: Option<OverlapCounter>,
}

/// Working memory of one thread.
#[derive(Default)]
pub struct ElementScratch {
    section: SectionScratch,
    /// Over the query box, by element.
    counts: Vec<Vec<u32>>,
    total: Vec<u32>,
    minimum: Vec<f32>,
    /// Sharp point that has it.
    at: Vec<u32>,
}

impl ElementPlans {
    /// Plans sections of every element of a tool at every voxel of `query_grid`; no element for a mesh.
    ///
    /// # Errors
    /// As [`SectionPlan::with_query`].
    pub fn new(
        obstacle: impl Into<Obstacle>,
        assembly: impl Into<Assembly>,
        query_grid: &Grid,
    ) -> Result<Self, SectionError> {
        let (obstacle, assembly) = (obstacle.into(), assembly.into());
        let whole = SectionPlan::with_query(&obstacle, &assembly, ToolPoints::SharpPoints, query_grid)?;
        let cuttable = cuttable_and_noncutting(&obstacle, &assembly);
        let forbidden = (&obstacle.forbidden, assembly.whole());
        let counter = |(voxels, tool): (&Arc<Occupancy>, &Tool), kind: ElementKind| {
            Some(OverlapCounter::new(voxels.clone(), alone(tool, kind)?, whole.query))
        };
        let tools = [forbidden].into_iter().chain(cuttable).map(|(_, tool)| tool);
        let kinds = kinds_of(tools.flat_map(Tool::elements));
        let element = |kind| PlannedElement {
            kind,
            whole: counter(forbidden, kind),
            noncutting: cuttable.and_then(|pair| counter(pair, kind)),
        };
        let elements = kinds.into_iter().map(element).collect();
        Ok(Self { whole, elements })
    }

    /// The elements from the tip upwards.
    pub fn elements(&self) -> impl Iterator<Item = ElementKind> {
        self.elements.iter().map(|e| e.kind)
    }

    /// The whole tool's plan.
    #[must_use]
    pub fn whole(&self) -> &SectionPlan {
        &self.whole
    }

    /// Bytes that plans of a tool's elements take with this many threads, beside those of the whole tool's plan.
    #[must_use]
    pub fn memory_estimate(obstacle: &Grid, query_grid: &Grid, tool: &Tool, threads: usize) -> u64 {
        let kinds = kinds_of(tool.elements().iter());
        let sharp_points = tool.sharp_point_positions(obstacle.pitch);
        let query = query_box(obstacle, query_grid, &sharp_points).unwrap_or_default();
        // All are read over the same box, that of the whole tool.
        let each = kinds.iter().filter_map(|&kind| alone(tool, kind)).map(|alone| {
            let alone = Tool { sharp_points: SharpPoints::Points(sharp_points.clone()), ..alone };
            SectionPlan::memory_estimate_with_query(obstacle, query_grid, &alone, threads)
        });
        // Counts of every element and the total over the query box, and the minimum and where it is.
        let reads = (kinds.len() as u64 + 1) * 4 * query.len() as u64 + 8 * query_grid.len() as u64;
        each.sum::<u64>() + threads as u64 * reads
    }

    /// Every element's fraction of the collision measure at every voxel of the grid, C-ordered into
    /// `measures[element]`: whole-number counts read at the first sharp point `k` whose overlap of the whole tool is
    /// smallest, over the whole tool's count. They sum to [`SectionPlan::cmf`] but for the rounding of each to f32
    /// (at most half a unit in its last place). Equal to [`super::direct_element_measures`].
    ///
    /// # Errors
    /// As [`SectionPlan::cmf`].
    ///
    /// # Panics
    /// If there is not one array of the grid's length for each element.
    pub fn measures(
        &self,
        orientation: &Orientation,
        scratch: &mut ElementScratch,
        measures: &mut [Vec<f32>],
    ) -> Result<(), SectionError> {
        self.measures_where(|_| true, orientation, scratch, measures)
    }

    /// The same at the voxels that are `wanted`, and 0 elsewhere.
    fn measures_where(
        &self,
        wanted: impl Fn(usize) -> bool,
        orientation: &Orientation,
        scratch: &mut ElementScratch,
        measures: &mut [Vec<f32>],
    ) -> Result<(), SectionError> {
        let (plan, voxels) = (&self.whole, self.whole.grid.len());
        let fits = measures.len() == self.elements.len() && measures.iter().all(|m| m.len() == voxels);
        assert!(fits, "one array of the grid's length for each element");
        let ElementScratch { section, counts, total, minimum, at } = scratch;
        counts.resize_with(self.elements.len(), Vec::new);
        total.clear();
        total.resize(plan.query.len(), 0);
        let mut normaliser = 0;
        for (element, counts) in self.elements.iter().zip(&mut *counts) {
            counts.clear();
            counts.resize(plan.query.len(), 0);
            let mut add = |counter: &OverlapCounter| {
                let SectionScratch { counter: scratch, more, .. } = &mut *section;
                counter.add(orientation, &plan.query, scratch, (counts, more))
            };
            normaliser += element.whole.as_ref().map_or(Ok(0), &mut add)?;
            element.noncutting.as_ref().map_or(Ok(0), &mut add)?;
            total.iter_mut().zip(counts).for_each(|(total, count)| *total += *count);
        }
        if normaliser == 0 {
            // Of a mesh, or too thin a tool, which is an error.
            normaliser = plan.rotated(orientation)?.count;
        }
        minimum.clear();
        minimum.extend((0..voxels).map(|voxel| if wanted(voxel) { f32::INFINITY } else { 0.0 }));
        at.clear();
        at.resize(voxels, 0);
        let reading = SharpPointReader::new(plan, orientation, normaliser, (total, &mut section.around));
        let (mut starts, mut reads) = (Vec::new(), Line::default());
        for (line, place) in plan.lines() {
            let (minimum, at) = (&mut minimum[line.clone()], &mut at[line.clone()]);
            reading.lower(place, minimum, Some(at), &mut reads);
            let mut last = None;
            for (z, voxel) in line.enumerate() {
                if minimum[z] == 0.0 {
                    // The sum of no elements.
                    measures.iter_mut().for_each(|measures| measures[voxel] = 0.0);
                    continue;
                }
                if last.replace(at[z]) != Some(at[z]) {
                    plan.starts(&reading.corners[at[z] as usize], place, &mut starts);
                }
                for (counts, measures) in counts.iter().zip(&mut *measures) {
                    measures[voxel] = mean(counts, &starts, z);
                }
            }
        }
        Ok(())
    }
}

/// The pieces of a tool that are of one kind.
fn alone(tool: &Tool, kind: ElementKind) -> Option<Tool> {
    let pieces: Vec<Element> = tool.elements().iter().filter(|e| e.kind == kind).cloned().collect();
    (!pieces.is_empty()).then(|| Tool { shape: ToolShape::Revolved(pieces), ..tool.clone() })
}

/// What every element contributes to the inaccessibility measure.
#[derive(Clone, Debug, PartialEq)]
pub struct ElementMeasures {
    /// The elements from the tip upwards.
    pub kinds: Vec<ElementKind>,
    /// By element: its measure at every voxel's best orientation, C-ordered.
    pub values: Vec<Vec<f32>>,
}

/// The elements' measures at the best orientation of every voxel of `imf`, on all threads of the current pool: a second
/// pass, over those orientations alone that are the best of a voxel which is not free. One unit of progress is one
/// orientation.
///
/// # Errors
/// As [`SectionPlan::cmf`]; [`SectionError::Cancelled`] when the control asks to stop.
///
/// # Panics
/// If `imf` has not the plans' grid.
pub fn elements_at_best(
    plans: &ElementPlans,
    orientations: &[Orientation],
    imf: &Imf,
    control: Control<'_>,
) -> Result<ElementMeasures, SectionError> {
    let voxels = plans.whole.grid.len();
    assert_eq!(imf.value.len(), voxels, "one value for each voxel of the grid");
    let wanted = |index: usize, voxel: usize| imf.best[voxel] as usize == index && imf.value[voxel] > 0.0;
    let mut any = vec![false; orientations.len()];
    for voxel in (0..voxels).filter(|&voxel| imf.value[voxel] > 0.0) {
        any.get_mut(imf.best[voxel] as usize).into_iter().for_each(|any| *any = true);
    }
    let kinds: Vec<ElementKind> = plans.elements().collect();
    let found = Mutex::new(vec![vec![0.0_f32; voxels]; kinds.len()]);
    let start = || (ElementScratch::default(), vec![vec![0.0_f32; voxels]; kinds.len()]);
    stream_orientations(
        orientations.len(),
        control,
        start,
        |(scratch, measures), index| -> Result<(), SectionError> {
            if !any[index] {
                return Ok(());
            }
            plans.measures_where(|voxel| wanted(index, voxel), &orientations[index], scratch, measures)?;
            // Every voxel has one best orientation: no two threads write the same place.
            let mut found = found.lock().unwrap_or_else(PoisonError::into_inner);
            for (found, measures) in found.iter_mut().zip(&*measures) {
                (0..voxels).filter(|&v| wanted(index, v)).for_each(|voxel| found[voxel] = measures[voxel]);
            }
            Ok(())
        },
    )?;
    let values = found.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(ElementMeasures { kinds, values })
}

#[cfg(test)]
mod tests;
