//! `imf eval`.

use crate::arguments::EvalArguments;
use crate::session::Session;

pub(crate) fn run(_session: &Session, _arguments: &EvalArguments) -> anyhow::Result<()> {
    anyhow::bail!("not written")
}
