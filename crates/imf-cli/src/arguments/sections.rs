//! What `imf sections` is asked.

use std::path::PathBuf;

use clap::Args;

use super::FieldDeviceArguments;

/// Write sections of a field that was kept or trained, or the least of them over any orientations
#[derive(Args)]
#[command(
    after_help = "Examples:\n  imf sections teapot/field.safetensors --orientations '0,0;12,6' --out sections\n  \
                        imf sections teapot/field.safetensors --orientations fibonacci:10000 --imf --out imf\n\n\
                        Writes what imf field writes: .npy, .vti (ParaView) and .png slices. Nothing is counted: imf field \
                        counts the exact minimum. A kept field holds the overlap with the tool's tip at the voxel: of a tool with several \
                        sharp points these are not the least over them, which imf field writes. Fields of depth are refused."
)]
pub(crate) struct SectionsArguments {
    /// Trained model, or a harmonic or factored field
    pub(crate) field: PathBuf,
    /// grid:N, fibonacci:N, random:N:SEED, cone:X,Y,Z:HALF_ANGLE:N, so3:N, pairs such as 0,0;30,40 or a CSV file
    #[arg(long, value_name = "SET", allow_hyphen_values = true)]
    pub(crate) orientations: String,
    /// The inaccessibility measure (least over the orientations) with its best orientation, not every section
    #[arg(long)]
    pub(crate) imf: bool,
    /// With --imf: the least over all orientations, not only over the set: from its best one down the field's gradient
    #[arg(long, requires = "imf")]
    pub(crate) refine: bool,
    #[command(flatten)]
    pub(crate) device: FieldDeviceArguments,
    /// Folder to write to
    #[arg(long, value_name = "DIR")]
    pub(crate) out: PathBuf,
}
