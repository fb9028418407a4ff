//! Profiles of bodies of revolution: radius as a function of height, in lines and arcs.

use std::f64::consts::{PI, TAU};
use std::fmt;

use glam::{DVec2, DVec3};
use serde::{Deserialize, Serialize};

/// What an element of the assembly is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ElementKind {
    /// The part that cuts.
    Cutter,
    /// The plain part between cutter and holder.
    Shank,
    /// A segment of the holder, counted from the tip.
    Holder(usize),
}

impl ElementKind {
    /// Place in the order from the tip upwards.
    #[must_use]
    pub fn order(self) -> usize {
        match self {
            Self::Cutter => 0,
            Self::Shank => 1,
            Self::Holder(index) => 2 + index,
        }
    }
}

/// Whether what begins at a height stands on what ends at one: they are equal up to the rounding of sums.
pub(super) fn meets(end: f64, from: f64) -> bool {
    (from - end).abs() <= 1e-9 * (from.abs() + end.abs())
}

impl fmt::Display for ElementKind {
    /// `cutter`, `shank`, or `holder 1` for the segment nearest to the tip.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cutter => f.pad("cutter"),
            Self::Shank => f.pad("shank"),
            Self::Holder(index) => f.pad(&format!("holder {}", index + 1)),
        }
    }
}

/// A named piece of the assembly.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Element {
    /// What it is for.
    pub kind: ElementKind,
    /// Its outline from its lower to its upper end, without gaps.
    pub profile: Vec<Segment>,
}

/// Height at which a profile ends.
pub(super) fn top(profile: &[Segment]) -> f64 {
    profile.last().map_or(0.0, |segment| segment.range().1)
}

impl Element {
    /// Height at which it ends.
    pub(crate) fn top(&self) -> f64 {
        top(&self.profile)
    }

    /// True where each of its segments begins where the one below ends.
    pub(crate) fn runs_upwards(&self) -> bool {
        let mut end = None;
        self.profile.iter().all(|segment| {
            let (from, to) = segment.range();
            let follows = end.is_none_or(|end| meets(end, from));
            end = Some(to);
            from <= to && follows
        })
    }

    /// True where every radius is finite and, up to rounding, at least 0.
    pub(super) fn has_radii(&self) -> bool {
        let least = -1e-9 * self.max_radius();
        self.profile.iter().flat_map(Segment::radii).all(|radius| radius.is_finite() && radius >= least)
    }

    /// Largest radius of the element.
    #[must_use]
    pub fn max_radius(&self) -> f64 {
        self.profile.iter().map(Segment::max_radius).fold(0.0, f64::max)
    }

    /// Smallest radius of the element.
    #[must_use]
    pub fn min_radius(&self) -> f64 {
        let ends = self.profile.iter().map(|segment| {
            let (from, to) = segment.range();
            // An arc bulges outwards.
            segment.radius(from).min(segment.radius(to))
        });
        ends.reduce(f64::min).unwrap_or(0.0)
    }

    /// Length of the longest stretch along the axis on which its radius is within `room` of the largest.
    pub(crate) fn widest_length(&self, room: f64) -> f64 {
        let least = self.max_radius() - room;
        let (mut longest, mut begin, mut end) = (0.0_f64, 0.0, f64::NEG_INFINITY);
        for [from, to] in self.profile.iter().filter_map(|segment| segment.heights_of_radius(least)) {
            begin = if from > end { from } else { begin };
            end = to;
            longest = longest.max(end - begin);
        }
        longest
    }

    pub(super) fn scaled(&self, factor: f64) -> Self {
        Self { kind: self.kind, profile: self.profile.iter().map(|s| s.scaled(factor)).collect() }
    }

    pub(super) fn raised(&self, by: f64) -> Self {
        Self { kind: self.kind, profile: self.profile.iter().map(|s| s.raised(by)).collect() }
    }
}

/// A piece of an outline; heights are along the tool's axis, from the tip.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Segment {
    /// A cylinder or a cone.
    Line {
        /// Lower height.
        from: f64,
        /// Upper height.
        to: f64,
        /// Radius at the lower height.
        radius_from: f64,
        /// Radius at the upper height.
        radius_to: f64,
    },
    /// A piece of a sphere or a torus: ρ(z) = centre_radius + √(arc_radius² − (z − centre_height)²).
    Arc {
        /// Lower height.
        from: f64,
        /// Upper height.
        to: f64,
        /// Height of the arc's centre.
        centre_height: f64,
        /// Distance of the arc's centre from the axis.
        centre_radius: f64,
        /// Radius of the arc.
        arc_radius: f64,
    },
}

