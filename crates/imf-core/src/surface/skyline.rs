//! How high material stands around a tool's axis, for all positions of an axis in one direction.
//!
//! A holder that goes on upwards without end collides with a voxel centre at height z and distance r from its axis
//! exactly where it begins lower than `z − G(r)`, G(r) being the height above its own lower end from which on it is as
//! wide as r. So one maximum over the voxels gives the least stick-out that is free, with no trial of others. Voxels are
//! sorted into square cells across the direction, cells into a pyramid of their highest voxels, and what cannot be the
//! maximum is passed over.

use glam::{DVec2, DVec3};

use crate::occupancy::Occupancy;
use crate::tool::{Element, Segment};

/// A body of revolution that goes on upwards without end, never narrower than it was below.
#[derive(Clone, Debug)]
pub(crate) struct RisingProfile {
    /// Heights from the lower end of the first.
    segments: Vec<Segment>,
    start: f64,
    widest: f64,
}

impl RisingProfile {
    /// Of elements one above the other; `None` without any.
    pub(crate) fn of<'a>(elements: impl Iterator<Item = &'a Element>) -> Option<Self> {
        let mut segments: Vec<Segment> =
            elements.flat_map(|element| element.profile.iter().copied()).collect();
        segments.sort_by(|a, b| a.range().0.total_cmp(&b.range().0));
        let start = segments.first()?.range().0;
        let widest = segments.iter().map(Segment::max_radius).fold(0.0, f64::max);
        Some(Self { segments, start, widest })
    }

    /// Height of its lower end in the tool.
    pub(crate) fn start(&self) -> f64 {
        self.start
    }

    /// The height above its lower end from which on it holds points at this distance from the axis; infinite beyond its
    /// widest place.
    fn rise(&self, radius: f64) -> f64 {
        for segment in &self.segments {
            let (from, to) = segment.range();
            if segment.radius(from) >= radius {
                return from - self.start;
            }
            if segment.max_radius() < radius {
                continue;
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
            return at.clamp(from, to) - self.start;
        }
        f64::INFINITY
    }
}

/// The solid voxels as seen along one direction.
pub(crate) struct Skyline {
    axis: DVec3,
    u: DVec3,
    v: DVec3,
    /// Lower corner of the first cell.
    lower: DVec2,
    cell: f64,
    /// By cell, row by row: where its voxels begin.
    starts: Vec<u32>,
    /// Places across the axis and heights along it; the highest of a cell first.
    voxels: Vec<(DVec2, f64)>,
    /// The finest level has the cells, each further one half as many along both sides, the last one alone.
    levels: Vec<Level>,
}

/// The height of the highest voxel of each cell.
struct Level {
    dims: [usize; 2],
    highest: Vec<f64>,
}

impl Skyline {
    /// Of the solid voxel centres, seen along the unit vector `axis` from tip to holder.
    pub(crate) fn new(solid: &Occupancy, axis: DVec3) -> Self {
        let (u, v) = axis.any_orthonormal_pair();
        let grid = &solid.grid;
        let seen = |index: usize| {
            let centre = grid.centre(grid.voxel(index));
            (DVec2::new(centre.dot(u), centre.dot(v)), centre.dot(axis))
        };
        let solid = || solid.solid.iter().enumerate().filter(|(_, s)| **s != 0).map(|(index, _)| seen(index));
        let empty = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        let (lower, upper) = solid().fold(empty, |(low, high), (at, _)| (low.min(at), high.max(at)));
        let cell = 2.0 * grid.pitch;
        let (lower, size) =
            if lower.x <= upper.x { (lower, upper - lower) } else { (DVec2::ZERO, DVec2::ZERO) };
        let dims = [size.x, size.y].map(|length| (length / cell) as usize + 1);
        let place = |at: DVec2| {
            let [x, y] = ((at - lower) / cell).to_array().map(|c| c as usize);
            y.min(dims[1] - 1) * dims[0] + x.min(dims[0] - 1)
        };
        let mut starts = vec![0u32; dims[0] * dims[1] + 1];
        solid().for_each(|(at, _)| starts[place(at) + 1] += 1);
        for cell in 1..starts.len() {
            starts[cell] += starts[cell - 1];
        }
        let mut next = starts.clone();
        let mut voxels = vec![(DVec2::ZERO, 0.0); starts[starts.len() - 1] as usize];
        for (at, height) in solid() {
            let to = &mut next[place(at)];
            voxels[*to as usize] = (at, height);
            *to += 1;
        }
        for cell in 0..starts.len() - 1 {
            voxels[starts[cell] as usize..starts[cell + 1] as usize].sort_by(|a, b| b.1.total_cmp(&a.1));
        }
        let first = |cell: usize| {
            if starts[cell] < starts[cell + 1] { voxels[starts[cell] as usize].1 } else { f64::NEG_INFINITY }
        };
        let mut levels = vec![Level { dims, highest: (0..dims[0] * dims[1]).map(first).collect() }];
        while levels[levels.len() - 1].highest.len() > 1 {
            levels.push(levels[levels.len() - 1].halved());
        }
        Self { axis, u, v, lower, cell, starts, voxels, levels }
    }

