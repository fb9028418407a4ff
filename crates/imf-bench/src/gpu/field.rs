//! A factored field of the scene, taught on the GPU and on the CPU, and the harmonic field that teaches it; their minima at every voxel,
//! the first one's errors at random orientations, its sections and its answers to random poses, by both.

use std::sync::Arc;
use std::time::Instant;

use anyhow::{Result, ensure};
use imf_cli::arguments::harmonic::DEFAULT_SECTIONS;
use imf_cli::commands::train::harmonic;
use imf_cli::engine::Device;
use imf_cli::interrupt;
use imf_cli::job::{Distillation, Extent, FactoredStart, Settings, Source, symmetry_of};
use imf_cli::output::table;
use imf_cli::session::Session;
use imf_core::control::Control;
use imf_core::field::{Gradient, GridField, PoseField};
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::pose::Pose;
use imf_core::scene::Scene;
use imf_core::section::{At, SectionPlan, sections};
use imf_fields::factored::DistillSettings;
use imf_fields::factored::file::FactoredFile;
use imf_fields::file::FieldFile;
use imf_fields::harmonic::FitSettings;
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::coefficients::Precision;
use imf_fields::harmonic::file::HarmonicFile;
use imf_fields::metrics::{ErrorReport, Errors};
use imf_fields::recipe::Length;
use imf_gpu::{Gpu, GpuField};
use rayon::prelude::*;
use serde::Serialize;
use serde_json::json;

use super::Part;
use crate::machine::timed;
use crate::query::random_poses;

/// How much is measured.
pub(super) struct Sizes {
    /// Of the harmonic field that teaches.
    pub(super) degree: usize,
    /// Neurons of a hidden layer.
    pub(super) width: usize,
    pub(super) steps: u64,
    /// Orientations that errors are measured at.
    pub(super) random: usize,
    /// Sets that minima are taken over.
    pub(super) minima: &'static [&'static str],
    pub(super) poses: usize,
}

/// Overlap above which a pose counts as colliding.
const THRESHOLD: f64 = 1e-3;
/// What takes less memory.
const SMALLER: &str = "take the other parts by --only";
/// Differences above this, of overlaps or of the largest slope, are no roundings: some 1e-6 was seen.
const TOLERANCE: f32 = 1e-4;
/// Orientations whose sections are compared.
const COMPARED: usize = 4;
/// Poses that one thread of the CPU is asked at a time.
const POSES: usize = 256;

pub(super) fn measured(
    session: &Session,
    gpu: &Gpu,
    scene: &Scene,
    sizes: &Sizes,
    part: &mut Part,
) -> Result<()> {
    let plan = SectionPlan::of_scene(scene, At::Tip)?;
    let (teacher, settings, fitted) = taught_by(session, scene, &plan, sizes)?;
    let [x, y, z] = plan.grid().dims;
    let teacher_told = format!(
        "Teapot {x}×{y}×{z}; the harmonic field of degree {} that teaches took {fitted:.2} s on the CPU. Errors are at {} random \
         orientations.",
        sizes.degree, sizes.random
    );
    let mut rows = Rows { part, teacher: teacher_told, judged: Vec::new(), rows: Vec::new() };
    let (file, seconds) = taught(session, &Device::Gpu(gpu.clone()), &teacher, settings)?;
    let what = format!("{} steps of {}", sizes.steps, file.field.shape);
    let (of_cpu, cpu_seconds) = taught(session, &Device::Cpu, &teacher, settings)?;
    rows.add(&what, seconds, cpu_seconds, None)?;
    let sets = sizes.minima.iter().map(|set| Ok((*set, OrientationSet::parse(set)?.orientations)));
    let sets: Vec<(&str, Vec<Orientation>)> = sets.collect::<Result<_>>()?;
    of_harmonic(gpu, teacher, &sets, &mut rows)?;

    let grid = scene.record.grid;
    // The sections at random orientations, exact and of a field.
    let needed = grid.len() * 2 * size_of::<f32>() * sizes.random;
    session.require_memory(needed as u64, || format!("{} sections; {SMALLER}", sizes.random))?;
    let random = OrientationSet::parse(&format!("random:{}:1", sizes.random))?.orientations;
    let exact = sections(&plan, &random, session.control(&|_| {}))?;
    drop(plan);
    let [on_device, of_cpu] =
        [file, of_cpu].map(|file| GpuField::new(gpu, FieldFile::Factored(Box::new(file))));
    let (on_device, of_cpu) = (on_device?, of_cpu?);
    for (by, field) in [("GPU", &on_device), ("CPU", &of_cpu)] {
        rows.judge(by, errors(field, &random, &exact)?);
    }
    drop((exact, of_cpu));

    let few = &random[..COMPARED.min(random.len())];
    let [mut found, mut twin] = [0; 2].map(|_| vec![0.0; grid.len() * few.len()]);
    let (seconds, ()) = timed(|| Ok(on_device.sections(few, &mut found)?))?;
    let (cpu, ()) = timed(|| Ok(on_device.twin().sections(few, &mut twin)?))?;
    rows.add(&format!("{} sections, read back", few.len()), seconds, cpu, Some(largest(&found, &twin)?))?;
    for (set, orientations) in &sets {
        let (seconds, least) = timed(|| Ok(on_device.minimum(orientations, Control::quiet())?))?;
        let (cpu, twin) = timed(|| Ok(on_device.twin().minimum(orientations, Control::quiet())?))?;
        rows.add(&format!("IMF over {set}"), seconds, cpu, Some(largest(&least.value, &twin.value)?))?;
    }

    let poses = random_poses(&grid, sizes.poses, 1)?;
    asked(&on_device, &poses, &mut rows)
}

