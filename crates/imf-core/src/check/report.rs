//! What a check found, line by line.

use std::fmt;

use glam::{DMat4, DVec3};
use serde::Serialize;

use super::CheckSettings;
use crate::machine::Joints;
use crate::orientation::Orientation;
use crate::pose::Pose;
use crate::toolpath::{MoveKind, Toolpath};

/// What was hit.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum HitBody {
    /// The part.
    Part,
    /// A fixture, by its name.
    Fixture(String),
    /// Something that the machine's table carries, by its name.
    Machine(String),
    /// Stock beside the part that is still there then.
    Stock,
}

impl fmt::Display for HitBody {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Part => f.write_str("part"),
            Self::Fixture(name) => write!(f, "fixture {name}"),
            Self::Machine(name) => write!(f, "machine's {name}"),
            Self::Stock => f.write_str("stock"),
        }
    }
}

/// One element that collides with one body during one motion. Lengths are in the grid's unit, places in world coordinates.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Collision {
    /// The element's name; `tool` for a mesh; the part or a fixture where it swings into the machine.
    pub element: String,
    /// What it hits.
    pub against: HitBody,
    /// The element's required clearance, by which it is offset.
    pub clearance: f64,
    /// Largest depth of all sampled poses: no shorter translation parts the element, offset by its clearance, from the
    /// centres of the body's voxels. It falls short of the depth in the body itself by up to a pitch or so, and exceeds it by up to
    /// half a pitch where a face lies between two centres. Of stock it is the depth in the element, and half a pitch.
    pub depth: f64,
    /// How deep the deepest of the centres and points in the element, offset by its clearance, lies below its surface; not always the
    /// contact point. It is more than what is accepted. Of a mesh that of the contact point, at least.
    pub depth_in_tool: f64,
    /// The solid voxel's centre that is so deep, or the point of the part's surface.
    pub contact: [f64; 3],
    /// Tip at that pose.
    pub position: [f64; 3],
    /// Axis at that pose, from tip to holder.
    pub axis: [f64; 3],
    /// Roll at that pose in degrees, of a tool that is not round.
    pub roll: Option<f64>,
    /// Where a machine's axes stand at that pose, on a path that says so.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub joints: Option<Joints>,
    /// How far on the way to the line that pose is, from 0 to 1.
    pub fraction: f64,
    /// Solid voxels in the element at that pose, in the cutter those deeper than the contact; none where points of the part's surface alone
    /// are so deep. Where the part or a fixture hits the machine, its own that do.
    pub voxels: u32,
    /// Their volume in units cubed.
    pub volume: f64,
    /// Poses of the motion at which the element collides.
    pub poses: u64,
}

impl Collision {
    /// The same collision in other coordinates, by a rigid motion and a uniform scale; lengths and volumes stay as they are.
    fn place(&mut self, into: &DMat4) {
        let point = |p: [f64; 3]| into.transform_point3(DVec3::from_array(p)).to_array();
        self.contact = point(self.contact);
        self.position = point(self.position);
        let axis = DVec3::from_array(self.axis);
        self.axis = into.transform_vector3(axis).normalize_or_zero().to_array();
        if let (Some(roll), Some(upright)) = (self.roll, Orientation::from_direction(axis)) {
            let (_, turn, _) = into.to_scale_rotation_translation();
            let turned = turn * Orientation { roll, ..upright }.quaternion();
            self.roll = Some(Pose::new(DVec3::ZERO, turned).orientation().roll);
        }
    }
}

/// A line of the toolpath on the way to which something collides.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LineCollisions {
    /// Line of the toolpath's file.
    pub line: usize,
    /// Number of the tool, where the file names one.
    pub tool: Option<u32>,
    /// How the tool moves where the deepest of them is.
    pub kind: MoveKind,
    /// Poses checked on the way to it, its own included.
    pub poses: u64,
    /// What collides.
    pub collisions: Vec<Collision>,
}

/// Where an axis of the machine leaves its range on the way to a line.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct TravelFault {
    /// Line of the toolpath's file.
    pub line: usize,
    /// X, Y, Z or a rotary axis' letter.
    pub axis: char,
    /// Where it would have to be first, in the grid's unit or in degrees.
    pub value: f64,
    /// Where it would have to be farthest beyond.
    pub farthest: f64,
    /// Where it can be; `None` without a limit.
    pub range: [Option<f64>; 2],
    /// How far on the way it first is, from 0 to 1.
    pub fraction: f64,
}

