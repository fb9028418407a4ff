//! `imf query`.

use crate::arguments::QueryArguments;
use crate::session::Session;

pub(crate) fn run(_session: &Session, _arguments: &QueryArguments) -> anyhow::Result<()> {
    anyhow::bail!("not written")
}
