//! Sections of the tool's elements by themselves: what collides, cutter, shank or which holder segment.
//!
//! An element's measure is its share of the collision measure: its voxels over the *whole* tool's count, at the sharp
//! point that makes the whole least. Elements do not overlap, so their measures sum to the collision measure.

use std::sync::{Arc, Mutex, PoisonError};

use super::{
    At, Cuttable, Imf, SectionError, SectionPlan, SectionScratch, direct_count, stream_orientations,
};
use crate::control::Control;
use crate::grid::Grid;
use crate::obstacle::Obstacle;
use crate::occupancy::Occupancy;
use crate::orientation::Orientation;
use crate::tool::{Assembly, Element, ElementKind, RotatedTool, SharpPoints, Tool, ToolError, ToolShape};

/// One plan for each element of a tool, and one for the whole.
///
/// Of a tool grown by a clearance ([`Tool::inflated`]) each piece belongs to the element that reaches farthest out there;
/// pieces of one element are one. Lists of orientations, grids and errors are those of [`SectionPlan`].
pub struct ElementPlans {
    whole: SectionPlan,
    elements: Vec<Planned>,
}

struct Planned {
    kind: ElementKind,
    layers: Vec<Layer>,
}

/// An element against what it must stay out of.
enum Layer {
    Planned(Box<SectionPlan>),
    /// It holds no voxel centre upright: it is so thin that direct sums are quick.
    Thin {
        obstacle: Arc<Occupancy>,
        alone: Tool,
    },
}

/// Working memory of one thread.
#[derive(Default)]
pub struct ElementScratch {
    section: SectionScratch,
    /// Over the query box, by element.
    counts: Vec<Vec<u32>>,
    total: Vec<u32>,
    least: Vec<f32>,
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
        let whole = SectionPlan::with_query(&obstacle, &assembly, At::SharpPoints, query_grid)?;
        let (tool, layer) = (assembly.whole(), Cuttable::of(&obstacle, &assembly));
        let mut kinds = kinds_of(tool);
        kinds.extend(layer.iter().flat_map(|layer| kinds_of(layer.noncutting)));
        kinds.sort_by_key(|kind| kind.rank());
        kinds.dedup();
        let plan = |kind: ElementKind| {
            let cuttable = layer.map(|Cuttable { voxels, noncutting }| (voxels, noncutting));
            let against = [(&obstacle.forbidden, tool)].into_iter().chain(cuttable);
            let layers = against
                .filter_map(|(obstacle, owner)| Some((obstacle, alone(owner, kind, tool, query_grid.pitch)?)))
                .map(|(obstacle, alone)| Layer::new(obstacle, query_grid, alone))
                .collect::<Result<_, _>>()?;
            Ok(Planned { kind, layers })
        };
        let elements = kinds.into_iter().map(plan).collect::<Result<_, SectionError>>()?;
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

    /// The whole tool's count in an orientation, which every element's count is divided by.
    ///
    /// # Errors
    /// A tool that does not fit the grid.
    pub fn normaliser(&self, orientation: &Orientation) -> Result<u32, ToolError> {
        Ok(RotatedTool::new(&self.whole.tool, orientation, self.whole.grid.pitch)?.count)
    }

    /// Bytes that plans of a tool's elements take with this many threads, beside those of the whole tool's plan.
    #[must_use]
    pub fn memory_estimate(obstacle: &Grid, query_grid: &Grid, tool: &Tool, threads: usize) -> u64 {
        let kinds = kinds_of(tool);
        let each = |&kind: &ElementKind| {
            alone(tool, kind, tool, obstacle.pitch).map_or(0, |alone| {
                SectionPlan::memory_estimate_with_query(obstacle, query_grid, &alone, threads)
            })
        };
        // Counts of every element and the total over the query box, and what is least where.
        let reads = (kinds.len() as u64 + 1) * 4 * SectionPlan::query_voxels(obstacle, query_grid, tool)
            + 8 * query_grid.len() as u64;
        kinds.iter().map(each).sum::<u64>() + threads as u64 * reads
    }

