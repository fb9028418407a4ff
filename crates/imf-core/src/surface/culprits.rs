//! Why a surface is not reached: for each sample the contact pose of minimum overlap, and how much each solid voxel
//! contributes.
//!
//! The overlap of a pose counts the solid voxel centres that obstruct its cutter, shank and holder. Its minimum over
//! the contact poses at which the cutter fits among the part, or over all where it fits at none, is a sample's *obstruction*, in
//! volume; over the surface it sums to `J = Σ area · obstruction`. With the
//! poses fixed, `J` is linear in the material of each voxel, so that [`culprits`] is its exact derivative: what J loses when a
//! voxel goes.

use std::cell::Cell;

use glam::DVec3;

use super::contact::{ContactFrame, Touch};
use super::places::map_alike;
use super::sample_query::{Outcome, SampleQuery};
use super::{Revolved, Shape, SurfaceError, SurfaceSample, SurfaceTool, ToolDirection, Verdict};
use crate::control::Control;
use crate::field::solid::SolidField;
use crate::grid::Grid;
use crate::orientation::Orientation;
use crate::parallel;
use crate::pose::Pose;
use crate::tool::{Element, ElementKind, ToolShape};

/// The contact pose of minimum overlap of one sample, among those at which the cutter fits where there are any.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MinimumOverlap {
    /// The direction's number.
    pub direction: u32,
    /// The pose, in the grid's unit.
    pub pose: Pose,
    /// Number of solid voxels that obstruct cutter, shank and holder together.
    pub voxels: u32,
    /// Number of those that obstruct the cutter.
    pub of_cutter: u32,
    /// Number of points of surfaces in the pieces of the tool that hold no voxel.
    pub surface: u32,
    /// True where the cutter holds nothing of the part that counts: neither voxels nor points of its surface.
    pub cutter_fits: bool,
}

impl MinimumOverlap {
    /// Less is nearer to being reached.
    #[must_use]
    pub fn key(&self) -> (bool, u32, u32) {
        (!self.cutter_fits, self.voxels, self.surface)
    }
}

/// An element that collides with a body at a pose. Lengths are in the grid's unit, of the element offset by its clearance.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ElementCollision {
    /// The element.
    pub kind: ElementKind,
    /// 0 the part, then the fixtures.
    pub body: usize,
    /// Solid voxels whose centres are in it; of the cutter those deeper than the tolerance, 0 where it holds points of the surface alone.
    pub voxels: u32,
    /// How deep below its surface the deepest of these centres and points lies.
    pub depth: f64,
    /// With a radius smaller by this at every height it would hold none of them.
    pub slimmer: f64,
}

impl Revolved {
    /// The elements that a pose's overlap counts, each with the solid that it must avoid. `named` are the elements
    /// that hits report; the first is the cutter against fixtures.
    fn elements<'a>(&'a self, named: &'a [(Element, Vec<SolidField>)]) -> Vec<(&'a Element, &'a SolidField)> {
        let mut elements = vec![(&self.eroded, &self.cutter)];
        elements.extend(self.held.as_ref().map(|held| (&named[0].0, held)));
        if let (Some(rest), Some(ToolShape::Revolved(above))) =
            (&self.rest, self.above.as_ref().map(|tool| &tool.shape))
        {
            elements.extend(above.iter().map(|element| (element, rest)));
        }
        elements
    }
}

/// Places around a level ring.
const AROUND: u32 = 8;
/// Samples that are one unit of work.
const CHUNK: usize = 16;

impl SurfaceTool {
    /// What obstructs the tool at a pose; nothing its cutter where that is known to fit.
    fn overlap(&self, direction: u32, pose: Pose, fits: bool) -> MinimumOverlap {
        // Voxels, or else points of surfaces.
        let count = |piece: &SolidField| {
            let (voxels, surface) = (piece.count(&pose).unwrap_or(u32::MAX), Cell::new(0));
            if voxels == 0 {
                piece.visit_surface(&pose, |_, _, _, _| surface.set(surface.get() + 1));
            }
            (voxels, surface.get())
        };
        match &*self.shape {
            Shape::Mesh { whole, .. } => {
                let (voxels, surface) = count(whole);
                MinimumOverlap { direction, pose, voxels, of_cutter: 0, surface, cutter_fits: true }
            }
            Shape::Revolved(tool) => {
                let cutter = if fits { (0, 0) } else { count(&tool.cutter) };
                let others = tool.held.iter().chain(&tool.rest).map(count);
                let (voxels, surface) =
                    others.fold(cutter, |a, b| (a.0.saturating_add(b.0), a.1.saturating_add(b.1)));
                let cutter_fits = cutter == (0, 0);
                MinimumOverlap { direction, pose, voxels, of_cutter: cutter.0, surface, cutter_fits }
            }
        }
    }

