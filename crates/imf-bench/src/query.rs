//! `imf-bench query`: poses a second on one core, and what each answer is worth.

mod libraries;
mod turned;

use std::fmt::Write;
use std::time::Instant;

use anyhow::{Result, ensure};
use imf_cli::output::{prepare_folder, print, print_json, write_json, write_text};
use imf_cli::session::Session;
use imf_core::field::{Decision, ExactField, Gradient, PoseField};
use imf_core::orientation::OrientationSet;
use imf_core::pose::Pose;
use imf_core::section::Quantity;
use imf_fields::field::{Field, VerifiedField};
use imf_fields::file::FieldFile;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::Serialize;

use crate::arguments::query::QueryArguments;
use crate::machine::Machine;

/// Every figure is the best of this many rounds, batch by batch.
const ROUNDS: usize = 3;
/// Poses asked in a call.
const BATCH: usize = 1000;

/// One way to be told about poses.
#[derive(Serialize)]
struct Row {
    name: String,
    /// What an answer is.
    answers: &'static str,
    poses: usize,
    poses_per_second: f64,
    /// Share of the poses called free, and called colliding.
    free: Option<f64>,
    blocked: Option<f64>,
    /// Share of the decided poses where the decision is the exact one for the true tool.
    agree: Option<f64>,
    how: String,
}

#[derive(Serialize)]
struct Report {
    machine: Machine,
    scene: String,
    rows: Vec<Row>,
    /// Why a library is missing.
    missing: Vec<String>,
}

pub(crate) fn run(session: &Session, arguments: &QueryArguments) -> Result<()> {
    prepare_folder(&arguments.out)?;
    let mut machine = Machine::new(1);
    let first = FieldFile::read(&arguments.fields[0])?;
    let scene = first.scene().clone();
    let record = &scene.record;
    drop(first);
    let poses = random_poses(&scene.record.grid, arguments.poses as usize, arguments.seed)?;
    session.note("exact counts");
    let exact = ExactField::new(&scene.obstacle, record.bare_tool());
    let mut truth = vec![Decision::Undecided; poses.len()];
    exact.classify(&poses, &mut truth)?;
    let trial = Trial { poses: &poses, truth: &truth };
    let mut rows = vec![
        trial.classified("ExactField", "proven yes or no", "balls and exact counts", &exact)?,
        trial.valued("ExactField", "exact overlap", "exact counts", &exact)?,
    ];
    for path in &arguments.fields {
        let how = path.display().to_string();
        session.note(&how);
        let stored = FieldFile::read(path)?;
        ensure!(
            stored.scene().record.obstacle_crc32 == record.obstacle_crc32
                && stored.scene().record.bare_tool() == record.bare_tool(),
            "{how} is of another scene than {}: give fields of one part, grid and tool",
            arguments.fields[0].display()
        );
        let family = match &stored {
            FieldFile::Siren(_) => "siren5",
            FieldFile::Harmonic(_) => "harmonic",
            FieldFile::Factored(_) => "factored",
        };
        let verified = VerifiedField::new(Field::new(stored)?)?;
        let model = verified.model();
        let name = |what: &str| format!("{what}, {family}");
        rows.push(trial.classified(
            &name("VerifiedField"),
            "proven yes or no",
            "balls and exact counts",
            &verified,
        )?);
        let decided =
            trial.classified(&name("Field"), "yes, no or undecided, by calibration", &how, model)?;
        rows.push(match model.calibration() {
            Some(_) => decided,
            // Every pose is undecided then, which says nothing of the field.
            None => Row { answers: "not calibrated (imf calibrate)", free: None, blocked: None, ..decided },
        });
        let (value, slopes) = match model.quantity() {
            Quantity::Overlap => ("overlap, approximate", "overlap with both gradients"),
            Quantity::Depth => ("depth, approximate", "depth with both gradients"),
        };
        rows.push(trial.valued(&name("Field"), value, &how, model)?);
        rows.push(trial.sloped(&name("Field"), slopes, &how, model)?);
    }
    let asked = &poses[..poses.len().min(arguments.rival_poses as usize)];
    let (found, missing) = match libraries::meshes(record) {
        Some([part, tool]) => {
            session.note("Coal, FCL and parry3d");
            libraries::measure(arguments, [&part, &tool], asked, &truth)?
        }
        None => (Vec::new(), vec!["the libraries need a built-in part, whose mesh is at hand".into()]),
    };
    rows.extend(found);
    machine.finish();
    let [x, y, z] = record.grid.dims;
    let report = Report {
        machine,
        scene: format!(
            "{} {x}×{y}×{z}, tool {}; positions uniform between the voxel centres, orientations uniform",
            record.part,
            record.bare_tool().name
        ),
        rows,
        missing,
    };
    let text = report.markdown();
    write_json(&arguments.out.join("query.json"), &report)?;
    write_text(&arguments.out.join("query.md"), &text)?;
    if session.json { print_json(&report) } else { print(&text) }
}

