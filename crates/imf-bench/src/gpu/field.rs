//! A factored field of the scene, distilled on the GPU and on the CPU, and the harmonic field that it is distilled from; their minima
//! at every voxel, the first one's errors at random orientations, its sections and its values at random poses, by both.

use anyhow::{Result, ensure};
use imf_cli::commands::train::harmonic::fit_field;
use imf_cli::engine::Device;
use imf_cli::interrupt;
use imf_cli::session::Session;
use imf_core::control::Control;
use imf_core::field::{Gradient, GridField, PoseField};
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::pose::Pose;
use imf_core::scene::Scene;
use imf_core::section::{SectionPlan, ToolPoints, sections};
use imf_fields::factored::DistillSettings;
use imf_fields::file::FieldFile;
use imf_fields::harmonic::FitSettings;
use imf_fields::harmonic::basis::Domain;
use imf_fields::metrics::{ErrorReport, Errors};
use imf_fields::recipe::TrainingLength;
use imf_gpu::{Gpu, GpuField};
use rayon::prelude::*;
use serde::Serialize;
use serde_json::json;

use super::Part;
use crate::candidates::{distilled, symmetric};
use crate::document::Document;
use crate::measurement::{better_seconds, seconds};
use crate::query::random_poses;

/// How much is measured.
pub(super) struct Sizes {
    /// Of the harmonic field.
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
/// Differences above this, of overlaps or of the largest slope, are not roundings: some 1e-6 was seen.
const TOLERANCE: f32 = 1e-4;
/// Orientations whose sections are compared.
const COMPARED: usize = 4;
/// Poses that one thread of the CPU evaluates at a time.
const POSES: usize = 256;

pub(super) fn measured(
    session: &Session,
    gpu: &Gpu,
    scene: &Scene,
    sizes: &Sizes,
    part: &mut Part,
) -> Result<()> {
    let (grid, plan) = (scene.record.grid, SectionPlan::of_scene(scene, ToolPoints::Tip)?);
    let domain = Domain::Directions;
    let fit = FitSettings { degree: sizes.degree, ..FitSettings::for_distillation(domain) };
    let (time, harmonic) = seconds(|| fit_field(session, scene, &plan, domain, fit, SMALLER))?;
    let settings = DistillSettings {
        width: sizes.width,
        ..DistillSettings::of_length(TrainingLength::Steps(sizes.steps))
    };
    let settings = symmetric(&harmonic, settings);
    let [x, y, z] = grid.dims;
    let about = format!(
        "Teapot {x}×{y}×{z}; the harmonic field of degree {} took {time:.2} s on the CPU. Errors are at {} random orientations.",
        sizes.degree, sizes.random
    );
    let mut rows = Rows { part, about, judged: Vec::new(), rows: Vec::new() };
    let (gpu_time, by_gpu) = seconds(|| distilled(session, &Device::Gpu(gpu.clone()), &harmonic, settings))?;
    let (cpu_time, by_cpu) = seconds(|| distilled(session, &Device::Cpu, &harmonic, settings))?;
    rows.add(&format!("{} steps of {}", sizes.steps, by_gpu.field.shape), gpu_time, cpu_time, None)?;
    let sets = sizes.minima.iter().map(|set| Ok((*set, OrientationSet::parse(set)?.orientations)));
    let sets: Vec<(&str, Vec<Orientation>)> = sets.collect::<Result<_>>()?;
    let on_device = GpuField::new(gpu, FieldFile::Harmonic(harmonic.into()))?;
    // The first call uploads.
    let (time, _) = seconds(|| Ok(on_device.minimum(&sets[0].1[..1], Control::quiet())?))?;
    rows.about += &format!(" Its coefficients went up in {time:.2} s.");
    minima(&on_device, &sets, " by that harmonic field", &mut rows)?;
    drop(on_device);

    // The sections at random orientations, exact and of a field.
    let needed = grid.len() * 2 * size_of::<f32>() * sizes.random;
    session.require_memory(needed as u64, || format!("{} sections; {SMALLER}", sizes.random))?;
    let random = OrientationSet::parse(&format!("random:{}:1", sizes.random))?.orientations;
    let exact = sections(&plan, &random, session.control(&|_| {}))?;
    drop(plan);
    let on_gpu = |file| GpuField::new(gpu, FieldFile::Factored(Box::new(file)));
    let (on_device, of_cpu) = (on_gpu(by_gpu)?, on_gpu(by_cpu)?);
    for (by, field) in [("GPU", &on_device), ("CPU", &of_cpu)] {
        rows.judge(by, errors(field, &random, &exact)?);
    }
    drop((exact, of_cpu));

    let few = &random[..COMPARED.min(random.len())];
    let [mut found, mut twin] = [0; 2].map(|_| vec![0.0; grid.len() * few.len()]);
    let (gpu_time, ()) = better_seconds(|| Ok(on_device.sections(few, &mut found)?))?;
    let (cpu_time, ()) = better_seconds(|| Ok(on_device.twin().sections(few, &mut twin)?))?;
    let difference = Some(largest(&found, &twin)?);
    rows.add(&format!("{} sections, read back", few.len()), gpu_time, cpu_time, difference)?;
    minima(&on_device, &sets, "", &mut rows)?;
    let poses = random_poses(&grid, sizes.poses, 1)?;
    at_poses(&on_device, &poses, &mut rows)
}

/// Minima at every voxel.
fn minima(field: &GpuField, sets: &[(&str, Vec<Orientation>)], by: &str, rows: &mut Rows<'_>) -> Result<()> {
    for (set, orientations) in sets {
        let (gpu_time, found) = better_seconds(|| Ok(field.minimum(orientations, Control::quiet())?))?;
        let (cpu_time, twin) =
            better_seconds(|| Ok(field.twin().minimum(orientations, Control::quiet())?))?;
        let difference = Some(largest(&found.value, &twin.value)?);
        rows.add(&format!("IMF over {set}{by}"), gpu_time, cpu_time, difference)?;
    }
    Ok(())
}

/// Random poses, values and gradients.
fn at_poses(field: &GpuField, poses: &[Pose], rows: &mut Rows<'_>) -> Result<()> {
    // The first call compiles and uploads.
    field.values(&poses[..1], &mut [0.0])?;
    let (mut found, mut twin) = (vec![0.0; poses.len()], vec![0.0; poses.len()]);
    let (gpu_time, ()) = better_seconds(|| Ok(field.values(poses, &mut found)?))?;
    let (cpu_time, ()) = better_seconds(|| {
        let parts = poses.par_chunks(POSES).zip(twin.par_chunks_mut(POSES));
        Ok(parts.try_for_each(|(poses, values)| field.twin().values(poses, values))?)
    })?;
    rows.add(&format!("{} poses", poses.len()), gpu_time, cpu_time, Some(largest(&found, &twin)?))?;

    let (mut found, mut twin) = (vec![Gradient::NAN; poses.len()], vec![Gradient::NAN; poses.len()]);
    let (gpu_time, ()) = better_seconds(|| Ok(field.gradients(poses, &mut found)?))?;
    let (cpu_time, ()) = better_seconds(|| {
        let parts = poses.par_chunks(POSES).zip(twin.par_chunks_mut(POSES));
        Ok(parts.try_for_each(|(poses, found)| field.twin().gradients(poses, found))?)
    })?;
    let slopes = |found: &[Gradient]| -> Vec<f32> {
        found.iter().flat_map(|g| g.position.to_array().into_iter().chain(g.direction.to_array())).collect()
    };
    let (slopes, expected) = (slopes(&found), slopes(&twin));
    let scale = expected.iter().fold(0.0f32, |most, slope| most.max(slope.abs()));
    let difference = largest(&slopes, &expected)? / scale;
    rows.add(&format!("{} with gradients", poses.len()), gpu_time, cpu_time, Some(difference))
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
    /// Of the values of one field, or of slopes over the largest; nothing too where one is not a number, which ends
    /// the part.
    largest_difference: Option<f32>,
}

/// Errors of a field that one of them distilled.
#[derive(Serialize)]
struct DistilledErrors {
    by: &'static str,
    errors: ErrorReport,
}

/// What was found, which the part has after every row.
struct Rows<'a> {
    part: &'a mut Part,
    about: String,
    judged: Vec<DistilledErrors>,
    rows: Vec<Row>,
}