    /// The tips of a direction's contact poses.
    fn contact_tips(&self, sample: &SurfaceSample, turn: &ToolDirection, mut visit: impl FnMut(DVec3)) {
        let tool = match &*self.shape {
            Shape::Revolved(tool) => tool,
            Shape::Mesh { touching, .. } => {
                let support = |v: &&DVec3| -sample.normal.dot(turn.rotation * **v);
                if let Some(touching) = touching.iter().max_by(|a, b| support(a).total_cmp(&support(b))) {
                    visit(sample.point + sample.normal * self.tolerance - turn.rotation * *touching);
                }
                return;
            }
        };
        let Some(frame) = ContactFrame::new(sample.normal, turn.axis, tool.highest) else { return };
        let u = turn.axis.any_orthonormal_vector();
        let v = turn.axis.cross(u);
        tool.outline.touches(frame.slope, self.tolerance, |touch| match touch {
            Touch::Point { height, radius, hangs } => {
                let tip = frame.tip(sample.point, height, radius);
                if !(hangs && tool.axis_meets_part(tip, turn.axis)) {
                    visit(tip);
                }
            }
            Touch::Ring { height, inner, outer } => {
                let middle = sample.point - turn.axis * height;
                if inner == 0.0 {
                    visit(middle);
                }
                for place in 0..AROUND {
                    let angle = f64::from(place) * std::f64::consts::TAU / f64::from(AROUND);
                    visit(middle + (u * angle.cos() + v * angle.sin()) * outer);
                }
            }
        });
    }

    fn minimum_overlap(
        &self,
        sample: &SurfaceSample,
        verdict: Verdict,
        turns: &[ToolDirection],
    ) -> Option<MinimumOverlap> {
        let mut least: Option<MinimumOverlap> = None;
        // A cutter that steps aside fits where none fits that touches the sample itself; where it is gouged none does.
        let query = (verdict == Verdict::Obstructed).then(|| SampleQuery::new(self, sample, None));
        for (direction, turn) in turns.iter().enumerate() {
            let mut consider = |tip: DVec3, fits: bool| {
                let here = self.overlap(direction as u32, Pose::new(tip, turn.rotation), fits);
                if least.is_none_or(|before| here.key() < before.key()) {
                    least = Some(here);
                }
            };
            let beside = query.as_ref().map(|query| self.at_best(query, turn, &mut [None; 2]));
            if let Some(Outcome::Obstructed(tip)) = beside {
                consider(tip, true);
            }
            self.contact_tips(sample, turn, |tip| consider(tip, false));
        }
        least
    }

    /// What collides at such a pose with what, the largest volume first.
    #[must_use]
    pub fn collisions(&self, at: &MinimumOverlap) -> Vec<ElementCollision> {
        let mut found = Vec::new();
        let mut try_one = |element: &Element, body: usize, solid: &SolidField| {
            let is_cutter = element.kind == ElementKind::Cutter;
            let Some(voxels) = solid.count(&at.pose) else { return };
            let deepest = Cell::new(None);
            let visit = |height: f64, radius: f64| {
                let (depth, slimmer) = deepest.get().unwrap_or((0.0_f64, 0.0_f64));
                let own = element.depth(height, radius, !is_cutter);
                deepest.set(Some((depth.max(own), slimmer.max(element.radius_at(height) - radius))));
            };
            element.visit_inside(solid.voxels().occupancy(), &at.pose, |_, height, radius| {
                visit(height, radius);
            });
            solid.visit_surface(&at.pose, |_, _, height, radius| visit(height, radius));
            let Some((mut depth, slimmer)) = deepest.get() else { return };
            // The cutter is tried without its outermost layer.
            depth += if is_cutter { self.tolerance } else { 0.0 };
            found.push(ElementCollision { kind: element.kind, body, voxels, depth, slimmer });
        };
        if let Some(revolved) = self.revolved().filter(|_| !at.cutter_fits) {
            try_one(&revolved.eroded, 0, &revolved.cutter);
        }
        for (element, against) in self.elements.iter() {
            for (body, solid) in against.iter().enumerate() {
                if element.kind != ElementKind::Cutter || body > 0 {
                    try_one(element, body, solid);
                }
            }
        }
        found.sort_by_key(|hit| std::cmp::Reverse(hit.voxels));
        found
    }
}