/// Uniform positions between the voxel centres, uniform directions.
pub(crate) fn random_poses(grid: &imf_core::grid::Grid, count: usize, seed: u64) -> Result<Vec<Pose>> {
    let set = OrientationSet::parse(&format!("random:{count}:{seed}"))?;
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut number = || f64::from(random.next_u32()) / f64::from(u32::MAX);
    let (low, high) = (grid.centre([0; 3]), grid.centre(grid.dims.map(|n| n - 1)));
    let pose = |orientation: &imf_core::orientation::Orientation| {
        // A hair inside, so that single precision on a device does not step over a face.
        let unit = (glam::DVec3::new(number(), number(), number()) - 0.5) * (1.0 - 2e-6) + 0.5;
        Pose::oriented(low + unit * (high - low), orientation)
    };
    Ok(set.orientations.iter().map(pose).collect())
}

/// What is asked of every field.
struct Trial<'a> {
    poses: &'a [Pose],
    truth: &'a [Decision],
}

impl Trial<'_> {
    /// Poses a second: the sum over batches of the best time of each, so that a busy machine disturbs few of them.
    fn speed(&self, mut ask: impl FnMut(&[Pose], usize) -> Result<()>) -> Result<f64> {
        let mut seconds = 0.0;
        for (index, batch) in self.poses.chunks(BATCH).enumerate() {
            let mut best = f64::INFINITY;
            for _ in 0..ROUNDS {
                let begun = Instant::now();
                ask(batch, index * BATCH)?;
                best = best.min(begun.elapsed().as_secs_f64());
            }
            seconds += best;
        }
        Ok(self.poses.len() as f64 / seconds)
    }

    fn row(&self, name: &str, answers: &'static str, how: &str, poses_per_second: f64) -> Row {
        Row {
            name: name.into(),
            answers,
            poses: self.poses.len(),
            poses_per_second,
            free: None,
            blocked: None,
            agree: None,
            how: how.into(),
        }
    }

    fn classified(&self, name: &str, answers: &'static str, how: &str, field: &dyn PoseField) -> Result<Row> {
        let mut decisions = vec![Decision::Undecided; self.poses.len()];
        let speed =
            self.speed(|batch, from| Ok(field.classify(batch, &mut decisions[from..from + batch.len()])?))?;
        let share = |decision| {
            let of = decisions.iter().filter(|&&d| d == decision).count();
            Some(of as f64 / decisions.len() as f64)
        };
        let decided: Vec<bool> = decisions
            .iter()
            .zip(self.truth)
            .filter(|(d, _)| **d != Decision::Undecided)
            .map(|(d, t)| d == t)
            .collect();
        let agree = decided.iter().filter(|&&same| same).count() as f64 / decided.len() as f64;
        Ok(Row {
            free: share(Decision::Free),
            blocked: share(Decision::Colliding),
            agree: (!decided.is_empty()).then_some(agree),
            ..self.row(name, answers, how, speed)
        })
    }

    fn valued(&self, name: &str, answers: &'static str, how: &str, field: &dyn PoseField) -> Result<Row> {
        let mut values = [0.0; BATCH];
        let speed = self.speed(|batch, _| Ok(field.values(batch, &mut values[..batch.len()])?))?;
        Ok(self.row(name, answers, how, speed))
    }

    fn sloped(&self, name: &str, answers: &'static str, how: &str, field: &dyn PoseField) -> Result<Row> {
        let mut gradients = vec![Gradient::NAN; BATCH];
        let speed = self.speed(|batch, _| Ok(field.gradients(batch, &mut gradients[..batch.len()])?))?;
        Ok(self.row(name, answers, how, speed))
    }
}

impl Report {
    fn markdown(&self) -> String {
        let mut text = format!(
            "Random poses, one core: {}\n{}\n\n| | answers | poses/s | free | colliding | as exact | how |\n| --- | --- \
             | --- | --- | --- | --- | --- |\n",
            self.scene, self.machine
        );
        let percent = |share: Option<f64>| share.map_or(String::new(), |s| format!("{:.2} %", 100.0 * s));
        for row in &self.rows {
            // Writing to a string does not fail.
            let _ = writeln!(
                text,
                "| {} | {} | {:.0} | {} | {} | {} | {} |",
                row.name,
                row.answers,
                row.poses_per_second,
                percent(row.free),
                percent(row.blocked),
                percent(row.agree),
                row.how
            );
        }
        for advice in &self.missing {
            let _ = writeln!(text, "\n{advice}");
        }
        text
    }
}
