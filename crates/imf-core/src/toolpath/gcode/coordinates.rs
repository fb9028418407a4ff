//! From the program's coordinates to the machine's axes and back.

use glam::DVec3;

use super::arrival::Coordinates;
use super::block::Block;
use super::{Motion, Program};
use crate::machine::Joints;

impl Program<'_> {
    pub(super) fn set_offset(&mut self, offset: u8) -> Result<(), String> {
        let known = match self.machine {
            Some(machine) => machine.offsets.contains_key(&offset),
            // Of one offset alone it does not matter where it lies.
            None => self.offset == offset || self.is_nowhere(),
        };
        if !known {
            return Err(format!(
                "G{offset} is another work offset than that of the part, and where it lies is not known: a machine says so ([offsets])"
            ));
        }
        let before = self.origin();
        self.offset = offset;
        self.kept += before - self.origin();
        Ok(())
    }

    /// No coordinate has been said that a location has or will have.
    fn is_nowhere(&self) -> bool {
        self.path.locations.is_empty() && (0..3).all(|axis| self.joints.linear[axis].is_nan())
    }

    /// The origin of the program's coordinates in the machine's.
    pub(super) fn origin(&self) -> DVec3 {
        self.machine
            .map_or(DVec3::ZERO, |machine| machine.offsets.get(&self.offset).copied().unwrap_or(DVec3::NAN))
    }

    /// Where the program's coordinates stand.
    pub(super) fn position(&self) -> Result<DVec3, String> {
        let below = DVec3::new(0.0, 0.0, self.tool_length()?);
        let Some(machine) = self.machine.filter(|_| self.centre_point) else {
            let below = if self.length || self.machine.is_none() { below } else { DVec3::ZERO };
            return Ok(self.joints.linear - self.origin() - below);
        };
        let turned = |place: usize| self.joints.rotary[place] != 0.0;
        if turned(0) || turned(1) || !self.joints.linear.is_nan() {
            let pose = machine.forward(&self.joints, below.z);
            return Ok(self.or_kept(pose.position + machine.part_zero() - self.origin()));
        }
        // With nothing turned one coordinate does not touch another.
        let standing = self.joints.linear - below - self.origin();
        Ok(self.or_kept(standing))
    }

    /// What the axes do not say as long as one of them is unknown, as the program has said it.
    fn or_kept(&self, standing: DVec3) -> DVec3 {
        DVec3::select(standing.is_nan_mask(), self.kept, standing)
    }

    pub(super) fn value(&self, given: f64) -> f64 {
        given * self.factor.unwrap_or(1.0)
    }

    /// Where a block leads: the program's coordinates, and the angles.
    pub(super) fn target(&self, block: &Block) -> Result<(DVec3, [f64; 2]), String> {
        let (mut to, mut rotary) = (self.position()?, self.joints.rotary);
        for axis in 0..3 {
            if let Some(given) = block.linear[axis] {
                let value = self.value(given);
                to[axis] = if self.absolute { value } else { to[axis] + value };
                if to[axis].is_nan() {
                    let letter = ['X', 'Y', 'Z'][axis];
                    return Err(format!(
                        "{letter} is a step (G91) from a place that is not known: give {letter} by G90 before"
                    ));
                }
            }
        }
        for (place, angle) in rotary.iter_mut().enumerate() {
            if let Some(given) = block.rotary[place] {
                *angle = if self.absolute { given } else { *angle + given };
            }
        }
        Ok((to, rotary))
    }

    /// Moves to program coordinates.
    pub(super) fn reach(
        &mut self,
        line: usize,
        to: DVec3,
        rotary: [f64; 2],
        motion: Motion,
    ) -> Result<(), String> {
        let below = DVec3::new(0.0, 0.0, self.tool_length()?);
        let linear = match self.machine {
            Some(machine) if self.centre_point => {
                self.kept = to;
                machine.linear(to + self.origin() - machine.part_zero(), &rotary, below.z)
            }
            Some(_) if !self.length => to + self.origin(),
            _ => to + self.origin() + below,
        };
        let by = if self.centre_point { Coordinates::CentrePoints } else { Coordinates::Programs };
        self.arrive(line, Joints { linear, rotary }, motion, by)
    }
}
