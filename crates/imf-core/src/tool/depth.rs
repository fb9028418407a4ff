//! Which solid voxels' centres an element or a mesh holds at a pose, and how deep below its surface each of them lies.

use glam::{DVec2, DVec3};

use super::extent::{bounds, line_through_cylinder};
use super::tool_voxels::{locate_inside, turn};
use super::voxel_count::{mesh_voxels, snapped};
use super::{Element, ElementKind, Segment, Tool, ToolVoxels};
use crate::mesh::Mesh;
use crate::occupancy::Occupancy;
use crate::pose::Pose;

impl Tool {
    /// All that cuts, as one element, and whether its upper end sticks out beyond what stands on it; `None` without a cutter.
    pub(crate) fn cutter(&self) -> Option<(Element, bool)> {
        let elements = self.elements();
        let cutting = |e: &&Element| e.kind == ElementKind::Cutter;
        let profile: Vec<Segment> =
            elements.iter().filter(cutting).flat_map(|e| e.profile.iter().copied()).collect();
        let last = profile.last()?;
        let end = last.range().1;
        let rest = elements.iter().filter(|e| !cutting(e)).filter_map(|e| e.profile.first());
        let neck = rest.filter(|s| s.range().0 <= end).map(|s| s.radius(end)).fold(0.0, f64::max);
        let exposed = last.radius(end) > neck;
        Some((Element { kind: ElementKind::Cutter, profile }, exposed))
    }

    /// The cutter's diameter, `None` where it tapers, and its corner radius; `None` of a mesh or without a cutter.
    pub(crate) fn cutter_size(&self) -> Option<(Option<f64>, f64)> {
        let (cutter, _) = self.cutter()?;
        let corner = match *cutter.profile.first()? {
            Segment::Arc { arc_radius, .. } => arc_radius,
            Segment::Line { .. } => 0.0,
        };
        let tapers = |s: &Segment| matches!(s, Segment::Line { radius_from, radius_to, .. } if radius_from != radius_to);
        let diameter = (!cutter.profile.iter().any(tapers)).then(|| 2.0 * cutter.max_radius());
        Some((diameter, corner))
    }

    /// Largest distance of any of a mesh's points from the tool's axis; 0 of a tool of revolution, which no roll moves.
    pub(crate) fn rolling_radius(&self) -> f64 {
        let vertices = self.mesh().into_iter().flat_map(|mesh| &mesh.vertices);
        vertices.map(|v| v.x.hypot(v.y)).fold(0.0, f64::max)
    }

    /// Visits the obstacle's solid voxels whose centres lie in a mesh tool at a pose, each with its place relative to the tip, and
    /// gives the mesh turned as there. `None` for other tools and an invalid pose.
    pub(crate) fn visit_inside_mesh(
        &self,
        obstacle: &Occupancy,
        pose: &Pose,
        mut visit: impl FnMut(&Mesh, usize, DVec3),
    ) -> Option<()> {
        let mesh = self.mesh()?;
        pose.axis()?;
        let (grid, orientation) = (&obstacle.grid, pose.orientation());
        let tip = snapped(grid, pose.position);
        let turned = turn(mesh, &orientation, grid.pitch);
        let voxels = mesh_voxels(&turned, obstacle, tip, bounds(self, &orientation, grid.pitch));
        for offset in voxels.iter().flat_map(ToolVoxels::offsets) {
            let at = [0, 1, 2].map(|a| tip[a].floor() as i64 + offset[a]);
            if (0..3).all(|a| (0..grid.dims[a] as i64).contains(&at[a])) {
                let held = grid.index(at.map(|v| v as usize));
                if obstacle.solid[held] == 1 {
                    visit(&turned, held, (DVec3::from_array(at.map(|v| v as f64)) - tip) * grid.pitch);
                }
            }
        }
        Some(())
    }
}

impl Element {
    /// Visits the obstacle's solid voxels whose centres lie in the element at a pose, each with its height on the element's axis
    /// and its distance from it, by the predicate that defines the tool. Nothing at an invalid pose.
    pub(crate) fn visit_inside(
        &self,
        obstacle: &Occupancy,
        pose: &Pose,
        mut visit: impl FnMut(usize, f64, f64),
    ) {
        let Some(axis) = pose.axis() else { return };
        let (Some(first), Some(last)) = (self.profile.first(), self.profile.last()) else { return };
        let grid = &obstacle.grid;
        let (pitch, tip) = (grid.pitch, snapped(grid, pose.position));
        let span = (first.range().0, last.range().1);
        let widest = self.max_radius();
        let spread = (1.0 - axis * axis).max(DVec3::ZERO).map(f64::sqrt) * widest;
        let (low, high) = ((axis * span.0).min(axis * span.1), (axis * span.0).max(axis * span.1));
        let (low, high) = (tip + (low - spread) / pitch, tip + (high + spread) / pitch);
        let clamp = |v: f64, axis: usize| v.clamp(0.0, grid.dims[axis] as f64) as usize;
        let range = |axis: usize| clamp(low[axis].floor(), axis)..clamp(high[axis].ceil() + 1.0, axis);
        for (x, y) in range(0).flat_map(|x| range(1).map(move |y| (x, y))) {
            let (across, along) = ((x as f64 - tip.x) * pitch, (y as f64 - tip.y) * pitch);
            let (from, to) = line_through_cylinder(across, along, axis, widest, span, pitch);
            let row = grid.index([x, y, 0]);
            for z in clamp((tip.z + from).floor(), 2)..clamp((tip.z + to).ceil() + 1.0, 2) {
                if obstacle.solid[row + z] == 0 {
                    continue;
                }
                let offset = DVec3::new(across, along, (z as f64 - tip.z) * pitch);
                if let Some((height, radius)) = self.holds(offset, axis, pitch) {
                    visit(row + z, height, radius);
                }
            }
        }
    }

