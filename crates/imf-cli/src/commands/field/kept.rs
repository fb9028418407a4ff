//! `imf sections`: sections of a field that was kept or trained, or the least of them, with no exact section counted.

use anyhow::{Context as _, Result, bail};
use imf_core::orientation::OrientationSet;
use imf_core::section::Quantity;
use imf_fields::file::FieldFile;
use imf_fields::harmonic::basis::Domain;

use super::approximate::Approximate;
use super::{Values, Work, note_of_rolls};
use crate::arguments::sections::SectionsArguments;
use crate::commands::notes;
use crate::engine::Device;
use crate::output::OutputFolder;
use crate::session::Session;

pub(crate) fn run(session: &Session, arguments: &SectionsArguments) -> Result<()> {
    let set = OrientationSet::parse(&arguments.orientations)?;
    let folder = OutputFolder::check(&arguments.out)?;
    let path = arguments.field.display();
    let stored = FieldFile::read(&arguments.field)
        .context("sections are of a field that was kept, by imf train, imf compress or imf field --save")?;
    if stored.quantity() == Quantity::Depth {
        bail!("{path} is a field of depth, which is asked for poses: see imf query and imf check");
    }
    let scene = stored.scene().clone();
    let record = &scene.record;
    if stored.basis().is_some_and(|basis| basis.domain() == Domain::Rotations) {
        note_of_rolls(session, &set);
    }
    let field = Approximate::kept(stored, arguments.refine)?;
    notes::of_scene(session, record);
    if let FieldFile::Siren(model) = field.stored() {
        notes::of_training(session, &arguments.field, model);
    }
    let device = Device::for_field(&arguments.device.device, session, field.stored())?;
    Work { session, folder, scene: &scene, device: &device, values: Values::Approximate(&field), set: &set }
        .run(arguments.imf)
}
