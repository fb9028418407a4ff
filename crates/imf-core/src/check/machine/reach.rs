//! Whether a machine brings a tool to a pose, with all that it is made of out of the way.

use std::collections::HashMap;
use std::sync::{Arc, OnceLock};

use glam::DVec3;
use thiserror::Error;

use super::{MachineBodies, MachinePairs};
use crate::check::elements::Body;
use crate::check::{CheckError, CheckSettings, HitBody};
use crate::machine::{Joints, OutOfTravel, Placement, Side};
use crate::occupancy::Occupancy;
use crate::orientation::Orientation;
use crate::parallel::make_once;
use crate::pose::{Pose, axis_of};
use crate::tool::Assembly;

/// Why a machine does not bring a tool to a pose.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum MachineFault {
    /// No angles within the ranges turn the tool that way.
    #[error("the machine does not turn the tool that way")]
    OutOfReach,
    /// An axis would have to leave its range.
    #[error(
        "the machine's {} would have to be at {:.1}, and goes from {} to {}", .0.axis, .0.value, .0.range[0], .0.range[1]
    )]
    OutOfTravel(OutOfTravel),
    /// Something that the head carries would be in something else, or the part or a fixture in what does not turn with it.
    #[error("the {what} hits the {against}")]
    Hit {
        /// What: an element of the tool, `machine's` and the name of a solid, or the part or a fixture.
        what: String,
        /// In what.
        against: HitBody,
    },
}

/// One tool on a machine, among what is set up on its table.
///
/// A pose is the tool's in the part's frame, which is that of the work offset G54 until the part is
/// [placed](Self::placed). It is reached if, for at least one solution of the rotary axes:
///
/// - all axes are within their ranges;
/// - what the head carries is clear of part, fixtures and table, by its clearance (the holder's), and the tool is
///   clear of the table;
/// - part and fixtures are clear of what does not turn with them.
///
/// An axis that only turns the tool about itself is free, and is tried at every 45°. The motion to the pose is not
/// checked.
pub struct MachineReach {
    pairs: MachinePairs,
    /// From the part's frame to that of G54.
    place: Pose,
    length: f64,
    /// By the bits of a direction that was announced, in the part's frame.
    known: HashMap<[u64; 3], Vec<RotarySolution>>,
}

/// The rotary axes at angles that give a direction.
struct RotarySolution {
    rotary: [f64; 2],
    place: Placement,
    /// Part or fixture, and the machine's solid that it swings into; checked where the axes are within their travel.
    on_table: OnceLock<Option<[HitBody; 2]>>,
}

/// Angles of a free axis.
const FREE: usize = 8;

impl MachineReach {
    /// Of part and fixtures on grids of one pitch, where they stand in the frame of G54, in the machine's unit. Poses
    /// with one of these directions are evaluated faster.
    ///
    /// # Errors
    /// A tool that cannot be offset, solids that are thinner than the voxels show, a clearance around a solid that is a mesh.
    pub fn new(
        machine: &MachineBodies,
        part: &Arc<Occupancy>,
        fixtures: &[(String, Arc<Occupancy>)],
        assembly: &Assembly,
        directions: &[Orientation],
    ) -> Result<Self, CheckError> {
        let pitch = part.grid.pitch;
        machine.check(pitch)?;
        let tool = assembly.tool();
        let clearance = *assembly.clearance();
        let settings = CheckSettings { clearance, ..CheckSettings::of_pitch(pitch, tool.unit) };
        let here = Pose::new(DVec3::ZERO, glam::DQuat::IDENTITY);
        let pairs = MachinePairs::new(machine, &Body::all(part, fixtures), tool, &settings, &here)?;
        let reach = Self { pairs, place: here, length: tool.length(), known: HashMap::new() };
        Ok(reach.with(directions))
    }

    /// The same with part and fixtures elsewhere on the table: `place` leads from their frame, that of all poses, to that of G54.
    /// Poses with one of these directions are evaluated faster.
    #[must_use]
    pub fn placed(&self, place: &Pose, directions: &[Orientation]) -> Self {
        let pairs = self.pairs.at(&place.inverse());
        Self { pairs, place: *place, length: self.length, known: HashMap::new() }.with(directions)
    }

