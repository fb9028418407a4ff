//! The arguments of `imf field`.

use std::path::PathBuf;

use anyhow::Result;
use clap::Args;
use imf_core::section::Quantity;

use super::clearance::ContactArguments;
use super::explicit::ExplicitOptions;
use super::quantity::quantity;
use super::scene::SceneArguments;

/// The field over the whole grid: how much the tool hits at every point, for each direction or at the best of them
#[derive(Args)]
#[command(mut_arg("part", |part| part.value_name("PART or FIELD").help(
    "An OBJ, STL, PLY or 3MF file, or a built-in part (teapot, bracket, bracket-raw, screw-gear), whose voxels are counted; or a \
     saved field (.safetensors), which is evaluated, and nothing is counted again: then none of the options of a part"
)))]
#[command(after_help = super::orientations::after(
    "Examples:\n  imf field teapot --orientations '0,0;12,6' --out sections\n  \
                        imf field model/field.safetensors --orientations fibonacci:10000 --imf --out imf\n  \
                        imf field part.obj --tool mill.toml --imf --out imf\n  \
                        imf field part.obj --tool mill.toml --imf --quantity depth --out depth\n\n\
                        Writes .npy, .vti (ParaView) and .png slices. A part's values are exact for voxel centres."
))]
pub(crate) struct FieldArguments {
    #[command(flatten)]
    explicit: ExplicitOptions,
    #[command(flatten)]
    pub(crate) scene: SceneArguments,
    #[command(flatten)]
    pub(crate) contact: ContactArguments,
    /// A set of directions, see below. With --imf by default axes+normals+fibonacci:225 of a part, axes+fibonacci:225 of a saved
    /// field; so3:500 in place of fibonacci:225 where the tool is not round
    #[arg(long, value_name = "SET", allow_hyphen_values = true, required_unless_present = "imf")]
    pub(crate) orientations: Option<String>,
    /// The inaccessibility measure (minimum over the orientations) with its best orientation, not every section
    #[arg(long)]
    pub(crate) imf: bool,
    /// Of a part: its values, either overlap, the fraction of the tool's volume that lies in the part, or depth, the signed penetration
    /// depth (how far the tool must be moved to be free, below 0 how far it may be moved, clamped within 7.5 pitches)
    #[arg(long, value_parser = quantity(), default_value = "overlap")]
    pub(crate) quantity: Quantity,
    /// Of a part: also the measures of cutter, shank and each holder segment by themselves
    #[arg(long)]
    pub(crate) elements: bool,
    /// Of a part: compare this many voxels of every section with direct sums, and say so
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub(crate) check: usize,
    /// Where sections are counted or the field is evaluated: cpu, gpu, auto (a discrete or integrated GPU where there is one), software
    /// (software Vulkan), or a number or part of a name from `imf info`. Sections are counted by the CPU by default, in a few
    /// milliseconds each at most; of saved fields siren5 alone goes to a GPU by itself
    #[arg(long, value_name = "DEVICE")]
    pub(crate) device: Option<String>,
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
}

impl FieldArguments {
    /// Refuses what is of a part beside a saved field, and the other way round.
    pub(crate) fn check(&self, is_saved: bool) -> Result<()> {
        if !is_saved {
            if self.quantity == Quantity::Depth {
                let whose = "overlaps, and --quantity depth asks for lengths";
                self.explicit.refuse_options(&["elements", "check"], whose)?;
            }
            return Ok(());
        }
        let whose = format!("a part, and {} is a saved field, which was made with its own", self.scene.part);
        self.explicit.refuse_scene(&["elements", "check"], &whose)
    }
}
