//! Motions by the machine's own coordinates: G53 and G28.

use super::block::Block;
use super::{Motion, Program};

impl Program<'_> {
    /// G53: the linear axes by the machine's own coordinates.
    pub(super) fn go_in_machine_coordinates(&mut self, line: usize, block: &Block) -> Result<(), String> {
        if self.machine.is_none() {
            return Err("G53 moves in the machine's coordinates, which no machine is given for".into());
        }
        let motion = self.motion.filter(|motion| matches!(motion, Motion::Rapid | Motion::Feed));
        let motion = motion.ok_or("G53 needs G0 or G1")?;
        if self.centre_point || !self.absolute {
            return Err("G53 is followed by G90 and while no centre point is kept (G49)".into());
        }
        let mut joints = self.joints;
        for (axis, given) in block.linear.iter().enumerate() {
            joints.linear[axis] = given.map_or(joints.linear[axis], |given| self.value(given));
        }
        for (place, given) in block.rotary.iter().enumerate() {
            joints.rotary[place] = given.unwrap_or(joints.rotary[place]);
        }
        self.arrive(line, joints, motion, false)
    }

    /// G28: by the place that is given to the reference point, each axis that is named.
    pub(super) fn go_home(&mut self, line: usize, block: &Block) -> Result<(), String> {
        let Some(machine) = self.machine else {
            return Err(
                "G28 moves to the machine's reference point, and no machine is given that says where it is"
                    .into(),
            );
        };
        if self.centre_point {
            return Err("G28 while the tool's centre point is kept: end that with G49 before".into());
        }
        let given = block.linear.map(|v| v.is_some());
        let steps =
            !self.absolute && block.linear.iter().chain(&block.rotary).flatten().all(|&step| step == 0.0);
        if !steps {
            let (to, rotary) = self.target(block)?;
            self.reach(line, to, rotary, Motion::Rapid)?;
        }
        let mut joints = self.joints;
        for axis in (0..3).filter(|&axis| given[axis]) {
            joints.linear[axis] = machine.home[axis];
        }
        for place in (0..2).filter(|&place| block.rotary[place].is_some()) {
            joints.rotary[place] = 0.0;
        }
        self.arrive(line, joints, Motion::Rapid, false)
    }
}
