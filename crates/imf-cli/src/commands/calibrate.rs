//! `imf calibrate`: thresholds of a field's decisions and their error rates, saved in its file.

use std::fmt::Write;
use std::path::Path;

use anyhow::{Result, bail};
use imf_core::field::PoseField as _;
use imf_core::section::Quantity;
use imf_core::tool::ToolShape;
use imf_fields::calibration::{Calibration, DecisionRates, Rate};
use imf_fields::field::Field;
use imf_fields::field::calibrate::{CHUNK, CalibrationError, CalibrationSettings, calibrate, measure_rates};
use imf_fields::file::FieldFile;
use serde_json::{Value, json};

use crate::arguments::saved::CalibrateArguments;
use crate::exit::WrongArgument;
use crate::interrupt::{self, Interruption};
use crate::output::{OutputFile, print_written, short};
use crate::session::{Session, show_bytes};

pub(crate) fn run(session: &Session, arguments: &CalibrateArguments) -> Result<()> {
    let out = arguments.out.as_ref().unwrap_or(&arguments.field);
    let out = (!arguments.verify).then(|| OutputFile::check(out)).transpose()?;
    let settings = arguments.settings();
    // The file's bytes, and the field that they become; a file that is not there is named when it is read.
    let field = 2 * std::fs::metadata(&arguments.field).map_or(0, |file| file.len());
    session.require_memory(settings.memory_bytes().saturating_add(field), || {
        format!(
            "{} random poses and {} at contact, beside the field; use fewer --poses or --boundary",
            settings.uniform, settings.boundary
        )
    })?;
    let field = Field::load(&arguments.field)?;
    let known = field.calibration().copied();
    let (quantity, unit) = (field.quantity(), field.scene().record.unit);
    let (name, units, found) = if arguments.verify {
        let Some(known) = known else {
            bail!("{} was never calibrated: leave out --verify", arguments.field.display());
        };
        if known.seed == arguments.seed {
            let why = format!("--seed {} drew the poses of the calibration: choose another one", known.seed);
            return Err(WrongArgument(why).into());
        }
        let units = settings.uniform.div_ceil(CHUNK) + settings.boundary.div_ceil(CHUNK);
        ("judging", units as u64, Some(known))
    } else {
        ("calibrating", settings.units(), None)
    };
    let stage = session.stage(name, "batches", units);
    let advance = |n| stage.advance(n);
    let control = session.control(&advance);
    let calibration = match found {
        Some(known) => measure_rates(&field, &known, &settings, control).map(|[uniform, boundary]| {
            Calibration { uniform, boundary, goals: settings.goals, seed: settings.seed, ..known }
        }),
        None => calibrate(&field, &settings, control),
    }?;
    stage.finish(if calibration.meets_its_goals() { "goals met" } else { "goals missed" });
    // Two of a field need not be in memory at once.
    drop(field);
    let write = |out: OutputFile| -> Result<()> {
        let out = out.begin()?;
        keep(&arguments.field, calibration, out)?;
        session.note(&format!("wrote {}", out.display()));
        Ok(())
    };
    let written = out.map_or(Ok(()), write);
    let json = json!({
        "field": arguments.field, "quantity": quantity, "unit": unit, "verified": arguments.verify, "meets_its_goals": calibration.meets_its_goals(),
        "calibration": calibration, "verdict": calibration.verdict(),
    });
    let shown = |value: f64| threshold_text(value, quantity, unit);
    let words = format!("{}Verdict: {}.", text(&calibration, quantity, &shown), calibration.verdict());
    print_written(session, &json, &words, written)
}

/// Error rates of a field's decisions, or why they are not known.
pub(crate) enum DecisionQuality {
    Known(Box<Calibration>),
    /// Not, because.
    Unknown(String),
}

impl DecisionQuality {
    pub(crate) fn calibration(&self) -> Option<&Calibration> {
        match self {
            Self::Known(calibration) => Some(calibration),
            Self::Unknown(_) => None,
        }
    }

    /// What the field may be used for, in a sentence.
    pub(crate) fn text(&self) -> String {
        match self {
            Self::Known(calibration) => format!("Verdict: {}.", calibration.verdict()),
            Self::Unknown(why) => format!("Verdict: none, decisions are not calibrated: {why}."),
        }
    }

    pub(crate) fn json(&self) -> Value {
        match self {
            Self::Known(calibration) => json!(calibration.verdict()),
            Self::Unknown(why) => json!({ "usable_for": null, "text": why }),
        }
    }
}

