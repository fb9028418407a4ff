//! Balls beside the axis that together cover a short piece: which lines of voxels must be counted.

use super::super::runs::Lines;
use super::lookup::Lookup;
use super::{Items, LANES, Places, SLACK, at, keep_items};

/// 19 points of a hexagonal lattice, a middle and two rings: the discs of radius 1 around them cover the disc of radius √13.
const POINTS: [[f32; 2]; 19] = points();

const fn points() -> [[f32; 2]; 19] {
    let (side, mut points, mut count, mut y) = (1.732_050_8, [[0.0; 2]; 19], 0, -2_i32);
    while y <= 2 {
        let few = 5 - y.abs();
        let mut x = 0;
        while x < few {
            points[count] = [(x as f32 - 0.5 * (few - 1) as f32) * side, 1.5 * y as f32];
            (count, x) = (count + 1, x + 1);
        }
        y += 1;
    }
    points
}

/// The balls of one piece: around points at this height of the axis, so many times farther from it than [`POINTS`] say, with this
/// radius; in voxels.
pub(super) struct BallsBeside {
    height: f32,
    apart: f32,
    radius: f32,
}

impl BallsBeside {
    /// Balls that together cover all within a radius of the axis between two heights.
    pub(super) fn new(from: f64, to: f64, wide: f64) -> Self {
        let apart = wide / 13.0_f64.sqrt();
        let radius = (0.5 * (to - from)).hypot(apart) as f32 + SLACK;
        Self { height: (0.5 * (from + to)) as f32, apart: apart as f32, radius }
    }
}

/// Finds for every item whose place is not known to collide the lines on which it may hold a solid centre, and removes it
/// where there are none.
#[inline(always)]
pub(super) fn find_lines<'a>(
    lookup: &Lookup<'_>,
    balls: impl Fn(usize) -> &'a BallsBeside,
    items: &mut Items,
    places: &Places,
) {
    let Items { listed, lines, .. } = items;
    lines.clear();
    for listed in listed.chunks(LANES) {
        let (mut tip, mut axis) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
        let (mut height, mut apart, mut radius) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
        for (lane, &(place, piece)) in listed.iter().enumerate() {
            let place = at(place);
            let balls = balls(piece as usize);
            (height[lane], apart[lane], radius[lane]) = (balls.height, balls.apart, balls.radius);
            for a in 0..3 {
                tip[a][lane] = places.tip[a][place];
                axis[a][lane] = places.axis[a][place];
            }
        }
        // Two directions at right angles to the axis and to each other (Duff et al. 2017).
        let (mut one, mut other) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
        for lane in 0..LANES {
            let [x, y, z] = [axis[0][lane], axis[1][lane], axis[2][lane]];
            let sign = 1.0_f32.copysign(z);
            let a = -1.0 / (sign + z);
            let b = x * y * a;
            let scale = apart[lane];
            one[0][lane] = (1.0 + sign * x * x * a) * scale;
            one[1][lane] = sign * b * scale;
            one[2][lane] = -sign * x * scale;
            other[0][lane] = b * scale;
            other[1][lane] = (sign + y * y * a) * scale;
            other[2][lane] = -y * scale;
        }
        for a in 0..3 {
            for lane in 0..LANES {
                tip[a][lane] += axis[a][lane] * height[lane];
            }
        }
        // The box of the balls that may hold a centre: its lower ends, and its upper ones negated.
        let mut low = [[f32::INFINITY; LANES]; 2];
        let mut high = [[f32::INFINITY; LANES]; 2];
        for [x, y] in POINTS {
            let mut middle = [[0.0; LANES]; 3];
            for a in 0..3 {
                for lane in 0..LANES {
                    middle[a][lane] = tip[a][lane] + one[a][lane] * x + other[a][lane] * y;
                }
            }
            let found = lookup.at(middle);
            let mut far = [0.0; LANES];
            for lane in 0..LANES {
                let open = found.may_hold(lane, radius[lane], lookup.part);
                far[lane] = if open { 0.0 } else { f32::INFINITY };
            }
            for a in 0..2 {
                for lane in 0..LANES {
                    low[a][lane] = low[a][lane].min(far[lane] + middle[a][lane]);
                    high[a][lane] = high[a][lane].min(far[lane] - middle[a][lane]);
                }
            }
        }
        for lane in 0..listed.len() {
            let wide = radius[lane] + SLACK;
            let range = |a: usize| (low[a][lane] - wide, wide - high[a][lane]);
            lines.push(Lines { x: range(0), y: range(1) });
        }
    }
    keep_items(listed, |index, _| !lines[index].is_empty());
    lines.retain(|lines| !lines.is_empty());
}

#[cfg(test)]
mod tests {
    use super::POINTS;

    #[test]
    fn discs_around_the_points_cover_the_disc() {
        let (mut farthest, steps) = (0.0_f32, 400);
        for angle in 0..steps {
            let (sin, cos) = (angle as f32 / steps as f32 * std::f32::consts::TAU).sin_cos();
            for step in 0..=steps {
                let radius = 13.0_f32.sqrt() * step as f32 / steps as f32;
                let away = POINTS.map(|[x, y]| (x - radius * cos).hypot(y - radius * sin));
                farthest = farthest.max(away.into_iter().fold(f32::INFINITY, f32::min));
            }
        }
        assert!(farthest < 1.0 + 1e-5 && farthest > 0.98, "{farthest}");
    }
}