    /// Every element's share of the collision measure at every voxel of the grid, C-ordered into `measures[element]`:
    /// whole-number counts read at the first sharp point `k` whose overlap of the whole tool is least, over the whole
    /// tool's count. They sum to [`SectionPlan::cmf`] but for the rounding of each to f32 (at most half a unit in its
    /// last place). Equal to [`super::direct_element_measures`].
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
        let voxels = self.whole.grid.len();
        let fits = measures.len() == self.elements.len() && measures.iter().all(|m| m.len() == voxels);
        assert!(fits, "one array of the grid's length for each element");
        let normaliser = f64::from(self.normaliser(orientation)?);
        scratch.counts.resize_with(self.elements.len(), Vec::new);
        scratch.total.clear();
        scratch.total.resize(self.whole.query.len(), 0);
        for (element, counts) in self.elements.iter().zip(&mut scratch.counts) {
            element.count(&self.whole, orientation, &mut scratch.section, counts)?;
            scratch.total.iter_mut().zip(&*counts).for_each(|(total, count)| *total += count);
        }
        let rotation = orientation.rotation();
        let pitch = self.whole.grid.pitch;
        let corners: Vec<_> = self
            .whole
            .sharp_points
            .iter()
            .map(|&sharp| {
                let mut corners = self.whole.corners(-(rotation * sharp / pitch));
                corners.iter_mut().for_each(|(_, weight)| *weight /= normaliser);
                corners
            })
            .collect();
        let ElementScratch { counts, total, least, at, .. } = scratch;
        least.clear();
        least.resize(voxels, f32::INFINITY);
        at.clear();
        at.resize(voxels, 0);
        for (k, corners) in corners.iter().enumerate() {
            self.each_line(corners, |line, starts| {
                if k > 0 && least[line.clone()].iter().all(|&least| least == 0.0) {
                    return;
                }
                let places = least[line.clone()].iter_mut().zip(&mut at[line]);
                for (z, (least, at)) in places.enumerate() {
                    let overlap = read(total, starts, z);
                    if overlap < *least {
                        (*least, *at) = (overlap, k as u32);
                    }
                }
            });
        }
        for (k, corners) in corners.iter().enumerate() {
            self.each_line(corners, |line, starts| {
                for (z, voxel) in line.enumerate().filter(|&(_, voxel)| at[voxel] == k as u32) {
                    for (counts, measures) in counts.iter().zip(&mut *measures) {
                        measures[voxel] = read(counts, starts, z);
                    }
                }
            });
        }
        Ok(())
    }

    /// Shows every line along z of the grid with the positions in the query box where its reading begins.
    fn each_line(
        &self,
        corners: &[([i64; 3], f64)],
        mut visit: impl FnMut(std::ops::Range<usize>, &[(usize, f64)]),
    ) {
        let [nx, ny, nz] = self.whole.grid.dims;
        let mut starts = Vec::with_capacity(corners.len());
        for (x, y) in (0..nx).flat_map(|x| (0..ny).map(move |y| (x, y))) {
            starts.clear();
            starts.extend(corners.iter().map(|&([dx, dy, dz], weight)| {
                (self.whole.query.index([x as i64 + dx, y as i64 + dy, dz]), weight)
            }));
            let from = (x * ny + y) * nz;
            visit(from..from + nz, &starts);
        }
    }
}

/// The weighted mean of counts, in the same steps as a section's.
fn read(counts: &[u32], starts: &[(usize, f64)], z: usize) -> f32 {
    let mean: f64 = starts.iter().map(|&(from, weight)| weight * f64::from(counts[from + z])).sum();
    (mean as f32).clamp(0.0, 1.0)
}

/// The elements of a tool, each once.
fn kinds_of(tool: &Tool) -> Vec<ElementKind> {
    let ToolShape::Revolved(elements) = &tool.shape else { return Vec::new() };
    let mut kinds: Vec<ElementKind> = elements.iter().map(|e| e.kind).collect();
    kinds.sort_by_key(|kind| kind.rank());
    kinds.dedup();
    kinds
}

