//! Random paths of tilted tools through scattered stock, against a twin that tries every voxel at every pose.

use glam::DVec3;

use super::super::CheckBodies;
use super::tool::RING;
use super::*;
use crate::grid::Grid;
use crate::orientation::OrientationSet;
use crate::pose::Pose;
use crate::section::test_shapes::{arc, line, revolved};
use crate::tool::{Clearance, Element, ElementKind, Segment, contains, snapped};
use crate::unit::LengthUnit;

/// What the twin says of an element on a line: its poses, and the largest depth of all of them.
#[derive(Debug)]
struct Hit {
    line: usize,
    element: String,
    poses: u64,
    depth: f64,
}

struct Twin<'a> {
    grid: Grid,
    part: &'a Occupancy,
    solid: Vec<u8>,
    settings: CheckSettings,
    removed_by: Vec<u32>,
    hits: Vec<Hit>,
}

impl Twin<'_> {
    /// Voxels, heights and radii of the stock in an element.
    fn inside(&self, element: &Element, pose: &Pose) -> Vec<(usize, f64, f64)> {
        let (tip, axis, pitch) = (snapped(&self.grid, pose.position), pose.axis().unwrap(), self.grid.pitch);
        let held = (0..self.grid.len()).filter(|&v| self.solid[v] == 1);
        held.filter_map(|v| {
            let offset = (DVec3::from_array(self.grid.voxel(v).map(|v| v as f64)) - tip) * pitch;
            let height = offset.dot(axis);
            let radius = (offset.length_squared() - height * height).max(0.0).sqrt();
            contains(&element.profile, axis, offset, pitch).then_some((v, height, radius))
        })
        .collect()
    }

    fn note(&mut self, line: usize, element: &Element, touching: &[(usize, f64, f64)], exposed: bool) {
        let depths = touching.iter().map(|&(_, h, r)| element.depth(h, r, exposed) + 0.5 * self.grid.pitch);
        let Some(depth) = depths.reduce(f64::max) else { return };
        let name = element.kind.to_string();
        match self.hits.iter_mut().find(|hit| hit.line == line && hit.element == name) {
            Some(hit) => (hit.poses, hit.depth) = (hit.poses + 1, hit.depth.max(depth)),
            None => self.hits.push(Hit { line, element: name, poses: 1, depth }),
        }
    }

    fn beside_part(&self, mut inside: Vec<(usize, f64, f64)>) -> Vec<(usize, f64, f64)> {
        inside.retain(|&(v, ..)| self.part.solid[v] == 0);
        inside
    }

    /// Nothing goes: true where it touches.
    fn rapid(&mut self, tool: &Tool, motion: &Motion<'_>, line: usize) -> bool {
        let (cutter, exposed) = tool.cutter().unwrap();
        let before = self.hits.len();
        for (_, pose) in motion.poses() {
            let deep = cutter.eroded(self.settings.accepted_in_stock(), exposed).unwrap();
            let touching = self.beside_part(self.inside(&deep, &pose));
            self.note(line, &cutter, &touching, exposed);
        }
        self.hits.len() > before
    }

    fn cut(&mut self, tool: &Tool, motion: &Motion<'_>, line: usize) {
        let (cutter, exposed) = tool.cutter().unwrap();
        let deep = cutter.eroded(self.settings.contact, exposed).unwrap();
        let accepted = self.settings.accepted_in_stock();
        let take = |twin: &mut Self, pose: &Pose| {
            let cut = twin.beside_part(twin.inside(&cutter, pose));
            for (voxel, ..) in cut.into_iter().chain(twin.inside(&deep, pose)) {
                twin.solid[voxel] = 0;
                twin.removed_by[voxel] = line as u32;
            }
        };
        for (step, pose) in motion.poses() {
            let between = motion.poses_between(&step, cutter.widest_length(RING * self.grid.pitch));
            between.for_each(|pose| take(self, &pose));
            for element in tool.offset_elements(&self.settings.clearance).unwrap() {
                if element.kind == ElementKind::Cutter {
                    continue;
                }
                let mut touching = self.beside_part(self.inside(&element, &pose));
                if element.kind == ElementKind::Shank && self.settings.clearance.shank == 0.0 {
                    let flank = cutter.max_radius();
                    touching.retain(|&(.., r)| r <= flank - accepted || r > flank + self.settings.contact);
                }
                self.note(line, &element, &touching, true);
            }
            take(self, &pose);
        }
    }
}

fn tools() -> [Tool; 4] {
    let shank_and_holder = |radius: f64| {
        let holder = vec![line(8.0, 10.0, 2.0, 3.5), line(10.0, 14.0, 3.5, 3.5)];
        [(ElementKind::Shank, vec![line(4.0, 8.0, radius, radius)]), (ElementKind::Holder(0), holder)]
    };
    let with = |profile: Vec<Segment>, shank: f64| {
        revolved([(ElementKind::Cutter, profile)].into_iter().chain(shank_and_holder(shank)))
    };
    [
        with(vec![line(0.0, 4.0, 1.6, 1.6)], 1.6),
        with(vec![arc(0.0, 1.2, 1.2, 0.0, 1.2), line(1.2, 4.0, 1.2, 1.2)], 1.5),
        with(vec![arc(0.0, 0.5, 0.5, 1.0, 0.5), line(0.5, 4.0, 1.5, 2.0)], 1.9),
        // A cone up to the shank, which moves between two poses by more than its rim is thick.
        with(vec![line(0.0, 3.0, 1.0, 1.0), line(3.0, 4.0, 1.0, 2.5)], 2.5),
    ]
}

