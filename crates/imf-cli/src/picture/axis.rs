//! A linear or logarithmic axis: which values it spans, and the numbers along it.
//!
//! plotters sees an axis in its own coordinates: values, or their logarithms to base 10.

use std::ops::Range;

use anyhow::Result;
use plotters::backend::BitMapBackend;
use plotters::chart::{ChartBuilder, ChartContext};
use plotters::coord::cartesian::Cartesian2d;
use plotters::coord::ranged1d::{BoldPoints, KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use plotters::coord::types::RangedCoordf64;
use plotters::style::RGBColor;

use super::canvas::{Area, FAINT_INK, INK, text, width};

/// Size of the numbers along axes.
pub(super) const TICK_SIZE: f64 = 15.0;
/// Size of names of axes, curves and panels.
pub(super) const NAME_SIZE: f64 = 16.0;
/// Room below a plot for numbers and the axis' name, in pixels.
pub(super) const BELOW: u32 = 44;
/// Grid lines at numbers, and between them.
pub(super) const GRIDS: [RGBColor; 2] = [RGBColor(214, 214, 214), RGBColor(240, 240, 240)];
/// By how much plotters writes the numbers of an axis upwards too high.
const LOWER: i32 = 3;

/// How values are spread along an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AxisScale {
    /// Evenly.
    Linear,
    /// By their logarithm; only values above 0 have a place.
    Logarithmic,
}

impl AxisScale {
    /// The coordinate of `value`; `None` if it has no place on such an axis.
    pub(super) fn place(self, value: f64) -> Option<f64> {
        let place = if self == Self::Linear { value } else { value.log10() };
        place.is_finite().then_some(place)
    }
}

#[derive(Clone, Debug)]
pub(super) struct Axis {
    scale: AxisScale,
    /// First and last coordinate.
    pub(super) range: [f64; 2],
    /// Coordinates of the numbers along it.
    numbers: Vec<f64>,
    decimals: usize,
    /// What is written instead of the numbers, if anything is.
    names: Vec<String>,
}

impl Axis {
    /// An axis with about `most` numbers.
    fn new(scale: AxisScale, range: [f64; 2], most: usize) -> Self {
        let [low, high] = range;
        let ticks = |most| RangedCoordf64::from(low..high).key_points(BoldPoints(most));
        let mut axis = Self { scale, range, numbers: vec![], decimals: 0, names: vec![] };
        axis.numbers = match scale {
            // A single tick shows no scale.
            AxisScale::Linear => {
                (most..most + 4).map(ticks).find(|ticks| ticks.len() > 1).unwrap_or_default()
            }
            AxisScale::Logarithmic if high - low < 2.6 => axis.digits(&[1, 2, 5]),
            AxisScale::Logarithmic => {
                let every = ((high - low) / most as f64).ceil();
                axis.digits(&[1]).into_iter().filter(|place| place.rem_euclid(every) == 0.0).collect()
            }
        };
        if let [first, second, ..] = axis.numbers[..] {
            axis.decimals = (-(second - first).log10() - 1e-9).ceil().max(0.0) as usize;
        }
        axis
    }

    /// A linear axis from `low` to `high` with about `most` numbers.
    pub(super) fn linear(low: f64, high: f64, most: usize) -> Self {
        Self::new(AxisScale::Linear, [low, high], most)
    }

    /// A linear axis along `pixels` pixels, with at most seven numbers, as many as stand apart.
    pub(super) fn along(low: f64, high: f64, pixels: u32) -> Self {
        let apart = |axis: &Self| match axis.numbers[..] {
            [first, second, ..] => {
                let step = (second - first).abs() / (high - low) * f64::from(pixels);
                step >= f64::from(axis.widest() + 8)
            }
            _ => true,
        };
        let axes = (2..=7).rev().map(|most| Self::linear(low, high, most));
        axes.reduce(|kept, fewer| if apart(&kept) { kept } else { fewer })
            .unwrap_or_else(|| Self::linear(low, high, 2))
    }