impl Rows<'_> {
    fn judge(&mut self, by: &'static str, errors: ErrorReport) {
        self.judged.push(DistilledErrors { by, errors });
        self.update();
    }

    /// A row; refuses values that are not the CPU's.
    fn add(&mut self, what: &str, gpu: f64, cpu: f64, difference: Option<f32>) -> Result<()> {
        self.rows.push(Row {
            what: what.to_owned(),
            gpu_seconds: gpu,
            cpu_seconds: cpu,
            largest_difference: difference,
        });
        self.update();
        let most = difference.unwrap_or(0.0);
        ensure!(most <= TOLERANCE, "{what}: values of the GPU and of the CPU are {most:.1e} apart");
        ensure!(!interrupt::requested(), "interrupted");
        Ok(())
    }

    fn update(&mut self) {
        let Self { part, about, judged, rows } = self;
        let mut document = Document::default();
        document.paragraph(about.as_str());
        for DistilledErrors { by, errors: ErrorReport { mse, mpe, .. } } in &*judged {
            document.paragraph(format!("Distilled on the {by}: MSE {mse:.2e}, MPE {mpe:.4}."));
        }
        let cells = rows.iter().map(|row| {
            let Row { what, gpu_seconds: gpu, cpu_seconds: cpu, largest_difference } = row;
            let difference = largest_difference.map_or("–".to_owned(), |most| format!("{most:.1e}"));
            let times = [gpu, cpu].map(|time| format!("{time:.4}"));
            let ratio = format!("{:.2}", cpu / gpu);
            [what.clone()].into_iter().chain(times).chain([ratio, difference]).collect()
        });
        let head = ["", "s on the GPU", "s on the CPU", "times as fast", "largest difference"];
        document.table(&head, cells.collect());
        part.document = document;
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
        let mut rows = Rows { part: &mut part, about: String::new(), judged: Vec::new(), rows: Vec::new() };
        rows.add("fine", 1.0, 2.0, Some(1e-6)).unwrap();
        let refused = rows.add("apart", 1.0, 2.0, Some(f32::NAN)).unwrap_err().to_string();
        assert!(refused.contains("apart"), "{refused}");
        let text = part.document.markdown();
        assert!(text.contains("fine") && text.contains("apart"), "{text}");
    }
}
