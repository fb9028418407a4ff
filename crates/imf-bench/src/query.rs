//! `imf-bench query`: poses a second on one core, and the quality of each result.

mod change;
mod libraries;

use std::path::PathBuf;

use anyhow::{Context as _, Result, ensure};
use clap::Args;
use glam::DVec3;
use imf_cli::output::prepare_folder;
use imf_cli::session::Session;
use imf_core::field::{Decision, ExactField, Gradient, PoseField};
use imf_core::grid::Grid;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::parts::ReferencePart;
use imf_core::pose::Pose;
use imf_core::section::Quantity;
use imf_fields::field::{Field, Planner};
use imf_fields::file::FieldFile;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

use crate::candidates::reference_scene;
use crate::document::Document;
use crate::measurement::{Machine, ROUNDS, seconds};

/// Answers a second at random poses, one core: exact, verified and learnt fields beside mesh collision libraries
#[derive(Args)]
#[command(after_help = "Examples:\n  imf-bench query --part teapot\n  \
                        imf-bench query bracket.safetensors small/field.safetensors --python venv/bin/python\n\n\
                        The fields are of one scene. Where its part is built in, parry3d, Coal and FCL answer for \
                        collisions of the same tool and part as meshes at the same poses, and vamp-planner for those of balls \
                        around the tool with the centres of the part's voxels. Writes query.json and query.md.")]
pub(crate) struct QueryArguments {
    /// Fields of one scene: models, harmonic or factored fields; without any the exact field alone is measured
    fields: Vec<PathBuf>,
    /// Reference part at its full resolution, where no field is given
    #[arg(long, default_value = "teapot", conflicts_with = "fields", value_name = "PART")]
    part: ReferencePart,
    /// Folder to write to
    #[arg(long, default_value = "imf-bench", value_name = "DIR")]
    out: PathBuf,
    /// Random poses for ours
    #[arg(long, default_value_t = 20_000, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    poses: u32,
    /// How many of them the libraries get
    #[arg(long, default_value_t = 2_000, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    rival_poses: u32,
    /// Python with coal, python-fcl, vamp-planner and numpy (crates/imf-bench/python/requirements-query.txt)
    #[arg(long, default_value = "python3", value_name = "COMMAND")]
    python: String,
    /// Program for parry3d: cargo build --release --manifest-path crates/imf-bench/parry3d/Cargo.toml
    #[arg(
        long,
        default_value = "crates/imf-bench/parry3d/target/release/parry3d-rival",
        value_name = "COMMAND"
    )]
    parry3d: String,
}

/// Poses in a call of what takes batches.
const BATCH: usize = 1000;

/// One way to know about poses.
#[derive(Serialize)]
struct Row {
    name: String,
    /// What a result is.
    answers: String,
    poses: usize,
    /// Poses in a call.
    batch: usize,
    poses_per_second: f64,
    /// Fraction of the poses called free, and called colliding.
    free: Option<f64>,
    colliding: Option<f64>,
    /// Fraction of the decided poses where the decision is the exact one for the true tool.
    agree: Option<f64>,
    how: String,
}

#[derive(Serialize)]
struct Report {
    machine: Machine,
    scene: String,
    rows: Vec<Row>,
    changes: Vec<change::ChangeRow>,
    /// Why a library is missing.
    missing: Vec<String>,
}