    /// Height on the axis and distance from it of a voxel's centre, given by its offset from the tip, where the element holds it by
    /// the predicate that defines the tool.
    #[inline]
    pub(crate) fn holds(&self, offset: DVec3, axis: DVec3, pitch: f64) -> Option<(f64, f64)> {
        let (height, squared) = locate_inside(&self.profile, axis, offset, pitch)?;
        Some((height, squared.max(0.0).sqrt()))
    }

    /// Its radius at a height; 0 where it has none.
    pub(crate) fn radius_at(&self, height: f64) -> f64 {
        let held = self.profile.iter().find(|s| s.range().0 <= height && height < s.range().1);
        held.map_or(0.0, |segment| segment.radius(height))
    }

    /// Distance from a point in the element, by its height and its distance from the axis, to the element's surface. The upper
    /// end is surface only where it is `exposed`.
    pub(crate) fn depth(&self, height: f64, radius: f64, exposed: bool) -> f64 {
        self.foot(height, radius, exposed).distance(DVec2::new(height, radius))
    }

    /// Height and distance from the axis of the point of the element's surface that is nearest to a point, given so as well. The upper
    /// end is surface only where it is `exposed`.
    pub(crate) fn foot(&self, height: f64, radius: f64, exposed: bool) -> DVec2 {
        let point = DVec2::new(height, radius);
        let level =
            |at: f64, one: f64, other: f64| DVec2::new(at, radius.clamp(one.min(other), one.max(other)));
        let nearer = |one: DVec2, other: DVec2| {
            if other.distance_squared(point) < one.distance_squared(point) { other } else { one }
        };
        let (mut nearest, mut last) = (DVec2::INFINITY, (0.0, 0.0));
        for (index, segment) in self.profile.iter().enumerate() {
            let (from, to) = segment.range();
            let start = if index == 0 { 0.0 } else { last.1 };
            if from < to {
                nearest = nearer(nearest, level(from, start, segment.radius(from)));
                nearest = nearer(nearest, outline(segment, point));
                last = (to, segment.radius(to));
            }
        }
        if exposed { nearer(nearest, level(last.0, 0.0, last.1)) } else { nearest }
    }
}

/// The point of one piece of an outline that is nearest to a point, in the plane of height and radius.
fn outline(segment: &Segment, point: DVec2) -> DVec2 {
    let (from, to) = segment.range();
    match *segment {
        Segment::Line { radius_from, radius_to, .. } => {
            let (start, way) =
                (DVec2::new(from, radius_from), DVec2::new(to - from, radius_to - radius_from));
            start + way * ((point - start).dot(way) / way.length_squared()).clamp(0.0, 1.0)
        }
        Segment::Arc { centre_height, centre_radius, arc_radius, .. } => {
            let centre = DVec2::new(centre_height, centre_radius);
            let offset = point - centre;
            let facing = centre + offset * (arc_radius / offset.length());
            if offset.y >= 0.0 && (from..=to).contains(&facing.x) {
                return facing;
            }
            let [one, other] = [from, to].map(|at| DVec2::new(at, segment.radius(at)));
            if one.distance_squared(point) <= other.distance_squared(point) { one } else { other }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depths_are_distances_to_the_outline() {
        let of = |profile| Element { kind: ElementKind::Cutter, profile };
        let flat = of(vec![Segment::cylinder(0.0, 10.0, 3.0)]);
        let depths = [(1.0, 0.0), (5.0, 0.5), (9.5, 1.0)].map(|(h, r)| flat.depth(h, r, true));
        assert_eq!(depths, [1.0, 2.5, 0.5]);
        assert_eq!(flat.depth(9.5, 1.0, false), 2.0);
        let [shaft, collar] = [Segment::cylinder(3.0, 10.0, 3.0), Segment::cylinder(10.0, 12.0, 5.0)];
        let mill = of(vec![Segment::ball_end(3.0), shaft, collar]);
        for (height, radius, expected) in [
            (1.0, 0.0, 1.0),
            (3.0, 0.0, 3.0),
            (2.0, 1.0, 3.0 - 2f64.sqrt()),
            (7.0, 1.0, 2.0),
            (10.5, 4.0, 0.5),
            (11.0, 2.9, 1.0),
        ] {
            assert!((mill.depth(height, radius, true) - expected).abs() < 1e-12, "{height} {radius}");
        }
    }
}
