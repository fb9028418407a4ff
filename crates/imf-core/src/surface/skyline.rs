//! Where on its axis a body of revolution is free: how far above a tip its lower end must be, for all tips of one direction.
//!
//! A voxel centre at height z and distance r from the axis is in the body while its lower end stands at z − h for
//! some height h of the body at which it is as wide as r. So a voxel that obstructs says how far up the body must go
//! to clear it: to the lowest such h below the current one, without a gap. The body goes there and queries again;
//! it collides at every height between its start and its end. Voxels are sorted into square cells across the direction,
//! cells into a pyramid of their highest voxels, and what cannot obstruct is skipped.

use glam::{DVec2, DVec3};

use crate::occupancy::Occupancy;
use crate::tool::Segment;

/// What is added to a body, in pitches: more than rounding.
const MARGIN: f64 = 1e-6;
/// Steps of the table of lowest heights.
const STEPS: usize = 128;
/// Width of a cell in pitches.
const CELL: f64 = 2.0;

/// The outline of a body of revolution, without gaps; heights are from where it is said to stand.
#[derive(Clone, Debug)]
pub(super) struct Body {
    segments: Vec<Segment>,
    lowest: f64,
    highest: f64,
    widest: f64,
    /// By distance from the axis, in steps of the widest: no height below is as wide.
    rises: Vec<f64>,
}

impl Body {
    /// `None` without a segment that has a height.
    pub(super) fn new(outline: impl Iterator<Item = Segment>) -> Option<Self> {
        let segments: Vec<Segment> = outline.filter(|s| s.range().0 < s.range().1).collect();
        let (lowest, highest) = (segments.first()?.range().0, segments.last()?.range().1);
        let widest = segments.iter().map(Segment::max_radius).fold(0.0, f64::max);
        let mut body = Self { segments, lowest, highest, widest, rises: Vec::new() };
        body.rises = (0..=STEPS).map(|step| body.rise(widest * step as f64 / STEPS as f64)).collect();
        Some(body)
    }

    /// The lowest height at which it holds points at this distance from its axis.
    fn rise(&self, radius: f64) -> f64 {
        let wide = self.segments.iter().find(|segment| segment.max_radius() >= radius);
        wide.map_or(f64::INFINITY, |segment| lowest(segment, radius))
    }

    /// No more than [`Self::rise`], from the table.
    #[inline]
    fn rise_at_least(&self, radius: f64) -> f64 {
        if radius > self.widest {
            return f64::INFINITY;
        }
        self.rises[((radius / self.widest * STEPS as f64) as usize).min(STEPS)]
    }

    /// Of a point that it holds: how far down from there it goes on holding points at this distance from its axis. `None` of
    /// others.
    fn lower_end(&self, height: f64, radius: f64) -> Option<f64> {
        let mut at = self.segments.partition_point(|segment| segment.range().1 <= height);
        let segment = self.segments.get(at)?;
        if height < segment.range().0 || segment.radius(height) < radius {
            return None;
        }
        loop {
            let segment = &self.segments[at];
            let (from, _) = segment.range();
            let low = lowest(segment, radius);
            if low > from || at == 0 {
                return Some(low);
            }
            let below = &self.segments[at - 1];
            if below.radius(below.range().1) < radius {
                return Some(low);
            }
            at -= 1;
        }
    }
}

/// The lowest height at which a segment is as wide as `radius`, which it is somewhere: on its way up to there it widens.
fn lowest(segment: &Segment, radius: f64) -> f64 {
    let (from, to) = segment.range();
    if segment.radius(from) >= radius {
        return from;
    }
    let at = match *segment {
        Segment::Line { radius_from, radius_to, .. } => {
            from + (to - from) * (radius - radius_from) / (radius_to - radius_from)
        }
        Segment::Arc { centre_height, centre_radius, arc_radius, .. } => {
            let across = radius - centre_radius;
            centre_height - (arc_radius * arc_radius - across * across).max(0.0).sqrt()
        }
    };
    at.clamp(from, to)
}

/// Centres of the solid voxels at the surface.
pub(super) fn boundary(solid: &Occupancy) -> Vec<DVec3> {
    let exposed = solid.solids().filter(|&index| solid.is_exposed(index));
    exposed.map(|index| solid.grid.centre(solid.grid.voxel(index))).collect()
}

/// Points as seen along one direction.
pub(super) struct Skyline {
    axis: DVec3,
    u: DVec3,
    v: DVec3,
    /// Lower corner of the first cell.
    lower: DVec2,
    pitch: f64,
    /// By cell, row by row: where its points begin.
    starts: Vec<u32>,
    /// Places across the axis and heights along it; the highest of a cell first.
    points: Vec<[f64; 3]>,
    /// The finest level has the cells, each further one half as many along both sides, the last one alone.
    levels: Vec<Level>,
}

/// The height of the highest point of each cell.
struct Level {
    dims: [usize; 2],
    highest: Vec<f64>,
}

/// Cells that wait to be visited: level, cell, and how far up they may send the body.
pub(super) type CellQueue = Vec<(u32, u32, f64)>;

