//! How the weights follow the gradient.

use serde::{Deserialize, Serialize};

/// Settings of SOAP.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SoapConfig {
    /// Exponential decay of moments and Gram matrices (the paper's β).
    pub beta: f32,
    /// Steps between two updates of the eigenvectors (the paper's f).
    pub precondition_every: u64,
    /// Learning rate over that of the other weights.
    pub rate: f32,
}

impl Default for SoapConfig {
    fn default() -> Self {
        Self { beta: 0.95, precondition_every: 10, rate: 1.0 }
    }
}

/// How the weights follow the gradient.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Optimiser {
    /// Adam for every weight.
    #[default]
    Adam,
    /// Adam along the axes of their gradients for the matrices between hidden layers, Adam for the rest.
    Soap(SoapConfig),
}

impl Optimiser {
    /// Numbers that a state holds for a matrix between hidden layers beside weights and moments, after the first
    /// step: SOAP's means and axes of both sides.
    #[must_use]
    pub fn state_count(self, rows: usize, columns: usize) -> usize {
        match self {
            Self::Adam => 0,
            Self::Soap(_) => 2 * (rows * rows + columns * columns),
        }
    }
}
