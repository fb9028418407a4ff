//! `imf train`.

use crate::arguments::TrainArguments;
use crate::session::Session;

pub(crate) fn run(_session: &Session, _arguments: &TrainArguments) -> anyhow::Result<()> {
    anyhow::bail!("not written")
}
