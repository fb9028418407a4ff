//! `imf finetune`.

use crate::arguments::FinetuneArguments;
use crate::session::Session;

pub(crate) fn run(_session: &Session, _arguments: &FinetuneArguments) -> anyhow::Result<()> {
    anyhow::bail!("not written")
}
