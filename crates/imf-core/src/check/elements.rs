//! The elements of one tool against part and fixtures: which collide at a pose, and how deep.

use std::sync::{Arc, OnceLock};

use glam::DVec3;

use super::deepest::DepthElement;
use super::motions::{Motion, Step, look_at_poses};
use super::{CheckError, CheckSettings, Collision, HitBody};
use crate::distance::squared_depths;
use crate::field::solid::{SolidField, SolidVoxels};
use crate::grid::Grid;
use crate::mesh::Mesh;
use crate::occupancy::Occupancy;
use crate::parallel::make_once;
use crate::pose::Pose;
use crate::tool::{Element, ElementKind, Tool};

/// Taken off proven clearances, in pitches: more than rounding.
const MARGIN: f64 = 1e-3;

/// How far a tool may move from a pose in the body's frame before it collides, searched up to `most`; at or below 0
/// where that is unknown, `None` for meshes.
pub(super) fn room(field: &SolidField, pose: &Pose, most: f64) -> Option<f64> {
    let margin = MARGIN * field.voxels().occupancy().grid.pitch;
    Some(field.clearance_up_to(pose, most + 2.0 * margin)? - margin)
}

/// Something that may be hit.
pub(super) struct Body {
    pub(super) voxels: SolidVoxels,
    /// With points of its surface, for tools that may touch it.
    with_points: Option<SolidVoxels>,
    pub(super) against: HitBody,
    /// By voxel, how deep its centre lies below the surface; made at the first collision.
    depths: OnceLock<Vec<f32>>,
}

impl Body {
    pub(super) fn new(voxels: impl Into<Arc<Occupancy>>, against: HitBody) -> Arc<Self> {
        Arc::new(Self { voxels: voxels.into().into(), with_points: None, against, depths: OnceLock::new() })
    }

    /// The same with points of its surface, and how far they are apart.
    pub(super) fn with_surface_of(&self, mesh: &Mesh) -> (Arc<Self>, f64) {
        let (voxels, against) = (self.voxels.clone(), self.against.clone());
        let (with_points, apart) = voxels.clone().with_surface_of(mesh);
        (Arc::new(Self { voxels, with_points: Some(with_points), against, depths: OnceLock::new() }), apart)
    }

    /// The same of other voxels, with the points that are known of its surface.
    pub(super) fn of_voxels(&self, voxels: impl Into<Arc<Occupancy>>) -> Arc<Self> {
        let (voxels, against) = (SolidVoxels::from(voxels.into()), self.against.clone());
        let known = self.with_points.as_ref();
        let with_points = known.map(|known| voxels.clone().with_surfaces(known.surfaces()));
        Arc::new(Self { voxels, with_points, against, depths: OnceLock::new() })
    }

    /// The part, then the fixtures.
    pub(super) fn all<V: Clone + Into<Arc<Occupancy>>>(part: &V, fixtures: &[(String, V)]) -> Vec<Arc<Self>> {
        let fixture =
            |(name, voxels): &(String, V)| Self::new(voxels.clone(), HitBody::Fixture(name.clone()));
        let part = Self::new(part.clone(), HitBody::Part);
        std::iter::once(part).chain(fixtures.iter().map(fixture)).collect()
    }

    /// With points of its surface where they are known.
    fn tool_voxels(&self) -> &SolidVoxels {
        self.with_points.as_ref().unwrap_or(&self.voxels)
    }

    pub(super) fn grid(&self) -> &Grid {
        &self.voxels.occupancy().grid
    }

    /// Half a pitch less than to the nearest empty centre.
    pub(super) fn depth(&self, index: usize) -> f64 {
        let pitch = self.grid().pitch;
        let depths = make_once(&self.depths, || {
            let below = |squared: u64| (((squared as f64).sqrt() - 0.5) * pitch).max(0.0) as f32;
            squared_depths(self.voxels.occupancy()).into_iter().map(below).collect()
        });
        f64::from(depths[index])
    }

    /// How far a ball in the body's frame may move before it meets what reaches out of the solid centres by so many pitches; at or below
    /// 0 where that is not known.
    pub(super) fn ball_room(&self, middle: DVec3, radius: f64, around_centres: f64) -> f64 {
        let grid = self.grid();
        let away = self.voxels.distances().probe(grid.continuous(middle)).squared.sqrt();
        (away - around_centres - MARGIN) * grid.pitch - radius
    }
}

