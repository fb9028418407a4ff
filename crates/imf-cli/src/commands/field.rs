//! `imf field`.

use crate::arguments::FieldArguments;
use crate::session::Session;

pub(crate) fn run(_session: &Session, _arguments: &FieldArguments) -> anyhow::Result<()> {
    anyhow::bail!("not written")
}
