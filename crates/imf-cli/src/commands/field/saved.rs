//! Values of a saved field of any family: its sections, and their minimum, with nothing counted.

use anyhow::Result;
use glam::DVec3;
use imf_core::control::Cancelled;
use imf_core::section::Imf;
use imf_fields::file::FieldFile;
use imf_fields::harmonic::DIRECTIONS_AT_ONCE;
use imf_fields::harmonic::basis::Basis;
use serde_json::{Value, json};

use super::Work;
use crate::commands::train::harmonic::{describe, errors_text};
use crate::engine::{Device, Workload};
use crate::interrupt;
use crate::report::Subject;

/// Sections evaluated at a time.
const AT_ONCE: usize = 16;

/// Arrays that an inaccessibility measure is written from: values, places in the list, and angles.
const WRITTEN: usize = 7;

pub(super) struct SavedField {
    pub(super) saved: FieldFile,
    /// How values are computed, as text.
    pub(super) described: String,
    /// What else its values are, for the guarantee.
    besides: String,
}

impl SavedField {
    /// Of a field from a file, which is of the tool's tip.
    pub(super) fn new(saved: FieldFile) -> Result<Self> {
        let described = match &saved {
            FieldFile::Harmonic(file) => describe(file),
            FieldFile::Siren(_) | FieldFile::Factored(_) => Subject::of_saved_field(&saved)?.describe(),
        };
        let mut besides = String::new();
        let record = &saved.scene().record;
        if record.tool.sharp_point_positions(record.grid.pitch) != [DVec3::ZERO] {
            besides += "; values are of the tool with its tip at the voxel, and imf query --sharp evaluates its sharp points";
        }
        if matches!(&saved, FieldFile::Siren(model) if !model.record.finished) {
            besides += "; the network is not trained to its end";
        }
        Ok(Self { saved, described, besides })
    }

    /// In titles of pictures.
    pub(super) fn exactness(&self) -> &'static str {
        match &self.saved {
            FieldFile::Siren(_) => "from a network trained on exact sections",
            FieldFile::Harmonic(_) => "from a harmonic fit to exact sections",
            FieldFile::Factored(_) => "from a network distilled from a harmonic fit to exact sections",
        }
    }

    pub(super) fn guarantee(&self) -> String {
        let guarantee = match &self.saved {
            FieldFile::Harmonic(file) => {
                format!(
                    "approximate ({}); decisions need exact counts",
                    errors_text(&file.field, file.scene.record.unit)
                )
            }
            FieldFile::Siren(_) | FieldFile::Factored(_) => {
                "approximate (imf eval says by how much); decisions need exact counts".to_owned()
            }
        };
        guarantee + &self.besides
    }

    /// What it is, by the name of its family.
    pub(super) fn summary(&self) -> (&'static str, Value) {
        let summary = match &self.saved {
            FieldFile::Harmonic(file) => {
                json!({ "settings": file.settings, "report": file.field.report, "bytes": file.field.bytes() })
            }
            FieldFile::Factored(file) => json!({
                "shape": file.field.shape,
                "distilled_from": { "settings": file.fit, "report": file.report },
                "bytes": file.field.bytes(),
            }),
            FieldFile::Siren(model) => json!({ "shape": model.shape, "steps": model.record.steps }),
        };
        (self.saved.family(), summary)
    }

    /// Shows the sections of all orientations in order, once it is `ready` to.
    pub(super) fn stream<V>(
        &self,
        work: &Work<'_>,
        ready: impl FnOnce() -> Result<()>,
        start: impl Fn() -> V,
        visit: impl Fn(&mut V, usize, &[f32]) -> Result<()>,
    ) -> Result<Vec<V>> {
        let voxels = work.scene.record.grid.len();
        let all = &work.set.orientations;
        let calls = if all.len() > AT_ONCE { Workload::Many } else { Workload::One };
        let together = AT_ONCE.min(all.len());
        self.require_memory(work, work.device.copied_bytes(&self.saved, calls), together, together)?;
        let stage = work.session.stage("sections of the field", "sections", all.len() as u64);
        let field = work.device.field(work.session, &self.saved, calls)?.field;
        ready()?;
        let mut values = vec![0.0; voxels * together];
        let mut own = start();
        for (batch, orientations) in all.chunks(AT_ONCE).enumerate() {
            if interrupt::requested() {
                return Err(Cancelled.into());
            }
            let sections = &mut values[..voxels * orientations.len()];
            field.sections(orientations, sections)?;
            for (place, section) in sections.chunks_exact(voxels).enumerate() {
                visit(&mut own, batch * AT_ONCE + place, section)?;
                stage.advance(1);
            }
        }
        stage.finish("");
        Ok(vec![own])
    }

    /// The minimum over all orientations. Also checks that there is memory for what is computed from it.
    pub(super) fn minimum(&self, work: &Work<'_>) -> Result<Imf> {
        let together = work.set.len().min(DIRECTIONS_AT_ONCE);
        self.require_memory(work, work.device.copied_bytes(&self.saved, Workload::One), WRITTEN, together)?;
        let values = work.scene.record.grid.len() as u64 * work.set.len() as u64;
        work.session.staged("minimum of the field", "values", values, |control| {
            let field = work.device.field(work.session, &self.saved, Workload::One)?.field;
            Ok(field.minimum(&work.set.orientations, control)?)
        })
    }

    /// Refuses what does not fit beside the field: its coefficients at every voxel where they are needed, some arrays of values, and
    /// what some orientations are multiplied with.
    fn require_memory(&self, work: &Work<'_>, copied: u64, arrays: usize, orientations: usize) -> Result<()> {
        let values = 4 * (arrays * work.scene.record.grid.len()) as u64;
        // Functions of the orientations, and these along axes in two orders.
        let functions = self.saved.basis().map_or(0, Basis::len);
        let heads = 4 * (orientations * (functions + 2 * self.saved.coefficient_count())) as u64;
        work.session.require_memory(copied + values + heads, || {
            let most = copied.max(values).max(heads);
            let remedy = match work.device {
                _ if most == heads && heads > 0 => "take fewer orientations",
                Device::Gpu(_) if most == copied && copied > 0 => "take --device cpu",
                Device::Cpu if most == copied && copied > 0 => "take at most 16 sections at a time",
                _ => "take fewer orientations at a time, or a field of a larger pitch",
            };
            format!("the field's values, and where needed its coefficients, at every voxel; {remedy}")
        })
    }
}
