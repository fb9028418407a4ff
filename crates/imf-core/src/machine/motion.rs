//! The way from one set of joints to another, and how far anything moves on it.

use glam::DVec3;

use super::{Joints, Machine, Side};
use crate::pose::Pose;

/// A motion between two sets of joints: the rotary axes turn evenly, and either the tip goes straight in the part's frame (the
/// control keeps the tool's centre point, G43.4) or the linear axes move evenly.
#[derive(Clone, Copy, Debug)]
pub struct MachineMotion<'a> {
    machine: &'a Machine,
    from: Joints,
    to: Joints,
    length: f64,
    /// Ends of the tip's way in the part's frame, where it goes straight.
    tips: Option<[DVec3; 2]>,
}

/// Where everything stands at one time, by level: what stands on the first `level` rotary axes of a side.
pub(crate) struct Placement {
    /// Of the table, from where it is with all axes at 0.
    pub(crate) table: [Pose; 3],
    /// Of the head, linear axes included.
    pub(crate) head: [Pose; 3],
}

impl Placement {
    /// With the linear axes at 0.
    pub(crate) fn turned(machine: &Machine, rotary: &[f64; 2]) -> Self {
        Self { table: machine.placements(Side::Table, rotary), head: machine.placements(Side::Head, rotary) }
    }

    /// Of one with the linear axes at 0: where they bring the tip to a point of the part, given where it is with all axes at 0.
    pub(crate) fn linear(&self, tip: DVec3, length: f64) -> DVec3 {
        self.table[2].of_point(tip) - self.head[2].of_point(DVec3::new(0.0, 0.0, -length))
    }

    /// With the linear axes there.
    pub(crate) fn moved(&self, linear: DVec3) -> Self {
        let moved = |pose: Pose| Pose { position: pose.position + linear, ..pose };
        Self { table: self.table, head: self.head.map(moved) }
    }
}

/// A ball around something that the head carries, where it is with all axes at 0.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Ball {
    pub(crate) centre: DVec3,
    pub(crate) radius: f64,
    /// Rotary axes of the head that carry it.
    pub(crate) level: usize,
}

impl<'a> MachineMotion<'a> {
    /// A motion of a tool whose tip lies `length` below the spindle's face.
    #[must_use]
    pub fn new(machine: &'a Machine, from: Joints, to: Joints, length: f64, tip_goes_straight: bool) -> Self {
        let tip = |joints: &Joints| machine.forward(joints, length).position;
        let tips = tip_goes_straight.then(|| [tip(&from), tip(&to)]);
        Self { machine, from, to, length, tips }
    }

    /// The joints at a fraction of the way, from 0 to 1.
    #[must_use]
    pub fn joints(&self, fraction: f64) -> Joints {
        let rotary = [0, 1].map(|i| mix(self.from.rotary[i], self.to.rotary[i], fraction));
        let linear = match self.tips {
            Some([from, to]) => self.machine.linear(from.lerp(to, fraction), &rotary, self.length),
            None => self.from.linear.lerp(self.to.linear, fraction),
        };
        Joints { linear, rotary }
    }

    /// The tool in the part's frame at a fraction of the way.
    #[must_use]
    pub fn pose(&self, fraction: f64) -> Pose {
        let pose = self.machine.forward(&self.joints(fraction), self.length);
        match self.tips {
            Some([from, to]) => Pose { position: from.lerp(to, fraction), ..pose },
            None => pose,
        }
    }