/// Measures the error rates of the decisions of a field that takes `held` bytes, with more poses where too few
/// collide to resolve the required rate; `kept` says what an interruption leaves.
pub(crate) fn measure_decisions(
    session: &Session,
    field: &Field,
    held: u64,
    kept: &str,
) -> Result<DecisionQuality> {
    if matches!(field.scene().record.bare_tool().shape, ToolShape::Mesh(_)) {
        let why = "a mesh tool is voxelised at every pose, which may take hours (imf calibrate does it)";
        return Ok(DecisionQuality::Unknown(why.into()));
    }
    let mut settings = CalibrationSettings::default();
    interrupt::leave(kept.to_owned().into());
    loop {
        let (needed, limit) = (settings.memory_bytes().saturating_add(held), session.memory_limit);
        if needed > limit {
            return Ok(DecisionQuality::Unknown(no_room(needed, limit)));
        }
        let stage = session.stage("calibrating", "batches", settings.units());
        let advance = |n| stage.advance(n);
        match calibrate(field, &settings, session.control(&advance)) {
            Err(CalibrationError::Cancelled(_)) => return Err(Interruption(kept.to_owned()).into()),
            Err(CalibrationError::TooFew { colliding, .. })
                if let Some(more) = settings.with_more_poses(colliding) =>
            {
                stage.finish("too few poses collide; more are drawn");
                settings = more;
            }
            Err(error) => {
                stage.finish("not calibrated");
                return Ok(DecisionQuality::Unknown(error.to_string()));
            }
            Ok(calibration) => {
                stage.finish(if calibration.meets_its_goals() { "goals met" } else { "goals missed" });
                return Ok(DecisionQuality::Known(Box::new(calibration)));
            }
        }
    }
}

fn no_room(needed: u64, limit: u64) -> String {
    format!(
        "that takes about {} of memory, and {} may be used; imf calibrate does it where there is more",
        show_bytes(needed),
        show_bytes(limit)
    )
}

/// Calibrates a field just written and saves the calibration in its file: the last step of making or training one. Where that is
/// not possible the file stays as it is.
pub(super) fn calibrate_written(session: &Session, path: &Path, wanted: bool) -> Result<DecisionQuality> {
    if !wanted {
        return Ok(DecisionQuality::Unknown("calibration was skipped (imf calibrate does it)".into()));
    }
    // The file's bytes, and the field that they become.
    let (needed, limit) = (2 * std::fs::metadata(path)?.len(), session.memory_limit);
    if needed > limit {
        return Ok(DecisionQuality::Unknown(no_room(needed, limit)));
    }
    let field = Field::load(path)?;
    if let Some(known) = field.calibration() {
        return Ok(DecisionQuality::Known(Box::new(*known)));
    }
    let kept = format!("{} is written; imf calibrate goes on", path.display());
    let quality = measure_decisions(session, &field, needed, &kept)?;
    drop(field);
    if let Some(&calibration) = quality.calibration() {
        keep(path, calibration, path)?;
    }
    Ok(quality)
}

/// Writes a field with error rates of its decisions.
fn keep(field: &Path, calibration: Calibration, out: &Path) -> Result<()> {
    let mut saved = FieldFile::read(field)?;
    saved.set_calibration(calibration);
    Ok(saved.write(out)?)
}

/// A value of a field in words: a length in a scene's unit, or a fraction.
pub(crate) fn threshold_text(value: f64, quantity: Quantity, unit: impl std::fmt::Display) -> String {
    match quantity {
        Quantity::Depth => format!("{} {unit}", short(value)),
        Quantity::Overlap => format!("{value:.3e}"),
    }
}

/// The record as a table; `shown` is of a value in words.
fn text(calibration: &Calibration, quantity: Quantity, shown: &dyn Fn(f64) -> String) -> String {
    let threshold = |value: Option<f32>| value.map_or("never".into(), |v| shown(f64::from(v)));
    let goals = &calibration.goals;
    let mut text = format!(
        "free up to {}, colliding from {}; bounds at {} % confidence, goals {:.1e} false-free and {:.1e} false-colliding\n",
        threshold(calibration.free_up_to),
        threshold(calibration.colliding_from),
        goals.confidence * 100.0,
        goals.false_free,
        goals.false_colliding
    );
    for (name, judged) in [("anywhere", &calibration.uniform), ("at contact", &calibration.boundary)] {
        // Writing to a string does not fail.
        let _ = writeln!(text, "{name:<10}  {}", decision_rates(judged, quantity, shown));
    }
    text
}

/// One kind of poses in a line.
pub(crate) fn decision_rates(
    judged: &DecisionRates,
    quantity: Quantity,
    shown: &dyn Fn(f64) -> String,
) -> String {
    let rate = |rate: &Rate| {
        format!("{} of {} ({:.1e}, at most {:.1e})", rate.wrong, rate.of, rate.fraction(), rate.bound)
    };
    format!(
        "{} poses: colliding called free {}; clear called colliding {}; undecided {:.2} %; {} {}",
        judged.poses,
        rate(&judged.false_free),
        rate(&judged.false_colliding),
        100.0 * judged.undecided_fraction(),
        match quantity {
            Quantity::Overlap => "largest error at some of them",
            Quantity::Depth => "farthest on the wrong side",
        },
        shown(judged.largest_error)
    )
}