/// The pieces of `owner` that are of one kind, sharp where `tool` is, so that all are read over the same box.
fn alone(owner: &Tool, kind: ElementKind, tool: &Tool, pitch: f64) -> Option<Tool> {
    let ToolShape::Revolved(elements) = &owner.shape else { return None };
    let pieces: Vec<Element> = elements.iter().filter(|e| e.kind == kind).cloned().collect();
    let sharp_points = SharpPoints::Points(tool.sharp_point_positions(pitch));
    (!pieces.is_empty()).then(|| Tool { shape: ToolShape::Revolved(pieces), sharp_points, ..owner.clone() })
}

impl Layer {
    fn new(obstacle: &Arc<Occupancy>, query_grid: &Grid, alone: Tool) -> Result<Self, SectionError> {
        match SectionPlan::with_query(obstacle.clone(), &alone, At::SharpPoints, query_grid) {
            Ok(plan) => Ok(Self::Planned(Box::new(plan))),
            Err(SectionError::Tool(ToolError::TooSmall { .. } | ToolError::Empty { .. })) => {
                Ok(Self::Thin { obstacle: obstacle.clone(), alone })
            }
            Err(error) => Err(error),
        }
    }
}

impl Planned {
    /// The element's voxels that are forbidden to it, over the query box of `whole`.
    fn count(
        &self,
        whole: &SectionPlan,
        orientation: &Orientation,
        scratch: &mut SectionScratch,
        counts: &mut Vec<u32>,
    ) -> Result<(), SectionError> {
        counts.clear();
        counts.resize(whole.query.len(), 0);
        for layer in &self.layers {
            let outcome = match layer {
                Layer::Planned(plan) => plan.box_counts(orientation, &plan.query, scratch).map(|_| {
                    counts.iter_mut().zip(&scratch.counts).for_each(|(sum, count)| *sum += count);
                }),
                Layer::Thin { obstacle, alone } => RotatedTool::new(alone, orientation, obstacle.grid.pitch)
                    .map_err(Into::into)
                    .map(|rotated| {
                        for (index, sum) in counts.iter_mut().enumerate() {
                            *sum += direct_count(obstacle, &rotated, whole.query.voxel(index));
                        }
                    }),
            };
            match outcome {
                // Thin elements may hold a centre in some orientations and none in others.
                Ok(()) | Err(SectionError::Tool(ToolError::TooSmall { .. })) => {}
                other => return other,
            }
        }
        Ok(())
    }
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
    let mut wanted: Vec<Vec<u32>> = vec![Vec::new(); orientations.len()];
    for (voxel, (&value, &best)) in imf.value.iter().zip(&imf.best).enumerate() {
        if let Some(list) = wanted.get_mut(best as usize).filter(|_| value > 0.0) {
            list.push(voxel as u32);
        }
    }
    let kinds: Vec<ElementKind> = plans.elements().collect();
    let found = Mutex::new(vec![vec![0.0_f32; voxels]; kinds.len()]);
    let start = || (ElementScratch::default(), vec![vec![0.0_f32; voxels]; kinds.len()]);
    stream_orientations(
        orientations.len(),
        control,
        start,
        |(scratch, measures), index| -> Result<(), SectionError> {
            if wanted[index].is_empty() {
                return Ok(());
            }
            plans.measures(&orientations[index], scratch, measures)?;
            // Every voxel has one best orientation: no two threads write the same place.
            let mut found = found.lock().unwrap_or_else(PoisonError::into_inner);
            for (found, measures) in found.iter_mut().zip(&*measures) {
                wanted[index].iter().for_each(|&voxel| found[voxel as usize] = measures[voxel as usize]);
            }
            Ok(())
        },
    )?;
    let values = found.into_inner().unwrap_or_else(PoisonError::into_inner);
    Ok(ElementMeasures { kinds, values })
}

#[cfg(test)]
mod tests;
