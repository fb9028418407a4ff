//! The end of the paper's network: a sigmoid that reaches a little below 0, and is clamped there.
//!
//! A plain sigmoid `σ` never is 0, and the slope of a loss of absolute values dies where it comes near: 1e-4 was left wherever the
//! tool is free, half of the error of the inaccessibility measure. `(1 + e)·σ(s) − e` passes 0 with the slope `e`, and what is
//! below counts as 0.

/// How far the sigmoid reaches below 0, `e`. At 0.003 and 0.03 the minimum over directions errs a tenth more (`docs/lab/paper-network.md`).
pub const STRETCH: f64 = 0.01;

/// The output of one sample.
#[derive(Clone, Copy, Debug)]
pub struct Output {
    /// Before it is clamped: −[`STRETCH`] to 1.
    open: f64,
    /// Its derivative by the sum.
    slope: f64,
}

impl Output {
    /// From the last layer's sum.
    #[must_use]
    pub fn of_sum(sum: f64) -> Self {
        let sigmoid = 1.0 / (1.0 + (-sum).exp());
        Self { open: (1.0 + STRETCH) * sigmoid - STRETCH, slope: (1.0 + STRETCH) * sigmoid * (1.0 - sigmoid) }
    }

    /// The collision measure, in [0, 1].
    #[must_use]
    pub fn value(self) -> f64 {
        // Not `max`, by which NaN would be free.
        if self.open < 0.0 { 0.0 } else { self.open }
    }

    /// The value's derivative by the sum: 0 where it is clamped.
    #[must_use]
    pub fn slope(self) -> f64 {
        if self.open > 0.0 { self.slope } else { 0.0 }
    }

    /// What a loss compares with a target, and its derivative by the sum. Below 0 it is right for a target of 0 alone: for
    /// others it is what stands before the clamp, whose slope leads back.
    #[must_use]
    pub fn learnt(self, target: f64) -> (f64, f64) {
        if target > 0.0 { (self.open, self.slope) } else { (self.value(), self.slope()) }
    }
}

/// Moves a network's values about 0, as many below as above: its last bias to where the output passes 0. For tests.
///
/// # Panics
/// Without parameters.
#[doc(hidden)]
pub fn move_to_the_foot(parameters: &mut [f32]) {
    *parameters.last_mut().expect("a bias") = STRETCH.ln() as f32;
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn below_the_foot_the_value_is_zero_and_only_a_target_above_leads_back() {
        let foot = STRETCH.ln();
        for (sum, is_clamped) in
            [(-80.0, true), (foot - 1e-6, true), (foot + 1e-6, false), (0.0, false), (80.0, false)]
        {
            let output = Output::of_sum(sum);
            assert_eq!(output.value() == 0.0, is_clamped, "{sum}");
            assert_eq!(output.slope() == 0.0, is_clamped || sum == 80.0, "{sum}");
            assert_eq!(output.learnt(0.0), (output.value(), output.slope()));
            let (learnt, slope) = output.learnt(0.3);
            assert_eq!(learnt < 0.0, is_clamped, "{sum}");
            let above = Output::of_sum(sum + 1e-5).learnt(0.3).0;
            // Central differences would do no better than this one-sided one: 1e-5 of a slope that is 1 at most.
            assert!(((above - learnt) / 1e-5 - slope).abs() < 1e-5, "{sum}");
        }
        assert_eq!(Output::of_sum(80.0).value(), 1.0);
        assert!(Output::of_sum(f64::NAN).value().is_nan());
    }
}
