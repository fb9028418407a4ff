//! The bracket of the examples: a coarse one, with a harmonic field made in a moment.

use std::sync::Arc;

use imf_core::control::Control;
use imf_core::parts::ReferencePart;
use imf_core::scene::SceneSpec;
use imf_core::section::{At, SectionPlan};
use imf_core::tool::{Clearance, Tool};
use imf_fields::field::Field;
use imf_fields::file::FieldFile;
use imf_fields::harmonic::basis::Domain;
use imf_fields::harmonic::file::HarmonicFile;
use imf_fields::harmonic::{FitSettings, fit};

/// The field of the paper's tool, its holder grown by `clearance`. A program would load it: `Field::load`.
pub(crate) fn field(clearance: f64) -> Result<Field, Box<dyn std::error::Error>> {
    let scene = SceneSpec::of_reference(
        ReferencePart::Bracket,
        &ReferencePart::Bracket.mesh(),
        [17, 49, 29],
        &Tool::paper(),
    )
    .scene()?
    .with_clearance(&Clearance::around_holder_and_shank(clearance))?;
    let settings = FitSettings { degree: 6, sections_per_function: 2.0, axes: 49, ..FitSettings::default() };
    let made =
        fit(&SectionPlan::of_scene(&scene, At::Tip)?, Domain::Directions, &settings, Control::quiet())?;
    let file = HarmonicFile { field: made, scene, settings, calibration: None };
    Ok(Field::new(FieldFile::Harmonic(Arc::new(file)))?)
}
