//! `imf dataset`.

use crate::arguments::DatasetArguments;
use crate::session::Session;

pub(crate) fn run(_session: &Session, _arguments: &DatasetArguments) -> anyhow::Result<()> {
    anyhow::bail!("not written")
}
