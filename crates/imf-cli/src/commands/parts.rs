//! `imf parts`.

use crate::arguments::PartsArguments;
use crate::session::Session;

pub(crate) fn run(_session: &Session, _arguments: &PartsArguments) -> anyhow::Result<()> {
    anyhow::bail!("not written")
}
