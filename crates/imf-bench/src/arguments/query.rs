//! The arguments of `imf-bench query`.

use std::path::PathBuf;

use clap::Args;
use imf_core::parts::ReferencePart;

/// Answers a second at random poses, one core: exact, verified and learnt fields beside mesh collision libraries
#[derive(Args)]
#[command(after_help = "Examples:\n  imf-bench query --part teapot\n  \
                        imf-bench query bracket.safetensors small/field.safetensors --python venv/bin/python\n\n\
                        The fields are of one scene. Where its part is built in, parry3d, Coal and FCL answer for \
                        collisions of the same tool and part as meshes at the same poses, and vamp-planner for those of balls \
                        around the tool with the centres of the part's voxels. Writes query.json and query.md.")]
pub(crate) struct QueryArguments {
    /// Fields of one scene: models, harmonic or factored fields; without any the exact field alone is measured
    pub(crate) fields: Vec<PathBuf>,
    /// Reference part at its full resolution, where no field is given
    #[arg(long, default_value = "teapot", conflicts_with = "fields", value_name = "PART")]
    pub(crate) part: ReferencePart,
    /// Folder to write to
    #[arg(long, default_value = "imf-bench", value_name = "DIR")]
    pub(crate) out: PathBuf,
    /// Random poses for ours
    #[arg(long, default_value_t = 20_000, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) poses: u32,
    /// How many of them the libraries get
    #[arg(long, default_value_t = 2_000, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) rival_poses: u32,
    /// Python with coal, python-fcl, vamp-planner and numpy (crates/imf-bench/python/requirements-query.txt)
    #[arg(long, default_value = "python3", value_name = "COMMAND")]
    pub(crate) python: String,
    /// Program for parry3d: cargo build --release --manifest-path crates/imf-bench/parry3d/Cargo.toml
    #[arg(
        long,
        default_value = "crates/imf-bench/parry3d/target/release/parry3d-rival",
        value_name = "COMMAND"
    )]
    pub(crate) parry3d: String,
    /// Seed of the poses
    #[arg(long, default_value_t = 0)]
    pub(crate) seed: u64,
}
