//! A step of SOAP's for all matrices between hidden layers: each by a thread of its own, as far as there are any.

use crate::engine::soap::{Soap, state_of};
use crate::engine::update::Arrays;
use imf_core::field::EngineError;
use imf_fields::recipe::SoapConfig;
use imf_fields::siren::plan::Plan;
use imf_fields::siren::transpose::transpose;

/// What steps each matrix between hidden layers, in their order.
pub(super) struct Matrices(Vec<Soap>);

impl Matrices {
    /// Goes on from the state saved after `step` steps.
    pub(super) fn new(config: SoapConfig, plan: &Plan, step: u64, kept: &[f32]) -> Result<Self, EngineError> {
        let kept = state_of(&plan.stack, step, kept)?;
        let rules = plan.layers[plan.stack.between()].iter().zip(kept).map(|(layer, kept)| {
            let mut soap = Soap::new(config, layer.outputs, layer.inputs);
            if !kept.is_empty() {
                soap.restore(kept);
            }
            soap
        });
        Ok(Self(rules.collect()))
    }

    /// What a state holds beside the moments.
    pub(super) fn kept(&self) -> Vec<f32> {
        self.0.iter().flat_map(Soap::kept).flatten().copied().collect()
    }

    /// Step number `step` of them all, with whole arrays in the layout of the parameters.
    pub(super) fn step(&mut self, plan: &Plan, step: u64, learning_rate: f32, arrays: Arrays<'_>) {
        let Some(first) = plan.layers.get(1) else { return };
        let (_, arrays) = arrays.split(first.weights);
        Pass { plan, step, learning_rate }.run(1, &mut self.0, arrays);
    }
}

/// One step.
struct Pass<'a> {
    plan: &'a Plan,
    step: u64,
    learning_rate: f32,
}

impl Pass<'_> {
    /// Of the layers from `index` on, one for each of `rules`, with arrays from the layer's weights on.
    fn run(&self, index: usize, rules: &mut [Soap], arrays: Arrays<'_>) {
        let start = self.plan.layers[index].weights;
        if rules.len() > 1 {
            let middle = rules.len() / 2;
            let (head, tail) = rules.split_at_mut(middle);
            let (first, second) = arrays.split(self.plan.layers[index + middle].weights - start);
            rayon::join(|| self.run(index, head, first), || self.run(index + middle, tail, second));
            return;
        }
        let [soap] = rules else { return };
        let layer = self.plan.layers[index];
        let (own, _) = arrays.split(layer.biases - start);
        let Arrays { parameters, first_moment, second_moment, gradient, panels } = own;
        soap.step(self.step, self.learning_rate, parameters, gradient, first_moment, second_moment);
        for neurons in self.plan.panels(index) {
            let range = self.plan.panel_range(index, &neurons);
            let range = range.start - start..range.end - start;
            transpose(&parameters[range.clone()], neurons.len(), layer.inputs, &mut panels[range]);
        }
    }
}
