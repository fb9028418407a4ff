//! The recipes that come with the program.

use super::RecipeError;

/// A recipe's file inside the program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct BuiltIn {
    /// Name on the command line.
    pub(crate) name: &'static str,
    /// The file's text.
    pub(crate) text: &'static str,
}

/// All, in the order in which they are listed: the paper's, then ours.
pub(crate) const BUILT_IN: [BuiltIn; 6] = [
    BuiltIn { name: "single", text: include_str!("../../recipes/single.toml") },
    BuiltIn { name: "multi", text: include_str!("../../recipes/multi.toml") },
    BuiltIn { name: "transfer", text: include_str!("../../recipes/transfer.toml") },
    BuiltIn { name: "sparsity", text: include_str!("../../recipes/sparsity.toml") },
    BuiltIn { name: "architecture", text: include_str!("../../recipes/architecture.toml") },
    BuiltIn { name: "online", text: include_str!("../../recipes/online.toml") },
];

/// The recipe of that name.
///
/// # Errors
/// [`RecipeError::Unknown`], which lists them.
pub(crate) fn built_in(name: &str) -> Result<BuiltIn, RecipeError> {
    let found = BUILT_IN.iter().find(|recipe| recipe.name == name);
    found.copied().ok_or_else(|| RecipeError::Unknown(name.to_owned()))
}
