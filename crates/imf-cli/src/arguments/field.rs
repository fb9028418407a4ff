//! What `imf field` is asked.

use std::path::PathBuf;

use anyhow::{Result, bail};
use clap::Args;

use super::harmonic::{FieldMethod, FieldQuantity};
use super::scene::SceneArguments;
use super::{clearance, harmonic};

/// Compute the field: how much the tool hits at every point, for each direction or at the best of them
#[derive(Args)]
#[command(after_help = "Examples:\n  imf field teapot --orientations '0,0;12,6' --out sections\n  \
                        imf field part.obj --tool mill.toml --orientations fibonacci:225 --imf --out imf\n  \
                        imf field bracket --clearance 2 --clearance-cutter 2 --method harmonic --quantity depth --save \
                        bracket.safetensors\n\n\
                        Writes .npy, .vti (ParaView) and .png slices. Values are exact for voxel centres. A field of depth is \
                        kept alone (--save), and decides best for planners: how far the tool must be moved to be free, held \
                        within 8 pitches.")]
pub(crate) struct FieldArguments {
    #[command(flatten)]
    pub(crate) scene: SceneArguments,
    /// grid:N, fibonacci:N, random:N:SEED, cone:X,Y,Z:HALF_ANGLE:N, so3:N, pairs such as 0,0;30,40 or a CSV file
    #[arg(
        long,
        value_name = "SET",
        allow_hyphen_values = true,
        requires = "out",
        required_unless_present_any = ["save", "quantity"]
    )]
    pub(crate) orientations: Option<String>,
    /// The inaccessibility measure (least over the orientations) with its best orientation, not every section
    #[arg(long)]
    pub(crate) imf: bool,
    /// Also the measures of cutter, shank and each holder segment by themselves
    #[arg(long)]
    pub(crate) elements: bool,
    #[command(flatten)]
    pub(crate) contact: clearance::ContactArguments,
    /// Compare this many voxels of every section with direct sums, and say so
    #[arg(long, default_value_t = 0, value_name = "N")]
    pub(crate) check: usize,
    /// Where sections are counted, or the harmonic field is evaluated: cpu, gpu, auto, software (software Vulkan), or a number
    /// or part of a name from `imf devices`. All count the same values; a CPU, which takes a few milliseconds a section at most, is
    /// the default; auto is a discrete or integrated GPU where there is one
    #[arg(long, default_value = "cpu", value_name = "DEVICE")]
    pub(crate) device: String,
    #[command(flatten)]
    pub(crate) harmonic: harmonic::HarmonicArguments,
    /// Folder to write to
    #[arg(long, value_name = "DIR", requires = "orientations", required_unless_present_any = ["save", "quantity"])]
    pub(crate) out: Option<PathBuf>,
}

impl FieldArguments {
    /// Refuses what does not go together and what would be passed over.
    pub(crate) fn check(&self) -> Result<()> {
        let Self { harmonic, orientations, .. } = self;
        let depth = harmonic.quantity == FieldQuantity::Depth;
        if harmonic.method == FieldMethod::Exact {
            if depth {
                bail!(
                    "exact sections are of overlaps: depths are fitted, by --method harmonic --quantity depth --save FILE"
                );
            }
            if let Some(option) = harmonic.first_given() {
                bail!(
                    "{option} is of --method harmonic, and exact sections are asked for: leave out one of them"
                );
            }
        }
        if depth && harmonic.save.is_none() {
            bail!(
                "a field of depth is kept in a file, not written as sections: give --save FILE, and leave out --orientations \
                 and --out"
            );
        }
        if depth && orientations.is_some() {
            bail!("a field of depth is kept, not written as sections: leave out --orientations and --out");
        }
        if orientations.is_none() && self.imf {
            bail!(
                "--imf is the least over orientations, and a field that is kept has all of them: give --orientations and --out, \
                 or leave out --imf"
            );
        }
        if orientations.is_none() && harmonic.save.is_none() {
            bail!(
                "there is nothing to write: give --orientations and --out, or --save FILE with --method harmonic"
            );
        }
        Ok(())
    }
}