/// For each of some samples, by their numbers and the tool's verdicts, the [`MinimumOverlap`] of all directions; `None` where the cutter has no point that
/// could touch. On all threads; one unit of progress is one sample.
///
/// # Errors
/// [`SurfaceError::Cancelled`] when the control asks to stop.
///
/// # Panics
/// If there is no such sample.
pub fn minimum_overlaps(
    tool: &SurfaceTool,
    samples: &[SurfaceSample],
    chosen: &[(usize, Verdict)],
    directions: &[Orientation],
    control: Control<'_>,
) -> Result<Vec<Option<MinimumOverlap>>, SurfaceError> {
    let turns: Vec<ToolDirection> = directions.iter().map(ToolDirection::new).collect();
    let least = |_: &mut (), &(sample, verdict): &(usize, Verdict)| {
        tool.minimum_overlap(&samples[sample], verdict, &turns)
    };
    let alike = |&(one, of_one): &(usize, Verdict), &(other, of_other): &(usize, Verdict)| {
        of_one == of_other && samples[one].is_tried_with(&samples[other])
    };
    Ok(map_alike(chosen, alike, (CHUNK, control), || (), least)?)
}

/// For each voxel of the surroundings' grid: the summed area of the samples whose pose it obstructs, counted once per
/// piece of the tool (cutter; cutter at fixtures; shank and holder), in the grid's unit squared. Multiplied by the
/// voxel's volume it is ∂J/∂(material) at fixed poses; what points of surfaces alone obstruct weighs nothing. `poses` are pairs of a
/// sample's area and its pose. `None` for
/// mesh tools.
///
/// # Errors
/// [`SurfaceError::Cancelled`] when the control asks to stop; one unit of progress is one sample.
pub fn culprits(
    tool: &SurfaceTool,
    poses: &[(f64, MinimumOverlap)],
    control: Control<'_>,
) -> Result<Option<(Grid, Vec<f32>)>, SurfaceError> {
    let Some(revolved) = tool.revolved() else { return Ok(None) };
    let grid = revolved.cutter.voxels().occupancy().grid;
    let elements = revolved.elements(&tool.elements);
    let in_the_way = |_: &mut (), &(area, at): &(f64, MinimumOverlap)| {
        let mut blamed: Vec<(usize, f64)> = Vec::new();
        // The first is the cutter among the part.
        for (element, solid) in elements.iter().skip(usize::from(at.cutter_fits)) {
            element
                .visit_inside(solid.voxels().occupancy(), &at.pose, |voxel, _, _| blamed.push((voxel, area)));
        }
        blamed
    };
    let blamed = parallel::map_in_chunks(poses, CHUNK, control, || (), in_the_way)?;
    let mut blame = vec![0.0_f64; grid.len()];
    blamed.into_iter().flatten().for_each(|(voxel, area)| blame[voxel] += area);
    Ok(Some((grid, blame.into_iter().map(|area| area as f32).collect())))
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::CollisionEnvironment;
    use super::super::closed_forms::Part;
    use super::*;
    use crate::occupancy::Occupancy;
    use crate::parts::shell::{circle, pocketed};
    use crate::section::test_shapes::{orientations, revolved};
    use crate::tool::{Segment, Tool};
    use glam::DVec2;

    /// A block with a round pocket that a short tool does not reach the bottom of, from straight above and from two sides.
    fn pocket() -> Part {
        let mesh = pocketed(DVec3::new(24.0, 20.0, 16.0), &circle(DVec2::new(10.0, 10.0), 5.0, 48), 12.0);
        let grid = Grid { origin: DVec3::splat(-2.0), pitch: 1.0, dims: [28, 24, 20] };
        Part::on(&grid, &mesh, 400)
    }

    fn short() -> Tool {
        revolved([
            (ElementKind::Cutter, vec![Segment::ball_end(2.0), Segment::cylinder(2.0, 5.0, 2.0)]),
            (ElementKind::Shank, vec![Segment::cylinder(5.0, 6.0, 2.0)]),
            (ElementKind::Holder(0), vec![Segment::cylinder(6.0, 26.0, 7.0)]),
        ])
    }

    #[test]
    fn what_is_in_the_way_is_what_the_obstruction_loses_when_it_goes() {
        let part = pocket();
        let (solid, samples) = (part.environment.part().clone(), &part.samples);
        let tool_here = part.surface_tool(&short());
        let directions = orientations("0,0;30,40;200,70");
        let no = Control::quiet();
        let reach = part.access(&tool_here, &directions).reach;
        let verdicts = (0..samples.len()).map(|sample| (sample, reach[sample].verdict()));
        let missed: Vec<(usize, Verdict)> =
            verdicts.filter(|(_, verdict)| *verdict == Verdict::Obstructed).collect();
        assert!(missed.len() > 20, "{}", missed.len());
        let least = minimum_overlaps(&tool_here, samples, &missed, &directions, no).unwrap();
        let poses: Vec<(f64, MinimumOverlap)> =
            missed.iter().zip(least).map(|(&(s, _), least)| (samples[s].area, least.unwrap())).collect();
        // Something is in the way at all of them, by the definition.
        let obstruction = |solid: &Occupancy| -> f64 {
            let environment = CollisionEnvironment::new(&Arc::new(solid.clone()).into(), &[]);
            let tool = SurfaceTool::new(&environment, &short().into(), 0.1).unwrap();
            poses
                .iter()
                .map(|(area, at)| area * f64::from(tool.overlap(0, at.pose, at.cutter_fits).voxels))
                .sum()
        };
        assert!(poses.iter().all(|(_, at)| at.voxels > 0 || at.surface > 0));
        let (grid, blame) = culprits(&tool_here, &poses, no).unwrap().unwrap();
        assert_eq!(grid, solid.grid);
        let whole = obstruction(&solid);
        let total: f64 = blame.iter().map(|&b| f64::from(b)).sum();
        assert!((total - whole).abs() < 1e-5 * whole, "{total} {whole}");
        let mut tried = 0;
        // One inside that is taken away would leave a cavity, which counts as filled.
        for voxel in solid.solids().filter(|&voxel| solid.is_exposed(voxel)).step_by(31) {
            let mut without = solid.clone();
            without.solid[voxel] = 0;
            let loss = whole - obstruction(&without);
            assert!(
                (loss - f64::from(blame[voxel])).abs() < 1e-5 * whole,
                "{voxel}: {loss} {}",
                blame[voxel]
            );
            tried += u32::from(blame[voxel] > 0.0);
        }
        assert!(tried > 3, "{tried}");
        // The holder is to blame, not the ball.
        let found = tool_here.collisions(&poses[0].1);
        assert_eq!(found.iter().map(|hit| hit.voxels).sum::<u32>(), poses[0].1.voxels);
        let blamed = |hit: &ElementCollision| hit.kind != ElementKind::Cutter && hit.body == 0;
        assert!(found.iter().all(blamed), "{found:?}");
        // As deep as the deepest centre or point, by trying all, and slim enough when its radius is that much less.
        let ToolShape::Revolved(elements) = short().shape else { panic!() };
        for hit in &found {
            let element = elements.iter().find(|e| e.kind == hit.kind).unwrap();
            let pose = poses[0].1.pose;
            let axis = pose.axis().unwrap();
            let inside = solid.centres().chain(part.environment.keep_out.points()).filter_map(|place| {
                let offset = place - pose.position;
                let height = offset.dot(axis);
                let radius = (offset - axis * height).length();
                let segment =
                    element.profile.iter().find(|s| s.range().0 <= height && height < s.range().1)?;
                let room = segment.radius(height) - radius;
                (room > 1e-9).then(|| (room, element.depth(height, radius, true)))
            });
            let inside: Vec<(f64, f64)> = inside.collect();
            let most = |of: &dyn Fn(&(f64, f64)) -> f64| inside.iter().map(of).fold(0.0, f64::max);
            assert!((hit.slimmer - most(&|found| found.0)).abs() < 1e-6, "{hit:?}");
            assert!(hit.depth > 0.0 && (hit.depth - most(&|found| found.1)).abs() < 1e-6, "{hit:?}");
        }
    }
}