/// Elements that are decided together, and the body that they must not hit.
pub(super) struct Group {
    pub(super) field: SolidField,
    pub(super) elements: Vec<DepthElement>,
    pub(super) body: Arc<Body>,
}

/// All elements of one tool.
pub(super) struct Elements(Vec<Group>);

impl Elements {
    /// `cut` is the part as the cutter meets it.
    pub(super) fn new(
        bodies: &[Arc<Body>],
        cut: &Arc<Body>,
        tool: &Tool,
        settings: &CheckSettings,
    ) -> Result<Self, CheckError> {
        let clearance = &settings.clearance;
        let offset = tool.offset_elements(clearance)?;
        if offset.is_empty() {
            return Ok(Self::whole(bodies, tool));
        }
        let measured =
            |element: &Element| DepthElement::new(element.clone(), true, clearance.of(element.kind));
        // A little less than the contact: rounding must not accept more.
        let accepted = (1.0 - 1e-6) * settings.contact;
        let mut wanted = Vec::new();
        for body in bodies {
            let voxels = body.tool_voxels();
            let mut stay_out = offset.clone();
            let pitch = body.grid().pitch;
            if body.against == HitBody::Part
                && settings.contact > 0.0
                && let Some((cutter, exposed)) = tool.cutter()
            {
                let deep = cutter.eroded_among_voxels(settings.contact, exposed, pitch);
                let deep = deep.ok_or_else(|| CheckError::Contact {
                    tool: tool.name.clone(),
                    contact: settings.contact,
                })?;
                let deep = SolidField::of_elements(cut.tool_voxels().clone(), &[deep]);
                let measured = DepthElement::new(cutter, exposed, 0.0);
                wanted.push((cut, deep, vec![DepthElement { accepted, ..measured }]));
                stay_out.retain(|element| element.kind != ElementKind::Cutter);
            }
            let (mut rest, mut hit, mut touching) = (Vec::new(), Vec::new(), Vec::new());
            for element in stay_out {
                let measured = measured(&element);
                // Shank and holder may touch, unless they have a clearance; no cutter may touch a fixture.
                let may_touch = element.kind != ElementKind::Cutter && clearance.of(element.kind) == 0.0;
                let (held, contact) = match may_touch {
                    true => element.touching(settings.contact, pitch),
                    false => (element, settings.contact),
                };
                let accepted = if contact < 0.0 { accepted } else { 0.0 };
                rest.push(DepthElement { accepted, ..measured });
                touching.push((held.clone(), contact));
                hit.push(held);
            }
            if !rest.is_empty() {
                let field = SolidField::of_elements(voxels.clone(), &hit);
                wanted.push((body, field.map(|field| field.touching(touching)), rest));
            }
        }
        let mut groups = Vec::new();
        for (body, field, elements) in wanted {
            let Some(field) = field else {
                if clearance.is_zero() {
                    return Ok(Self::whole(bodies, tool));
                }
                return Err(CheckError::Outline(tool.name.clone()));
            };
            groups.push(Group { field, elements, body: body.clone() });
        }
        Ok(Self(groups))
    }

    /// A tool whose elements cannot be distinguished: it has no cutter that may touch.
    fn whole(bodies: &[Arc<Body>], tool: &Tool) -> Self {
        let group = |body: &Arc<Body>| Group {
            field: SolidField::of_tool(body.voxels.clone(), tool),
            elements: vec![DepthElement::whole(tool)],
            body: body.clone(),
        };
        Self(bodies.iter().map(group).collect())
    }

    /// Whether all of them are held against points of surfaces.
    pub(super) fn know_the_surfaces(&self) -> bool {
        self.0.iter().all(|group| group.field.knows_the_surface())
    }

    /// Whether anything collides at a pose.
    #[cfg(test)]
    pub(super) fn any(&self, pose: &Pose) -> bool {
        self.0.iter().any(|group| group.field.collides(pose))
    }

