//! The access map of one point: the collision measure of every direction from there, over longitude and latitude.

use glam::DVec3;

use crate::control::Control;
use crate::field::{Best, ExactField, FieldError, PoseField};
use crate::obstacle::Obstacle;
use crate::orientation::{Limits, Orientation};
use crate::parallel;
use crate::pose::Pose;
use crate::tool::Assembly;

/// Collision measures over cells of longitude θ and latitude 90° − φ of the tool's axis.
#[derive(Clone, Debug, PartialEq)]
pub struct AccessMap {
    /// Cells along longitude (0° to 360°) and latitude (−90° to 90°).
    pub cells: [usize; 2],
    /// The measure at each cell's middle, `[longitude][latitude]`, in [0, 1]; no number where it is out of a machine's
    /// limits ([`AccessMap::within`]).
    pub values: Vec<f32>,
}

impl AccessMap {
    /// The orientation in the middle of a cell, without roll.
    #[must_use]
    pub fn orientation(cells: [usize; 2], longitude: usize, latitude: usize) -> Orientation {
        let middle = |i: usize, n: usize, whole: f64| whole * (i as f64 + 0.5) / n as f64;
        Orientation::new(middle(longitude, cells[0], 360.0), 180.0 - middle(latitude, cells[1], 180.0))
    }

    /// The map without the directions that a machine cannot give the tool.
    #[must_use]
    pub fn within(mut self, limits: &Limits) -> Self {
        for (cell, value) in self.values.iter_mut().enumerate() {
            let orientation = Self::orientation(self.cells, cell / self.cells[1], cell % self.cells[1]);
            if !limits.reach(orientation.direction()) {
                *value = f32::NAN;
            }
        }
        self
    }

    /// Fraction of the map's directions, by their area on the sphere, whose measure is at most `tau`; 0 without
    /// directions.
    #[must_use]
    pub fn free_fraction(&self, tau: f64) -> f64 {
        let step = std::f64::consts::PI / self.cells[1] as f64;
        let area = |j: usize| ((j as f64) * step).cos() - ((j + 1) as f64 * step).cos();
        let (mut free, mut all) = (0.0, 0.0);
        for (index, &value) in self.values.iter().enumerate().filter(|(_, value)| !value.is_nan()) {
            let area = area(index % self.cells[1]);
            all += area;
            free += if f64::from(value) <= tau { area } else { 0.0 };
        }
        if all > 0.0 { free / all } else { 0.0 }
    }
}

/// The collision measure at the world point `point` for every cell of directions, by direct counts: the least over the
/// tool's sharp points, each put exactly there. At voxel centres it is what a section reads, where the tip alone is sharp. The tool's
/// lengths are in the grid's unit. One unit of progress is one direction.
///
/// # Errors
/// A tool that does not fit the grid; [`FieldError::Cancelled`] when the control asks to stop.
pub fn access_map(
    obstacle: impl Into<Obstacle>,
    assembly: impl Into<Assembly>,
    point: DVec3,
    cells: [usize; 2],
    control: Control<'_>,
) -> Result<AccessMap, FieldError> {
    let field = ExactField::new(obstacle, assembly)?;
    let values = parallel::try_map(cells[0] * cells[1], |cell| {
        control.check()?;
        let orientation = AccessMap::orientation(cells, cell / cells[1], cell % cells[1]);
        let rotation = Pose::oriented(point, &orientation).rotation;
        let mut best = [Best::NONE];
        field.best(&[point], &[rotation], &mut best)?;
        (control.progress)(1);
        Ok::<_, FieldError>(best[0].value)
    })?;
    Ok(AccessMap { cells, values })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::access::tests::{slotted, small_tool};
    use crate::section::direct_cmf;
    use crate::tool::{SharpPoints, Tool, ToolVoxels};

    #[test]
    fn at_a_voxel_centre_it_is_the_direct_measure_of_every_direction() {
        let (obstacle, tool) = (slotted(), small_tool());
        let voxel = [6, 5, 4];
        let cells = [7, 5];
        let centre = obstacle.grid.centre(voxel);
        let map = access_map(&obstacle, &tool, centre, cells, Control::quiet()).unwrap();
        for (cell, &value) in map.values.iter().enumerate() {
            let orientation = AccessMap::orientation(cells, cell / 5, cell % 5);
            let expected = direct_cmf(&obstacle, &tool, &orientation, voxel).unwrap();
            assert!((f64::from(value) - expected).abs() < 1e-6, "{orientation:?}");
        }
        assert!((map.free_fraction(1.0) - 1.0).abs() < 1e-12 && map.free_fraction(-1.0) == 0.0);
        // Of the lower half, which a machine with a cone about +z does not reach, nothing is left.
        let limits = Limits::parse("cone:0,0,1:90").unwrap();
        let upper = map.clone().within(&limits);
        for (cell, (&value, &whole)) in upper.values.iter().zip(&map.values).enumerate() {
            let reached = AccessMap::orientation(cells, cell / 5, cell % 5).direction().z >= -1e-12;
            assert!(if reached { value == whole } else { value.is_nan() }, "{cell}");
        }
        assert!((upper.free_fraction(1.0) - 1.0).abs() < 1e-12);
        assert_eq!(map.within(&Limits::parse("cone:0,0,1:0").unwrap()).free_fraction(1.0), 0.0);
        // The last cell along latitude looks nearly straight up.
        assert!(AccessMap::orientation(cells, 3, 4).direction().z > 0.9);
    }

    #[test]
    fn at_any_point_it_counts_what_the_tool_holds_there_whatever_is_sharp() {
        let obstacle = slotted();
        let sharp = SharpPoints::Points(vec![DVec3::new(0.4, -0.3, 0.8), DVec3::new(0.0, 0.0, 1.7)]);
        let (cells, pitch) = ([4, 3], obstacle.grid.pitch);
        let mut free = 0;
        for sharp_points in [SharpPoints::Tip, sharp, SharpPoints::Boundary(None)] {
            let tool = Tool { sharp_points, ..small_tool() };
            let below = obstacle.grid.centre([6, 5, 4]) + DVec3::new(0.25, 0.5, 0.75) * pitch;
            let above = below + DVec3::Z * obstacle.grid.size().z;
            let of = |point| access_map(&obstacle, &tool, point, cells, Control::quiet()).unwrap().values;
            let all = [below, above].into_iter().flat_map(|point| {
                of(point).into_iter().enumerate().map(move |(cell, value)| (point, cell, value))
            });
            for (point, cell, value) in all {
                let orientation = AccessMap::orientation(cells, cell / 3, cell % 3);
                let whole = ToolVoxels::new(&tool, &orientation, pitch).unwrap().count;
                let held = tool.sharp_point_positions(pitch).into_iter().map(|sharp| {
                    tool.count_inside(&obstacle, point - orientation.rotation() * sharp, &orientation)
                });
                let expected = f64::from(held.min().unwrap()) / f64::from(whole);
                assert!(
                    (f64::from(value) - expected.min(1.0)).abs() < 1e-6,
                    "{:?} {cell}",
                    tool.sharp_points
                );
                free += usize::from(value == 0.0);
            }
        }
        assert!((1..72).contains(&free), "{free}");
    }
}