    /// Rows from top to bottom with their names, each one long.
    pub(super) fn rows(names: Vec<String>) -> Self {
        let numbers = (0..names.len()).map(|row| row as f64 + 0.5).collect();
        Self { scale: AxisScale::Linear, range: [names.len() as f64, 0.0], numbers, decimals: 0, names }
    }

    /// Spans those of `values` that have a place, with `room` of the span left free at both ends.
    pub(super) fn around(scale: AxisScale, values: impl Iterator<Item = f64>, room: f64) -> Self {
        let places = || values.filter_map(|value| scale.place(value));
        let ends = places().fold(None, |ends: Option<[f64; 2]>, place| {
            let [low, high] = ends.unwrap_or([place; 2]);
            Some([low.min(place), high.max(place)])
        });
        let [mut low, mut high] = ends.unwrap_or([0.0, 1.0]);
        if low == high {
            let half = if scale == AxisScale::Linear && low != 0.0 { 0.5 * low.abs() } else { 0.5 };
            (low, high) = (low - half, high + half);
        }
        let free = room * (high - low);
        Self::new(scale, [low - free, high + free], 8)
    }

    /// A logarithmic axis from a power of ten well below the smallest of `values` to beyond the largest.
    pub(super) fn for_bars(values: impl Iterator<Item = f64>) -> Self {
        let [low, high] = Self::around(AxisScale::Logarithmic, values, 0.0).range;
        // At least a third of a decade of every bar is seen.
        let low = (low - 0.33).floor();
        Self::new(AxisScale::Logarithmic, [low, high + 0.05 * (high - low)], 8)
    }

    /// Room for what is written along the axis, if it is one upwards, and for its ticks and its name.
    pub(super) fn room(&self) -> u32 {
        self.widest() + 36
    }

    /// Pixels of the widest number.
    fn widest(&self) -> u32 {
        let style = text(TICK_SIZE, FAINT_INK);
        self.labels().iter().map(|label| width(label, &style)).max().unwrap_or(0)
    }

    fn labels(&self) -> Vec<String> {
        self.numbers.iter().map(|place| self.format_ext(place)).collect()
    }

    /// Coordinates of these digits of every decade within the axis.
    fn digits(&self, digits: &[u8]) -> Vec<f64> {
        let [low, high] = self.range;
        let decades = low.floor() as i32..=high.floor() as i32;
        let all = decades
            .flat_map(|decade| digits.iter().map(move |&digit| f64::from(decade) + f64::from(digit).log10()));
        all.filter(|place| (low - 1e-9..=high + 1e-9).contains(place)).collect()
    }
}

/// As plotters takes it: grid lines at the numbers and, on a logarithmic axis, finer ones at all digits.
impl Ranged for Axis {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, place: &f64, pixels: (i32, i32)) -> i32 {
        RangedCoordf64::from(self.range()).map(place, pixels)
    }

    fn key_points<Hint: KeyPointHint>(&self, hint: Hint) -> Vec<f64> {
        if !hint.weight().allow_light_points() {
            return self.numbers.clone();
        }
        if self.scale == AxisScale::Linear { vec![] } else { self.digits(&[1, 2, 3, 4, 5, 6, 7, 8, 9]) }
    }

    fn range(&self) -> Range<f64> {
        self.range[0]..self.range[1]
    }
}

impl ValueFormatter<f64> for Axis {
    fn format_ext(&self, place: &f64) -> String {
        if let Some(name) = self.names.get(*place as usize) {
            return name.clone();
        }
        match self.scale {
            // No minus sign before zero.
            AxisScale::Linear if place.abs() < 1e-9 * (self.range[1] - self.range[0]) => {
                format!("{:.*}", self.decimals, 0.0)
            }
            AxisScale::Linear => format!("{place:.*}", self.decimals),
            AxisScale::Logarithmic => format!("{:.0e}", 10f64.powf(*place)),
        }
    }
}

