//! `imf train harmonic`: a fit to exact sections, which gives values at any orientation.

use anyhow::Result;
use imf_core::scene::Scene;
use imf_core::section::{Quantity, SectionPlan, ToolPoints};
use imf_core::unit::LengthUnit;
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::file::HarmonicFile;
use imf_fields::harmonic::{FitReport, FitSettings, HarmonicField, fit, section_count};
use imf_fields::metrics::Validation;
use serde_json::json;

use crate::arguments::harmonic::HarmonicArguments;
use crate::arguments::quantity::scene_of;
use crate::commands::calibrate;
use crate::output::{OutputFile, print_result, short};
use crate::session::Session;

pub(super) fn run(session: &Session, arguments: &HarmonicArguments) -> Result<()> {
    let out = OutputFile::check(&arguments.out)?;
    let quantity = arguments.quantity.of(&arguments.scene);
    let scene =
        scene_of(quantity, &arguments.explicit, &arguments.scene).scene_with(session, &arguments.contact)?;
    // A field that is saved is of the tip, which serves every sharp point: turning a tool of revolution about its axis moves
    // its sharp points, not the overlap at its tip.
    let plan = SectionPlan::of_scene(&scene, ToolPoints::Tip)?;
    let domain = Domain::of_tool(scene.record.bare_tool());
    let settings = arguments.settings(domain, quantity);
    let smaller = "use a lower --degree, fewer --components, or a larger --pitch";
    let file = fit_field(session, &scene, &plan, domain, settings, smaller)?;
    drop(plan);
    let path = out.begin()?;
    file.write(path)?;
    let (text, settings, report, bytes) =
        (describe(&file), file.settings, file.field.report, file.field.bytes());
    // Two of a field need not be in memory at once.
    drop(file);
    let quality = calibrate::calibrate_written(session, path, !arguments.no_calibrate)?;
    let json = json!({
        "field": path, "settings": settings, "report": report, "bytes": bytes, "scene": scene.record,
        "verdict": quality.json(),
    });
    print_result(session, &json, &format!("{}: {text}\n{}", path.display(), quality.text()))
}

/// A field and its errors, as text.
pub(crate) fn describe(file: &HarmonicFile) -> String {
    let FitReport { functions, sections, .. } = &file.field.report;
    format!(
        "{functions} harmonics of degree {} fitted to {sections} exact sections, {} components; {}",
        file.settings.degree,
        file.field.component_count(),
        errors_text(&file.field, file.scene.record.unit),
    )
}

/// What is known of the errors of a fit.
pub(crate) fn errors_text(field: &HarmonicField, unit: LengthUnit) -> String {
    let report = &field.report;
    let left_out = match report.dropped {
        0.0 => String::new(),
        dropped => format!(", {dropped:.1e} of it by the components left out"),
    };
    validation_text(&report.validation, field.quantity, unit) + &left_out
}

/// An error with its standard error; of depths its root as a length too.
pub(crate) fn validation_text(told: &Validation, quantity: Quantity, unit: LengthUnit) -> String {
    let Validation { orientations, mse, standard_error, mpe } = told;
    let at = format!(
        "at {orientations} random orientations that were not fitted MSE {mse:.2e} ± {standard_error:.1e}"
    );
    match quantity {
        Quantity::Overlap => format!("{at}, largest error {mpe:.3}"),
        Quantity::Depth => {
            format!("{at} {unit}² (root {} {unit}), largest error {} {unit}", short(mse.sqrt()), short(*mpe))
        }
    }
}

/// The field of a scene from as many exact sections as the settings require; `smaller` says what takes less memory.
pub fn fit_field(
    session: &Session,
    scene: &Scene,
    plan: &SectionPlan,
    domain: Domain,
    mut settings: FitSettings,
    smaller: &str,
) -> Result<HarmonicFile> {
    let [one, two] =
        [true, false].map(|one_pass| FitSettings { one_pass, ..settings }.memory_with(plan, domain).0);
    settings.one_pass = one <= session.memory_limit.max(two);
    let needed = if settings.one_pass { one } else { two };
    session.require_memory(needed, || {
        let components = settings.sizes(domain).components;
        format!("a harmonic field of degree {} along {components} components; {smaller}", settings.degree)
    })?;
    let stage = session.stage("sections to fit", "sections", section_count(domain, &settings) as u64);
    let advance = |sections| stage.advance(sections);
    let field = fit(plan, domain, &settings, session.control(&advance))?;
    stage.finish(&errors_text(&field, scene.record.unit));
    // As its file would have them, which does not distinguish one pass from two: what is distilled from it is resumed
    // by a fit in either.
    let settings = FitSettings { one_pass: true, ..settings };
    Ok(HarmonicFile { field, scene: scene.clone(), settings, calibration: None })
}
