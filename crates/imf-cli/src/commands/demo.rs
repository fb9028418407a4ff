//! `imf demo`.

use crate::arguments::DemoArguments;
use crate::session::Session;

pub(crate) fn run(_session: &Session, _arguments: &DemoArguments) -> anyhow::Result<()> {
    anyhow::bail!("not written")
}
pub(crate) const STEPS: u64 = 30_000;
