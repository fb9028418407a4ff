//! The paper's own numbers, which `paper/published.toml` holds.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use serde::Deserialize;

/// Mean squared and largest error.
pub(super) type Published = (f64, f64);

/// The paper's tables, by the names of ours.
#[derive(Deserialize)]
pub(super) struct Paper {
    pub(super) network_bytes: f64,
    /// By recipe and part.
    pub(super) parts: BTreeMap<String, BTreeMap<String, [Published; 4]>>,
    pub(super) plane: BTreeMap<String, Published>,
    pub(super) seconds: BTreeMap<String, [f64; 3]>,
    pub(super) transfer: BTreeMap<String, Published>,
    pub(super) transfer_seconds: BTreeMap<String, f64>,
    pub(super) sweep: BTreeMap<String, [Published; 2]>,
}

pub(super) static PAPER: LazyLock<Paper> = LazyLock::new(|| {
    let text = include_str!("../../paper/published.toml");
    toml::from_str(text).unwrap_or_else(|error| unreachable!("a test reads it: {error}"))
});

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_numbers_are_read() {
        assert_eq!(PAPER.parts["single"]["teapot"][0], (7.353e-7, 0.0176));
        assert_eq!((PAPER.seconds["bracket"][2], PAPER.sweep["6x512"][1].0), (9.3, 5.857e-7));
        assert_eq!((PAPER.plane.len(), PAPER.transfer.len(), PAPER.network_bytes), (4, 2, 2e6));
    }
}
