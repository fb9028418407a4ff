//! One Adam step over a range of parameters in a single pass; the definition is [`super::reference::adam_step`].

use pulp::{Arch, Simd, WithSimd};

use imf_fields::recipe::AdamConfig;
use imf_fields::siren::lanes::{load, store};

/// The factors of one step, computed once in f64.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AdamFactors {
    config: AdamConfig,
    /// Learning rate over the first moment's bias correction.
    rate: f32,
    /// One over the root of the second moment's bias correction.
    root_correction: f32,
}

impl AdamFactors {
    /// `step` counts from 1.
    pub(crate) fn new(config: AdamConfig, learning_rate: f32, step: u64) -> Self {
        let correction = |beta: f32| 1.0 - f64::from(beta).powf(step as f64);
        Self {
            config,
            rate: (f64::from(learning_rate) / correction(config.beta1)) as f32,
            root_correction: (1.0 / correction(config.beta2).sqrt()) as f32,
        }
    }

    /// Updates parameters and moments from the gradient of the loss; all of one length.
    pub(crate) fn apply(
        &self,
        arch: Arch,
        parameters: &mut [f32],
        gradient: &[f32],
        first_moment: &mut [f32],
        second_moment: &mut [f32],
    ) {
        arch.dispatch(Pass { factors: *self, parameters, gradient, first_moment, second_moment });
    }
}

struct Pass<'a> {
    factors: AdamFactors,
    parameters: &'a mut [f32],
    gradient: &'a [f32],
    first_moment: &'a mut [f32],
    second_moment: &'a mut [f32],
}

impl WithSimd for Pass<'_> {
    type Output = ();
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let AdamFactors { config, rate, root_correction } = self.factors;
        let splat = |value| simd.splat_f32s(value);
        let (beta1, rest1) = (splat(config.beta1), splat(1.0 - config.beta1));
        let (beta2, rest2) = (splat(config.beta2), splat(1.0 - config.beta2));
        let (rate, root_correction) = (splat(rate), splat(root_correction));
        let (decay, epsilon) = (splat(config.weight_decay), splat(config.epsilon));
        for at in (0..self.parameters.len()).step_by(S::F32_LANES) {
            let weight = load(simd, self.parameters, at);
            let slope = simd.mul_add_e_f32s(decay, weight, load(simd, self.gradient, at));
            let first = simd.mul_f32s(beta1, load(simd, self.first_moment, at));
            let first = simd.mul_add_e_f32s(rest1, slope, first);
            let second = simd.mul_f32s(beta2, load(simd, self.second_moment, at));
            let second = simd.mul_add_e_f32s(rest2, simd.mul_f32s(slope, slope), second);
            let denominator = simd.mul_add_e_f32s(simd.sqrt_f32s(second), root_correction, epsilon);
            let change = simd.div_f32s(simd.mul_f32s(rate, first), denominator);
            store(simd, self.first_moment, at, first);
            store(simd, self.second_moment, at, second);
            store(simd, self.parameters, at, simd.sub_f32s(weight, change));
        }
    }
}
