//! The last layer folded into the functions, and taken out again.
//!
//! ```text
//! s U (W a + b) + μ = V a + μ',    V = s U W  [K][width],    μ' = μ + s U b
//! ```
//! a are the last sines. V takes `K · width` numbers where U and W take `components · (K + width)`. With V as the linear layer the
//! outputs are the weights of the functions themselves ([`FactoredField::by_function`]).

use std::borrow::Cow;

use super::{FactoredField, FactoredShape};
use crate::siren::Layer;
use crate::siren::matrix::{Matrix, product};

impl FactoredField {
    /// The same field, to the rounding of f32, whose last sines are its coefficients; as it is where that would take more
    /// memory, and where it is so already.
    #[must_use]
    pub fn folded(self) -> Self {
        let FactoredShape { width, components, folded, .. } = self.shape;
        let functions = self.basis.len();
        if folded || functions * width > components * (functions + width) { self } else { self.fold() }
    }

    /// [`Self::folded`], whatever memory that takes.
    #[must_use]
    pub fn fold(self) -> Self {
        let FactoredShape { width, components, .. } = self.shape;
        let Some(Layer { weights, biases, .. }) = self.shape.layers().pop() else { return self };
        let (matrix, bias) = (&self.parameters[weights..biases], &self.parameters[biases..]);
        let turned = Matrix::dense(&self.components, components);
        let mut along = product(turned, Matrix::dense(matrix, width));
        along.iter_mut().for_each(|value| *value *= self.scale);
        let mut mean = product(turned, Matrix::dense(bias, 1));
        mean.iter_mut().zip(&self.mean).for_each(|(sum, &mean)| *sum = mean + self.scale * *sum);
        let mut parameters = self.parameters;
        parameters.truncate(weights);
        let shape = self.shape.folded();
        Self { components: along, mean, shape, parameters, scale: 1.0, ..self }
    }

    /// The same field, to the rounding of f32, whose outputs are the coefficients of its functions, each by itself and μ with
    /// them: V and μ' are the linear layer.
    #[must_use]
    pub fn by_function(&self) -> Self {
        let folded = if self.shape.folded { self.clone() } else { self.clone().fold() };
        let functions = folded.basis.len();
        let mut parameters = folded.parameters;
        parameters.extend(folded.components.iter().map(|value| folded.scale * value));
        parameters.extend(&folded.mean);
        let mut components = vec![0.0; functions * functions];
        components.iter_mut().step_by(functions + 1).for_each(|value| *value = 1.0);
        let shape = FactoredShape { components: functions, folded: false, ..folded.shape };
        Self { components, mean: vec![0.0; functions], shape, parameters, scale: 1.0, ..folded }
    }

    /// The same field with a linear layer behind its sines: that of a folded one changes nothing.
    pub fn unfolded(&self) -> Cow<'_, Self> {
        if !self.shape.folded {
            return Cow::Borrowed(self);
        }
        let width = self.shape.width;
        let mut parameters = self.parameters.clone();
        let first = parameters.len();
        parameters.resize(first + width * (width + 1), 0.0);
        for neuron in 0..width {
            parameters[first + neuron * (width + 1)] = 1.0;
        }
        let shape = FactoredShape { folded: false, ..self.shape };
        Cow::Owned(Self { shape, parameters, ..self.clone() })
    }
}
