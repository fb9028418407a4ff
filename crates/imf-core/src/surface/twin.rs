//! The fast contact path against its definition: at every contact pose every solid voxel centre, and every point of the surfaces, against
//! every element.

use std::sync::Arc;

use glam::{DMat4, DQuat, DVec3};

use super::closed_forms::solids::{ball, extruded, flat, tapered, tool};
use super::contact::ContactFrame;
use super::sample_query::TOUCH;
use super::*;
use crate::control::Control;
use crate::grid::Grid;
use crate::mesh::{Mesh, points_at_pitch};
use crate::orientation::Orientation;
use crate::section::test_shapes::{arc, line};
use crate::tool::{Clearance, Tool, contains};
use crate::voxelize::voxelize;

/// Numbers in [0, 1).
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 33) as f64 / (1u64 << 31) as f64
    }

    fn vector(&mut self, from: f64, to: f64) -> DVec3 {
        DVec3::from_array([0; 3].map(|_| from + (to - from) * self.next()))
    }

    fn rotation(&mut self) -> DQuat {
        let [a, b, c, d] = [0; 4].map(|_| self.next() - 0.5);
        DQuat::from_xyzw(a, b, c, d).normalize()
    }

    /// Some boxes, turned, that may cross each other.
    fn boxes(&mut self, count: usize, within: [f64; 2]) -> Mesh {
        let mut all = Mesh::default();
        let unit = extruded(&[[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]], 1.0);
        for _ in 0..count {
            let (size, at) = (self.vector(3.0, 12.0), self.vector(within[0], within[1]));
            let place = DMat4::from_scale_rotation_translation(size, self.rotation(), at);
            all.append(&unit.transformed(&place));
        }
        all
    }
}

/// Part and fixtures as points, and a tool as elements: what the fast path has prepared.
struct Definition {
    bodies: Vec<Vec<DVec3>>,
    /// Points of their surfaces.
    surfaces: Vec<Vec<DVec3>>,
    outline: Outline,
    tolerance: f64,
    /// What lies deeper than the tolerance in the cutter.
    cutter: Element,
    /// The same of fixtures.
    at_fixtures: Element,
    /// Shank and holder, offset.
    rest: Vec<Element>,
    slack: f64,
    pitch: f64,
    /// Height of the cutter's upper end.
    end: f64,
    /// A shank without a clearance holds centres as deep as points.
    shank_touches: bool,
}

impl Definition {
    /// Whether it holds a centre of the body, or a point of its surface, deeper than `contact` if that is given.
    fn any(&self, body: usize, element: &Element, contact: Option<f64>, tip: DVec3, axis: DVec3) -> bool {
        let touches = self.shank_touches && element.kind == ElementKind::Shank;
        let held = |&&point: &&DVec3| contains(&element.profile, axis, point - tip, self.slack);
        let deep = |point: &DVec3| {
            let height = (point - tip).dot(axis);
            let away = (point - tip - axis * height).length();
            contact.is_none_or(|contact| element.depth(height, away, true) > contact)
        };
        self.bodies[body].iter().filter(held).any(|centre| !touches || deep(centre))
            || self.surfaces[body].iter().filter(held).any(deep)
    }

    /// What collides with what, from the tip upwards.
    fn hits(&self, tip: DVec3, axis: DVec3) -> Vec<(ElementKind, usize)> {
        let all = 0..self.bodies.len();
        let cutter = all.clone().skip(1).filter(|&body| self.any(body, &self.at_fixtures, None, tip, axis));
        let mut hits: Vec<_> = cutter.map(|body| (ElementKind::Cutter, body)).collect();
        for element in &self.rest {
            let contact = if element.kind == ElementKind::Shank { self.tolerance } else { 0.0 };
            let bodies = all.clone().filter(|&body| self.any(body, element, Some(contact), tip, axis));
            hits.extend(bodies.map(|body| (element.kind, body)));
        }
        hits
    }

    /// Whether a voxel of the part holds a point of the axis above the cutter.
    fn is_held_by_part(&self, tip: DVec3, axis: DVec3) -> bool {
        (0..400).map(|step| tip + axis * (self.end + 0.5 * self.pitch * f64::from(step))).any(|place| {
            self.bodies[0].iter().any(|centre| (*centre - place).abs().max_element() <= 0.5 * self.pitch)
        })
    }

    /// The best of the contact poses of a direction, with what collides there; `None` where a level ring touches, whose poses are
    /// searched for.
    fn outcome(&self, sample: &SurfaceSample, axis: DVec3) -> Option<(Outcome, Vec<(ElementKind, usize)>)> {
        let mut best = (Outcome::NoContact, Vec::new());
        let highest = self.outline.highest(self.tolerance);
        let Some(frame) = ContactFrame::new(sample.normal, axis, highest) else { return Some(best) };
        let mut touches = Vec::new();
        self.outline.touches(frame.slope, self.tolerance, |touch| touches.push(touch));
        for touch in touches {
            let contact::Touch::Point { height, radius, hangs } = touch else { return None };
            let at = |tip: DVec3| {
                let cutter = &self.cutter;
                if self.any(0, cutter, None, tip, axis) {
                    return (Outcome::Gouged, Vec::new());
                }
                match self.hits(tip, axis) {
                    hits if hits.is_empty() => (Outcome::Good(tip), hits),
                    hits => (Outcome::Obstructed(tip), hits),
                }
            };
            let tip = frame.tip(sample.point, height, radius);
            let mut found = at(tip);
            if matches!(found.0, Outcome::Obstructed(_)) {
                let off = at(tip + sample.normal * (TOUCH * self.tolerance));
                found = if off.0.is_good() { off } else { found };
            }
            if matches!(found.0, Outcome::Obstructed(_)) && hangs && self.is_held_by_part(tip, axis) {
                found = (Outcome::Gouged, Vec::new());
            }
            if found.0.verdict() < best.0.verdict() {
                best = found;
            }
        }
        Some(best)
    }
}

