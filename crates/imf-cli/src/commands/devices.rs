//! `imf devices`.

use crate::session::Session;

pub(crate) fn run(_session: &Session) -> anyhow::Result<()> {
    anyhow::bail!("not written")
}
