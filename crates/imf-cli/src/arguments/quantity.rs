//! The quantity of a new field, and the clearance and margin that its scene has by default: the same for every family.

use std::str::FromStr as _;

use clap::Args;
use clap::builder::TypedValueParser;
use imf_core::parts::ReferencePart;
use imf_core::section::Quantity;
use imf_fields::harmonic::FitSettings;

use super::explicit::ExplicitOptions;
use super::numbers::named;
use super::scene::SceneArguments;

/// A quantity by its name.
pub(crate) fn quantity() -> impl TypedValueParser<Value = Quantity> {
    named(&["depth", "overlap"])
}

/// The choice of what a field's values are.
#[derive(Args, Clone, Copy)]
pub(crate) struct QuantityArguments {
    /// What the field's values are: depth, the signed penetration depth (how far the tool must be moved to be free, below 0 how far it may
    /// be moved, clamped within 7.5 pitches), which decides; or overlap, the fraction of the tool's volume that lies in the part, the paper's
    /// measure, which beside a holder hardly sees a small cutter. By default depth, and overlap for the paper's question, a built-in part
    /// with the tool paper. A field of depth is of the tool with its shank and holder offset by two voxels, where no clearance is given; the
    /// cutter may touch. Around a part of your own there are six empty voxels, where neither --margin nor --dims is given
    #[arg(long, value_parser = quantity())]
    quantity: Option<Quantity>,
}

/// Empty voxels around a user's part: the tool approaches within the field's box, beyond its clearance.
const MARGIN: usize = 6;
/// Names of the options that give a clearance.
const CLEARANCES: [&str; 3] = ["clearance", "clearance_holder", "clearance_shank"];

impl QuantityArguments {
    /// The quantity of a field of this scene.
    pub(crate) fn of(self, scene: &SceneArguments) -> Quantity {
        match self.quantity {
            Some(quantity) => quantity,
            None if is_built_in(scene) && scene.tool.iter().all(|tool| tool == "paper") => Quantity::Overlap,
            None => Quantity::Depth,
        }
    }
}

/// The scene of a field of such values, with the clearance and the margin that it has where none was given.
pub(crate) fn scene_of(
    quantity: Quantity,
    explicit: &ExplicitOptions,
    scene: &SceneArguments,
) -> SceneArguments {
    let mut scene = scene.clone();
    if !quantity.is_overlap() && !CLEARANCES.iter().any(|name| explicit.has(name)) {
        scene.clearance = scene.clearance.of_voxels(FitSettings::CLEARANCE);
    }
    if !is_built_in(&scene) && scene.dims.is_none() && !explicit.has("margin") {
        scene.margin = MARGIN;
    }
    scene
}

fn is_built_in(scene: &SceneArguments) -> bool {
    ReferencePart::from_str(&scene.part).is_ok()
}
