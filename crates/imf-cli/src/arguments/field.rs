//! The arguments of `imf field`.

use std::path::{Path, PathBuf};

use anyhow::{Result, bail};
use clap::Args;

use super::harmonic::{FieldMethod, FieldQuantity};
use super::scene::SceneArguments;
use super::train::Given;
use super::{clearance, harmonic};

/// The field over the whole grid: how much the tool hits at every point, for each direction or at the best of them
#[derive(Args)]
#[command(mut_arg("part", |part| part.value_name("PART or FIELD").help(
    "An OBJ, STL, PLY or 3MF file, or a built-in part (teapot, bracket, bracket-raw, screw-gear), whose voxels are counted; or a \
     saved field (.safetensors), which answers without counting anything again: then none of the options of a part"
)))]
#[command(after_help = "Examples:\n  imf field teapot --orientations '0,0;12,6' --out sections\n  \
                        imf field model/field.safetensors --orientations fibonacci:10000 --imf --out imf\n  \
                        imf field part.obj --tool mill.toml --orientations fibonacci:225 --imf --out imf\n  \
                        imf field bracket --clearance 2 --clearance-cutter 2 --method harmonic --quantity depth --save \
                        bracket.safetensors\n\n\
                        Writes .npy, .vti (ParaView) and .png slices. Values are exact for voxel centres. A field of depth is \
                        kept alone (--save), and decides best for planners: how far the tool must be moved to be free, held \
                        within 8 pitches.")]
pub(crate) struct FieldArguments {
    // Before the others, which take their values away.
    #[command(flatten)]
    pub(crate) given: Given,
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
    /// Where sections are counted or the field is evaluated: cpu, gpu, auto (a discrete or integrated GPU where there is one), software
    /// (software Vulkan), or a number or part of a name from `imf info`. Sections are counted by the CPU by default, in a few
    /// milliseconds each at most; of saved fields siren5 alone goes to a GPU by itself
    #[arg(long, value_name = "DEVICE")]
    device: Option<String>,
    #[command(flatten)]
    pub(crate) harmonic: harmonic::HarmonicArguments,
    /// Folder to write to
    #[arg(long, value_name = "DIR", requires = "orientations", required_unless_present_any = ["save", "quantity"])]
    pub(crate) out: Option<PathBuf>,
}

impl FieldArguments {
    /// The device's name, or that which is usual for its subject.
    pub(crate) fn device_or<'a>(&'a self, usual: &'a str) -> &'a str {
        self.device.as_deref().unwrap_or(usual)
    }

    /// Refuses what is a part's, beside a saved field.
    pub(crate) fn check_of_saved(&self) -> Result<(&str, &Path)> {
        let given =
            [self.given.first_of::<SceneArguments>(), self.given.first_of::<clearance::ContactArguments>()];
        let mut given =
            given.into_iter().flatten().chain(self.given.has("elements").then(|| "--elements".into()));
        let of_part = given.next().or_else(|| self.given.has("check").then(|| "--check".into()));
        if let Some(option) = of_part.or_else(|| self.harmonic.first_of_fit().map(str::to_owned)) {
            bail!(
                "{option} is of a part, and {} is a saved field, which was made with its own: leave it out",
                self.scene.part
            );
        }
        match (&self.orientations, &self.out) {
            (Some(set), Some(out)) => Ok((set, out)),
            _ => bail!("a saved field has every direction: give --orientations and --out"),
        }
    }

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
