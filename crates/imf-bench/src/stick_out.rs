//! `imf-bench stick-out`: the least stick-outs of a surface, held against exact counts, and a crib of tools decided together
//! beside the same tools one by one.

use std::sync::Arc;

use anyhow::{Result, ensure};
use imf_cli::output::prepare_folder;
use imf_cli::session::Session;
use imf_core::control::Control;
use imf_core::occupancy::Occupancy;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::surface::{
    CollisionEnvironment, StickOut, StickOutTool, SurfaceSample, SurfaceSamples, SurfaceTool, crib_access,
    default_tolerance, least_stick_outs, surface_access,
};
use imf_core::tool::{Assembly, Clearance, Element, ElementKind, Segment, SharpPoints, Tool, ToolShape};
use imf_core::unit::LengthUnit;
use rand::SeedableRng as _;
use rand::seq::SliceRandom as _;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use serde::Serialize;

use crate::arguments::stick_out::StickOutArguments;
use crate::candidates::reference_scene;
use crate::document::Document;
use crate::measurement::{Machine, seconds};

/// Threads that the figures are for.
const THREADS: usize = 2;
/// Around shank and holder, in millimetres.
const CLEARANCE: f64 = 0.5;

#[derive(Serialize)]
struct Report {
    machine: Machine,
    scene: String,
    points: usize,
    directions: usize,
    /// The best of all directions for every point.
    best_seconds: f64,
    /// One direction for every point, in the mean of a few.
    one_direction_seconds: f64,
    /// Share of the points that are reached at some length, at the length that the tool is set to, and what they need at most.
    reached: f64,
    reached_as_set: f64,
    largest: f64,
    checks: Checks,
    crib: Crib,
}

/// Answers for one point and one direction, by exact counts.
#[derive(Default, Serialize)]
struct Checks {
    answers: usize,
    /// Not free at the answer.
    optimistic: usize,
    /// Longer than the shortest by a voxel at least: what is one voxel shorter is a tool too.
    longer: usize,
    /// Of these, free one voxel shorter.
    pessimistic: usize,
}

#[derive(Serialize)]
struct Crib {
    tools: usize,
    cutters: usize,
    seconds: f64,
    alone: usize,
    /// One tool by itself, in the mean.
    one_seconds: f64,
    /// Verdicts of a tool alone that are others together.
    different: usize,
}

struct Asked {
    pool: ThreadPool,
    samples: Vec<SurfaceSample>,
    directions: Vec<Orientation>,
    solid: Arc<Occupancy>,
    surroundings: CollisionEnvironment,
    tolerance: f64,
}

pub(crate) fn run(session: &Session, arguments: &StickOutArguments) -> Result<()> {
    prepare_folder(&arguments.out)?;
    let mut machine = Machine::new(THREADS);
    let scene = reference_scene(arguments.part, 1.0)?;
    let grid = scene.record.grid;
    let solid = Arc::new(scene.obstacle.clone());
    let mesh = arguments.part.mesh().transformed(&scene.record.transform);
    let mut random = ChaCha8Rng::seed_from_u64(arguments.seed);
    let points = arguments.points as usize;
    let mut samples = SurfaceSamples::new(&mesh, &solid, points).samples;
    ensure!(samples.len() >= points, "the surface has only {} samples", samples.len());
    samples.shuffle(&mut random);
    samples.truncate(points);
    let asked = Asked {
        pool: ThreadPoolBuilder::new().num_threads(THREADS).build()?,
        samples,
        directions: OrientationSet::parse(&format!("fibonacci:{}", arguments.directions))?.orientations,
        surroundings: CollisionEnvironment::new(&solid.clone().into(), &[]),
        solid,
        tolerance: default_tolerance(grid.pitch, LengthUnit::Mm),
    };
    session.note("least stick-outs");
    let assembly = mill(End::Ball, 3.0, 20.0, 30.0, 12.0).offset(&clearance())?;
    let tool = StickOutTool::new(&asked.surroundings, &assembly, asked.tolerance)?;
    let (best_seconds, best) = seconds(|| asked.least(&tool, &asked.samples, &asked.directions))?;
    let few = &asked.directions[..asked.directions.len().min(10)];
    let (few_seconds, ()) = seconds(|| {
        few.iter().try_for_each(|&direction| asked.least(&tool, &asked.samples, &[direction]).map(drop))
    })?;
    let share =
        |most: f64| best.iter().filter(|found| found.length() <= most).count() as f64 / best.len() as f64;
    let longest = best.iter().map(StickOut::length).filter(|length| length.is_finite()).fold(0.0, f64::max);
    session.note("exact counts");
    let checks = asked.check(&tool, &assembly, arguments.checks as usize)?;
    session.note("the crib");
    let crib = asked.crib(arguments, &mut random)?;
    machine.finish();
    let [x, y, z] = grid.dims;
    let report = Report {
        machine,
        scene: format!(
            "{} {x}×{y}×{z}, pitch {:.3} mm, ball end mill of 6 mm with shank of 6 and holder of 24 mm, clearance {CLEARANCE} mm, {} \
             points, fibonacci:{}, tolerance {:.3} mm",
            scene.record.part,
            grid.pitch,
            asked.samples.len(),
            asked.directions.len(),
            asked.tolerance
        ),
        points: asked.samples.len(),
        directions: asked.directions.len(),
        best_seconds,
        one_direction_seconds: few_seconds / few.len() as f64,
        reached: share(f64::MAX),
        reached_as_set: share(tool.given()),
        largest: longest,
        checks,
        crib,
    };
    let document = report.document();
    document.write(&arguments.out, "stick-out", &report)?;
    document.show(session, &report)
}

