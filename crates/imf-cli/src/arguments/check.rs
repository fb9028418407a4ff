//! What `imf check` is asked.

use std::path::PathBuf;

use clap::Args;
use imf_core::check::CheckSettings;

use super::scene::SceneArguments;

/// Check a 5-axis toolpath for collisions, exactly, line by line
#[derive(Args)]
#[command(
    after_help = "Examples:\n  imf check part.stl finish.cl --unit mm --tool mill.toml --clearance 2\n  \
                        imf check teapot path.csv --contact 0.5 --json\n\n\
                        The toolpath is CSV (x,y,z,i,j,k: tip, and axis from tip to holder) or APT/CL (GOTO/ lines), \
                        in the part's coordinates and unit. Exit code 3 says that something collides."
)]
pub(crate) struct CheckArguments {
    #[command(flatten)]
    pub(crate) scene: SceneArguments,
    /// Toolpath, CSV or APT/CL
    pub(crate) toolpath: PathBuf,
    /// Farthest that any point of the tool moves between two checked poses; a quarter of a voxel by default
    #[arg(long, value_name = "LENGTH")]
    pub(crate) tolerance: Option<f64>,
    /// A field of this part, grid and tool: what its guard proves free is not counted again. The report is the same
    #[arg(long, value_name = "MODEL")]
    pub(crate) field: Option<PathBuf>,
    /// How deep below the part's surface the cutter may reach; one voxel by default
    #[arg(long, value_name = "LENGTH")]
    pub(crate) contact: Option<f64>,
}

impl CheckArguments {
    /// The settings, with defaults that follow the grid's pitch.
    pub(crate) fn settings(&self, pitch: f64) -> CheckSettings {
        let usual = CheckSettings::of_pitch(pitch);
        CheckSettings {
            clearance: self.scene.clearance.clearance(),
            contact: self.contact.unwrap_or(usual.contact),
            tolerance: self.tolerance.unwrap_or(usual.tolerance),
        }
    }
}
