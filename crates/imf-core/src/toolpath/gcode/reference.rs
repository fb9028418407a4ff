//! Motions by the machine's own coordinates: G53 and G28.

use super::arrival::Coordinates;
use super::block::Block;
use super::{Motion, Program};

impl Program<'_> {
    /// G53: the linear axes by the machine's own coordinates.
    pub(super) fn go_in_machine_coordinates(&mut self, line: usize, block: &Block) -> Result<(), String> {
        let motion = self.motion.filter(|motion| matches!(motion, Motion::Rapid | Motion::Feed));
        let motion = motion.ok_or("G53 needs G0 or G1")?;
        if self.centre_point || !self.absolute {
            return Err("G53 is followed by G90 and while no centre point is kept (G49)".into());
        }
        if self.machine.is_none() {
            return self.leave(line, block, "G53");
        }
        let mut joints = self.joints;
        for (axis, given) in block.linear.iter().enumerate() {
            joints.linear[axis] = given.map_or(joints.linear[axis], |given| self.value(given));
        }
        for (place, given) in block.rotary.iter().enumerate() {
            joints.rotary[place] = given.unwrap_or(joints.rotary[place]);
        }
        self.z_by_spindle |= block.linear[2].is_some();
        self.arrive(line, joints, motion, Coordinates::Machines)
    }

    /// G28: by the place that is given to the reference point, each axis that is named.
    pub(super) fn go_home(&mut self, line: usize, block: &Block) -> Result<(), String> {
        if self.centre_point {
            return Err("G28 while the tool's centre point is kept: end that with G49 before".into());
        }
        let steps =
            !self.absolute && block.linear.iter().chain(&block.rotary).flatten().all(|&step| step == 0.0);
        if !steps {
            if self.machine.is_none() {
                self.check_length(line, block)?;
            }
            let (to, rotary) = self.target(block)?;
            self.z_by_spindle &= block.linear[2].is_none();
            self.reach(line, to, rotary, Motion::Rapid)?;
        }
        let Some(machine) = self.machine else { return self.leave(line, block, "G28") };
        let mut joints = self.joints;
        for axis in (0..3).filter(|&axis| block.linear[axis].is_some()) {
            joints.linear[axis] = machine.home[axis];
        }
        for place in (0..2).filter(|&place| block.rotary[place].is_some()) {
            joints.rotary[place] = 0.0;
        }
        self.z_by_spindle |= block.linear[2].is_some();
        self.arrive(line, joints, Motion::Rapid, Coordinates::Machines)
    }

    /// Without a machine: to a place that is not known, and the path begins anew behind it.
    fn leave(&mut self, line: usize, block: &Block, word: &str) -> Result<(), String> {
        for axis in (0..3).filter(|&axis| block.linear[axis].is_some()) {
            self.joints.linear[axis] = f64::NAN;
        }
        self.broken = true;
        self.remark(
            line,
            "leaves",
            &format!(
                "{word} goes to the machine's own place, which only a machine's description says: the ways there and from there are not checked"
            ),
        );
        Ok(())
    }
}
