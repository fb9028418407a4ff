//! `imf train`: a field of every direction, by family; and `imf finetune`.

pub(super) mod factored;
pub mod harmonic;
pub(super) mod siren5;

use std::path::Path;

use anyhow::Result;

use super::calibrate;
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

/// Measures what the decisions of a trained field are worth, where that is short beside a training of so many samples.
fn calibrated(session: &Session, path: &Path, is_known: bool, samples: u64) -> Result<()> {
    if is_known || !session.rank().is_first() || !calibrate::is_short_beside(samples) {
        return Ok(());
    }
    calibrate::afterwards(session, path)
}
