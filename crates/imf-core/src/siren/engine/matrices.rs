//! A step of Muon's for all matrices between hidden layers: each by a thread of its own, as far as there are any.

use super::super::muon::Muon;
use super::super::plan::{Plan, transpose};

/// The matrices between hidden layers, in a step of Muon's.
pub(super) struct Matrices<'a> {
    pub(super) plan: &'a Plan,
    pub(super) learning_rate: f32,
}

impl Matrices<'_> {
    /// Those from layer `index` on, one for each of `muons`: weights, momentum and panels from the layer's weights on, the whole
    /// gradient.
    pub(super) fn step(&self, index: usize, muons: &mut [Muon], arrays: [&mut [f32]; 3], gradient: &[f32]) {
        let start = self.plan.layers[index].weights;
        if muons.len() > 1 {
            let middle = muons.len() / 2;
            let at = self.plan.layers[index + middle].weights - start;
            let (head, tail) = muons.split_at_mut(middle);
            let [weights, momentum, panels] = arrays.map(|array| array.split_at_mut(at));
            rayon::join(
                || self.step(index, head, [weights.0, momentum.0, panels.0], gradient),
                || self.step(index + middle, tail, [weights.1, momentum.1, panels.1], gradient),
            );
            return;
        }
        let [muon] = muons else { return };
        let layer = self.plan.layers[index];
        let length = layer.biases - start;
        let [weights, momentum, panels] = arrays.map(|array| &mut array[..length]);
        muon.step(self.learning_rate, layer.outputs, weights, &gradient[start..layer.biases], momentum);
        for neurons in self.plan.panels(index) {
            let range = self.plan.panel_range(index, &neurons);
            let range = range.start - start..range.end - start;
            transpose(&weights[range.clone()], neurons.len(), layer.inputs, &mut panels[range]);
        }
    }
}