impl TravelFault {
    /// Adds it to others, of which there is one an axis: the first, with the value that is farthest beyond.
    pub(super) fn add_to(self, found: &mut Vec<Self>) {
        let Some(known) = found.iter_mut().find(|known| known.axis == self.axis) else {
            return found.push(self);
        };
        if self.excess() > known.excess() {
            known.farthest = self.farthest;
        }
    }

    /// How far beyond its range the axis would have to be at the farthest.
    #[must_use]
    pub fn excess(&self) -> f64 {
        let [low, high] = self.range;
        let (low, high) = (low.unwrap_or(f64::NEG_INFINITY), high.unwrap_or(f64::INFINITY));
        (low - self.farthest).max(self.farthest - high)
    }
}

/// The result for a whole toolpath.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CheckReport {
    /// What was accepted.
    pub settings: CheckSettings,
    /// How deep an overlap must be to be certain to be detected, in walls no thinner: it then holds the ball of
    /// [`CheckSettings::sure_depth`], which a slender tip does only where it is deep enough to be as wide.
    pub sure_depth: f64,
    /// How deep a cutter must enter the part's surface to be certain to be detected; `None` where the surface is not known, nothing may
    /// touch it, there is no cutter, or a tool is a mesh.
    pub sure_gouge: Option<f64>,
    /// How deep shank and holder, each with its clearance, must enter part or fixtures, and a cutter the fixtures, to be certain to be
    /// detected; `None` where there are none of them, and where [`CheckReport::sure_gouge`] is `None`.
    pub sure_overlap: Option<f64>,
    /// Lines of the toolpath that lead somewhere.
    pub locations: usize,
    /// Locations whose approach is not in the file: the first one, the first after each tool change, and, without a
    /// machine, those after moves in its coordinates (G53, G28).
    pub starts: usize,
    /// Poses checked in all.
    pub poses: u64,
    /// Lines with a collision, in order.
    pub colliding: Vec<LineCollisions>,
    /// Lines on the way to which an axis of the machine leaves its range, in order.
    pub out_of_travel: Vec<TravelFault>,
}

/// What was found on one motion: its place in the path, its collisions, and which axes leave the machine's travel.
pub(super) type MotionFindings = (usize, LineCollisions, Vec<TravelFault>);

/// One entry a line, also of lines of many motions (the chords of an arc). The collisions are taken out of what was found: there may be
/// as many as lines.
pub(super) fn gather(
    found: &mut [MotionFindings],
    toolpath: &Toolpath,
    settings: &CheckSettings,
    pitch: f64,
) -> CheckReport {
    let starts = toolpath.starts();
    let poses = found.iter().map(|(_, line, _)| line.poses).sum();
    let is_next =
        |a: &MotionFindings, b: &MotionFindings| a.1.line == b.1.line && b.1.kind != MoveKind::Start;
    let (mut locations, mut colliding, mut out_of_travel) = (0, Vec::new(), Vec::new());
    for of_line in found.chunk_by_mut(is_next) {
        locations += 1;
        let mut deepest = f64::NEG_INFINITY;
        let count = of_line.len() as f64;
        let mut whole = LineCollisions { collisions: Vec::new(), poses: 0, ..of_line[0].1 };
        let mut beyond: Vec<TravelFault> = Vec::new();
        for (place, (_, motion, travel)) in of_line.iter_mut().enumerate() {
            let fraction = |own: f64| (place as f64 + own) / count;
            whole.poses += motion.poses;
            for hit in std::mem::take(&mut motion.collisions) {
                // A drilling cycle has rapids and feeds in one line.
                if hit.depth > deepest {
                    (deepest, whole.kind) = (hit.depth, motion.kind);
                }
                whole.add(Collision { fraction: fraction(hit.fraction), ..hit });
            }
            for fault in travel.iter() {
                TravelFault { fraction: fraction(fault.fraction), ..*fault }.add_to(&mut beyond);
            }
        }
        out_of_travel.extend(beyond);
        if !whole.collisions.is_empty() {
            whole.collisions.shrink_to_fit();
            colliding.push(whole);
        }
    }
    let sure_depth = settings.sure_depth(pitch);
    let settings = *settings;
    CheckReport {
        settings,
        sure_depth,
        sure_gouge: None,
        sure_overlap: None,
        locations,
        starts,
        poses,
        colliding,
        out_of_travel,
    }
}