impl Asked {
    fn least(
        &self,
        tool: &StickOutTool,
        samples: &[SurfaceSample],
        directions: &[Orientation],
    ) -> Result<Vec<StickOut>> {
        Ok(self.pool.install(|| least_stick_outs(tool, samples, directions, Control::quiet()))?)
    }

    /// At random points, the same number in every direction.
    fn check(&self, tool: &StickOutTool, assembly: &Assembly, checks: usize) -> Result<Checks> {
        let each = checks.div_ceil(self.directions.len());
        let pitch = self.solid.grid.pitch;
        let mut all = Checks::default();
        for (index, &direction) in self.directions.iter().enumerate() {
            // As many as have surely enough answers among them; the samples are in random order.
            let first = index * 8 * each % self.samples.len();
            let samples: Vec<SurfaceSample> =
                self.samples[first..].iter().chain(&self.samples).take(8 * each).copied().collect();
            let found = self.least(tool, &samples, &[direction])?;
            let answers = found.iter().filter_map(|found| match found {
                StickOut::Reached { length, tip, .. } => Some((*length, *tip)),
                _ => None,
            });
            let answers: Vec<_> = answers.take(each.min(checks - all.answers)).collect();
            let free = |length: f64, tip| {
                let set = assembly.tool().with_stick_out(length)?;
                let set = set.offset(assembly.clearance()).ok()?;
                Some(set.noncutting()?.count_inside(&self.solid, tip, &direction) == 0)
            };
            let verdicts: Vec<_> = self.pool.install(|| {
                let verdict = |&(length, tip): &(f64, _)| {
                    let below = length - pitch;
                    (free(length, tip), (below >= tool.shortest()).then(|| free(below, tip)))
                };
                answers.par_iter().map(verdict).collect()
            });
            for (at, below) in verdicts {
                all.answers += 1;
                all.optimistic += usize::from(at != Some(true));
                all.longer += usize::from(below.is_some());
                all.pessimistic += usize::from(below.is_some_and(|below| below != Some(false)));
            }
        }
        Ok(all)
    }

    fn crib(&self, arguments: &StickOutArguments, random: &mut ChaCha8Rng) -> Result<Crib> {
        let (cutters, tools) = crib(arguments.tools as usize);
        let make = |tool: &Tool| -> Result<SurfaceTool> {
            Ok(SurfaceTool::new(&self.surroundings, &tool.offset(&clearance())?, self.tolerance)?)
        };
        let (seconds_together, together) = seconds(|| {
            let tools = tools.iter().map(make).collect::<Result<Vec<_>>>()?;
            Ok(self
                .pool
                .install(|| crib_access(&tools, &self.samples, &self.directions, Control::quiet()))?)
        })?;
        let mut chosen: Vec<usize> = (0..tools.len()).collect();
        chosen.shuffle(random);
        chosen.truncate(arguments.alone as usize);
        let (seconds_alone, different) = seconds(|| {
            let mut different = 0;
            for &index in &chosen {
                let tool = make(&tools[index])?;
                let access = self
                    .pool
                    .install(|| surface_access(&tool, &self.samples, &self.directions, Control::quiet()))?;
                let verdicts = access.reach.iter().zip(&together[index]);
                different += verdicts.filter(|(reach, verdict)| reach.verdict() != **verdict).count();
            }
            Ok(different)
        })?;
        Ok(Crib {
            tools: tools.len(),
            cutters,
            seconds: seconds_together,
            alone: chosen.len(),
            one_seconds: seconds_alone / chosen.len() as f64,
            different,
        })
    }
}