#[test]
fn verdicts_are_those_of_every_voxel_against_every_element() {
    let bull = arc(0.0, 1.0, 1.0, 1.5, 1.0);
    let tools = [
        ball(1.5),
        flat(2.0),
        tapered(0.8, 12.0, 12.0),
        tool(vec![bull, line(1.0, 9.0, 2.5, 2.5)], 2.0),
        // A slot cutter, and one with a step.
        Tool { back_cutting: true, ..tool(vec![line(0.0, 2.5, 3.0, 3.0)], 1.2) },
        tool(vec![line(0.0, 4.0, 1.0, 1.0), line(4.0, 9.0, 2.2, 2.2)], 2.2),
    ];
    let (mut seen, mut searched) = ([0; 4], 0);
    for (seed, tool) in (0..3).flat_map(|seed| tools.iter().map(move |tool| (seed, tool))) {
        let mut random = Random(0x5eed + 977 * seed);
        let pitch = 0.7 + 0.4 * random.next();
        let (part, clamp) = (random.boxes(3, [2.0, 14.0]), random.boxes(1, [14.0, 20.0]));
        let (low, high) = (DVec3::splat(-8.0), DVec3::splat(30.0));
        let grid = Grid::with_pitch(low, high, pitch, 0).unwrap();
        let solids = [&part, &clamp].map(|mesh| Arc::new(voxelize(mesh, &grid, false)));
        let samples = SurfaceSamples::new(&part, &solids[0], 100).samples;
        let directions: Vec<Orientation> =
            (0..20).filter_map(|_| Orientation::from_direction(random.vector(-1.0, 1.0))).collect();
        // Without one a shank touches what the cutter does.
        let shank = if seed == 0 { 0.0 } else { 0.3 * random.next() };
        let clearance = Clearance { holder: random.next(), shank, cutter: 0.0 };
        let tolerance = default_tolerance(pitch, LengthUnit::Mm);

        let outline = Outline::of(tool).unwrap();
        let shoulder = outline.shoulder;
        let at = |depth: f64| tool.cutter().unwrap().0.eroded(depth, shoulder).unwrap();
        let offset = tool.offset_elements(&clearance).unwrap();
        let definition = Definition {
            bodies: solids.iter().map(|solid| solid.centres().collect()).collect(),
            surfaces: [&part, &clamp].map(|mesh| points_at_pitch(mesh, pitch).0).to_vec(),
            outline,
            tolerance,
            cutter: at(tolerance),
            at_fixtures: at(TOUCH * tolerance),
            rest: offset.into_iter().filter(|e| e.kind != ElementKind::Cutter).collect(),
            slack: crate::tool::SLACK * pitch * pitch,
            pitch,
            end: tool.cutter().unwrap().0.profile.last().unwrap().range().1,
            shank_touches: shank == 0.0,
        };
        let [body, fixture] = solids;
        let environment = CollisionEnvironment::new(&body.into(), &[fixture]).with_surfaces(&[&part, &clamp]);
        let assembly = Tool::offset(tool, &clearance).unwrap();
        let fast = SurfaceTool::new(&environment, &assembly, tolerance).unwrap();
        let found = surface_access(&fast, &samples, &directions, Control::quiet()).unwrap();

        let axes: Vec<DVec3> =
            directions.iter().map(|direction| ToolDirection::new(direction).axis).collect();
        for (index, sample) in samples.iter().enumerate() {
            assert_eq!(sample.bend, 0.0, "a box has flat faces");
            let outcomes = axes.iter().map(|&axis| definition.outcome(sample, axis));
            let Some(outcomes) = outcomes.collect::<Option<Vec<_>>>() else {
                searched += 1;
                continue;
            };
            for (direction, (outcome, _)) in outcomes.iter().enumerate() {
                let free = found.is_free(index, direction);
                assert_eq!(free, outcome.is_good(), "{seed} {index} {direction}: {outcome:?}");
            }
            let reached = outcomes.iter().filter(|(outcome, _)| outcome.is_good()).count();
            let frame = |direction: usize| sample.normal.dot(axes[direction]);
            let obstructed = (0..axes.len()).filter(|&d| matches!(outcomes[d].0, Outcome::Obstructed(_)));
            let nearest = obstructed.max_by(|&a, &b| frame(a).total_cmp(&frame(b)));
            let gouged = outcomes.iter().any(|(outcome, _)| *outcome == Outcome::Gouged);
            match (found.reach[index], nearest) {
                (SampleReach::Reached { directions }, _) => {
                    assert_eq!(directions as usize, reached);
                    seen[0] += 1;
                }
                (SampleReach::Obstructed { direction, hits }, Some(nearest)) => {
                    assert_eq!((reached, direction as usize), (0, nearest));
                    assert_eq!(fast.hits(hits).collect::<Vec<_>>(), outcomes[nearest].1);
                    seen[1] += 1;
                }
                (SampleReach::Gouged, None) => {
                    assert!(reached == 0 && gouged);
                    seen[2] += 1;
                }
                (SampleReach::NotFaced, None) => {
                    assert!(reached == 0 && !gouged);
                    seen[3] += 1;
                }
                (other, nearest) => panic!("{seed} {index}: {other:?}, {nearest:?}"),
            }
        }
    }
    // Every verdict is met, and hardly any sample is left out.
    assert!(seen[..3].iter().all(|&n| n > 20), "{seen:?}");
    assert!(searched * 20 < seen.iter().sum::<usize>(), "{searched} of {seen:?}");
}
