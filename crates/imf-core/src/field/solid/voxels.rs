//! Solid voxels as tools meet them: prepared once, and shared by all tools around one obstacle.

use std::sync::{Arc, OnceLock};

use glam::DVec3;

use super::runs::Columns;
use super::{FreeBall, PointTree};
use crate::distance::{DistanceField, squared_depths};
use crate::mesh::{Mesh, points_at_pitch};
use crate::occupancy::Occupancy;
use crate::parallel::{self, make_once};

/// An obstacle's voxels with their running sums and, from the first decision on, their distance transform. Cloning it
/// copies nothing.
#[derive(Clone)]
pub(crate) struct SolidVoxels {
    tables: Arc<SolidTables>,
    surfaces: Arc<[Arc<PointTree>]>,
}

#[derive(Clone)]
struct SolidTables {
    occupancy: Arc<Occupancy>,
    columns: Columns,
    distances: OnceLock<DistanceField>,
    depths: OnceLock<Vec<f32>>,
    /// By how many parts of a voxel a byte counts: 1, 2, 4, 8.
    bytes: [OnceLock<Vec<u8>>; 4],
}

impl From<Arc<Occupancy>> for SolidVoxels {
    fn from(occupancy: Arc<Occupancy>) -> Self {
        let columns = Columns::new(&occupancy);
        let tables = SolidTables {
            occupancy,
            columns,
            distances: OnceLock::new(),
            depths: OnceLock::new(),
            bytes: Default::default(),
        };
        Self { tables: Arc::new(tables), surfaces: Arc::default() }
    }
}

/// Distance to the nearest solid centre in units of 1/`parts` voxel.
fn byte(distances: &DistanceField, index: usize, parts: u32) -> u8 {
    (distances.to_solid(index) * parts as f32).min(255.0) as u8
}

impl SolidVoxels {
    pub(crate) fn occupancy(&self) -> &Occupancy {
        &self.tables.occupancy
    }

    /// The same with points of the body's surface, and how far they are apart; the mesh is in the grid's coordinates.
    pub(crate) fn with_surface_of(self, mesh: &Mesh) -> (Self, f64) {
        let grid = &self.occupancy().grid;
        let (points, apart) = points_at_pitch(mesh, grid.pitch);
        let points = Arc::new(PointTree::new(points, grid));
        (self.with_surfaces(&[points]), apart)
    }

    /// The same with points of surfaces, which a tool must not hold either.
    pub(crate) fn with_surfaces(self, surfaces: &[Arc<PointTree>]) -> Self {
        Self { surfaces: surfaces.into(), ..self }
    }

    /// All points of surfaces, in the world.
    pub(crate) fn points(&self) -> Vec<DVec3> {
        let grid = &self.occupancy().grid;
        let points = self.surfaces.iter().flat_map(|surface| surface.points());
        points.map(|&point| grid.world(point)).collect()
    }

    pub(crate) fn surfaces(&self) -> &[Arc<PointTree>] {
        &self.surfaces
    }

    /// The voxels themselves.
    pub(crate) fn shared(&self) -> Arc<Occupancy> {
        self.tables.occupancy.clone()
    }

    /// Makes some voxels solid or empty, each of `changed` once and in order, and updates everything derived from
    /// them as if it were computed anew. In place where nobody else shares it; otherwise it is copied first and the
    /// others keep theirs.
    pub(crate) fn change(&mut self, changed: &[usize]) {
        if Arc::get_mut(&mut self.tables).is_none() {
            self.tables = Arc::new(SolidTables::clone(&self.tables));
        }
        let Some(prepared) = Arc::get_mut(&mut self.tables) else { return };
        let SolidTables { occupancy, columns, distances, depths, bytes } = prepared;
        let occupancy = Arc::make_mut(occupancy);
        changed.iter().for_each(|&index| occupancy.solid[index] ^= 1);
        columns.change(occupancy, changed);
        // Computed again when they are needed.
        *depths = OnceLock::new();
        if let Some(distances) = distances.get_mut() {
            let moved = distances.change(occupancy, changed);
            for (parts, bytes) in bytes.iter_mut().enumerate() {
                if let Some(bytes) = bytes.get_mut() {
                    moved.iter().for_each(|&index| {
                        bytes[index] = byte(distances, index, 1 << parts);
                    });
                }
            }
        }
    }

    pub(super) fn columns(&self) -> &Columns {
        &self.tables.columns
    }

    pub(crate) fn distances(&self) -> &DistanceField {
        make_once(&self.tables.distances, || DistanceField::new(&self.tables.occupancy))
    }

    /// For each voxel the distance to the nearest solid centre in units of 1/`parts` voxel (`parts` is 1, 2, 4 or 8),
    /// rounded down, 255 where it is larger. Computed at the first batch.
    pub(super) fn bytes(&self, parts: u32) -> &[u8] {
        let distances = self.distances();
        let made = || parallel::map(self.tables.occupancy.grid.len(), |index| byte(distances, index, parts));
        make_once(&self.tables.bytes[parts.trailing_zeros() as usize & 3], made).as_slice()
    }

