//! `imf query`: evaluates a field at poses from a CSV file, and counts exactly with --exact.
//!
//! Poses are read, evaluated and written in chunks: memory does not grow with their number. A file of poses is read
//! twice, first to find what is wrong with it before anything is evaluated.

mod poses;
mod results;

use std::io::{Error as IoError, Write, stdout};

use anyhow::{Context as _, Result};
use glam::{DQuat, DVec3};
use imf_core::atomic_file::write_atomically;
use imf_core::field::{Decision, ExactField, FieldError, collision_measures, values_on_all_threads};
use imf_core::grid::Grid;
use imf_core::pose::Pose;
use imf_core::section::Quantity;
use imf_fields::file::FieldFile;

use self::poses::Poses;
use self::results::{ResultChunk, ResultWriter};
use super::notes;
use crate::arguments::saved::QueryArguments;
use crate::engine::{Device, DeviceField, Workload, read_field};
use crate::interrupt::{self, Interruption};
use crate::output::{OutputFile, short, standard_output_failed};
use crate::session::Session;

/// Poses evaluated at a time: large enough for a GPU, less than seconds of work.
const CHUNK: usize = 1 << 14;
/// The same where the tool is voxelised for every pose.
const EXACT_CHUNK: usize = 1 << 8;
/// A pose that can be evaluated.
const ANY: Pose = Pose { position: DVec3::ZERO, rotation: DQuat::IDENTITY };

pub(crate) fn run(session: &Session, arguments: &QueryArguments) -> Result<()> {
    let out = arguments.out.as_deref().map(OutputFile::check).transpose()?;
    let (poses, count) = poses::open(&arguments.poses)?;
    let name = &arguments.device.device;
    let file = read_field(session, &arguments.model)?;
    let device = Device::for_field(name, session, &file)?;
    let quantity = file.quantity();
    if let (Device::Gpu(_), FieldFile::Harmonic(_)) = (&device, &file) {
        // Beside the field's own, and while they are copied.
        session.require_memory(3 * device.copied_bytes(&file, Workload::Many), || {
            "the field's coefficients at every voxel on the device; take --device cpu".into()
        })?;
    }
    let field = device.field(session, &file, Workload::One).with_context(|| format!("--device {name}"))?;
    let scene = file.scene();
    let record = &scene.record;
    if let FieldFile::Siren(model) = &file {
        session.detail(&field.by);
        notes::of_training(session, &arguments.model, model);
    }
    notes::of_scene(session, record);
    // The roll changes what the tool overlaps, and the paper's network is of directions alone.
    match (poses.roll.is_some(), &file) {
        (true, FieldFile::Siren(_)) => notes::of_roll(session, record),
        (true, _) => {}
        (false, _) => notes::of_no_roll(session, record, arguments.sharp),
    }
    session.note(&match quantity.is_overlap() {
        true => format!("a field is not a proof; --exact counts: {}", record.guarantee()),
        false => {
            let [_, most] = quantity.bounds(record.grid.pitch);
            format!(
                "a field is not a proof; depths are clamped within {} pitches, {} {}; --exact counts: {}",
                short(most / record.grid.pitch),
                short(most),
                record.unit,
                record.guarantee()
            )
        }
    });
    let work = Work {
        grid: record.grid,
        quantity,
        field,
        exact: arguments.exact.then(|| ExactField::of_scene(scene, &record.clearance)).transpose()?,
        sharp_points: arguments.sharp.then(|| record.tool.sharp_point_positions(record.grid.pitch)),
    };
    let Some(out) = out else {
        let answered = work.answer(session, poses, count, &mut stdout().lock(), false);
        // Who reads no further answers needs none.
        return answered.or_else(|error| match error.downcast() {
            Ok(error) => standard_output_failed(error),
            Err(error) => Err(error),
        });
    };
    let mut failure = None;
    let written = write_atomically(out.begin()?, |file| {
        let answered = work.answer(session, poses, count, file, true);
        answered.map_err(|error| {
            // Plain errors of the system are those of writing.
            error.downcast().unwrap_or_else(|error| {
                failure = Some(error);
                IoError::other("the poses were not evaluated")
            })
        })
    });
    match failure {
        Some(error) => Err(error),
        None => Ok(written?),
    }
}

struct Work {
    /// The field was made for its voxels.
    grid: Grid,
    quantity: Quantity,
    field: DeviceField,
    exact: Option<ExactField>,
    sharp_points: Option<Vec<DVec3>>,
}