/// Minima of the harmonic field, whose coefficients stay on the device.
fn of_harmonic(
    gpu: &Gpu,
    teacher: HarmonicFile,
    sets: &[(&str, Vec<Orientation>)],
    rows: &mut Rows<'_>,
) -> Result<()> {
    let on_device = GpuField::new(gpu, FieldFile::Harmonic(Arc::new(teacher)))?;
    let begun = Instant::now();
    // The first call uploads.
    on_device.minimum(&sets[0].1[..1], Control::quiet())?;
    rows.teacher += &format!(" Its coefficients went up in {:.2} s.", begun.elapsed().as_secs_f64());
    for (set, orientations) in sets {
        let (seconds, least) = timed(|| Ok(on_device.minimum(orientations, Control::quiet())?))?;
        let (cpu, twin) = timed(|| Ok(on_device.twin().minimum(orientations, Control::quiet())?))?;
        let difference = largest(&least.value, &twin.value)?;
        rows.add(&format!("IMF over {set} by that harmonic field"), seconds, cpu, Some(difference))?;
    }
    Ok(())
}

/// Random poses, values and gradients.
fn asked(field: &GpuField, poses: &[Pose], rows: &mut Rows<'_>) -> Result<()> {
    // The first call compiles and uploads.
    field.values(&poses[..1], &mut [0.0])?;
    let (mut found, mut twin) = (vec![0.0; poses.len()], vec![0.0; poses.len()]);
    let (seconds, ()) = timed(|| Ok(field.values(poses, &mut found)?))?;
    let (cpu, ()) = timed(|| {
        let parts = poses.par_chunks(POSES).zip(twin.par_chunks_mut(POSES));
        Ok(parts.try_for_each(|(poses, values)| field.twin().values(poses, values))?)
    })?;
    rows.add(&format!("{} poses", poses.len()), seconds, cpu, Some(largest(&found, &twin)?))?;

    let (mut found, mut twin) = (vec![Gradient::NAN; poses.len()], vec![Gradient::NAN; poses.len()]);
    let (seconds, ()) = timed(|| Ok(field.gradients(poses, &mut found)?))?;
    let (cpu, ()) = timed(|| {
        let parts = poses.par_chunks(POSES).zip(twin.par_chunks_mut(POSES));
        Ok(parts.try_for_each(|(poses, found)| field.twin().gradients(poses, found))?)
    })?;
    let slopes = |found: &[Gradient]| -> Vec<f32> {
        found.iter().flat_map(|g| g.position.to_array().into_iter().chain(g.direction.to_array())).collect()
    };
    let (slopes, expected) = (slopes(&found), slopes(&twin));
    let scale = expected.iter().fold(0.0f32, |most, slope| most.max(slope.abs()));
    let difference = largest(&slopes, &expected)? / scale;
    rows.add(&format!("{} with gradients", poses.len()), seconds, cpu, Some(difference))
}

/// The harmonic field that teaches, how, and the seconds that it took.
fn taught_by(
    session: &Session,
    scene: &Scene,
    plan: &SectionPlan,
    sizes: &Sizes,
) -> Result<(HarmonicFile, DistillSettings, f64)> {
    let fit = FitSettings {
        degree: sizes.degree,
        axes: usize::MAX,
        precision: Precision::F32,
        sections_per_function: DEFAULT_SECTIONS,
        ..FitSettings::default()
    };
    let mut settings =
        DistillSettings { width: sizes.width, ..DistillSettings::of_length(Length::Steps(sizes.steps)) };
    let (domain, voxels) = (Domain::Directions, scene.record.grid.len());
    Extent { by_sections: false, fit, domain, voxels }.require(session, &settings, SMALLER)?;
    let begun = Instant::now();
    let teacher = harmonic::fitted(session, scene, plan, Domain::Directions, fit, SMALLER)?;
    settings.symmetry = symmetry_of(session, &teacher);
    Ok((teacher, settings, begun.elapsed().as_secs_f64()))
}

