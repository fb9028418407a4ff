//! `imf info`.

use crate::arguments::InfoArguments;
use crate::session::Session;

pub(crate) fn run(_session: &Session, _arguments: &InfoArguments) -> anyhow::Result<()> {
    anyhow::bail!("not written")
}
