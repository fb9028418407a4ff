//! `imf voxelize`.

use crate::arguments::VoxelizeArguments;
use crate::session::Session;

pub(crate) fn run(_session: &Session, _arguments: &VoxelizeArguments) -> anyhow::Result<()> {
    anyhow::bail!("not written")
}
