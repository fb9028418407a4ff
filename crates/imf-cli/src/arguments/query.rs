//! What `imf query` is asked.

use std::path::PathBuf;

use clap::Args;

use super::FieldDeviceArguments;

/// Answer poses from a CSV file: how much does the tool overlap the part when its tip is here, or how deep is it
#[derive(Args)]
#[command(after_help = "Example:\n  imf query model/field.safetensors poses.csv --out answers.csv\n\n\
                        The first line names the columns: x,y,z,i,j,k (tool axis from tip to holder) or \
                        x,y,z,theta,phi (degrees); a column roll (degrees) turns the tool about its own axis. Other columns \
                        are kept. Answers add the column overlap, from 0 to 1; with --exact also overlap_exact; with --sharp \
                        they are called cmf and cmf_exact. A field of depth \
                        (imf info says which) adds the column depth instead: how far the tool must be moved to be free, below \
                        0 how far it may be moved, in the scene's unit, held within 8 pitches. Poses outside the box of the voxel centres are \
                        answered as the nearest point inside, without guarantee; --exact counts everywhere.")]
pub(crate) struct QueryArguments {
    /// Trained model, or a harmonic or factored field
    pub(crate) model: PathBuf,
    /// CSV file of poses, or - for standard input
    pub(crate) poses: PathBuf,
    /// CSV file of answers; standard output by default
    #[arg(long, value_name = "FILE")]
    pub(crate) out: Option<PathBuf>,
    /// Also count the exact overlap; for fields of overlap alone
    #[arg(long)]
    pub(crate) exact: bool,
    /// The least over the tool's sharp points k (CMF, or the least depth), not the tip's: each read or counted at x − R k itself, where
    /// sections take the mean of the voxels around
    #[arg(long)]
    pub(crate) sharp: bool,
    #[command(flatten)]
    pub(crate) device: FieldDeviceArguments,
}
