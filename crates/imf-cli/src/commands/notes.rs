//! Remarks on a field from a file before it is evaluated.

use std::path::Path;

use imf_core::scene::SceneRecord;
use imf_fields::model::Model;

use crate::arguments::clearance::{clearance_text, contact_text};
use crate::session::Session;

/// Says so where a training was not ended.
pub(super) fn of_training(session: &Session, path: &Path, model: &Model) {
    if !model.record.finished {
        session.note(&format!("{} is not trained to its end", path.display()));
    }
}

/// Says so of a network of the paper's kind where the tool's roll counts.
pub(super) fn of_roll(session: &Session, record: &SceneRecord) {
    if !record.bare_tool().with_tip_only().is_axisymmetric() {
        session.note(&format!(
            "a network of the paper's kind knows no roll, which counts for the tool '{}': its overlaps are the same at every roll; exact \
             queries read the column roll",
            record.tool.name
        ));
    }
}

/// Says so where poses without a roll are asked of a tool whose roll counts.
pub(super) fn of_no_roll(session: &Session, record: &SceneRecord, sharp: bool) {
    let tool = record.bare_tool();
    let is_round = if sharp { tool.is_axisymmetric() } else { tool.with_tip_only().is_axisymmetric() };
    if !is_round {
        session.note(&format!(
            "the tool '{}' is not axisymmetric, and the poses have no column roll: every answer is of the tool at roll 0",
            record.tool.name
        ));
    }
}

/// Says what tool and part are to each other.
pub(super) fn of_scene(session: &Session, record: &SceneRecord) {
    if let Some(text) = clearance_text(&record.clearance, record.unit) {
        session.note(&format!("values are of the tool offset by a clearance ({text})"));
    }
    if let Some(depth) = record.contact {
        session.note(&contact_text(depth, record.grid.pitch, record.unit));
    }
}