    fn with(mut self, directions: &[Orientation]) -> Self {
        let axes = directions.iter().filter_map(|orientation| axis_of(orientation.quaternion()));
        self.known = axes.map(|axis| (bits(axis), self.turned(axis))).collect();
        self
    }

    /// Whole turns of an axis change nothing of where anything is.
    fn turned(&self, axis: DVec3) -> Vec<RotarySolution> {
        let machine = &*self.pairs.machine;
        let found = machine.inverse(self.place.rotation * axis);
        let mut angles: Vec<[f64; 2]> = Vec::new();
        let mut add = |pair: [f64; 2]| {
            let same = |a: f64, b: f64| ((a - b) / 360.0 - ((a - b) / 360.0).round()).abs() < 1e-9;
            if !angles.iter().any(|known| (0..2).all(|place| same(known[place], pair[place]))) {
                angles.push(pair);
            }
        };
        for pair in found.angles {
            add(pair);
            if let Some(place) = found.free
                && let Some(rotary) = machine.rotary.get(place)
            {
                for step in 1..FREE {
                    let mut other = pair;
                    let around = 360.0 * step as f64 / FREE as f64;
                    let [low, high] = rotary.range;
                    let fits =
                        [around, around - 360.0].into_iter().find(|angle| (low..=high).contains(angle));
                    if let Some(angle) = fits {
                        other[place] = angle;
                        add(other);
                    }
                }
            }
        }
        let solution = |rotary| {
            let place = Placement::turned(machine, &rotary);
            RotarySolution { rotary, place, on_table: OnceLock::new() }
        };
        angles.into_iter().map(solution).collect()
    }

    /// True where the machine brings the tool's tip to `tip` with its axis along a unit vector.
    #[must_use]
    pub fn reaches(&self, tip: DVec3, axis: DVec3) -> bool {
        self.angles(tip, axis).is_some()
    }

    /// The rotary angles at which it does, in degrees and in the order of [`Machine::rotary`](crate::machine::Machine::rotary): the first solution
    /// that does, in the machine's order of preference.
    #[must_use]
    pub fn angles(&self, tip: DVec3, axis: DVec3) -> Option<[f64; 2]> {
        self.of_direction(axis, |turned| {
            turned.iter().find(|turned| self.fault_at(tip, turned).is_none()).map(|turned| turned.rotary)
        })
    }

    /// Why not, with the angles that the machine would choose first; `None` where it does.
    #[must_use]
    pub fn fault(&self, tip: DVec3, axis: DVec3) -> Option<MachineFault> {
        self.of_direction(axis, |turned| {
            let mut faults = turned.iter().map(|turned| self.fault_at(tip, turned));
            let first = faults.next().unwrap_or(Some(MachineFault::OutOfReach))?;
            faults.all(|fault| fault.is_some()).then_some(first)
        })
    }

    fn of_direction<T>(&self, axis: DVec3, answer: impl FnOnce(&[RotarySolution]) -> T) -> T {
        match self.known.get(&bits(axis)) {
            Some(turned) => answer(turned),
            None => answer(&self.turned(axis)),
        }
    }

    fn fault_at(&self, tip: DVec3, turned: &RotarySolution) -> Option<MachineFault> {
        let RotarySolution { rotary, place, on_table } = turned;
        let linear = place.linear(self.place.of_point(tip) + self.pairs.machine.part_zero(), self.length);
        let joints = Joints { linear, rotary: *rotary };
        if let Some(out) = self.pairs.machine.out_of_travel(&joints) {
            return Some(MachineFault::OutOfTravel(out));
        }
        let hits = make_once(on_table, || {
            let found = self.pairs.on_table.first_hit(place);
            found.map(|bodies| bodies.map(HitBody::clone))
        });
        if let Some([own, against]) = hits {
            return Some(MachineFault::Hit { what: own.to_string(), against: against.clone() });
        }
        let (what, against) = self.pairs.first_hit(&place.moved(linear))?;
        let is_solid = self.pairs.machine.solids.iter().any(|own| own.side == Side::Head && own.name == what);
        let what = if is_solid { format!("machine's {what}") } else { what.to_owned() };
        Some(MachineFault::Hit { what, against: against.clone() })
    }
}

fn bits(axis: DVec3) -> [u64; 3] {
    axis.to_array().map(f64::to_bits)
}