#[test]
fn what_goes_and_what_touches_is_that_of_trying_every_voxel_at_every_pose() {
    let grid = Grid { origin: DVec3::new(-1.0, 0.5, -0.3), pitch: 0.5, dims: [26, 22, 21] };
    let stock = Occupancy::of(grid, |[x, y, z]| z < 14 && (x + 2 * y + 3 * z) % 11 != 0);
    let mut part = stock.clone();
    (0..grid.len()).filter(|&v| grid.voxel(v)[2] > 4).for_each(|v| part.solid[v] = 0);
    let (mut spared, mut elements) = (0, Vec::new());
    for (case, tool) in tools().iter().enumerate() {
        for (seed, room) in [(1, 0.0), (2, 0.0), (3, 0.4)] {
            let clearance = Clearance { holder: room, shank: room, cutter: 0.0 };
            let settings = CheckSettings { clearance, ..CheckSettings::of_pitch(grid.pitch, LengthUnit::Mm) };
            // Every third motion is a rapid; axes lean by up to 60°.
            let set = OrientationSet::parse(&format!("cone:0,0,1:60:9+random:3:{seed}")).unwrap();
            let mut text = String::new();
            for (index, orientation) in set.orientations.iter().enumerate() {
                let place = |step: f64| ((index + 7 * seed) as f64 * step).fract();
                let tip = grid.origin
                    + grid.size() * DVec3::new(place(0.618), place(0.755), 0.2 + 0.6 * place(0.57));
                let d = if index % 4 == 3 { DVec3::Z } else { orientation.direction() };
                let rapid = if index % 3 == 2 { "RAPID\n" } else { "" };
                text += &format!(
                    "{rapid}GOTO/{:.9},{:.9},{:.9},{:.9},{:.9},{:.9}\n",
                    tip.x, tip.y, tip.z, d.x, d.y, d.z
                );
            }
            let path = Toolpath::parse(&text, LengthUnit::Mm, "path").unwrap();
            let bodies = CheckBodies::of_part(&part);
            let given = [(None, tool)];
            let report = check_stock(bodies, &stock, &given, &path, &settings, Control::quiet()).unwrap();

            let motions = motions(&path, &given, &settings, None).unwrap();
            let mut twin = Twin {
                grid,
                part: &part,
                solid: stock.solid.clone(),
                settings,
                removed_by: vec![0; grid.len()],
                hits: Vec::new(),
            };
            let mut waiting = Vec::new();
            for (motion, location) in motions.iter().zip(&path.locations) {
                let line = location.line;
                if location.kind != MoveKind::Rapid {
                    waiting.drain(..).for_each(|(motion, line)| twin.cut(tool, motion, line));
                }
                waiting.push((motion, line));
                let touches = location.kind != MoveKind::Feed && twin.rapid(tool, motion, line);
                if touches || location.kind == MoveKind::Feed {
                    waiting.drain(..).for_each(|(motion, line)| twin.cut(tool, motion, line));
                }
            }
            waiting.drain(..).for_each(|(motion, line)| twin.cut(tool, motion, line));

            assert!(report.removed_by == twin.removed_by, "{case} {seed}");
            assert_eq!(report.remaining.solid, twin.solid);
            let of_part = |line: usize| {
                let own = (0..grid.len()).filter(|&v| twin.removed_by[v] == line as u32);
                own.fold((0, 0), |(all, part_of), v| (all + 1, part_of + u64::from(part.solid[v])))
            };
            for line in &report.removed {
                assert_eq!((line.voxels, line.of_part), of_part(line.line), "{case} {seed} {line:?}");
                spared += usize::from(line.voxels == 0);
            }
            let found =
                report.colliding.iter().flat_map(|l| l.collisions.iter().map(move |hit| (l.line, hit)));
            let found: Vec<_> = found.collect();
            assert_eq!(found.len(), twin.hits.len(), "{case} {seed} {found:?} {:?}", twin.hits);
            for hit in &twin.hits {
                let own = found.iter().find(|(line, own)| *line == hit.line && own.element == hit.element);
                let (_, own) = own.unwrap_or_else(|| panic!("{case} {seed} {hit:?}"));
                assert_eq!(own.poses, hit.poses, "{case} {seed} {hit:?}");
                // Depths are sampled every half a pitch.
                let short = hit.depth - own.depth;
                assert!((-1e-9..=0.5 * grid.pitch + 1e-9).contains(&short), "{case} {seed} {hit:?} {own:?}");
                elements.push(hit.element.clone());
            }
        }
    }
    let count = |name: &str| elements.iter().filter(|own| *own == name).count();
    let counts = ["cutter", "shank", "holder 1"].map(count);
    assert!(counts.iter().all(|&n| n > 5), "{counts:?} {spared}");
}
