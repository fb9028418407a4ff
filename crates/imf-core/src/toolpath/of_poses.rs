//! Toolpaths from poses that a program has in memory.

use super::error::Fault;
use super::{Location, MoveKind, PathReading, Toolpath, ToolpathError};
use crate::pose::Pose;

impl Toolpath {
    /// Follows poses at feed rate, the first of them on line 1; `rolled` says whether their rolls mean anything. With a machine
    /// every location knows its joints, as in [`Toolpath::read`].
    ///
    /// # Errors
    /// Names the line of an invalid pose, or of one that the machine does not reach; no pose at all.
    pub fn of_poses<'a>(
        poses: impl IntoIterator<Item = Pose>,
        rolled: bool,
        reading: impl Into<PathReading<'a>>,
    ) -> Result<Self, ToolpathError> {
        let (reading, name) = (reading.into(), "poses");
        let location = |(place, pose): (usize, Pose)| {
            let line = place + 1;
            if !pose.is_valid() {
                let what = "a pose must be of finite numbers, its axis or quaternion not zero";
                return Err(Fault::from(what).on_line(line).in_file(name));
            }
            Ok(Location { line, pose, rolled, tool: None, kind: MoveKind::Feed, machine: None })
        };
        let locations = poses.into_iter().enumerate().map(location).collect::<Result<Vec<_>, _>>()?;
        if locations.is_empty() {
            return Err(ToolpathError::Empty(name.to_owned()));
        }
        let mut path = Self { locations, unit: reading.unit, ..Self::default() };
        path.mark_starts();
        if let Some(machine) = reading.machine {
            path.turn(machine, &reading).map_err(|fault| fault.in_file(name))?;
        }
        Ok(path)
    }
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use super::*;
    use crate::unit::LengthUnit;

    #[test]
    fn poses_are_the_locations_of_a_table_counted_from_one() {
        let tips = [DVec3::new(1.0, 2.0, 3.0), DVec3::new(4.0, 5.0, 6.0)];
        let axis = DVec3::new(0.0, 0.6, 0.8);
        let poses = tips.map(|tip| Pose::along(tip, axis));
        let path = Toolpath::of_poses(poses, false, LengthUnit::Mm).unwrap();
        let table =
            Toolpath::parse("x,y,z,i,j,k\n1,2,3,0,.6,.8\n4,5,6,0,.6,.8\n", LengthUnit::Mm, "a").unwrap();
        let lower = |location: &Location| Location { line: location.line - 1, ..*location };
        assert_eq!(path.locations, table.locations.iter().map(lower).collect::<Vec<_>>());
        let bad = [poses[0], Pose::new(tips[1], DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0))];
        let refusal = Toolpath::of_poses(bad, true, LengthUnit::Mm).unwrap_err().to_string();
        assert!(refusal.starts_with("poses, line 2: a pose must be"), "{refusal}");
        assert!(matches!(Toolpath::of_poses([], false, LengthUnit::Mm), Err(ToolpathError::Empty(_))));
    }
}