    pub(crate) fn machine(&self) -> &'a Machine {
        self.machine
    }

    /// Upper bound of the displacement of any point of a tool of revolution, in the part's frame; its points are at
    /// most `reach` from its tip. A fraction of the motion has that fraction of the bound.
    pub(crate) fn tool_motion_bound(&self, reach: f64) -> f64 {
        let [head, table] = [Side::Head, Side::Table].map(|side| self.machine.axes_of(side));
        let ball = Ball { centre: DVec3::new(0.0, 0.0, -self.length), radius: reach, level: head };
        self.motion_bound(&ball, table)
    }

    pub(crate) fn placement(&self, fraction: f64) -> Placement {
        let joints = self.joints(fraction);
        Placement::turned(self.machine, &joints.rotary).moved(joints.linear)
    }

    /// Upper bound of the displacement of any point of a ball on the head, in the frame of the first `level` rotary
    /// axes of the table. A fraction of the motion has that fraction of the bound.
    pub(crate) fn motion_bound(&self, ball: &Ball, level: usize) -> f64 {
        let head = self.arms(Side::Head, ball.level, ball.centre, ball.radius);
        // About where the spindle's face would be with the head's axes at 0.
        let around = self.centre(Side::Head).filter(|_| ball.level > 0);
        let around = around.map_or(ball.centre.length() + ball.radius, |first| first.length() + head[0]);
        let mut farthest = self.linear_way() + self.swept(Side::Head, ball.level, head);
        if level > 0 {
            let most = self.farthest_from_table_axis() + around;
            farthest += self.swept(Side::Table, level, self.table_steps().map(|step| most + step));
        }
        let ends = (self.machine.axes_of(Side::Head), self.machine.axes_of(Side::Table));
        match self.tips {
            // Tool and part: what turns, turns about the tip.
            Some([from, to]) if (ball.level, level) == ends => {
                let reach = ball.centre.distance(DVec3::new(0.0, 0.0, -self.length)) + ball.radius;
                let all = self.swept(Side::Head, 2, [reach; 2]) + self.swept(Side::Table, 2, [reach; 2]);
                farthest.min(from.distance(to) + all)
            }
            _ => farthest,
        }
    }

    /// Upper bound of the displacement of any point of a ball that the table's last axis carries, in the frame of the
    /// table's first `level` axes. `centre` is where the ball is with all axes at 0. A fraction of the motion has that
    /// fraction of the bound.
    pub(crate) fn carried_bound(&self, centre: DVec3, radius: f64, level: usize) -> f64 {
        let arms = self.arms(Side::Table, 2, centre, radius);
        self.swept(Side::Table, 2, arms) - self.swept(Side::Table, level, arms)
    }

    /// Upper bound of the way of the linear axes.
    pub(crate) fn linear_way(&self) -> f64 {
        let Some([from, to]) = self.tips else { return self.from.linear.distance(self.to.linear) };
        let tip = DVec3::new(0.0, 0.0, -self.length);
        from.distance(to)
            + self.swept(Side::Head, 2, self.arms(Side::Head, 2, tip, 0.0))
            + self.swept(Side::Table, 2, self.tip_arms(from, to))
    }

    /// True where no rotary axis leaves its range on the way.
    pub(crate) fn turns_within_range(&self) -> bool {
        let ends = [&self.from, &self.to];
        ends.iter().all(|joints| self.machine.turned_too_far(&joints.rotary).next().is_none())
    }

    /// How far points move at the ends of arms about the first `level` axes of a side, all turns together.
    fn swept(&self, side: Side, level: usize, arms: [f64; 2]) -> f64 {
        let by = |place: usize| (self.to.rotary[place] - self.from.rotary[place]).abs().to_radians();
        self.machine.chain(side).take(level).zip(arms).map(|((place, _), arm)| by(place) * arm).sum()
    }

    /// From each axis of the table, the farthest that the tip is in the part's frame.
    fn tip_arms(&self, from: DVec3, to: DVec3) -> [f64; 2] {
        let zero = self.machine.part_zero();
        let [one, other] = [from, to].map(|tip| self.arms(Side::Table, 2, tip + zero, 0.0));
        [one[0].max(other[0]), one[1].max(other[1])]
    }

    /// Farthest that the linear axes are from the first axis of the table.
    fn farthest_from_table_axis(&self) -> f64 {
        let Some(centre) = self.centre(Side::Table) else { return 0.0 };
        match self.tips {
            Some([from, to]) => {
                let tip = DVec3::new(0.0, 0.0, -self.length);
                let arms = self.arms(Side::Head, 2, tip, 0.0);
                let arm = self.centre(Side::Head).map_or(self.length, |first| first.length() + arms[0]);
                self.tip_arms(from, to)[0] + arm
            }
            None => self.from.linear.distance(centre).max(self.to.linear.distance(centre)),
        }
    }

    fn centre(&self, side: Side) -> Option<DVec3> {
        self.machine.chain(side).next().map(|(_, axis)| axis.centre)
    }

    /// Centres of the axes of a side, and how many there are.
    fn centres(&self, side: Side, level: usize) -> ([DVec3; 2], usize) {
        let mut centres = [DVec3::ZERO; 2];
        let axes = self.machine.chain(side).take(level.min(2));
        let count = axes.zip(&mut centres).map(|((_, axis), own)| *own = axis.centre).count();
        (centres, count)
    }

    /// From the first axis of the table to each of them.
    fn table_steps(&self) -> [f64; 2] {
        let (centres, _) = self.centres(Side::Table, 2);
        centres.map(|own| own.distance(centres[0]))
    }

    /// Largest distances of a ball's points from the first `level` axes of a side that carry it, whatever the angles.
    fn arms(&self, side: Side, level: usize, centre: DVec3, radius: f64) -> [f64; 2] {
        let (centres, count) = self.centres(side, level);
        let mut arms = [0.0; 2];
        let (mut at, mut reach) = (centre, radius);
        for index in (0..count).rev() {
            reach += at.distance(centres[index]);
            at = centres[index];
            arms[index] = reach;
        }
        arms
    }
}

fn mix(from: f64, to: f64, fraction: f64) -> f64 {
    if fraction >= 1.0 { to } else { from + (to - from) * fraction }
}