impl Work {
    /// Evaluates all poses; `whole` where an interruption leaves nothing behind.
    fn answer(
        &self,
        session: &Session,
        mut poses: Poses,
        count: Option<u64>,
        out: &mut dyn Write,
        whole: bool,
    ) -> Result<()> {
        let size = if self.exact.is_some() { EXACT_CHUNK } else { CHUNK };
        let mut answers = ResultChunk::default();
        // Before the header: poses that cannot be read at all leave no partial result.
        poses.read(size, &mut answers.records, &mut answers.poses)?;
        let measure = match (self.quantity, &self.sharp_points) {
            (Quantity::Depth, Some(_)) => "depth_sharp",
            (Quantity::Depth, None) => "depth",
            (Quantity::Overlap, Some(_)) => "overlap_sharp",
            (Quantity::Overlap, None) => "overlap",
        };
        let mut writer =
            ResultWriter::start(&poses.header, measure, self.exact.is_some(), session.json, out)?;
        let _keeping = interrupt::stop_cleanly();
        let stage = session.stage("answering", "poses", count.unwrap_or(0));
        let (mut answered, mut outside) = (0u64, 0u64);
        let mut queries = Vec::new();
        while !answers.poses.is_empty() {
            if interrupt::requested() {
                let kept = if whole { "nothing was written" } else { "no further pose is evaluated" };
                return Err(Interruption(format!("{answered} poses were evaluated; {kept}")).into());
            }
            // In place of an invalid pose any other is evaluated, and the result discarded.
            queries.clear();
            queries.extend(answers.poses.iter().map(|pose| pose.unwrap_or(ANY)));
            answers.values = self.measure(&queries, |poses, values| self.field.values(poses, values))?;
            if let Some(exact) = &self.exact {
                answers.exact = self.measure(&queries, |poses, values| match self.quantity {
                    Quantity::Overlap => values_on_all_threads(exact, poses, values),
                    Quantity::Depth => exact.depths(poses, values),
                })?;
            }
            answers.decisions = self.decisions(&queries)?;
            answers.outside =
                answers.poses.iter().map(|pose| pose.is_none_or(|pose| self.is_outside(&pose))).collect();
            writer.write(&answers, out)?;
            answered += answers.poses.len() as u64;
            let known = answers.outside.iter().zip(&answers.poses).filter(|(_, pose)| pose.is_some());
            outside += known.filter(|(outside, _)| **outside).count() as u64;
            stage.advance(answers.poses.len() as u64);
            poses.read(size, &mut answers.records, &mut answers.poses)?;
        }
        writer.finish(out)?;
        stage.finish("");
        if outside > 0 {
            session.note(&format!(
                "{outside} of {answered} poses lie outside the box of the voxel centres, which the field was made for: it \
                 answers them as the nearest point inside, without guarantee"
            ));
        }
        let invalid = &poses.invalid;
        invalid.check(answered)?;
        if invalid.count > 0 {
            session.warn(&format!(
                "{} of {answered} lines are invalid poses and have no result (decision: invalid), the first of them: {}",
                invalid.count, invalid.first
            ));
        }
        Ok(())
    }

    /// True where the pose, or one of its sharp points, lies outside the field's domain.
    fn is_outside(&self, pose: &Pose) -> bool {
        let sharp_points = self.sharp_points.as_deref().unwrap_or(&[DVec3::ZERO]);
        sharp_points.iter().any(|&sharp| !self.grid.is_between_centres(pose.position - pose.rotation * sharp))
    }

    /// Whether the tool collides, by the field's calibration. Where sharp points are given it is free if it is with one of them.
    fn decisions(&self, poses: &[Pose]) -> Result<Vec<Decision>> {
        let mut decisions = vec![Decision::Undecided; poses.len()];
        let Some(points) = &self.sharp_points else {
            self.field.classify(poses, &mut decisions)?;
            return Ok(decisions);
        };
        let mut best = vec![Decision::Colliding; poses.len()];
        for &sharp in points {
            let shifted: Vec<Pose> = poses
                .iter()
                .map(|pose| Pose { position: pose.position - pose.rotation * sharp, ..*pose })
                .collect();
            self.field.classify(&shifted, &mut decisions)?;
            for (best, &decision) in best.iter_mut().zip(&decisions) {
                *best = match (*best, decision) {
                    (Decision::Free, _) | (_, Decision::Free) => Decision::Free,
                    (Decision::Undecided, _) | (_, Decision::Undecided) => Decision::Undecided,
                    (Decision::Colliding, Decision::Colliding) => Decision::Colliding,
                };
            }
        }
        Ok(best)
    }

    /// Overlaps of the tool with its tip at the poses, or collision measures where sharp points are given.
    fn measure(
        &self,
        poses: &[Pose],
        mut field: impl FnMut(&[Pose], &mut [f32]) -> Result<(), FieldError>,
    ) -> Result<Vec<f32>> {
        let mut values = vec![0.0; poses.len()];
        match &self.sharp_points {
            Some(points) => collision_measures(field, points, poses, &mut values)?,
            None => field(poses, &mut values)?,
        }
        Ok(values)
    }
}
