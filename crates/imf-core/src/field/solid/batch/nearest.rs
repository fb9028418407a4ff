//! Whether the solid voxels nearest to points of the axis lie in the tool, sixteen at a time.

use super::super::Body;
use super::lookup::Lookup;
use super::{Items, LANES, Places, SLACK, at};
use crate::tool::Segment;

/// The outlines of all bodies, a little smaller than they are; in voxels.
pub(super) struct Outline {
    cones: Vec<Cone>,
    rings: Vec<Ring>,
}

/// Points at heights between two, within a radius that is linear in the height.
struct Cone {
    from: f32,
    to: f32,
    at_zero: f32,
    per_height: f32,
}

/// Points at heights between two, within a circle that is revolved, or within its middle's radius.
struct Ring {
    from: f32,
    to: f32,
    height: f32,
    radius: f32,
    squared: f32,
}

impl Outline {
    pub(super) fn new(bodies: &[Body]) -> Self {
        let (mut cones, mut rings) = (Vec::new(), Vec::new());
        for part in bodies.iter().flat_map(|body| &body.parts) {
            let (from, to) = part.segment.range();
            let (from, to) = (from as f32 + SLACK, to as f32 - SLACK);
            match part.segment {
                Segment::Line { from: low, to: high, radius_from, radius_to } => {
                    let per_height = (radius_to - radius_from) / (high - low);
                    let slack = f64::from(SLACK) * (1.0 + per_height.abs());
                    let at_zero = (radius_from - per_height * low - slack) as f32;
                    cones.push(Cone { from, to, at_zero, per_height: per_height as f32 });
                }
                Segment::Arc { centre_height, centre_radius, arc_radius, .. } => {
                    let within = (arc_radius as f32 - SLACK).max(0.0);
                    let (height, radius) = (centre_height as f32, centre_radius as f32);
                    rings.push(Ring { from, to, height, radius, squared: within * within });
                }
            }
        }
        Self { cones, rings }
    }

    /// Notes which places collide, since the voxel nearest to an item lies in the tool.
    #[inline(always)]
    pub(super) fn try_nearest(&self, lookup: &Lookup<'_>, items: &Items, places: &mut Places) {
        for (listed, nearest) in items.listed.chunks(LANES).zip(items.nearest.chunks(LANES)) {
            let (mut tip, mut axis) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
            let mut index = [0; LANES];
            for (lane, (&(place, _), &nearest)) in listed.iter().zip(nearest).enumerate() {
                let place = at(place);
                index[lane] = nearest;
                for a in 0..3 {
                    tip[a][lane] = places.tip[a][place];
                    axis[a][lane] = places.axis[a][place];
                }
            }
            let voxel = lookup.distances.voxels_of(index);
            let held = self.holds(voxel, tip, axis);
            for (lane, &(place, _)) in listed.iter().enumerate() {
                places.collides[at(place)] |= held[lane] != 0;
            }
        }
    }

    /// 1 where a voxel lies in the tool, more than rounding below its surface.
    #[inline(always)]
    fn holds(
        &self,
        voxel: [[f32; LANES]; 3],
        tip: [[f32; LANES]; 3],
        axis: [[f32; LANES]; 3],
    ) -> [u32; LANES] {
        let (mut height, mut radius, mut held) = ([0.0; LANES], [0.0_f32; LANES], [0; LANES]);
        for lane in 0..LANES {
            let offset = [0, 1, 2].map(|a| voxel[a][lane] - tip[a][lane]);
            let along = [0, 1, 2].map(|a| axis[a][lane]);
            let up = offset[0] * along[0] + offset[1] * along[1] + offset[2] * along[2];
            let across = [0, 1, 2].map(|a| offset[a] - along[a] * up);
            height[lane] = up;
            radius[lane] = (across[0] * across[0] + across[1] * across[1] + across[2] * across[2]).sqrt();
        }
        for cone in &self.cones {
            for lane in 0..LANES {
                let within = cone.at_zero + cone.per_height * height[lane];
                let inside = (height[lane] > cone.from) & (height[lane] < cone.to) & (radius[lane] < within);
                held[lane] |= u32::from(inside);
            }
        }
        for ring in &self.rings {
            for lane in 0..LANES {
                let (up, out) = (height[lane] - ring.height, (radius[lane] - ring.radius).max(0.0));
                let within = up * up + out * out < ring.squared;
                let inside = (height[lane] > ring.from) & (height[lane] < ring.to) & within;
                held[lane] |= u32::from(inside);
            }
        }
        held
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::section::test_shapes::{arc, line};
    use crate::tool::{Element, ElementKind, contains};

    #[test]
    fn points_in_the_smaller_outline_are_inside_and_few_others_are() {
        let bull = vec![arc(0.0, 1.0, 1.0, 2.5, 1.0), line(1.0, 6.0, 3.5, 3.5), line(6.0, 9.0, 3.5, 5.0)];
        let ball = vec![arc(0.0, 3.0, 3.0, 0.0, 3.0), line(3.0, 9.0, 3.0, 3.0)];
        for profile in [bull, ball] {
            let element = Element { kind: ElementKind::Cutter, profile };
            let outline = Outline::new(&[Body::new(&element, 1.0).unwrap()]);
            let (mut inside, mut held) = (0, 0);
            for index in 0..400_u32 {
                let place = |step: f64| ((f64::from(index) + 0.5) * step).fract() - 0.5;
                let axis = DVec3::new(place(0.618), place(0.755), place(0.57)).normalize();
                let tip = DVec3::new(place(0.31), place(0.83), place(0.47)) * 20.0 + 40.0;
                let voxel = |lane: usize| {
                    let near = |step: f64| (f64::from(index * 16 + lane as u32) * step).fract() * 14.0 - 7.0;
                    (tip + axis * 4.0 + DVec3::new(near(0.618), near(0.755), near(0.57))).round()
                };
                let all = |point: &dyn Fn(usize) -> DVec3| {
                    [0, 1, 2].map(|a| std::array::from_fn(|lane| point(lane)[a] as f32))
                };
                let holds = outline.holds(all(&voxel), all(&|_| tip), all(&|_| axis));
                for (lane, &holds) in holds.iter().enumerate() {
                    let contained = contains(&element.profile, axis, voxel(lane) - tip, 0.0);
                    assert!(holds == 0 || contained, "{axis} {tip} {}", voxel(lane));
                    inside += u32::from(contained);
                    held += holds;
                }
            }
            assert!(
                inside > 300 && held <= inside && f64::from(held) > 0.98 * f64::from(inside),
                "{held} {inside}"
            );
        }
    }
}
