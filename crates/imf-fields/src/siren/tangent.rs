//! One sample with its tangents beside it: rows that pass through a layer together and share one reading of the weights.
//! Row 0 is the value, the others its derivatives along as many directions of the input.

use pulp::{Simd, WithSimd};

use super::forward::Network;
use super::lanes::{load, store};
use super::sine::sine_cosine;

impl Network<'_> {
    /// A layer for one point, its tangents beside it: from `signal [ROWS][input]` to `out [ROWS][neuron]`, rows `widest` apart.
    pub(crate) fn layer_of_point<const ROWS: usize>(
        &self,
        index: usize,
        widest: usize,
        signal: &[f32],
        out: &mut [f32],
    ) {
        let (plan, layer) = (self.plan, &self.plan.layers[index]);
        for neurons in plan.panels(index) {
            self.arch.dispatch(PanelOfPoint::<ROWS> {
                panel: &self.panels[plan.panel_range(index, &neurons)],
                biases: &self.parameters[layer.biases + neurons.start..][..neurons.len()],
                signal: std::array::from_fn(|row| &signal[row * widest..][..layer.inputs]),
                out,
                widest,
                first: neurons.start,
                omega: (index < plan.stack.hidden).then_some(plan.stack.omega),
            });
        }
    }
}

/// One panel of neurons for one point.
struct PanelOfPoint<'a, const ROWS: usize> {
    /// `[inputs][neurons]`.
    panel: &'a [f32],
    biases: &'a [f32],
    /// `[ROWS][inputs]`.
    signal: [&'a [f32]; ROWS],
    out: &'a mut [f32],
    widest: usize,
    /// The panel's first neuron.
    first: usize,
    /// `None` for the linear layer.
    omega: Option<f32>,
}

/// Runs a body for every number below a constant of at most six, each a constant in its turn. Sums that the numbers pick are
/// registers from the start; a loop would leave it to the compiler's idea of its size, and where that says no, a pose takes
/// twice as long.
macro_rules! unrolled {
    ($place:ident < $count:ident, $body:block) => {
        const { assert!($count <= 6) };
        unrolled!(@ $place, $count, $body, 0 1 2 3 4 5);
    };
    (@ $place:ident, $count:ident, $body:block, $($number:literal)*) => {
        $({
            let $place = $number;
            if $place < $count $body
        })*
    };
}

/// Registers of neurons taken together: with four rows their sums hide the latency of a product.
const TOGETHER: usize = 4;

impl<const ROWS: usize> PanelOfPoint<'_, ROWS> {
    #[inline(always)]
    fn registers<S: Simd, const N: usize>(&mut self, simd: S, at: usize) {
        let columns = self.biases.len();
        let mut sums = [[simd.splat_f32s(0.0); N]; ROWS];
        for (input, weights) in self.panel.chunks_exact(columns).enumerate() {
            // Not a closure: one that the compiler does not inline knows no vector instructions, and takes ten times as long.
            unrolled!(place < N, {
                let weights = load(simd, weights, at + place * S::F32_LANES);
                unrolled!(row < ROWS, {
                    let signal = simd.splat_f32s(self.signal[row][input]);
                    sums[row][place] = simd.mul_add_e_f32s(signal, weights, sums[row][place]);
                });
            });
        }
        unrolled!(place < N, {
            let at = at + place * S::F32_LANES;
            let mut values = [simd.splat_f32s(0.0); ROWS];
            unrolled!(row < ROWS, {
                values[row] = sums[row][place];
            });
            values[0] = simd.add_f32s(values[0], load(simd, self.biases, at));
            if let Some(omega) = self.omega {
                let omega = simd.splat_f32s(omega);
                let (sine, cosine) = sine_cosine(simd, simd.mul_f32s(omega, values[0]));
                let slope = simd.mul_f32s(omega, cosine);
                unrolled!(row < ROWS, {
                    values[row] = if row == 0 { sine } else { simd.mul_f32s(slope, values[row]) };
                });
            }
            unrolled!(row < ROWS, {
                let out = &mut self.out[row * self.widest + self.first..][..columns];
                store(simd, out, at, values[row]);
            });
        });
    }
}

impl<const ROWS: usize> WithSimd for PanelOfPoint<'_, ROWS> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let columns = self.biases.len();
        let mut at = 0;
        while at + TOGETHER * S::F32_LANES <= columns {
            self.registers::<S, TOGETHER>(simd, at);
            at += TOGETHER * S::F32_LANES;
        }
        while at < columns {
            self.registers::<S, 1>(simd, at);
            at += S::F32_LANES;
        }
    }
}
