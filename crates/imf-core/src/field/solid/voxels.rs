//! Solid voxels as tools meet them: prepared once, and shared by all tools around one obstacle.

use std::sync::{Arc, OnceLock};

use glam::DVec3;

use super::FreeBall;
use super::runs::Columns;
use crate::distance::DistanceField;
use crate::occupancy::Occupancy;

/// An obstacle's voxels with their running sums and, from the first decision on, their distance transform. Cloning it
/// copies nothing.
#[derive(Clone)]
pub(crate) struct SolidVoxels(Arc<Prepared>);

struct Prepared {
    occupancy: Arc<Occupancy>,
    columns: Columns,
    distances: OnceLock<DistanceField>,
}

impl From<Arc<Occupancy>> for SolidVoxels {
    fn from(occupancy: Arc<Occupancy>) -> Self {
        let columns = Columns::new(&occupancy);
        Self(Arc::new(Prepared { occupancy, columns, distances: OnceLock::new() }))
    }
}

impl SolidVoxels {
    pub(crate) fn occupancy(&self) -> &Occupancy {
        &self.0.occupancy
    }

    pub(super) fn columns(&self) -> &Columns {
        &self.0.columns
    }

    pub(crate) fn distances(&self) -> &DistanceField {
        self.0.distances.get_or_init(|| DistanceField::new(&self.0.occupancy))
    }

    /// The ball of a radius, in voxels, around a point on a surface, with the solid centres in it listed that lie outside the
    /// surface's tangent plane: a tool that stays on the plane's outer side, and holds none of these, holds none in the ball.
    /// A centre on the plane may be listed as well. `None` where there are more than `few`.
    pub(crate) fn free_ball(
        &self,
        point: DVec3,
        normal: DVec3,
        radius: f64,
        few: u32,
        listed: &mut Vec<[f64; 3]>,
    ) -> Option<FreeBall> {
        /// What is taken from the plane, and added to the ball, in voxels: more than any rounding.
        const MARGIN: f64 = 1e-6;
        listed.clear();
        let grid = &self.0.occupancy.grid;
        let middle = grid.continuous(point);
        let [nx, ny, nz] = grid.dims.map(|n| n as f64);
        let range = |at: f64, half: f64, count: f64| {
            ((at - half).ceil().max(0.0) as usize, ((at + half).floor() + 1.0).clamp(0.0, count) as usize)
        };
        let wide = radius + MARGIN;
        let (x0, x1) = range(middle.x, wide, nx);
        for x in x0..x1 {
            let dx = x as f64 - middle.x;
            let left = wide * wide - dx * dx;
            let (y0, y1) = range(middle.y, left.max(0.0).sqrt(), ny);
            let (first, last) = self.0.columns.row(x);
            if first > last {
                continue;
            }
            for y in y0.max(first as usize)..y1.min(last as usize + 1) {
                let dy = y as f64 - middle.y;
                let half = (left - dy * dy).max(0.0).sqrt();
                // On this line the outer side is where normal.z · dz > −base.
                let base = normal.x * dx + normal.y * dy + MARGIN;
                let (mut low, mut high) = (middle.z - half, middle.z + half);
                if normal.z.abs() < 1e-9 {
                    // Over the whole ball the plane then strays by less than the margin.
                    if base < 0.0 {
                        continue;
                    }
                } else if normal.z > 0.0 {
                    low = low.max(middle.z - base / normal.z);
                } else {
                    high = high.min(middle.z - base / normal.z);
                }
                let (from, to) = (low.ceil().max(0.0), (high.floor() + 1.0).min(nz));
                if from >= to {
                    continue;
                }
                let (from, to) = (from as usize, to as usize);
                let sums = self.0.columns.sums(x, y);
                if sums[to] == sums[from] {
                    continue;
                }
                if listed.len() as u32 + sums[to] - sums[from] > few {
                    listed.clear();
                    return None;
                }
                let solid = (from..to).filter(|&z| sums[z + 1] > sums[z]);
                listed.extend(solid.map(|z| [x as f64, y as f64, z as f64]));
            }
        }
        Some(FreeBall { middle, radius })
    }
}