    /// What collides at a pose, each element with each body.
    pub(super) fn at(&self, pose: &Pose) -> Vec<Collision> {
        let (mut found, mut counts) = (Vec::new(), Vec::new());
        for group in &self.0 {
            let mut tracks = group.tracks();
            let only = Step { index: 1, fraction: 1.0, is_last: true, length: 0.0 };
            group.follow(&only, pose, &mut tracks, &mut counts, 0.0);
            found.extend(tracks.into_iter().filter_map(Track::finish));
        }
        found
    }

    /// What collides on a motion, each element with each body once, at its deepest.
    pub(super) fn collisions(&self, motion: &Motion<'_>) -> Vec<Collision> {
        let farthest = motion.step * motion.count as f64;
        let half = (motion.count > 2).then(|| motion.at(0.5));
        let shown = |group: &&Group| {
            half.is_some_and(|pose| {
                room(&group.field, &pose, 0.5 * farthest).is_some_and(|room| room > 0.5 * farthest)
            })
        };
        let mut found = Vec::new();
        let mut counts = Vec::new();
        for group in self.0.iter().filter(|group| !shown(group)) {
            let mut tracks = group.tracks();
            look_at_poses(motion.count, farthest, |index, fraction| {
                let pose = motion.at(fraction);
                let is_last = index == motion.count;
                let step = Step { index, fraction, is_last, length: motion.step };
                group.follow(&step, &pose, &mut tracks, &mut counts, farthest)
            });
            found.extend(tracks.into_iter().filter_map(Track::finish));
        }
        found
    }
}

impl Group {
    /// Checks a pose in the body's frame and returns the room there, searched up to `most`; `counts` is working memory.
    pub(super) fn follow(
        &self,
        step: &Step,
        pose: &Pose,
        tracks: &mut [Track],
        counts: &mut Vec<u32>,
        most: f64,
    ) -> f64 {
        if let Some(room) = room(&self.field, pose, most)
            && room > 0.0
        {
            return room;
        }
        if !self.field.collides(pose) {
            return 0.0;
        }
        counts.clear();
        counts.resize(tracks.len(), 1);
        if tracks.len() > 1 {
            self.field.element_counts(pose, counts);
        }
        let held = counts.iter().enumerate().filter(|(_, count)| **count > 0);
        for (place, _) in held {
            let (track, element) = (&mut tracks[place], &self.elements[place]);
            let (against, grid) = (&self.body.against, self.body.grid());
            if track.meets(step, grid.pitch)
                && let Some(deepest) = element.deepest((&self.field, place), &self.body, pose)
            {
                track.take(deepest.depth, || deepest.collision(element, against, grid, step.fraction, pose));
            }
        }
        0.0
    }

    /// Of a motion that begins.
    pub(super) fn tracks(&self) -> Vec<Track> {
        self.elements.iter().map(|_| Track::default()).collect()
    }
}

/// The poses of a motion at which an element collides.
#[derive(Default)]
pub(super) struct Track {
    poses: u64,
    /// Number of the pose that was measured last, and its depth.
    last: u64,
    depth: f64,
    worst: Option<Collision>,
}

impl Track {
    /// What was found, if anything.
    pub(super) fn finish(self) -> Option<Collision> {
        Some(Collision { poses: self.poses, ..self.worst? })
    }

    /// Depth is known to half a pitch, so a pose within half a pitch of the last measured one is skipped, and so is
    /// one that cannot yet exceed the worst depth: newly entered centres add at most two pitches.
    fn may_be_deeper(&self, index: u64, step: f64, pitch: f64) -> bool {
        let Some(worst) = &self.worst else { return true };
        let moved = (index - self.last) as f64 * step;
        moved > 0.5 * pitch && self.depth + moved + 2.0 * pitch > worst.depth
    }

    /// The element collides at one more pose: whether it is to be measured there.
    pub(super) fn meets(&mut self, step: &Step, pitch: f64) -> bool {
        self.poses += 1;
        let measures = step.is_last || self.may_be_deeper(step.index, step.length, pitch);
        if measures {
            self.last = step.index;
        }
        measures
    }

    /// Retains the deepest pose, the first of equals.
    pub(super) fn take(&mut self, depth: f64, collision: impl FnOnce() -> Collision) {
        self.depth = depth;
        if self.worst.as_ref().is_none_or(|worst| worst.depth < depth) {
            self.worst = Some(collision());
        }
    }
}
