//! A linear or logarithmic axis: which values it spans, where each lies on it, its grid lines and their words.

use super::ticks::{label, one_digit, power_of_ten, ticks};

/// Decades at and above which only powers of ten are written, as such.
const WIDE: f64 = 2.6;

/// How values are spread along an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AxisScale {
    /// Evenly.
    Linear,
    /// By their logarithm; only values above 0 have a place.
    Logarithmic,
}

impl AxisScale {
    /// True if `value` has a place on some axis of this kind.
    pub(super) fn admits(self, value: f64) -> bool {
        value.is_finite() && (self == Self::Linear || value > 0.0)
    }

    fn map(self, value: f64) -> f64 {
        match self {
            Self::Linear => value,
            Self::Logarithmic => value.log10(),
        }
    }
}

/// A grid line across the plot.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct GridLine {
    /// From 0 at the axis' start to 1 at its end.
    pub(super) place: f64,
    /// `None` between the values that are written.
    pub(super) words: Option<String>,
}

/// An axis with a range.
#[derive(Clone, Copy, Debug)]
pub(super) struct Axis {
    scale: AxisScale,
    /// First value; its logarithm on a logarithmic axis.
    low: f64,
    /// Last value; likewise.
    high: f64,
}

impl Axis {
    /// Spans those of `values` that have a place, with `room` of the span left free at both ends.
    pub(super) fn around(scale: AxisScale, values: impl Iterator<Item = f64>, room: f64) -> Self {
        let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
        for value in values.filter(|&value| scale.admits(value)).map(|value| scale.map(value)) {
            low = low.min(value);
            high = high.max(value);
        }
        if low > high {
            (low, high) = (0.0, 1.0);
        }
        if low == high {
            let half = if scale == AxisScale::Linear && low != 0.0 { 0.5 * low.abs() } else { 0.5 };
            (low, high) = (low - half, high + half);
        }
        let free = room * (high - low);
        Self { scale, low: low - free, high: high + free }
    }

    /// From a foot for bars (0, or a power of ten well below the smallest value) to beyond the largest value.
    pub(super) fn for_bars(scale: AxisScale, values: impl Iterator<Item = f64>) -> Self {
        let mut axis = Self::around(scale, values, 0.0);
        axis.low = match scale {
            AxisScale::Linear => axis.low.min(0.0),
            // At least a third of a decade of every bar is seen.
            AxisScale::Logarithmic => (axis.low - 0.33).floor(),
        };
        axis.high += 0.05 * (axis.high - axis.low);
        axis
    }

    /// Where `value` lies, from 0 at the start to 1 at the end; `None` if it has no place on this kind of axis.
    pub(super) fn place(&self, value: f64) -> Option<f64> {
        self.scale.admits(value).then(|| (self.scale.map(value) - self.low) / (self.high - self.low))
    }

    /// Grid lines from low to high; about `most` of them are written.
    pub(super) fn grid(&self, most: usize) -> Vec<GridLine> {
        match self.scale {
            AxisScale::Linear => {
                let (values, decimals) = ticks(self.low, self.high, most);
                let line = |value| GridLine { place: self.unit(value), words: Some(label(value, decimals)) };
                values.into_iter().map(line).collect()
            }
            AxisScale::Logarithmic => self.logarithmic_grid(most),
        }
    }

    fn logarithmic_grid(&self, most: usize) -> Vec<GridLine> {
        let decades = self.high - self.low;
        let every = (decades / most.max(1) as f64).ceil().max(1.0) as i32;
        let mut lines = Vec::new();
        for exponent in self.low.floor() as i32..=self.high.floor() as i32 {
            for digit in 1u32..10 {
                let value = f64::from(exponent) + f64::from(digit).log10();
                if value < self.low - 1e-9 || value > self.high + 1e-9 {
                    continue;
                }
                let words = match digit {
                    1 | 2 | 5 if decades < WIDE => Some(one_digit(digit, exponent)),
                    1 if exponent.rem_euclid(every) == 0 => Some(power_of_ten(exponent)),
                    _ => None,
                };
                lines.push(GridLine { place: self.unit(value), words });
            }
        }
        lines
    }

    fn unit(&self, mapped: f64) -> f64 {
        (mapped - self.low) / (self.high - self.low)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(lines: &[GridLine]) -> Vec<&str> {
        lines.iter().filter_map(|line| line.words.as_deref()).collect()
    }

    #[test]
    fn a_linear_axis_is_even() {
        let axis = Axis::around(AxisScale::Linear, [0.0, 4.0, f64::NAN].into_iter(), 0.0);
        assert_eq!(axis.place(1.0), Some(0.25));
        assert_eq!(axis.place(f64::NAN), None);
        assert_eq!(words(&axis.grid(5)), ["0", "1", "2", "3", "4"]);
    }

    #[test]
    fn a_logarithmic_axis_writes_powers_of_ten() {
        let axis = Axis::around(AxisScale::Logarithmic, [1e-4, 1.0, 0.0, -3.0].into_iter(), 0.0);
        assert!((axis.place(1e-2).unwrap() - 0.5).abs() < 1e-12);
        assert_eq!(axis.place(0.0), None);
        assert_eq!(words(&axis.grid(8)), ["10⁻⁴", "10⁻³", "10⁻²", "10⁻¹", "10⁰"]);
        assert_eq!(words(&axis.grid(2)), ["10⁻⁴", "10⁻²", "10⁰"]);
        assert_eq!(axis.grid(8).len(), 37);
    }

    #[test]
    fn a_narrow_logarithmic_axis_writes_more() {
        let axis = Axis::around(AxisScale::Logarithmic, [0.015, 0.09].into_iter(), 0.0);
        assert_eq!(words(&axis.grid(8)), ["0.02", "0.05"]);
    }

    #[test]
    fn bars_stand_on_zero_or_on_a_power_of_ten() {
        let linear = Axis::for_bars(AxisScale::Linear, [2.0, 3.0].into_iter());
        assert_eq!(linear.place(0.0), Some(0.0));
        let logarithmic = Axis::for_bars(AxisScale::Logarithmic, [1.1e-3, 0.5].into_iter());
        assert!(logarithmic.place(1e-4).unwrap().abs() < 1e-12);
        assert!(logarithmic.place(0.5).unwrap() < 1.0);
    }

    #[test]
    fn an_axis_without_values_or_with_one_has_a_range() {
        for scale in [AxisScale::Linear, AxisScale::Logarithmic] {
            for values in [vec![], vec![0.25], vec![0.25, 0.25]] {
                let axis = Axis::around(scale, values.into_iter(), 0.05);
                assert!(axis.high > axis.low && !axis.grid(6).is_empty());
            }
        }
    }
}
