//! Small tools and obstacles that tests share.

use glam::DVec3;
use pulp::Arch;
use rand::Rng;
use rand_chacha::ChaCha8Rng;

use super::{SectionPlan, SectionScratch};
use crate::grid::Grid;
use crate::occupancy::Occupancy;
use crate::orientation::{Orientation, OrientationSet};
use crate::tool::{ElementKind, Segment, Tool};

pub(crate) fn line(from: f64, to: f64, radius_from: f64, radius_to: f64) -> Segment {
    Segment::Line { from, to, radius_from, radius_to }
}

pub(crate) fn arc(from: f64, to: f64, centre_height: f64, centre_radius: f64, arc_radius: f64) -> Segment {
    Segment::Arc { from, to, centre_height, centre_radius, arc_radius }
}

/// Sharp at its tip.
pub(crate) fn revolved(elements: impl IntoIterator<Item = (ElementKind, Vec<Segment>)>) -> Tool {
    Tool::revolved("test", elements)
}

/// A cutter of the given radius and height.
pub(crate) fn cylinder(radius: f64, height: f64) -> Tool {
    revolved([(ElementKind::Cutter, vec![Segment::cylinder(0.0, height, radius)])])
}

/// Whether a point, by its height and its distance from the axis, is within an outline.
pub(crate) fn holds(profile: &[Segment], height: f64, radius: f64) -> bool {
    let segment = profile.iter().find(|s| s.range().0 <= height && height < s.range().1);
    segment.is_some_and(|s| radius <= s.radius(height))
}

/// Distance in the plane of height and radius from a point to an outline, by a fine walk. Its lower end is part of it, its upper end where
/// it is `exposed`.
pub(crate) fn walk(profile: &[Segment], exposed: bool, height: f64, radius: f64) -> f64 {
    let (first, last) = (profile[0], profile[profile.len() - 1]);
    let (low, high) = (first.range().0, last.range().1);
    let points = (0..=1500).map(|step| f64::from(step) / 1500.0).flat_map(|t| {
        let flank = profile.iter().map(move |s| {
            let at = s.range().0 + (s.range().1 - s.range().0) * t;
            (at, s.radius(at))
        });
        let ends = exposed.then_some((high, last.radius(high) * t));
        flank.chain([(low, first.radius(low) * t)]).chain(ends)
    });
    points.map(|(h, r)| (h - height).hypot(r - radius)).fold(f64::INFINITY, f64::min)
}

/// A grid of unit voxels of which so many of four are solid.
pub(crate) fn scattered(dims: [usize; 3], of_four: usize) -> Occupancy {
    let grid = Grid { origin: DVec3::new(0.3, -1.0, 2.0), pitch: 1.0, dims };
    Occupancy::of(grid, |voxel| grid.index(voxel).wrapping_mul(2_654_435_761) >> 7 & 3 < of_four)
}

/// From 0 to 1.
pub(crate) fn number(random: &mut ChaCha8Rng) -> f64 {
    f64::from(random.next_u32()) / f64::from(u32::MAX)
}

pub(crate) fn orientations(set: &str) -> Vec<Orientation> {
    OrientationSet::parse(set).unwrap().orientations
}

/// Instruction sets of this machine, from the best to the plain one.
pub(crate) fn archs() -> Vec<Arch> {
    let mut archs = vec![Arch::new()];
    #[cfg(target_arch = "x86_64")]
    archs.extend(pulp::x86::V3::try_new().map(Arch::V3));
    archs.push(Arch::Scalar);
    archs
}

pub(crate) fn cmf(plan: &SectionPlan, orientation: &Orientation) -> Vec<f32> {
    let mut cmf = vec![f32::NAN; plan.grid().len()];
    plan.cmf(orientation, &mut SectionScratch::default(), &mut cmf).unwrap();
    cmf
}

/// Counts over the plan's grid, and the tool's own.
pub(crate) fn counts(plan: &SectionPlan, orientation: &Orientation) -> (Vec<u32>, u32) {
    let mut scratch = SectionScratch { counts: vec![u32::MAX; plan.grid().len()], ..Default::default() };
    let (whole, counts) = plan.counts_in(orientation, plan.grid(), &mut scratch).unwrap();
    (counts.to_vec(), whole)
}
