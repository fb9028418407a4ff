//! The machine that brings the tools to the part.

use std::sync::Arc;

use anyhow::Result;
use glam::DMat4;
use imf_core::check::{CheckBodies, HitBody, MachineBodies, MachineFault, MachineReach, machine_remarks};
use imf_core::machine::{Machine, Side};
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::pose::Pose;
use imf_core::scene::Bodies;
use imf_core::surface::{MinimumOverlap, SurfaceTool};
use imf_core::tool::Assembly;

use crate::session::Session;

/// The machine's row in the tables of obstructions.
pub(super) const IN_THE_WAY: [&str; 2] = ["machine", "its travel, head or table"];

/// A machine in the part's unit.
pub(super) struct OnMachine {
    pub(super) machine: Machine,
    /// By tool.
    reach: Vec<Arc<MachineReach>>,
    /// True where the part stands as each set-up says, not where it lies.
    pub(super) of_setups: bool,
}

impl OnMachine {
    /// Of the world as the frame of the work offset G54, until a set-up places the part.
    pub(super) fn new(
        session: &Session,
        machine: Machine,
        bodies: &Bodies,
        tools: &[Assembly],
        orientations: &OrientationSet,
        of_setups: bool,
    ) -> Result<Self> {
        let moving = MachineBodies::new(machine.clone(), bodies.part.grid.pitch, session.control(&|_| {}))?;
        let used = if of_setups {
            "used for the surface in each set-up, where the middle of the part's foot is on the zero of G54"
        } else {
            "used for the part's surface, which stands in the frame of G54; for volumes and stick-outs directions alone count"
        };
        let name = &machine.name;
        session.note(&format!("directions are those of {name}; its travel, head and table are {used}"));
        if !of_setups {
            let around = CheckBodies {
                machine: Some(&moving),
                fixtures: &bodies.fixtures,
                ..CheckBodies::of_part(&bodies.part)
            };
            machine_remarks(around, &[], &DMat4::IDENTITY).iter().for_each(|remark| session.warn(remark));
        }
        let part = Arc::new(bodies.part.clone());
        let fixtures: Vec<_> =
            bodies.fixtures.iter().map(|(name, voxels)| (name.clone(), Arc::new(voxels.clone()))).collect();
        let directions = &orientations.orientations;
        let reach = tools.iter().map(|tool| MachineReach::new(&moving, &part, &fixtures, tool, directions));
        let reach = reach.map(|reach| reach.map(Arc::new)).collect::<Result<_, _>>()?;
        Ok(Self { machine, reach, of_setups })
    }

    /// Letter and sense of its rotary axes, in the order of the machine's own angles.
    pub(super) fn axes(&self) -> [Option<(char, f64)>; 2] {
        [0, 1].map(|place| Some((self.machine.rotary.get(place)?.letter, 1.0)))
    }

    /// Where the machine brings a tool in a set-up.
    pub(super) fn in_setup(
        &self,
        index: usize,
        place: &Pose,
        directions: &[Orientation],
    ) -> Arc<MachineReach> {
        Arc::new(self.reach[index].placed(place, directions))
    }

    /// A tool where the machine brings it.
    pub(super) fn limited(tool: SurfaceTool, reach: Arc<MachineReach>) -> SurfaceTool {
        tool.limited(Arc::new(move |tip, axis| reach.reaches(tip, axis)))
    }

    /// A tool where the machine brings it, with the part where it lies.
    pub(super) fn limit(&self, index: usize, tool: SurfaceTool) -> SurfaceTool {
        let Some(reach) = self.reach.get(index).filter(|_| !self.of_setups).cloned() else { return tool };
        Self::limited(tool, reach)
    }

    /// What would help where the machine alone obstructs the tool.
    pub(super) fn remedy(&self, fault: &MachineFault) -> &'static str {
        let head_turns = self.machine.rotary.iter().any(|axis| axis.side == Side::Head);
        match fault {
            MachineFault::OutOfReach => "another direction",
            MachineFault::OutOfTravel(out) if !"XYZ".contains(out.axis) => "another direction",
            MachineFault::OutOfTravel(_) if head_turns => {
                "another place on the table, a tool of another length, or another direction"
            }
            // The tool stands along Z, and no length of it moves another axis.
            MachineFault::OutOfTravel(out) if out.axis != 'Z' => {
                "another place on the table, or another direction"
            }
            MachineFault::OutOfTravel(out) if out.value > out.range[1] => {
                "another place on the table, a shorter tool, or another direction"
            }
            // No length of the tool changes where the part is, nor how near to the table.
            MachineFault::Hit { what, against: HitBody::Machine(_) } if what == "cutter" => {
                "a higher place on the table, another direction, or another set-up"
            }
            MachineFault::Hit { what, .. } if what == "part" || what.starts_with("fixture") => {
                "another place on the table, or another direction"
            }
            _ => "another place on the table, a longer tool, or another direction",
        }
    }

    /// Why the machine does not reach a pose at which the tool is free of all else.
    pub(super) fn fault(
        &self,
        index: usize,
        at: &MinimumOverlap,
        orientations: &OrientationSet,
    ) -> Option<MachineFault> {
        if (at.voxels > 0 || at.surface > 0) || self.of_setups {
            return None;
        }
        let axis = orientations.orientations[at.direction as usize].direction();
        self.reach.get(index)?.fault(at.pose.position, axis)
    }
}
