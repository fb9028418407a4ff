//! The arguments of `imf-bench access`.

use std::path::PathBuf;

use clap::Args;
use imf_core::parts::ReferencePart;

/// Surface access: points and directions a second on one core and on two, beside the direct test
#[derive(Args)]
#[command(after_help = "Example:\n  imf-bench access --part bracket\n\n\
                        A 6 mm ball end mill with shank and holder at contact poses on a reference part at its full resolution. \
                        The direct test asks every solid voxel's centre at every pose; it gets some of them. \
                        Writes access.json and access.md. Some seconds.")]
pub(crate) struct AccessArguments {
    /// Reference part at its full resolution
    #[arg(long, default_value = "teapot", value_name = "PART")]
    pub(crate) part: ReferencePart,
    /// Folder to write to
    #[arg(long, default_value = "imf-bench", value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Points on the surface
    #[arg(long, default_value_t = 7_302, value_name = "N", value_parser = clap::value_parser!(u32).range(1..1_000_000))]
    pub(crate) points: u32,
    /// Directions from each
    #[arg(long, default_value_t = 102, value_name = "N", value_parser = clap::value_parser!(u32).range(1..100_000))]
    pub(crate) directions: u32,
    /// Points and directions that the direct test gets
    #[arg(long, default_value_t = 4_000, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) rival_poses: u32,
    /// Seed of the choice of points, and of the direct test's
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
}
