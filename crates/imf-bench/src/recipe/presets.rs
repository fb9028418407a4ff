//! The regimes that come with the program.

use super::RegimeError;

/// A regime's file inside the program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Preset {
    /// Name on the command line.
    pub name: &'static str,
    /// The file's text.
    pub text: &'static str,
}

/// All presets, in the order in which they are listed: the paper's, then ours.
pub const PRESETS: [Preset; 6] = [
    Preset { name: "single", text: include_str!("../../../../presets/single.toml") },
    Preset { name: "multi", text: include_str!("../../../../presets/multi.toml") },
    Preset { name: "transfer", text: include_str!("../../../../presets/transfer.toml") },
    Preset { name: "sparsity", text: include_str!("../../../../presets/sparsity.toml") },
    Preset { name: "architecture", text: include_str!("../../../../presets/architecture.toml") },
    Preset { name: "online", text: include_str!("../../../../presets/online.toml") },
];

/// The preset of that name.
///
/// # Errors
/// [`RegimeError::NoPreset`], which lists them.
pub fn preset(name: &str) -> Result<Preset, RegimeError> {
    let found = PRESETS.iter().find(|preset| preset.name == name);
    found.copied().ok_or_else(|| RegimeError::NoPreset(name.to_owned()))
}