fn clearance() -> Clearance {
    Clearance::around_holder_and_shank(CLEARANCE)
}

/// The end of a cutter.
#[derive(Clone, Copy)]
enum End {
    Ball,
    Flat,
    /// With a corner of a fifth of the radius.
    Bull,
}

/// A plain mill in a plain holder of 40 mm.
fn mill(end: End, radius: f64, flutes: f64, stick_out: f64, holder: f64) -> Tool {
    let line = |from, to, radius| Segment::Line { from, to, radius_from: radius, radius_to: radius };
    let corner = match end {
        End::Ball => radius,
        End::Flat => 0.0,
        End::Bull => 0.2 * radius,
    };
    let arc = Segment::Arc {
        from: 0.0,
        to: corner,
        centre_height: corner,
        centre_radius: radius - corner,
        arc_radius: corner,
    };
    let cutter = (corner > 0.0).then_some(arc).into_iter().chain([line(corner, flutes, radius)]).collect();
    let element = |kind, profile| Element { kind, profile };
    Tool {
        name: format!("{}", 2.0 * radius),
        unit: LengthUnit::Mm,
        shape: ToolShape::Revolved(vec![
            element(ElementKind::Cutter, cutter),
            element(ElementKind::Shank, vec![line(flutes, stick_out, radius)]),
            element(ElementKind::Holder(0), vec![line(stick_out, stick_out + 40.0, holder)]),
        ]),
        sharp_points: SharpPoints::Tip,
        overall_length: None,
    }
}

/// So many tools, and the number of their cutters: ten diameters, three ends and two lengths of the flutes, each in holders
/// of six diameters at several stick-outs.
fn crib(count: usize) -> (usize, Vec<Tool>) {
    let diameters = [4.0, 5.0, 6.0, 8.0, 10.0, 12.0, 14.0, 16.0, 18.0, 20.0];
    let ends = [End::Ball, End::Flat, End::Bull];
    let cutters: Vec<(End, f64, f64)> = diameters
        .into_iter()
        .flat_map(|diameter| ends.into_iter().map(move |end| (end, 0.5 * diameter)))
        .flat_map(|(end, radius)| [5.0, 8.0].map(|length| (end, radius, length * radius)))
        .collect();
    let tools: Vec<Tool> = (0..count)
        .map(|index| {
            let (end, radius, flutes) = cutters[index % cutters.len()];
            let set = index / cutters.len();
            let (holder, step) = (radius + 4.0 + 3.0 * (set % 6) as f64, set / 6);
            mill(end, radius, flutes, flutes + 5.0 + 12.0 * step as f64, holder)
        })
        .collect();
    (cutters.len().min(count), tools)
}

impl Report {
    fn document(&self) -> Document {
        let mut document = Document::new("Stick-out and crib");
        document.paragraph(format!("{}\n{}", self.scene, self.machine));
        document.section("Least stick-outs");
        let row = |name: &str, value: String| vec![name.to_owned(), value];
        let Checks { answers, optimistic, longer, pessimistic } = self.checks;
        document.table(
            &["", ""],
            vec![
                row("the best of all directions for every point", format!("{:.2} s", self.best_seconds)),
                row("one direction for every point", format!("{:.4} s", self.one_direction_seconds)),
                row("reached at some length", format!("{:.1} % of the points", 100.0 * self.reached)),
                row("reached as the tool is set", format!("{:.1} %", 100.0 * self.reached_as_set)),
                row("needed at most", format!("{:.1} mm", self.largest)),
                row("answers checked", answers.to_string()),
                row("not free at the answer", optimistic.to_string()),
                row("a voxel longer than the shortest", longer.to_string()),
                row("of these free one voxel shorter", pessimistic.to_string()),
            ],
        );
        document.section("Crib");
        let Crib { tools, cutters, seconds, alone, one_seconds, different } = self.crib;
        document.table(
            &["", ""],
            vec![
                row("tools, of so many cutters", format!("{tools}, {cutters}")),
                row("all together", format!("{seconds:.2} s")),
                row("one by itself, in the mean", format!("{one_seconds:.3} s of {alone}")),
                row("together, in times of one", format!("{:.1}", seconds / one_seconds)),
                row("verdicts that differ", different.to_string()),
            ],
        );
        document
    }
}
