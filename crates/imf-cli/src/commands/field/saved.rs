//! `imf field FIELD`: sections of a saved field, or their minimum, with no exact section counted.

use std::path::Path;

use anyhow::{Result, bail};
use imf_core::orientation::OrientationSet;
use imf_core::section::Quantity;
use imf_fields::file::FieldFile;
use imf_fields::harmonic::basis::Domain;

use super::approximate::Approximate;
use super::{Values, Work, note_of_rolls};
use crate::arguments::field::FieldArguments;
use crate::commands::notes;
use crate::engine::Device;
use crate::output::OutputFolder;
use crate::session::Session;

pub(super) fn run(session: &Session, arguments: &FieldArguments) -> Result<()> {
    let (set, out) = arguments.check_of_saved()?;
    let set = OrientationSet::parse(set)?;
    let folder = OutputFolder::check(out)?;
    let path = Path::new(&arguments.scene.part);
    let stored = FieldFile::read(path)?;
    if stored.quantity() == Quantity::Depth {
        bail!(
            "{} is a field of depth, which is asked for poses: see imf query and imf check",
            path.display()
        );
    }
    let scene = stored.scene().clone();
    let record = &scene.record;
    if stored.basis().is_some_and(|basis| basis.domain() == Domain::Rotations) {
        note_of_rolls(session, &set);
    }
    let field = Approximate::kept(stored, arguments.harmonic.refine)?;
    notes::of_scene(session, record);
    if let FieldFile::Siren(model) = field.stored() {
        notes::of_training(session, path, model);
    }
    let device = Device::for_field(arguments.device_or("auto"), session, field.stored())?;
    Work { session, folder, scene: &scene, device: &device, values: Values::Approximate(&field), set: &set }
        .run(arguments.imf)
}
