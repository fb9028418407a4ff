//! The bracket of the examples: a coarse one, with a harmonic field made in a moment.

use std::error::Error;
use std::sync::Arc;

use imf_core::control::Control;
use imf_core::parts::ReferencePart;
use imf_core::scene::Scene;
use imf_core::tool::Clearance;
use imf_fields::field::Field;
use imf_fields::file::FieldFile;
use imf_fields::harmonic::FitSettings;
use imf_fields::harmonic::file::HarmonicFile;

/// The field of the paper's tool, its holder offset by `clearance`, with as many voxels around the part as `margin` says. A
/// program would load it: `Field::load`.
pub(crate) fn field(clearance: f64, margin: usize, settings: FitSettings) -> Result<Field, Box<dyn Error>> {
    let dims = [17, 49, 29].map(|n| n + 2 * margin);
    let part = Scene::builder().reference(ReferencePart::Bracket).dims(dims).margin(margin);
    let scene = part.build()?.scene.with_clearance(&Clearance::around_holder_and_shank(clearance))?;
    let file = HarmonicFile::fit(&scene, &settings, Control::quiet())?;
    Ok(Field::new(FieldFile::Harmonic(Arc::new(file)))?)
}

/// Of a field of overlaps.
#[allow(dead_code, reason = "not every example has one")]
pub(crate) fn overlaps() -> FitSettings {
    FitSettings { degree: 6, sections_per_function: 2.0, components: 49, ..FitSettings::default() }
}
