//! What a machine's head carries beside the tool, among the stock.

use super::super::elements::Track;
use super::super::machine::{HeadBody, MachineBodies};
use super::super::motions::{Motion, Step};
use super::super::{CheckError, CheckSettings};
use super::non_cutting::NonCuttingBody;
use super::voxels::{BitLines, StockVoxels};
use crate::machine::{Machine, Side};
use crate::pose::Pose;

/// The bodies of the head. Between two poses of the tool each is sampled as often as its own motion requires.
pub(super) struct Heads<'a> {
    machine: &'a Machine,
    bodies: Vec<(HeadBody, NonCuttingBody)>,
    /// From the world to where the machine's coordinates are with the table's axes at 0.
    to_machine: Pose,
    step: f64,
}

/// One of the bodies on a motion.
pub(super) struct Samples {
    /// Per pose of the tool.
    each: u64,
    /// Its movement between two of them.
    length: f64,
    pub(super) track: Track,
}

impl<'a> Heads<'a> {
    /// `world` is where the part's frame is in the world.
    pub(super) fn new(
        machine: &'a MachineBodies,
        settings: &CheckSettings,
        world: &Pose,
        pitch: f64,
    ) -> Result<Self, CheckError> {
        machine.check(pitch)?;
        let machine = machine.machine();
        let of_head = machine.solids.iter().filter(|solid| solid.side == Side::Head);
        let body = |solid| {
            let body = HeadBody::of_solid(solid, settings.clearance.holder)?;
            let non_cutting = NonCuttingBody::new(body.measured.clone(), &body.round, None, pitch);
            let non_cutting = non_cutting.ok_or_else(|| body.intricate())?;
            Ok((body, non_cutting))
        };
        let bodies = of_head.map(body).collect::<Result<_, CheckError>>()?;
        let to_machine = HeadBody::to_machine(machine, world);
        Ok(Self { machine, bodies, to_machine, step: settings.step })
    }

    pub(super) fn forget(&mut self) {
        self.bodies.iter_mut().for_each(|(_, non_cutting)| non_cutting.approach.forget());
    }

    /// Of each body, on a motion that begins.
    pub(super) fn begin(&self, motion: &Motion<'_>) -> Vec<Samples> {
        let way = motion.by_machine();
        let table = self.machine.axes_of(Side::Table);
        let of_body = |(body, _): &(HeadBody, NonCuttingBody)| {
            let farthest = way.map_or(0.0, |way| way.motion_bound(&body.ball, table));
            let each = (farthest / self.step / motion.count as f64).ceil().max(1.0);
            let length = farthest / (each * motion.count as f64);
            Samples { each: each as u64, length, track: Track::default() }
        };
        self.bodies.iter().map(of_body).collect()
    }

    /// On the way to one of the tool's poses, counted from 1.
    pub(super) fn look(
        &mut self,
        stock: &StockVoxels,
        part: &BitLines,
        motion: &Motion<'_>,
        pose: u64,
        samples: &mut [Samples],
    ) {
        let (Some(way), count) = (motion.by_machine(), motion.count) else { return };
        let table = self.machine.axes_of(Side::Table);
        for ((body, non_cutting), samples) in self.bodies.iter_mut().zip(samples) {
            let Samples { each, length, ref mut track } = *samples;
            for part_way in 1..=each {
                let index = (pose - 1) * each + part_way;
                let fraction = index as f64 / (count * each) as f64;
                let place = way.placement(fraction);
                let head = place.head[body.ball.level].of_pose(&body.frame);
                let in_machine = place.table[table].inverse().of_pose(&head);
                let at = self.to_machine.inverse().of_pose(&in_machine);
                let step = Step { index, fraction, is_last: index == count * each, length };
                non_cutting.look(stock, part, &step, &at, track);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::super::super::{CheckBodies, HitBody, MachineBodies};
    use super::super::check_stock;
    use super::*;
    use crate::control::Control;
    use crate::grid::Grid;
    use crate::machine::tests::meeting_trunnion;
    use crate::machine::{MachineSolid, SolidShape};
    use crate::occupancy::Occupancy;
    use crate::section::test_shapes::{line, revolved};
    use crate::tool::ElementKind;
    use crate::toolpath::{PathReading, Toolpath};
    use crate::unit::LengthUnit;

    fn machine(nose: SolidShape) -> Machine {
        let solid = MachineSolid { name: "nose".into(), side: Side::Head, level: 0, shape: nose };
        Machine { solids: vec![solid], ..meeting_trunnion() }
    }

    #[test]
    fn a_nose_that_comes_down_on_the_stock_is_told_as_deep_as_it_is() {
        // A block with its top at z = 0 and a well in its middle, in which the tool has room.
        let grid = Grid { origin: DVec3::new(-30.0, -30.0, -40.0), pitch: 1.0, dims: [60, 60, 40] };
        let stock = Occupancy::of(grid, |voxel| grid.centre(voxel).truncate().length() > 12.0);
        let tool = revolved([
            (ElementKind::Cutter, vec![line(0.0, 10.0, 3.0, 3.0)]),
            (ElementKind::Holder(0), vec![line(10.0, 24.0, 9.0, 9.0)]),
        ]);
        let cylinder = SolidShape::Cylinder { base: DVec3::ZERO, top: DVec3::Z * 30.0, diameter: 50.0 };
        let (lower, upper) = (DVec3::new(-28.0, -20.0, 0.0), DVec3::new(25.0, 25.0, 30.0));
        for nose in [cylinder, SolidShape::Box { lower, upper }] {
            let machine = machine(nose);
            let reading =
                PathReading { unit: LengthUnit::Mm, machine: Some(&machine), lengths: &[(None, 24.0)] };
            let path =
                Toolpath::parse("x,y,z,A,C\n0,0,9,0,0\n0,0,-23,0,0\n0,0,-26,0,0\n", reading, "path.csv")
                    .unwrap();
            let machine = MachineBodies::new(machine.clone(), 1.0, Control::quiet()).unwrap();
            let part = Occupancy::empty(grid);
            let bodies = CheckBodies { machine: Some(&machine), ..CheckBodies::of_part(&part) };
            let settings = CheckSettings::of_pitch(1.0, LengthUnit::Mm);
            let tools = [(None, &tool)];
            let report = check_stock(bodies, &stock, &tools, &path, &settings, Control::quiet()).unwrap();
            let found: Vec<_> =
                report.colliding.iter().flat_map(|l| l.collisions.iter().map(move |c| (l.line, c))).collect();
            assert_eq!(found.len(), 1, "{found:?}");
            let (line, hit) = found[0];
            assert_eq!((line, hit.element.as_str(), &hit.against), (4, "nose", &HitBody::Stock));
            assert!((hit.depth - 2.0).abs() < 1e-6, "{hit:?}");
            assert_eq!(hit.position, [0.0, 0.0, -26.0]);
            // With room to keep it is too near before.
            let near = CheckSettings {
                clearance: crate::tool::Clearance { holder: 1.5, ..Default::default() },
                ..settings
            };
            let report = check_stock(bodies, &stock, &tools, &path, &near, Control::quiet()).unwrap();
            assert_eq!(report.colliding[0].line, 3);
        }
    }
}