pub(crate) fn run(session: &Session, arguments: &QueryArguments) -> Result<()> {
    prepare_folder(&arguments.out)?;
    let mut machine = Machine::new(1);
    let scene = match arguments.fields.first() {
        Some(path) => FieldFile::read(path)?.scene().clone(),
        None => reference_scene(arguments.part, 1.0)?,
    };
    let record = &scene.record;
    let poses = random_poses(&record.grid, arguments.poses as usize, 0)?;
    session.note("exact counts");
    let exact = ExactField::new(&scene.obstacle, record.bare_tool())?;
    let collides = |pose| exact.count(pose).map(|count| decided(count > 0)).context("an invalid pose");
    let truth: Vec<Decision> = poses.iter().map(collides).collect::<Result<_>>()?;
    let trial = Trial { poses: &poses, truth: &truth };
    let proven = ["proven yes or no", "spheres and exact counts"];
    let mut rows = vec![
        trial.decisions("ExactField", proven, BATCH, |poses, found| Ok(exact.classify(poses, found)?))?,
        trial.decisions("ExactField", proven, 1, |poses, found| {
            found.iter_mut().zip(poses).for_each(|(found, pose)| *found = decided(exact.collides(pose)));
            Ok(())
        })?,
        trial.values("ExactField", ["exact overlap", "exact counts"], BATCH, &exact)?,
        trial.single(["exact count", "every direction new"], |pose| exact.count(pose).is_some())?,
        trial.single(["lower bound of the clearance", "distances along the axis"], |pose| {
            exact.clearance_bound(pose).is_some()
        })?,
    ];
    for path in &arguments.fields {
        let how = path.display().to_string();
        session.note(&how);
        let file = FieldFile::read(path)?;
        ensure!(
            file.scene().record.obstacle_crc32 == record.obstacle_crc32
                && file.scene().record.bare_tool() == record.bare_tool(),
            "{how} is of another scene than {}: give fields of one part, grid and tool",
            arguments.fields[0].display()
        );
        let family = file.family();
        let planner = Planner::new(Field::new(file)?)?;
        let (model, name) = (&planner.model, format!("Field, {family}"));
        rows.push(trial.decisions(&format!("Planner, {family}"), proven, BATCH, |poses, found| {
            Ok(planner.classify(poses, found)?)
        })?);
        let by_field = ["yes, no or undecided, by calibration", &how];
        let row =
            trial.decisions(&name, by_field, BATCH, |poses, found| Ok(model.classify(poses, found)?))?;
        rows.push(match model.calibration() {
            Some(_) => row,
            // Every pose is undecided then, which says nothing of the field.
            None => {
                Row { answers: "not calibrated (imf calibrate)".into(), free: None, colliding: None, ..row }
            }
        });
        let (value, slopes) = match model.quantity() {
            Quantity::Overlap => ("overlap, approximate", "overlap with both gradients"),
            Quantity::Depth => ("depth, approximate", "depth with both gradients"),
        };
        for batch in [BATCH, 1] {
            rows.push(trial.values(&name, [value, &how], batch, model)?);
            rows.push(trial.gradients(&name, [slopes, &how], batch, model)?);
        }
    }
    let few = &poses[..poses.len().min(arguments.rival_poses as usize)];
    session.note("Coal, FCL, vamp and parry3d");
    let (found, missing) = libraries::measure(arguments, &scene, few, &truth)?;
    rows.extend(found);
    // Of a built-in part at two resolutions, not of the fields' scene.
    let changes = if arguments.fields.is_empty() {
        session.note("a changed obstacle");
        change::measure(arguments.part)?
    } else {
        Vec::new()
    };
    machine.finish();
    let [x, y, z] = record.grid.dims;
    let scene = format!(
        "{} {x}×{y}×{z}, tool {}; positions uniform between the voxel centres, orientations uniform",
        record.part,
        record.bare_tool().name
    );
    let report = Report { machine, scene, rows, changes, missing };
    report.document().write(&arguments.out, "query", &report)?.show(session, &report)
}

/// Uniform positions between the voxel centres, uniform directions.
pub(crate) fn random_poses(grid: &Grid, count: usize, seed: u64) -> Result<Vec<Pose>> {
    let set = OrientationSet::parse(&format!("random:{count}:{seed}"))?;
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut number = || f64::from(random.next_u32()) / f64::from(u32::MAX);
    let (low, high) = (grid.centre([0; 3]), grid.centre(grid.dims.map(|n| n - 1)));
    let pose = |orientation: &Orientation| {
        // A hair inside, so that single precision on a device does not step over a face.
        let unit = (DVec3::new(number(), number(), number()) - 0.5) * (1.0 - 2e-6) + 0.5;
        Pose::oriented(low + unit * (high - low), orientation)
    };
    Ok(set.orientations.iter().map(pose).collect())
}

/// Of what is certain.
fn decided(collides: bool) -> Decision {
    if collides { Decision::Colliding } else { Decision::Free }
}

/// Poses, and whether the tool collides there.
struct Trial<'a> {
    poses: &'a [Pose],
    truth: &'a [Decision],
}

