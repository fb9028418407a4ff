//! A stack of sine layers, with one linear layer behind them or none: what every network of the house has in common.
//!
//! Parameters are one flat array; [`Stack::layers`] is the one place that knows its layout. The fast engines and the
//! f64 definition work on stacks; their owners define what inputs and outputs mean.

use std::ops::Range;

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng as _, SeedableRng as _};

use super::{Layer, ShapeError};

/// What stands behind the last sum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ending {
    /// One output, through the clamped sigmoid ([`super::output`]): a collision measure.
    Sigmoid,
    /// Any number of outputs, as they are.
    Linear,
    /// No sum at all: the last hidden layer's sines are the outputs. Such a stack is evaluated, never trained.
    Sines,
}

/// What follows the last sum of a stack that is trained.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrainedEnding {
    /// As [`Ending::Sigmoid`].
    Sigmoid,
    /// As [`Ending::Linear`].
    Linear,
}

/// Sizes of a stack.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stack {
    /// Values of a sample: 3 or 5, which the kernels are made for.
    pub inputs: usize,
    /// Neurons of every hidden layer.
    pub width: usize,
    /// Hidden layers.
    pub hidden: usize,
    /// The input is appended to the activations of this hidden layer, counted from 1, if there is one behind it.
    pub skip_after: Option<usize>,
    /// Frequency factor ω inside every sine.
    pub omega: f32,
    /// Values of the last layer; as many as neurons where that is a hidden one.
    pub outputs: usize,
    /// What becomes of them.
    pub ending: Ending,
}

impl Stack {
    /// Checks width, depth and ω.
    ///
    /// # Errors
    /// Names the value that is out of range.
    pub fn check(&self) -> Result<(), ShapeError> {
        let Self { width, hidden, omega, .. } = *self;
        if !(1..=64).contains(&hidden) || !(1..=8192).contains(&width) {
            return Err(ShapeError::Size { hidden, width });
        }
        if !(omega.is_finite() && omega > 0.0) {
            return Err(ShapeError::Omega(omega));
        }
        Ok(())
    }

    /// As [`Stack::check`], of a stack that is to be trained: what its loss is taken of.
    ///
    /// # Errors
    /// As [`Stack::check`]; a stack without a last layer.
    pub fn trained_ending(&self) -> Result<TrainedEnding, ShapeError> {
        self.check()?;
        match self.ending {
            Ending::Sigmoid => Ok(TrainedEnding::Sigmoid),
            Ending::Linear => Ok(TrainedEnding::Linear),
            Ending::Sines => Err(ShapeError::NoLastLayer),
        }
    }

    /// The layers between hidden ones, whose matrices are neither the first nor the last.
    pub fn between(&self) -> Range<usize> {
        1..self.hidden.max(1)
    }

    /// The layers in order, hidden ones first, the output layer last if there is one: the one definition of the flat layout.
    pub fn layers(&self) -> Vec<Layer> {
        let mut layers = Vec::with_capacity(self.hidden + 1);
        let mut offset = 0;
        let count = self.hidden + usize::from(self.ending != Ending::Sines);
        for index in 0..count {
            let skip = index > 0 && index < self.hidden && self.skip_after == Some(index);
            let inputs = match index {
                0 => self.inputs,
                _ if skip => self.width + self.inputs,
                _ => self.width,
            };
            let outputs = if index == self.hidden { self.outputs } else { self.width };
            let biases = offset + inputs * outputs;
            layers.push(Layer { inputs, outputs, weights: offset, biases, skip });
            offset = biases + outputs;
        }
        layers
    }

    /// Number of parameters, weights and biases together.
    pub fn parameter_count(&self) -> usize {
        self.layers().last().map_or(0, |layer| layer.biases + layer.outputs)
    }

    /// Starting weights: the first layer U(±1/inputs), the others U(±√(6/inputs)/ω); biases U(±1/√inputs). The same
    /// seed gives the same bits on every machine.
    pub fn initial_parameters(&self, seed: u64) -> Vec<f32> {
        let mut generator = ChaCha8Rng::seed_from_u64(seed);
        let mut parameters = vec![0.0; self.parameter_count()];
        for (index, layer) in self.layers().iter().enumerate() {
            let inputs = layer.inputs as f32;
            let bound = if index == 0 { 1.0 / inputs } else { (6.0 / inputs).sqrt() / self.omega };
            for weight in &mut parameters[layer.weights..layer.biases] {
                *weight = symmetric_uniform(&mut generator, bound);
            }
            for bias in &mut parameters[layer.biases..layer.biases + layer.outputs] {
                *bias = symmetric_uniform(&mut generator, 1.0 / inputs.sqrt());
            }
        }
        parameters
    }

    /// Checks that a parameter array fits.
    ///
    /// # Errors
    /// Names both lengths.
    pub fn check_parameters(&self, parameters: &[f32]) -> Result<(), ShapeError> {
        let expected = self.parameter_count();
        if parameters.len() == expected {
            Ok(())
        } else {
            Err(ShapeError::Parameters { expected, found: parameters.len() })
        }
    }
}

/// A value of U(−bound, bound) from 24 random bits, so that it does not depend on a library's sampling code.
fn symmetric_uniform(generator: &mut ChaCha8Rng, bound: f32) -> f32 {
    let unit = (generator.next_u32() >> 8) as f32 / (1u32 << 24) as f32;
    (2.0 * unit - 1.0) * bound
}

#[cfg(test)]
mod tests {
    use super::*;

    const LINEAR: Stack = Stack {
        inputs: 3,
        width: 6,
        hidden: 3,
        skip_after: None,
        omega: 20.0,
        outputs: 6,
        ending: Ending::Linear,
    };

    #[test]
    fn what_ends_in_sines_is_not_trained() {
        let trained = |ending| Stack { ending, ..LINEAR }.trained_ending();
        assert!(matches!(trained(Ending::Linear), Ok(TrainedEnding::Linear)));
        assert!(matches!(trained(Ending::Sigmoid), Ok(TrainedEnding::Sigmoid)));
        assert!(matches!(trained(Ending::Sines), Err(ShapeError::NoLastLayer)));
    }

    #[test]
    fn layers_between_hidden_ones_are_neither_the_first_nor_the_last() {
        for hidden in 1..5 {
            for ending in [Ending::Linear, Ending::Sines] {
                let stack = Stack { hidden, ending, ..LINEAR };
                let layers = stack.layers();
                let between = &layers[stack.between()];
                assert_eq!(between.len(), hidden - 1);
                let square = between.iter().all(|layer| (layer.inputs, layer.outputs) == (6, 6));
                assert!(square && !between.contains(&layers[0]), "{hidden}, {ending:?}");
            }
        }
    }
}
