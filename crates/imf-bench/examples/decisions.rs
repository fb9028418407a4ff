//! What the decisions of a field are worth: overlaps beside signed depths, harmonic and factored, on a reference part with
//! a clearance of two voxels around the whole tool.
//!
//! `cargo run --release -p imf-bench --example decisions -- PART SCALE DEGREE overlap|depth [TEACHING_STEPS [POSES]]`

use std::sync::Arc;

use std::error::Error;
use std::str::FromStr;
use std::time::Instant;

use imf_core::control::Control;
use imf_core::parts::ReferencePart;
use imf_core::scene::SceneSpec;
use imf_core::section::{At, Quantity, SectionPlan};
use imf_core::tool::{Clearance, Tool};
use imf_fields::calibration::{Calibration, Judgement};
use imf_fields::factored::file::FactoredFile;
use imf_fields::factored::{DistillSettings, FactoredField};
use imf_fields::field::Field;
use imf_fields::field::calibrate::{CalibrationSettings, calibrate, judge};
use imf_fields::file::FieldFile;
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::coefficients::Precision;
use imf_fields::harmonic::file::HarmonicFile;
use imf_fields::harmonic::{FitSettings, fit};
use imf_fields::recipe::Length;
use imf_fields::recipe::Optimiser;
use imf_fields::recipe::SoapConfig;
use imf_fields::recipe::schedule::Schedule;
use imf_train::distill::distil;

/// Clearance around all elements, in voxels.
const CLEARANCE: f64 = 2.0;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let word = |place: usize, default: &str| arguments.get(place).cloned().unwrap_or_else(|| default.into());
    let part = ReferencePart::from_str(&word(0, "teapot"))?;
    let (scale, degree): (f64, usize) = (word(1, "0.5").parse()?, word(2, "14").parse()?);
    let quantity = if word(3, "depth") == "overlap" { Quantity::Overlap } else { Quantity::Depth };
    let (steps, uniform): (u64, usize) = (word(4, "0").parse()?, word(5, "400000").parse()?);

    let dims = part.dims().map(|n| (n as f64 * scale).round() as usize);
    let scene = SceneSpec::of_reference(part, &part.mesh(), dims, &Tool::paper()).scene()?;
    let room = CLEARANCE * scene.record.grid.pitch;
    let scene = scene.with_clearance(&Clearance { holder: room, shank: room, cutter: room })?;
    let settings = FitSettings { quantity, degree, sections_per_function: 2.0, ..FitSettings::default() };
    let begun = Instant::now();
    let made =
        fit(&SectionPlan::of_scene(&scene, At::Tip)?, Domain::Directions, &settings, Control::quiet())?;
    println!(
        "{} {dims:?}, {quantity:?}, degree {degree}: made in {:.1} s, {:?}",
        part.name(),
        begun.elapsed().as_secs_f64(),
        made.report
    );
    let taught = if steps > 0 {
        let defaults = DistillSettings::default();
        let settings = DistillSettings {
            width: 256,
            omega: 20.0,
            plan: imf_fields::recipe::TrainingPlan {
                length: Length::Steps(steps),
                schedule: Schedule::Cosine { initial: 1.5e-3, last: 0.0, warmup: 10 },
                ..defaults.plan
            },
            optimiser: Optimiser::Soap(SoapConfig::default()),
            ..defaults
        };
        let begun = Instant::now();
        let (mut state, mut loss) = (settings.start(made.axis_count()), 0.0);
        distil(&made, &settings, &mut state, Control::quiet(), &mut |report| loss = report.mean_loss)?;
        println!(
            "taught in {:.1} s, mean squared error from the teacher {loss:.2e}",
            begun.elapsed().as_secs_f64()
        );
        let field = FactoredField::new(&made, settings.shape(made.axis_count()), state.training.parameters)?;
        Some((field, settings))
    } else {
        None
    };
    let (report, fit) = (made.report, settings);
    let harmonic = HarmonicFile { field: made, scene: scene.clone(), settings, calibration: None };
    tell("harmonic", FieldFile::Harmonic(Arc::new(harmonic)), uniform)?;
    if let Some((field, settings)) = taught {
        let precision = Precision::F32;
        let file =
            FactoredFile { field, scene, fit, report, settings, precision, state: None, calibration: None };
        tell("factored", FieldFile::Factored(Box::new(file)), uniform)?;
    }
    Ok(())
}

/// Calibrates a field and judges it on fresh poses.
fn tell(name: &str, stored: FieldFile, uniform: usize) -> Result<(), Box<dyn Error>> {
    let field = Field::new(stored)?;
    let settings = CalibrationSettings { uniform, boundary: uniform / 8, ..CalibrationSettings::default() };
    let begun = Instant::now();
    let calibration: Calibration = calibrate(&field, &settings, Control::quiet())?;
    println!(
        "{name}: free up to {:?}, colliding from {:?}, calibrated in {:.1} s",
        calibration.free_up_to,
        calibration.colliding_from,
        begun.elapsed().as_secs_f64()
    );
    line("uniform, judged", &calibration.uniform);
    line("at contact", &calibration.boundary);
    let fresh = CalibrationSettings { seed: 1, ..settings };
    let [uniform, boundary] = judge(&field, &calibration, &fresh, Control::quiet())?;
    line("uniform, fresh", &uniform);
    line("at contact, fresh", &boundary);
    Ok(())
}

fn line(name: &str, judged: &Judgement) {
    println!(
        "  {name:<18} false-free {} of {} (≤ {:.1e}), false-colliding {:.2} % (≤ {:.2} %), undecided {:.2} %, clear found free \
         {:.2} %, largest error {:.3}",
        judged.false_free.wrong,
        judged.false_free.of,
        judged.false_free.bound,
        100.0 * judged.false_colliding.share(),
        100.0 * judged.false_colliding.bound,
        100.0 * judged.undecided_share(),
        100.0 * judged.found_free as f64 / judged.false_colliding.of.max(1) as f64,
        judged.largest_error
    );
}
