//! `imf train`: a field of every direction, by family; and `imf finetune`.

pub(super) mod factored;
pub mod harmonic;
pub(super) mod siren5;

use anyhow::Result;

use crate::arguments::either::Either;
use crate::arguments::train::{TrainArguments, TrainFamily};
use crate::job;
use crate::session::Session;

pub(crate) fn run(session: &Session, arguments: &TrainArguments) -> Result<()> {
    job::require_togetherness(session)?;
    match arguments {
        Either::Own(arguments) => factored::run(session, arguments),
        Either::Sub(TrainFamily::Factored(arguments)) => factored::run(session, arguments),
        Either::Sub(TrainFamily::Harmonic(arguments)) => harmonic::run(session, arguments),
        Either::Sub(TrainFamily::Siren5(arguments)) => siren5::run(session, arguments),
    }
}
