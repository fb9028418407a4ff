//! From activations and δ to the gradient, and from the gradient to Adam's step, one piece of the parameters after the other;
//! the plan defines the pieces (`plan.rs`).

use pulp::Arch;

use crate::engine::adam::AdamFactors;
use crate::engine::bf16::Pairs;
use imf_fields::recipe::TrainingState;
use imf_fields::siren::matrix::{Matrix, multiply};
use imf_fields::siren::plan::{BLOCK, Part, Piece, Plan};
use imf_fields::siren::scratch::ScratchPool;
use imf_fields::siren::transpose::transpose;

/// What the update writes, all in the layout of the flat parameters.
pub(super) struct Arrays<'a> {
    pub(super) parameters: &'a mut [f32],
    pub(super) first_moment: &'a mut [f32],
    pub(super) second_moment: &'a mut [f32],
    pub(super) gradient: &'a mut [f32],
    pub(super) panels: &'a mut [f32],
}

impl<'a> Arrays<'a> {
    pub(super) fn of(state: &'a mut TrainingState, gradient: &'a mut [f32], panels: &'a mut [f32]) -> Self {
        let TrainingState { parameters, first_moment, second_moment, .. } = state;
        Self { parameters, first_moment, second_moment, gradient, panels }
    }

    /// Runs `piece` for every piece, on all threads, with what it writes.
    fn each(self, pieces: &[Piece], piece: &(impl Fn(&Piece, Arrays<'_>) + Sync)) {
        if let [only] = pieces {
            return piece(only, self);
        }
        let (first, second) = pieces.split_at(pieces.len() / 2);
        let (head, tail) = self.split(second[0].range.start - first[0].range.start);
        rayon::join(|| head.each(first, piece), || tail.each(second, piece));
    }

    pub(super) fn split(self, middle: usize) -> (Self, Self) {
        let (w, parameters) = self.parameters.split_at_mut(middle);
        let (m, first_moment) = self.first_moment.split_at_mut(middle);
        let (v, second_moment) = self.second_moment.split_at_mut(middle);
        let (g, gradient) = self.gradient.split_at_mut(middle);
        let (p, panels) = self.panels.split_at_mut(middle);
        let head = Self { parameters: w, first_moment: m, second_moment: v, gradient: g, panels: p };
        (head, Self { parameters, first_moment, second_moment, gradient, panels })
    }
}

/// Gradient of one window and, in the batch's last one, the Adam step.
pub(super) struct Update<'a> {
    pub(super) arch: Arch,
    pub(super) plan: &'a Plan,
    pub(super) samples: usize,
    /// Values of one layer in `activations` and `deltas`.
    pub(super) layer_length: usize,
    pub(super) activations: &'a [f32],
    pub(super) deltas: &'a [f32],
    /// δ of the output layer.
    pub(super) outputs: &'a [f32],
    pub(super) partials: &'a [f32],
    /// Room for the gradient of a piece.
    pub(super) gradients: &'a ScratchPool,
    /// Products in bfloat16, which have what `activations` and `deltas` would.
    pub(super) pairs: Option<&'a Pairs>,
    /// An earlier window has left its gradient.
    pub(super) accumulate: bool,
    pub(super) factors: Option<AdamFactors>,
    /// Leave the matrices between hidden layers as they are, but for their gradient.
    pub(super) spare_matrices: bool,
}

impl Update<'_> {
    pub(super) fn run(&self, arrays: Arrays<'_>) {
        arrays.each(&self.plan.pieces, &|piece, arrays| self.piece(piece, arrays));
    }

    fn piece(&self, piece: &Piece, arrays: Arrays<'_>) {
        // A gradient that Adam takes at once need not leave the cache.
        if self.factors.is_some() && !self.accumulate && !self.spare_matrices {
            self.gradients.with(|gradient| {
                let gradient = &mut gradient[..piece.range.len()];
                self.piece_in(piece, Arrays { gradient, ..arrays });
            });
        } else {
            self.piece_in(piece, arrays);
        }
    }

    /// With a gradient of the piece's own length.
    fn piece_in(&self, piece: &Piece, arrays: Arrays<'_>) {
        let plan = self.plan;
        let gradient = &mut *arrays.gradient;
        match &piece.part {
            Part::Biases => self.sum_partials(plan.partial_biases(piece.layer), gradient, 1),
            Part::Output => self.sum_partials(plan.partial_output(), gradient, 1),
            Part::Panel(neurons) => {
                let (width, inputs) = (plan.stack.width, plan.layers[piece.layer].inputs);
                let neurons_in = plan.neurons_in(piece.layer);
                if let Some(pairs) = self.pairs.filter(|_| piece.layer > 0) {
                    let blocks = self.samples.div_ceil(BLOCK);
                    pairs.gradient(piece.layer, neurons.clone(), blocks, gradient, inputs, self.accumulate);
                } else if piece.layer > 0 {
                    let deltas = if piece.layer == plan.stack.hidden {
                        self.outputs
                    } else {
                        &self.deltas[piece.layer * self.layer_length..]
                    };
                    let stride = plan.row_stride(piece.layer);
                    let deltas =
                        Matrix::row_major(&deltas[neurons.start..], self.samples, neurons.len(), stride);
                    let before = &self.activations[(piece.layer - 1) * self.layer_length..];
                    let before = Matrix::row_major(before, self.samples, width, plan.stride());
                    multiply(gradient, inputs, deltas.transposed(), before, self.accumulate);
                }
                if plan.sees_input(piece.layer) {
                    for axis in 0..plan.stack.inputs {
                        let sums = plan.partial_inputs(piece.layer) + axis * width + neurons.start;
                        self.sum_partials(sums, &mut gradient[neurons_in + axis..], inputs);
                    }
                }
            }
        }
        if let Some(factors) = self.factors {
            Step { arch: self.arch, plan, factors, spare_matrices: self.spare_matrices }.piece(piece, arrays);
        }
    }

    /// Adds up the blocks' partial sums from `first` on, in the order of the blocks, into every `stride`-th value.
    fn sum_partials(&self, first: usize, gradient: &mut [f32], stride: usize) {
        for (index, value) in gradient.iter_mut().step_by(stride).enumerate() {
            let sum: f32 =
                self.partials.chunks_exact(self.plan.partial_length()).map(|p| p[first + index]).sum();
            *value = if self.accumulate { *value + sum } else { sum };
        }
    }
}

/// The Adam step by a gradient that is whole.
pub(super) struct Step<'a> {
    pub(super) arch: Arch,
    pub(super) plan: &'a Plan,
    pub(super) factors: AdamFactors,
    /// Leave the matrices between hidden layers as they are.
    pub(super) spare_matrices: bool,
}

impl Step<'_> {
    pub(super) fn run(&self, arrays: Arrays<'_>) {
        arrays.each(&self.plan.pieces, &|piece, arrays| self.piece(piece, arrays));
    }

    fn piece(&self, piece: &Piece, arrays: Arrays<'_>) {
        let is_panel = matches!(piece.part, Part::Panel(_));
        if self.spare_matrices && is_panel && self.plan.stack.between().contains(&piece.layer) {
            return;
        }
        let Arrays { parameters, first_moment, second_moment, gradient, panels } = arrays;
        self.factors.apply(self.arch, parameters, gradient, first_moment, second_moment);
        if let Part::Panel(neurons) = &piece.part {
            transpose(parameters, neurons.len(), self.plan.layers[piece.layer].inputs, panels);
        }
    }
}