/// A field that a device was taught, and the seconds of that.
fn taught(
    session: &Session,
    device: &Device,
    teacher: &HarmonicFile,
    settings: DistillSettings,
) -> Result<(FactoredFile, f64)> {
    let folder = tempfile::tempdir()?;
    let start = &FactoredStart::at(folder.path(), false)?;
    let begun = Instant::now();
    let beside = Settings {
        checkpoint_every: f64::INFINITY,
        go_on: "the field starts over",
        slower: " with a rate of ",
        held_out: 0,
        held_out_every: None,
    };
    let (source, precision, smaller) = (Source::Harmonic(teacher), Precision::F32, SMALLER);
    let (file, _) =
        Distillation { source, settings, precision, beside, smaller, start }.run(session, device, None)?;
    Ok((file, begun.elapsed().as_secs_f64()))
}

/// A field's errors, evaluated on the GPU.
fn errors(field: &GpuField, orientations: &[Orientation], exact: &[Vec<f32>]) -> Result<ErrorReport> {
    let mut values = vec![0.0; field.grid().len() * orientations.len()];
    field.sections(orientations, &mut values)?;
    let mut errors = Errors::default();
    for (exact, field) in exact.iter().zip(values.chunks_exact(field.grid().len())) {
        errors.add(exact, field, THRESHOLD);
    }
    Ok(errors.report(THRESHOLD))
}

/// The largest difference; NaN where there is one.
fn largest(found: &[f32], expected: &[f32]) -> Result<f32> {
    ensure!(found.len() == expected.len(), "{} values for {}", found.len(), expected.len());
    let differences = found.iter().zip(expected).map(|(a, b)| (a - b).abs());
    Ok(differences
        .fold(0.0, |most: f32, next| if most.is_nan() || next.is_nan() { f32::NAN } else { most.max(next) }))
}

/// What takes how long on either.
#[derive(Serialize)]
struct Row {
    what: String,
    gpu_seconds: f64,
    cpu_seconds: f64,
    /// Of the values of one field, or of slopes over the largest; nothing too where one is no number, which ends the part.
    largest_difference: Option<f32>,
}

/// What a field that one of them was taught errs by.
#[derive(Serialize)]
struct Judged {
    taught_on: &'static str,
    errors: ErrorReport,
}

/// What was found, which the part has after every row.
struct Rows<'a> {
    part: &'a mut Part,
    teacher: String,
    judged: Vec<Judged>,
    rows: Vec<Row>,
}

impl Rows<'_> {
    fn judge(&mut self, taught_on: &'static str, errors: ErrorReport) {
        self.judged.push(Judged { taught_on, errors });
        self.tell();
    }

    /// A row; refuses values that are not the CPU's.
    fn add(&mut self, what: &str, gpu: f64, cpu: f64, difference: Option<f32>) -> Result<()> {
        self.rows.push(Row {
            what: what.to_owned(),
            gpu_seconds: gpu,
            cpu_seconds: cpu,
            largest_difference: difference,
        });
        self.tell();
        let most = difference.unwrap_or(0.0);
        ensure!(most <= TOLERANCE, "{what}: values of the GPU and of the CPU are {most:.1e} apart");
        ensure!(!interrupt::requested(), "interrupted");
        Ok(())
    }

    fn tell(&mut self) {
        let Self { part, teacher, judged, rows } = self;
        part.text = format!("{teacher}\n");
        for Judged { taught_on, errors } in &*judged {
            let ErrorReport { mse, mpe, .. } = errors;
            part.text += &format!("Taught on the {taught_on}: MSE {mse:.2e}, MPE {mpe:.4}.\n");
        }
        let cells: Vec<Vec<String>> = rows
            .iter()
            .map(|row| {
                let Row { what, gpu_seconds: gpu, cpu_seconds: cpu, largest_difference } = row;
                let difference = largest_difference.map_or("–".to_owned(), |most| format!("{most:.1e}"));
                vec![
                    what.clone(),
                    format!("{gpu:.4}"),
                    format!("{cpu:.4}"),
                    format!("{:.2}", cpu / gpu),
                    difference,
                ]
            })
            .collect();
        let head = ["", "s on the GPU", "s on the CPU", "times as fast", "largest difference"];
        part.text += &format!("\n{}", table(&head, &cells));
        part.found = json!({ "judged": judged, "rows": rows });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_number_is_the_largest_difference() {
        assert_eq!(largest(&[1.0, 2.0], &[1.5, 2.25]).unwrap(), 0.5);
        for place in 0..3 {
            let mut found = [1.0; 3];
            found[place] = f32::NAN;
            assert!(largest(&found, &[1.0; 3]).unwrap().is_nan());
        }
        assert!(largest(&[], &[1.0]).is_err());
        let mut part = Part::default();
        let mut rows = Rows { part: &mut part, teacher: String::new(), judged: Vec::new(), rows: Vec::new() };
        rows.add("fine", 1.0, 2.0, Some(1e-6)).unwrap();
        let refused = rows.add("apart", 1.0, 2.0, Some(f32::NAN)).unwrap_err().to_string();
        assert!(refused.contains("apart"), "{refused}");
        assert!(part.text.contains("fine") && part.text.contains("apart"), "{}", part.text);
    }
}