impl Segment {
    /// A cylinder between two heights.
    #[must_use]
    pub fn cylinder(from: f64, to: f64, radius: f64) -> Self {
        Self::Line { from, to, radius_from: radius, radius_to: radius }
    }

    /// The end of a ball mill: half a ball that stands on the tip.
    #[must_use]
    pub fn ball_end(radius: f64) -> Self {
        Self::Arc { from: 0.0, to: radius, centre_height: radius, centre_radius: 0.0, arc_radius: radius }
    }

    /// Lower and upper height.
    #[must_use]
    pub fn range(&self) -> (f64, f64) {
        match *self {
            Self::Line { from, to, .. } | Self::Arc { from, to, .. } => (from, to),
        }
    }

    /// Radius ρ at a height; meaningful within the range.
    #[must_use]
    #[inline(always)]
    pub fn radius(&self, height: f64) -> f64 {
        match *self {
            Self::Line { from, to, radius_from, radius_to } => {
                if radius_from == radius_to {
                    radius_from
                } else {
                    radius_from + (radius_to - radius_from) * (height - from) / (to - from)
                }
            }
            Self::Arc { centre_height, centre_radius, arc_radius, .. } => {
                let rise = height - centre_height;
                centre_radius + (arc_radius * arc_radius - rise * rise).max(0.0).sqrt()
            }
        }
    }

    /// Its radii at its ends, where the smallest is; of an arc its own too.
    fn radii(&self) -> [f64; 3] {
        match *self {
            Self::Line { radius_from, radius_to, .. } => [radius_from, radius_to, radius_to],
            Self::Arc { from, to, arc_radius, .. } => [self.radius(from), self.radius(to), arc_radius],
        }
    }

    /// Largest radius within the range.
    #[must_use]
    pub fn max_radius(&self) -> f64 {
        let (from, to) = self.range();
        let ends = self.radius(from).max(self.radius(to));
        match *self {
            Self::Arc { centre_height, centre_radius, arc_radius, .. }
                if (from..=to).contains(&centre_height) =>
            {
                ends.max(centre_radius + arc_radius)
            }
            _ => ends,
        }
    }

    /// Heights between which its radius is no smaller.
    fn heights_of_radius(&self, least: f64) -> Option<[f64; 2]> {
        let (from, to) = self.range();
        let [low, high] = match *self {
            Self::Line { radius_from, radius_to, .. } => {
                let at = from + (to - from) * (least - radius_from) / (radius_to - radius_from);
                match (radius_from >= least, radius_to >= least) {
                    (true, true) => [from, to],
                    (true, false) => [from, at],
                    (false, true) => [at, to],
                    (false, false) => return None,
                }
            }
            Self::Arc { centre_height, centre_radius, arc_radius, .. } => {
                let across = (least - centre_radius).max(0.0);
                let half = (arc_radius * arc_radius - across * across).max(0.0).sqrt();
                [from.max(centre_height - half), to.min(centre_height + half)]
            }
        };
        (low <= high).then_some([low, high])
    }

    /// Volume of the body of revolution in cubic units.
    #[must_use]
    pub fn volume(&self) -> f64 {
        let (from, to) = self.range();
        match *self {
            Self::Line { radius_from: a, radius_to: b, .. } => {
                PI / 3.0 * (to - from) * (a * a + a * b + b * b)
            }
            Self::Arc { centre_height, centre_radius: c, arc_radius: r, .. } => {
                // ∫ (c + √(r² − t²))² dt = (c² + r²)·t − t³/3 + c·(t·√(r² − t²) + r²·asin(t/r))
                let antiderivative = |height: f64| {
                    let t = (height - centre_height).clamp(-r, r);
                    let root = (r * r - t * t).max(0.0).sqrt();
                    (c * c + r * r) * t - t.powi(3) / 3.0 + c * (t * root + r * r * (t / r).asin())
                };
                PI * (antiderivative(to) - antiderivative(from))
            }
        }
    }

    pub(crate) fn scaled(&self, factor: f64) -> Self {
        let mut scaled = *self;
        let scale = |length: &mut f64| *length *= factor;
        match &mut scaled {
            Self::Line { from, to, radius_from, radius_to } => {
                [from, to, radius_from, radius_to].into_iter().for_each(scale);
            }
            Self::Arc { from, to, centre_height, centre_radius, arc_radius } => {
                [from, to, centre_height, centre_radius, arc_radius].into_iter().for_each(scale);
            }
        }
        scaled
    }

    fn raised(&self, by: f64) -> Self {
        let mut raised = *self;
        match &mut raised {
            Self::Line { from, to, .. } => (*from, *to) = (*from + by, *to + by),
            Self::Arc { from, to, centre_height, .. } => {
                (*from, *to, *centre_height) = (*from + by, *to + by, *centre_height + by);
            }
        }
        raised
    }

