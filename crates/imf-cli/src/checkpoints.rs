//! The files that trainings of both families go on from: their names, and what is said where a folder has none.

use std::path::Path;

use anyhow::{Error, anyhow};

use crate::arguments::NetworkFamily;

impl NetworkFamily {
    /// The checkpoint of a training. Trainings of both families may lie in one folder.
    pub(crate) const fn checkpoint(self) -> &'static str {
        match self {
            Self::Factored => "teaching.safetensors",
            Self::Siren5 => "checkpoint.safetensors",
        }
    }
}

/// `--resume` in a folder without a training of `family`. One of the other family is named, and how to go on with it.
pub(crate) fn nothing_to_resume(out: &Path, family: NetworkFamily) -> Error {
    let nothing =
        format!("there is nothing to resume: {} does not exist", out.join(family.checkpoint()).display());
    let (other, remedy) = match family {
        NetworkFamily::Factored => (
            NetworkFamily::Siren5,
            "a training of siren5: imf train --family siren5 --resume goes on with it (or imf finetune)",
        ),
        NetworkFamily::Siren5 => (
            NetworkFamily::Factored,
            "a training of a factored field: imf train --family factored --resume goes on with it (or imf compress)",
        ),
    };
    let path = out.join(other.checkpoint());
    if path.exists() { anyhow!("{nothing}, and {} is {remedy}", path.display()) } else { anyhow!(nothing) }
}