/// Draws axes with `left` and `below` pixels of room for their numbers and names, and grid lines where they are wanted.
pub(super) fn plot<'a, 'b>(
    area: &'a Area<'b>,
    [left, below]: [u32; 2],
    [across, up]: [Axis; 2],
    [x_name, y_name]: [&str; 2],
    grid: bool,
) -> Result<ChartContext<'a, BitMapBackend<'b>, Cartesian2d<Axis, Axis>>> {
    let mut chart = ChartBuilder::on(area)
        .x_label_area_size(below)
        .y_label_area_size(left)
        .build_cartesian_2d(across, up)?;
    let mut mesh = chart.configure_mesh();
    if !grid {
        mesh.disable_mesh();
    }
    mesh.bold_line_style(GRIDS[0])
        .light_line_style(GRIDS[1])
        .axis_style(INK)
        .set_all_tick_mark_size(4)
        .label_style(text(TICK_SIZE, FAINT_INK))
        .y_label_offset(LOWER)
        .axis_desc_style(text(NAME_SIZE, INK))
        .x_desc(x_name)
        .y_desc(y_name)
        .draw()?;
    Ok(chart)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_linear_axis_is_even() {
        let axis = Axis::around(AxisScale::Linear, [0.0, 4.0, f64::NAN].into_iter(), 0.0);
        assert_eq!(axis.range, [0.0, 4.0]);
        assert_eq!(Axis::linear(0.0, 4.0, 5).labels(), ["0", "1", "2", "3", "4"]);
        assert_eq!(Axis::linear(-0.25, 1.0, 7).labels(), ["-0.2", "0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        assert_eq!(Axis::linear(-3.0, 61.0, 5).labels(), ["0", "20", "40", "60"]);
        assert_eq!(Axis::linear(0.0, 0.0123, 4).labels(), ["0.000", "0.005", "0.010"]);
        for limit in [0.0047, 0.0057] {
            assert!((3..6).contains(&Axis::linear(-limit, limit, 3).labels().len()));
        }
    }

    #[test]
    fn numbers_along_so_many_pixels_stand_apart() {
        assert_eq!(Axis::along(0.0, 0.99, 360).labels(), Axis::linear(0.0, 0.99, 7).labels());
        let long = Axis::along(-7.5e-4, 7.5e-4, 360);
        let step = (long.numbers[1] - long.numbers[0]) / 1.5e-3 * 360.0;
        assert!(long.numbers.len() > 1 && step > f64::from(long.widest()), "{:?}", long.labels());
    }

    #[test]
    fn a_logarithmic_axis_writes_powers_of_ten() {
        let around = |values: &[f64]| Axis::around(AxisScale::Logarithmic, values.iter().copied(), 0.0);
        let axis = around(&[1e-4, 1.0, 0.0, -3.0]);
        assert_eq!((axis.range, axis.digits(&[1, 2, 3, 4, 5, 6, 7, 8, 9]).len()), ([-4.0, 0.0], 37));
        assert_eq!(axis.labels(), ["1e-4", "1e-3", "1e-2", "1e-1", "1e0"]);
        assert_eq!(Axis::new(axis.scale, axis.range, 2).labels(), ["1e-4", "1e-2", "1e0"]);
        assert_eq!(around(&[0.015, 0.09]).labels(), ["2e-2", "5e-2"]);
        assert_eq!(AxisScale::Logarithmic.place(0.0), None);
    }

    #[test]
    fn bars_stand_on_a_power_of_ten() {
        let axis = Axis::for_bars([1.1e-3, 0.5].into_iter());
        assert!(axis.range[0] == -4.0 && axis.range[1] > 0.5f64.log10());
    }

    #[test]
    fn an_axis_without_values_or_with_one_has_a_range() {
        for scale in [AxisScale::Linear, AxisScale::Logarithmic] {
            for values in [vec![], vec![0.25], vec![0.25, 0.25]] {
                let axis = Axis::around(scale, values.into_iter(), 0.05);
                assert!(axis.range[1] > axis.range[0] && axis.labels().len() > 1);
            }
        }
    }
}
