//! Remarks on a machine and what is set up on it, before anything moves.

use std::sync::Arc;

use glam::DMat4;

use super::carried::HeadBody;
use super::on_table::{OnTable, TablePair};
use crate::check::CheckBodies;
use crate::check::elements::Body;
use crate::check::motions::rigid;
use crate::machine::Side;
use crate::tool::Tool;
use crate::unit::DisplayLength;

/// In words: part or fixtures that stand in what carries them, as where G54 is wrong, and tools without a holder, whose length up to the
/// spindle's face is then that of what is left; nothing without a machine. `set_up` is the toolpath's.
#[must_use]
pub fn machine_remarks(
    bodies: CheckBodies<'_>,
    tools: &[(Option<u32>, &Tool)],
    set_up: &DMat4,
) -> Vec<String> {
    let Some(on) = bodies.machine else { return Vec::new() };
    let machine = on.machine();
    let unit = machine.unit;
    let to_machine = HeadBody::to_machine(machine, &rigid(set_up));
    let bodies = Body::all(bodies.part, bodies.fixtures);
    let bodies: Vec<_> = bodies.iter().filter_map(|body| OnTable::new(body).map(Arc::new)).collect();
    let top = machine.axes_of(Side::Table);
    let own = on.bodies();
    let with_them = own.iter().filter(|solid| solid.level == top);
    let pairs = with_them.flat_map(|solid| bodies.iter().map(move |own| TablePair::new(own, solid)));
    let standing = pairs.filter_map(|pair| {
        let depth = pair.depth_at(&to_machine)?;
        let [body, solid] = pair.bodies();
        Some(format!(
            "the {body} stands {} {unit} deep in the {solid}: check where G54 is, and how the part lies",
            DisplayLength((depth * 100.0).round() / 100.0)
        ))
    });
    let bare = tools.iter().filter(|(_, tool)| !tool.has_holder()).map(|(_, tool)| {
        format!(
            "the tool '{}' has no holder: it is taken to end at the spindle's face, {} {unit} above its tip, by which the head's place and \
             the travel follow",
            tool.name,
            DisplayLength(tool.length())
        )
    });
    standing.chain(bare).collect()
}