    /// How far above `tip` the lower end of the body, its axis through the tip, must be at least so that it holds no voxel
    /// centre; `least` where less would do.
    pub(crate) fn clearing_height(&self, tip: DVec3, body: &RisingProfile, least: f64) -> f64 {
        let at = DVec2::new(tip.dot(self.u), tip.dot(self.v));
        let floor = tip.dot(self.axis);
        let mut best = least;
        // (level, cell, bound); the pyramid is at most 32 levels high, and three of four children wait.
        let mut waiting = vec![(self.levels.len() - 1, 0usize, f64::INFINITY)];
        while let Some((level, cell, bound)) = waiting.pop() {
            if bound <= best {
                continue;
            }
            if level == 0 {
                for &(place, height) in
                    &self.voxels[self.starts[cell] as usize..self.starts[cell + 1] as usize]
                {
                    if height - floor <= best {
                        break;
                    }
                    best = best.max(height - floor - body.rise(place.distance(at)));
                }
                continue;
            }
            let [width, _] = self.levels[level].dims;
            let (x, y) = (2 * (cell % width), 2 * (cell / width));
            let finer = &self.levels[level - 1];
            let mut children = [(0, f64::NEG_INFINITY); 4];
            for (child, (dx, dy)) in children.iter_mut().zip([(0, 0), (1, 0), (0, 1), (1, 1)]) {
                let (x, y) = (x + dx, y + dy);
                if x < finer.dims[0] && y < finer.dims[1] {
                    let index = y * finer.dims[0] + x;
                    let size = self.cell * f64::from(1u32 << (level - 1));
                    let corner = self.lower + DVec2::new(x as f64, y as f64) * size;
                    let away = (corner - at).max(at - corner - size).max(DVec2::ZERO).length();
                    let bound = if away > body.widest {
                        f64::NEG_INFINITY
                    } else {
                        finer.highest[index] - floor - body.rise(away)
                    };
                    *child = (index, bound);
                }
            }
            children.sort_by(|a, b| a.1.total_cmp(&b.1));
            waiting.extend(children.into_iter().map(|(index, bound)| (level - 1, index, bound)));
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
mod tests {
    use super::*;
    use crate::grid::Grid;
    use crate::tool::ElementKind;

    fn line(from: f64, to: f64, radius_from: f64, radius_to: f64) -> Segment {
        Segment::Line { from, to, radius_from, radius_to }
    }

    /// A cone, a collar that narrows again, and a round flange.
    fn holder() -> Element {
        let round =
            Segment::Arc { from: 9.0, to: 12.0, centre_height: 12.0, centre_radius: 3.0, arc_radius: 3.0 };
        let profile = vec![line(5.0, 7.0, 1.5, 3.5), line(7.0, 9.0, 3.5, 2.5), round];
        Element { kind: ElementKind::Holder(0), profile }
    }

    #[test]
    fn a_body_is_as_wide_as_it_ever_was() {
        let body = RisingProfile::of([holder()].iter()).unwrap();
        let expected =
            [(0.0, 0.0), (1.5, 0.0), (2.5, 1.0), (3.5, 2.0), (5.0, 7.0 - 5.0f64.sqrt()), (6.0, 7.0)];
        for (radius, height) in expected {
            assert!((body.rise(radius) - height).abs() < 1e-12, "{radius}: {}", body.rise(radius));
        }
        assert_eq!((body.rise(6.01), body.start()), (f64::INFINITY, 5.0));
    }

    /// The maximum over all voxels, one by one, at positions inside, above and far beside a jagged landscape.
    #[test]
    fn it_is_the_maximum_over_all_voxels() {
        let grid = Grid { origin: DVec3::new(-3.0, 1.0, 0.5), pitch: 0.5, dims: [23, 17, 19] };
        let mut solid = Occupancy::empty(grid);
        for (index, s) in solid.solid.iter_mut().enumerate() {
            let [x, y, z] = grid.voxel(index);
            *s = u8::from(z < (x * x + 3 * y + x * y * y) % 19 && (x + y + z) % 3 > 0);
        }
        let body = RisingProfile::of([holder()].iter()).unwrap();
        for axis in
            [DVec3::Z, DVec3::new(0.3, -0.5, 0.8).normalize(), DVec3::new(-1.0, 0.2, -0.1).normalize()]
        {
            let skyline = Skyline::new(&solid, axis);
            for step in 0..200 {
                let turn = f64::from(step) * 0.7;
                let tip = grid.origin
                    + DVec3::new(
                        6.0 + 8.0 * turn.sin(),
                        5.0 + 7.0 * (1.7 * turn).cos(),
                        f64::from(step % 12),
                    );
                let one_by_one =
                    solid.solid.iter().enumerate().filter(|(_, s)| **s != 0).map(|(index, _)| {
                        let from_tip = grid.centre(grid.voxel(index)) - tip;
                        let height = from_tip.dot(axis);
                        height - body.rise((from_tip - axis * height).length())
                    });
                let expected = one_by_one.fold(2.0, f64::max);
                let found = skyline.clearing_height(tip, &body, 2.0);
                assert!((found - expected).abs() < 1e-9, "{axis} {tip}: {found} {expected}");
            }
        }
    }

    #[test]
    fn nothing_solid_leaves_the_least() {
        let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [3, 4, 5] };
        let skyline = Skyline::new(&Occupancy::empty(grid), DVec3::Z);
        let body = RisingProfile::of([holder()].iter()).unwrap();
        assert_eq!(skyline.clearing_height(DVec3::ONE, &body, 7.0), 7.0);
    }
}