    /// The piece of the segment between two heights.
    pub(super) fn between(&self, from: f64, to: f64) -> Self {
        match *self {
            Self::Line { .. } => {
                Self::Line { from, to, radius_from: self.radius(from), radius_to: self.radius(to) }
            }
            Self::Arc { centre_height, centre_radius, arc_radius, .. } => {
                Self::Arc { from, to, centre_height, centre_radius, arc_radius }
            }
        }
    }

    /// The part of the segment below `height`; `None` where nothing is left.
    pub(super) fn below(&self, height: f64) -> Option<Self> {
        let (from, to) = self.range();
        (from < height).then(|| self.between(from, to.min(height)))
    }
}

/// Sine of the minimum angle by which an outline turns at a sharp edge: 20°.
const SHARP: f64 = 0.342;

/// `count` points on a surface of revolution: the tip, and rings in the middle of even steps along the outline, or on its sharp edge
/// where a step has one, whose sizes follow their circumference.
pub(super) fn surface_points(profile: &[Segment], count: usize) -> Vec<DVec3> {
    let mut points = vec![DVec3::ZERO];
    let Some(end) = profile.last().map(|s| s.range().1).filter(|_| count > 1) else {
        return points;
    };
    // The outline as a fine polyline; heights with a step in radius keep both ends.
    let mut outline = vec![(0.0, 0.0)];
    for segment in profile {
        let (from, to) = segment.range();
        let heights = (0..=64).map(|i| from + (to.min(end) - from) * f64::from(i) / 64.0);
        outline.extend(heights.map(|z| (z, segment.radius(z))));
    }
    let lengths: Vec<f64> = outline.windows(2).map(|w| (w[1].0 - w[0].0).hypot(w[1].1 - w[0].1)).collect();
    let total: f64 = lengths.iter().sum();
    let rings = (((count - 1) as f64 / 4.0).sqrt().round() as usize).clamp(1, count - 1);
    // How far along the outline it turns outwards sharply, as at a flat end mill's corner.
    let steps = outline.windows(2).zip(&lengths).scan(0.0, |along, (ends, &length)| {
        let from = *along;
        *along += length;
        Some((from, DVec2::new(ends[1].0 - ends[0].0, ends[1].1 - ends[0].1), length))
    });
    let steps: Vec<(f64, DVec2, f64)> = steps.filter(|step| step.2 > 1e-9 * total).collect();
    let edges = steps.windows(2).filter_map(|pair| {
        let turn = pair[1].1.perp_dot(pair[0].1) / (pair[0].2 * pair[1].2);
        (turn > SHARP).then_some(pair[1].0)
    });
    let edges: Vec<f64> = edges.collect();
    let ring = |index: usize| {
        let step = total / rings as f64;
        let middle = step * (index as f64 + 0.5);
        let edge = edges.iter().copied().filter(|edge| (edge - middle).abs() <= 0.5 * step);
        let mut rest =
            edge.min_by(|a, b| (a - middle).abs().total_cmp(&(b - middle).abs())).unwrap_or(middle);
        for (step, &length) in lengths.iter().enumerate() {
            if rest <= length || step + 1 == lengths.len() {
                let fraction = if length > 0.0 { (rest / length).min(1.0) } else { 1.0 };
                let (low, high) = (outline[step], outline[step + 1]);
                let z = low.0 + (high.0 - low.0) * fraction;
                // Back onto the outline itself, not its polyline; a level step is its own outline.
                let on_outline =
                    profile.iter().find(|s| (s.range().0..=s.range().1).contains(&z) && high.0 > low.0);
                return (z, on_outline.map_or(low.1 + (high.1 - low.1) * fraction, |s| s.radius(z)));
            }
            rest -= length;
        }
        (end, 0.0)
    };
    let circles: Vec<(f64, f64)> = (0..rings).map(ring).collect();
    let circumference: f64 = circles.iter().map(|c| c.1).sum();
    let mut share = 0.0;
    let mut placed = 0;
    for (index, &(z, radius)) in circles.iter().enumerate() {
        share += radius / circumference;
        let until =
            if index + 1 == rings { count - 1 } else { ((count - 1) as f64 * share).round() as usize };
        let here = until.max(placed) - placed;
        points.extend((0..here).map(|i| {
            let (sine, cosine) = (TAU * i as f64 / here as f64).sin_cos();
            DVec3::new(radius * cosine, radius * sine, z)
        }));
        placed += here;
    }
    points
}

#[cfg(test)]
mod tests;