    /// By voxel the distance to the nearest empty centre, in voxels, rounded down; 0 where empty. Made at the first bound of a
    /// penetration.
    pub(super) fn depths(&self) -> &[f32] {
        let round_down = |squared: u64| ((squared as f64).sqrt() as f32).next_down().max(0.0);
        let made =
            || -> Vec<f32> { squared_depths(&self.tables.occupancy).into_iter().map(round_down).collect() };
        make_once(&self.tables.depths, made).as_slice()
    }

    /// Visits the solid centres within a radius of a point, all in voxels; `visit` may make the radius smaller.
    pub(super) fn visit_ball(&self, middle: DVec3, mut radius: f64, mut visit: impl FnMut([f64; 3]) -> f64) {
        let [nx, ny, nz] = self.tables.occupancy.grid.dims;
        let (x0, x1) = whole_within(middle.x, radius, nx);
        for x in x0..x1 {
            let left = radius * radius - (x as f64 - middle.x).powi(2);
            let (first, last) = self.tables.columns.row(x);
            if left < 0.0 || first > last {
                continue;
            }
            let (y0, y1) = whole_within(middle.y, left.sqrt(), ny);
            for y in y0.max(first as usize)..y1.min(last as usize + 1) {
                let left = radius * radius - (x as f64 - middle.x).powi(2) - (y as f64 - middle.y).powi(2);
                let (from, to) = whole_within(middle.z, left.max(0.0).sqrt(), nz);
                let sums = self.tables.columns.sums(x, y);
                if left < 0.0 || from >= to || sums[to] == sums[from] {
                    continue;
                }
                for z in (from..to).filter(|&z| sums[z + 1] > sums[z]) {
                    radius = radius.min(visit([x as f64, y as f64, z as f64]));
                }
            }
        }
    }

    /// The solid centres outside the tangent plane of a surface at a point, as far as a radius, in voxels; one on the plane may be
    /// listed as well. `None` where there are more than `most`.
    pub(crate) fn outside_plane(
        &self,
        point: DVec3,
        normal: DVec3,
        radius: f64,
        most: u32,
    ) -> Option<OutsidePlane> {
        let mut listed = Vec::new();
        let grid = &self.tables.occupancy.grid;
        let middle = grid.continuous(point);
        let [nx, ny, nz] = grid.dims;
        let wide = radius + MARGIN;
        let (x0, x1) = whole_within(middle.x, wide, nx);
        for x in x0..x1 {
            let dx = x as f64 - middle.x;
            let left = wide * wide - dx * dx;
            let (y0, y1) = whole_within(middle.y, left.max(0.0).sqrt(), ny);
            let (first, last) = self.tables.columns.row(x);
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
                let (from, to) = (whole_above(low), whole_below(high).min(nz));
                if from >= to {
                    continue;
                }
                let sums = self.tables.columns.sums(x, y);
                if sums[to] == sums[from] {
                    continue;
                }
                if listed.len() as u32 + sums[to] - sums[from] > most {
                    return None;
                }
                let solid = (from..to).filter(|&z| sums[z + 1] > sums[z]);
                listed.extend(solid.map(|z| [x as f64, y as f64, z as f64]));
            }
        }
        Some(OutsidePlane { middle, radius, listed })
    }
}

/// Subtracted from the plane and added to the ball, in voxels: more than any rounding.
const MARGIN: f64 = 1e-6;

/// The first whole number from there on, of those from 0 on.
fn whole_above(at: f64) -> usize {
    let whole = at.max(0.0) as usize;
    whole + usize::from((whole as f64) < at)
}

/// Whole numbers within `half` of a coordinate, of those from 0 to `count`: the first, and one past the last.
fn whole_within(at: f64, half: f64, count: usize) -> (usize, usize) {
    (whole_above(at - half).min(count), whole_below(at + half).min(count))
}

/// One past the last whole number up to there, of those from 0 on.
fn whole_below(at: f64) -> usize {
    if at < 0.0 { 0 } else { (at as usize).saturating_add(1) }
}

/// Solid centres around a point on a surface, outside its tangent plane.
pub(crate) struct OutsidePlane {
    middle: DVec3,
    radius: f64,
    listed: Vec<[f64; 3]>,
}

impl OutsidePlane {
    /// The ball of a smaller radius, or of this one, and the centres in it: a tool that stays on the plane's outer side, and holds
    /// none of these, holds none in the ball. `None` where there are more than `few`, or the radius is larger.
    pub(crate) fn free_ball(&self, radius: f64, few: u32, listed: &mut Vec<[f64; 3]>) -> Option<FreeBall> {
        listed.clear();
        if radius > self.radius {
            return None;
        }
        let within = (radius + MARGIN) * (radius + MARGIN);
        let near = |voxel: &&[f64; 3]| DVec3::from_array(**voxel).distance_squared(self.middle) <= within;
        listed.extend(self.listed.iter().filter(near).take(few as usize + 1));
        if listed.len() > few as usize {
            listed.clear();
            return None;
        }
        Some(FreeBall { middle: self.middle, radius })
    }
}
