//! Clearance and contact: the same options in every command.

use anyhow::{Result, ensure};
use clap::Args;
use imf_core::scene::SceneRecord;
use imf_core::tool::{Clearance, Tool, ToolShape};

use super::numbers::parse_room;
use crate::output::short;

/// Heading of these options.
const HEADING: &str = "Clearance, in the part's unit";

/// Room around each kind of element, in the part's unit.
#[derive(Args, Clone, Default)]
pub struct ClearanceArguments {
    /// Room that holder and shank must keep: they are offset by it
    #[arg(help_heading = HEADING, long, default_value_t = 0.0, value_name = "LENGTH", value_parser = parse_room)]
    clearance: f64,
    /// Room that the holder must keep, instead of --clearance
    #[arg(help_heading = HEADING, long, value_name = "LENGTH", value_parser = parse_room)]
    clearance_holder: Option<f64>,
    /// Room that the shank must keep, instead of --clearance
    #[arg(help_heading = HEADING, long, value_name = "LENGTH", value_parser = parse_room)]
    clearance_shank: Option<f64>,
    /// Room that the cutter must keep from fixtures, and from the part where nothing may touch it; not from stock
    #[arg(help_heading = HEADING, long, default_value_t = 0.0, value_name = "LENGTH", value_parser = parse_room)]
    clearance_cutter: f64,
    /// In voxels instead, for shank and holder: the cutter may touch.
    #[arg(skip)]
    voxels: Option<f64>,
}

impl ClearanceArguments {
    /// So many voxels for shank and holder, whatever the pitch.
    pub(crate) fn of_voxels(&self, voxels: f64) -> Self {
        Self { voxels: Some(voxels), ..self.clone() }
    }

    /// The clearance of a tool on a grid of this pitch; a mesh tool has none of voxels, since it cannot be offset.
    pub(crate) fn at(&self, pitch: f64, tool: &Tool) -> Clearance {
        match (self.voxels, &tool.shape) {
            (None, _) => self.clearance(),
            (Some(_), ToolShape::Mesh(_)) => Clearance::default(),
            (Some(voxels), ToolShape::Revolved(_)) => {
                let room = voxels * pitch;
                Clearance { holder: room, shank: room, cutter: self.clearance_cutter }
            }
        }
    }

    pub(crate) fn clearance(&self) -> Clearance {
        Clearance {
            holder: self.clearance_holder.unwrap_or(self.clearance),
            shank: self.clearance_shank.unwrap_or(self.clearance),
            cutter: self.clearance_cutter,
        }
    }
}

impl From<Clearance> for ClearanceArguments {
    fn from(Clearance { holder, shank, cutter }: Clearance) -> Self {
        Self {
            clearance: 0.0,
            clearance_holder: Some(holder),
            clearance_shank: Some(shank),
            clearance_cutter: cutter,
            voxels: None,
        }
    }
}

/// Contact of the cutter with what it cuts, for fields.
#[derive(Args, Clone, Default)]
pub struct ContactArguments {
    /// The cutter may reach this deep below the part's surface (in the part's unit); shank, holder and fixtures may not
    #[arg(long, value_name = "LENGTH", value_parser = parse_room)]
    pub contact: Option<f64>,
}

impl ContactArguments {
    /// The depth, for tools that can touch: an error for one without a cutter.
    pub(crate) fn depth<'a>(&self, tools: impl IntoIterator<Item = &'a Tool>) -> Result<Option<f64>> {
        let Some(depth) = self.contact else { return Ok(None) };
        // A recipe's has passed no option.
        ensure!(
            depth.is_finite() && depth >= 0.0,
            "the contact must be a finite length of at least 0, not {depth}"
        );
        for tool in tools {
            ensure!(
                tool.has_cutter(),
                "--contact lets a cutter touch the part, and the tool '{}' names none: describe it by cutter, shank and \
                 holder",
                tool.name
            );
        }
        Ok(Some(depth))
    }
}

/// A clearance in words: nothing where there is none.
pub(crate) fn clearance_text(clearance: &Clearance, unit: impl std::fmt::Display) -> Option<String> {
    (!clearance.is_zero()).then(|| rooms_text(clearance, unit))
}

/// The room of each kind of element in words, 0 where it keeps none.
pub(crate) fn rooms_text(clearance: &Clearance, unit: impl std::fmt::Display) -> String {
    let [holder, shank, cutter] = [clearance.holder, clearance.shank, clearance.cutter].map(short);
    format!("holder {holder}, shank {shank}, cutter {cutter} {unit}")
}

/// A part and the tool around it, for the title of a picture or a page.
pub(crate) fn title(record: &SceneRecord) -> String {
    let offset = clearance_text(&record.clearance, record.unit);
    let offset = offset.map_or_else(String::new, |text| format!(" offset by {text}"));
    format!("{}, tool {}{offset}", record.part, record.tool.name)
}

/// What a contact allows voxels of a pitch, in words.
pub(crate) fn contact_text(depth: f64, pitch: f64, unit: impl std::fmt::Display) -> String {
    let what = "the cutter may hold voxels of the part whose centres lie no deeper than";
    // The centres next to a face lie half a pitch below it.
    let none =
        if depth < 0.5 * pitch { ": none of this pitch, which is more than twice as large" } else { "" };
    format!("{what} {depth} {unit} below its surface{none}")
}