impl LineCollisions {
    /// Retains the deepest collision of each element and body.
    fn add(&mut self, hit: Collision) {
        let same = |own: &&mut Collision| own.element == hit.element && own.against == hit.against;
        match self.collisions.iter_mut().find(same) {
            Some(own) => {
                let poses = own.poses + hit.poses;
                if hit.depth > own.depth {
                    *own = hit;
                }
                own.poses = poses;
            }
            None => self.collisions.push(hit),
        }
    }
}

impl CheckReport {
    /// Adds what collides on the same path's lines with something else.
    pub fn add(&mut self, more: Vec<LineCollisions>) {
        for line in more {
            let place = self.colliding.partition_point(|own| own.line < line.line);
            match self.colliding.get_mut(place).filter(|own| own.line == line.line) {
                Some(own) => own.collisions.extend(line.collisions),
                None => self.colliding.insert(place, line),
            }
        }
    }

    /// The same collisions in other coordinates, by a rigid motion and a uniform scale; lengths and volumes stay as they are.
    pub fn place(&mut self, into: &DMat4) {
        // A roll that is turned is rounded, even where nothing moves.
        if *into != DMat4::IDENTITY {
            let hits = self.colliding.iter_mut().flat_map(|line| &mut line.collisions);
            hits.for_each(|hit| hit.place(into));
        }
    }

    /// Every collision with its line, the deepest first: what only comes nearer than its clearance after all that collides.
    #[must_use]
    pub fn worst(&self) -> Vec<(&LineCollisions, &Collision)> {
        let mut all: Vec<_> =
            self.colliding.iter().flat_map(|line| line.collisions.iter().map(move |c| (line, c))).collect();
        let depth = |found: &Collision| found.depth - found.clearance;
        all.sort_by(|a, b| depth(b.1).total_cmp(&depth(a.1)));
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn collision(axis: [f64; 3], roll: f64, [depth, clearance]: [f64; 2]) -> Collision {
        Collision {
            element: "tool".into(),
            against: HitBody::Part,
            clearance,
            depth,
            depth_in_tool: depth,
            contact: [0.0; 3],
            position: [0.0; 3],
            axis,
            roll: Some(roll),
            joints: None,
            fraction: 0.0,
            voxels: 1,
            volume: 1.0,
            poses: 1,
        }
    }

    #[test]
    fn another_frame_has_the_same_rotation_of_a_tool_that_is_not_round() {
        let turn =
            DMat4::from_rotation_z(1.0) * DMat4::from_rotation_x(0.4) * DMat4::from_scale(DVec3::splat(2.0));
        let rotation = |hit: &Collision| {
            let upright = Orientation::from_direction(DVec3::from_array(hit.axis)).unwrap();
            Orientation { roll: hit.roll.unwrap(), ..upright }.quaternion()
        };
        for axis in [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8], [0.0, -1.0, 0.0]] {
            let before = collision(axis, 107.4, [1.0, 0.0]);
            let mut after = before.clone();
            after.place(&turn);
            let (_, by, _) = turn.to_scale_rotation_translation();
            assert!((by * rotation(&before)).angle_between(rotation(&after)) < 1e-6, "{axis:?}");
            after.place(&turn.inverse());
            assert!(rotation(&before).angle_between(rotation(&after)) < 1e-6, "{axis:?}");
        }
    }

    #[test]
    fn what_collides_is_worse_than_what_only_comes_near() {
        let line = |number: usize, depths: [f64; 2]| LineCollisions {
            line: number,
            tool: None,
            kind: MoveKind::Feed,
            poses: 1,
            collisions: vec![collision([0.0, 0.0, 1.0], 0.0, depths)],
        };
        let report = CheckReport {
            settings: CheckSettings::of_pitch(1.0, crate::unit::LengthUnit::Mm),
            sure_depth: 2.0,
            sure_gouge: None,
            sure_overlap: None,
            locations: 2,
            starts: 0,
            poses: 2,
            colliding: vec![line(1, [4.0, 7.0]), line(2, [0.7, 0.0])],
            out_of_travel: Vec::new(),
        };
        let worst: Vec<usize> = report.worst().iter().map(|(line, _)| line.line).collect();
        assert_eq!(worst, [2, 1]);
    }
}