impl Skyline {
    /// Of points, seen along the unit vector `axis` from tip to holder.
    pub(super) fn new(centres: &[DVec3], pitch: f64, axis: DVec3) -> Self {
        let (u, v) = axis.any_orthonormal_pair();
        let seen: Vec<[f64; 3]> = centres.iter().map(|c| [c.dot(u), c.dot(v), c.dot(axis)]).collect();
        let (mut lower, mut upper) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        for &[x, y, _] in &seen {
            (lower, upper) = (lower.min(DVec2::new(x, y)), upper.max(DVec2::new(x, y)));
        }
        if seen.is_empty() {
            (lower, upper) = (DVec2::ZERO, DVec2::ZERO);
        }
        let cell = CELL * pitch;
        let dims = (upper - lower).to_array().map(|length| (length / cell) as usize + 1);
        let place = |[x, y, _]: [f64; 3]| {
            let [x, y] = [(x - lower.x) / cell, (y - lower.y) / cell].map(|c| c as usize);
            y.min(dims[1] - 1) * dims[0] + x.min(dims[0] - 1)
        };
        let mut starts = vec![0u32; dims[0] * dims[1] + 1];
        seen.iter().for_each(|&point| starts[place(point) + 1] += 1);
        for cell in 1..starts.len() {
            starts[cell] += starts[cell - 1];
        }
        let mut next = starts.clone();
        let mut points = vec![[0.0; 3]; seen.len()];
        for point in seen {
            let to = &mut next[place(point)];
            points[*to as usize] = point;
            *to += 1;
        }
        let mut highest = Vec::with_capacity(dims[0] * dims[1]);
        for ends in starts.windows(2) {
            let cell = &mut points[ends[0] as usize..ends[1] as usize];
            cell.sort_unstable_by(|a, b| b[2].total_cmp(&a[2]));
            highest.push(cell.first().map_or(f64::NEG_INFINITY, |top| top[2]));
        }
        let mut levels = vec![Level { dims, highest }];
        while levels[levels.len() - 1].highest.len() > 1 {
            levels.push(levels[levels.len() - 1].halved());
        }
        Self { axis, u, v, lower, pitch, starts, points, levels }
    }

    /// Minimum height above `tip` at which the body, its axis through the tip, holds no point, searched from `least`
    /// up: every lower height collides. `None` where it is not below `limit`.
    pub(super) fn clearing_height(
        &self,
        tip: DVec3,
        body: &Body,
        least: f64,
        limit: f64,
        waiting: &mut CellQueue,
    ) -> Option<f64> {
        let at = DVec2::new(tip.dot(self.u), tip.dot(self.v));
        let floor = tip.dot(self.axis);
        let mut stands = least;
        while stands < limit {
            let freed = self.freed(at, floor, body, stands, limit, waiting);
            if freed == stands {
                return Some(stands);
            }
            stands = freed + MARGIN * self.pitch;
        }
        None
    }

    /// How far up the body must go until all that is now in it is out; no farther than needed to pass `limit`.
    fn freed(
        &self,
        at: DVec2,
        floor: f64,
        body: &Body,
        stands: f64,
        limit: f64,
        waiting: &mut CellQueue,
    ) -> f64 {
        let margin = MARGIN * self.pitch;
        let mut best = stands;
        waiting.clear();
        waiting.push((self.levels.len() as u32 - 1, 0, f64::INFINITY));
        while let Some((level, cell, bound)) = waiting.pop() {
            if bound <= best {
                continue;
            }
            let (level, cell) = (level as usize, cell as usize);
            if level == 0 {
                for &[x, y, height] in
                    &self.points[self.starts[cell] as usize..self.starts[cell + 1] as usize]
                {
                    let up = height - floor;
                    if up - body.lowest + margin <= best {
                        break;
                    }
                    if up - stands >= body.highest {
                        continue;
                    }
                    let away = (DVec2::new(x, y).distance(at) - margin).max(0.0);
                    if up - body.rise_at_least(away) + margin <= best {
                        continue;
                    }
                    // A point just below the body counts as in it.
                    let within = (up - stands).max(body.lowest);
                    if let Some(low) = body.lower_end(within, away) {
                        best = best.max(up - low);
                        if best >= limit {
                            return best;
                        }
                    }
                }
                continue;
            }
            let [width, _] = self.levels[level].dims;
            let (x, y) = (2 * (cell % width), 2 * (cell / width));
            let finer = &self.levels[level - 1];
            let size = CELL * self.pitch * f64::from(1u32 << (level - 1));
            let mut children = [(0, f64::NEG_INFINITY); 4];
            for (child, (dx, dy)) in children.iter_mut().zip([(0, 0), (1, 0), (0, 1), (1, 1)]) {
                let (x, y) = (x + dx, y + dy);
                if x < finer.dims[0] && y < finer.dims[1] {
                    let index = y * finer.dims[0] + x;
                    let up = finer.highest[index] - floor;
                    if up - body.lowest + margin <= best {
                        continue;
                    }
                    let corner = self.lower + DVec2::new(x as f64, y as f64) * size;
                    let away = (corner - at).max(at - corner - size).max(DVec2::ZERO).length();
                    *child = (index as u32, up - body.rise_at_least((away - margin).max(0.0)) + margin);
                }
            }
            children.sort_unstable_by(|a, b| a.1.total_cmp(&b.1));
            let finer = level as u32 - 1;
            waiting.extend(
                children.into_iter().filter(|c| c.1 > best).map(|(index, bound)| (finer, index, bound)),
            );
        }
        best
    }
}

impl Level {
    fn halved(&self) -> Self {
        let dims = self.dims.map(|n| n.div_ceil(2));
        let mut highest = vec![f64::NEG_INFINITY; dims[0] * dims[1]];
        for (index, &height) in self.highest.iter().enumerate() {
            let to = &mut highest[index / self.dims[0] / 2 * dims[0] + index % self.dims[0] / 2];
            *to = to.max(height);
        }
        Self { dims, highest }
    }
}

#[cfg(test)]
mod tests;