impl Trial<'_> {
    /// A row of `name` by the sum over batches of the best time of each, so that a busy machine disturbs few of them;
    /// names what is evaluated, and how. All poses have their turn before one comes again: asked again at once, caches and
    /// predictors of branches know it already, and decisions take two thirds of their time.
    fn row(
        &self,
        name: &str,
        [answers, how]: [&str; 2],
        batch: usize,
        mut ask: impl FnMut(&[Pose], usize) -> Result<()>,
    ) -> Result<Row> {
        let mut least = vec![f64::INFINITY; self.poses.len().div_ceil(BATCH)];
        for _ in 0..ROUNDS {
            for (index, (poses, least)) in self.poses.chunks(BATCH).zip(&mut least).enumerate() {
                *least = least.min(seconds(|| ask(poses, index * BATCH))?.0);
            }
        }
        let seconds: f64 = least.iter().sum();
        Ok(Row {
            name: name.into(),
            answers: answers.into(),
            poses: self.poses.len(),
            batch: batch.min(self.poses.len()),
            poses_per_second: self.poses.len() as f64 / seconds,
            free: None,
            colliding: None,
            agree: None,
            how: how.into(),
        })
    }

    fn decisions(
        &self,
        name: &str,
        about: [&str; 2],
        batch: usize,
        decide: impl Fn(&[Pose], &mut [Decision]) -> Result<()>,
    ) -> Result<Row> {
        let mut decisions = vec![Decision::Undecided; self.poses.len()];
        let row = self
            .row(name, about, batch, |poses, from| decide(poses, &mut decisions[from..from + poses.len()]))?;
        let fraction = |decision| {
            let of = decisions.iter().filter(|&&d| d == decision).count();
            Some(of as f64 / decisions.len() as f64)
        };
        let pairs = decisions.iter().zip(self.truth);
        let decided: Vec<bool> =
            pairs.filter(|(d, _)| **d != Decision::Undecided).map(|(d, t)| d == t).collect();
        let agree = decided.iter().filter(|&&same| same).count() as f64 / decided.len() as f64;
        Ok(Row {
            free: fraction(Decision::Free),
            colliding: fraction(Decision::Colliding),
            agree: (!decided.is_empty()).then_some(agree),
            ..row
        })
    }

    fn values(&self, name: &str, about: [&str; 2], batch: usize, field: &dyn PoseField) -> Result<Row> {
        let mut values = vec![0.0; batch];
        self.row(name, about, batch, |poses, _| {
            Ok(poses.chunks(batch).try_for_each(|poses| field.values(poses, &mut values[..poses.len()]))?)
        })
    }

    fn gradients(&self, name: &str, about: [&str; 2], batch: usize, field: &dyn PoseField) -> Result<Row> {
        let mut gradients = vec![Gradient::NAN; batch];
        self.row(name, about, batch, |poses, _| {
            Ok(poses
                .chunks(batch)
                .try_for_each(|poses| field.gradients(poses, &mut gradients[..poses.len()]))?)
        })
    }

    /// Of the exact field, pose by pose; all poses have a result.
    fn single(&self, about: [&str; 2], answer: impl Fn(&Pose) -> bool) -> Result<Row> {
        self.row("ExactField", about, 1, |poses, _| {
            ensure!(poses.iter().filter(|pose| answer(pose)).count() == poses.len(), "an invalid pose");
            Ok(())
        })
    }
}

impl Report {
    fn document(&self) -> Document {
        let mut document = Document::new("Random poses, one core");
        document.paragraph(format!("{}\n{}", self.scene, self.machine));
        let percent = |part: Option<f64>| part.map_or(String::new(), |part| format!("{:.2} %", 100.0 * part));
        let rows = self.rows.iter().map(|row| {
            vec![
                row.name.clone(),
                row.answers.clone(),
                row.batch.to_string(),
                format!("{:.0}", row.poses_per_second),
                percent(row.free),
                percent(row.colliding),
                percent(row.agree),
                row.how.clone(),
            ]
        });
        document.table(
            &["", "answers", "poses a call", "poses/s", "free", "colliding", "as exact", "how"],
            rows.collect(),
        );
        if !self.changes.is_empty() {
            document.section("A changed obstacle");
            document.paragraph(
                "Balls of a thousandth of the part's voxels are taken away and put back; from the change to the end of a batch of poses. Beside \
                 it the same of a world made anew of the voxels.",
            );
            let rows = self.changes.iter().map(|row| {
                let time = |seconds: f64| format!("{:.2}", 1e3 * seconds);
                let counts = [row.voxels, row.solid, row.changed].map(|count| count.to_string());
                let times = [row.first, row.median, row.longest, row.anew].map(time);
                let part = format!("{:.1} %", 100.0 * row.median / row.anew);
                counts.into_iter().chain(times).chain([part]).collect()
            });
            document.table(
                &[
                    "voxels",
                    "solid",
                    "changed",
                    "first, ms",
                    "median, ms",
                    "longest, ms",
                    "anew, ms",
                    "median of anew",
                ],
                rows.collect(),
            );
        }
        self.missing.iter().for_each(|advice| document.paragraph(advice));
        document
    }
}
