//! Named values as level bars with their numbers: errors beside what they are measured against.

use std::path::Path;

use anyhow::{Context as _, Result, ensure};
use image::Rgb;

use super::axis::{Axis, AxisScale};
use super::text::{Align, Pen};
use super::ticks::short;
use super::{FAINT_INK, INK, MARGIN, Picture, Tally, blank, fill};

const PLOT_WIDTH: u32 = 560;
const TITLE_HEIGHT: u32 = 42;
const ROW_HEIGHT: u32 = 40;
const BAR_HEIGHT: u32 = 24;
/// Room below the bars for numbers and the axis' name.
const BELOW: u32 = 50;
const TITLE_SIZE: f32 = 20.0;
const NAME_SIZE: f32 = 14.0;
const TICK_SIZE: f32 = 12.5;
const GRID: Rgb<u8> = Rgb([214, 214, 214]);
const FINE_GRID: Rgb<u8> = Rgb([240, 240, 240]);
const PLAIN: Rgb<u8> = Rgb([158, 172, 186]);
const MARKED: Rgb<u8> = Rgb([0, 114, 178]);

/// One named value.
#[derive(Clone, Debug, PartialEq)]
pub struct Bar {
    /// At the left of the bar.
    pub name: String,
    /// What has no place on the axis gets no bar, only its number.
    pub value: f64,
    /// In the colour of what the chart is about.
    pub marked: bool,
}

/// Bars from top to bottom.
#[derive(Clone, Debug, PartialEq)]
pub struct BarChart {
    /// Written on top.
    pub title: String,
    /// Name of the value axis, with its unit.
    pub value_name: String,
    /// Spread of the value axis.
    pub scale: AxisScale,
    /// The values.
    pub bars: Vec<Bar>,
}

impl BarChart {
    /// Draws the chart and writes it as a PNG file.
    ///
    /// # Errors
    /// A picture that cannot be drawn, or a file that cannot be written; the error names the file.
    pub fn save(&self, path: &Path) -> Result<Tally> {
        self.draw().with_context(|| format!("cannot draw {}", path.display()))?.save(path)
    }

    /// Draws the chart.
    ///
    /// # Errors
    /// No bars, or too many for a picture.
    pub(crate) fn draw(&self) -> Result<Picture> {
        ensure!(!self.bars.is_empty(), "a chart without bars");
        let names = Pen::regular(NAME_SIZE, INK);
        let numbers = Pen::regular(NAME_SIZE, INK);
        let widest = |pen: &Pen, words: &dyn Fn(&Bar) -> String| {
            self.bars.iter().map(|bar| pen.width(&words(bar))).max().unwrap_or(0)
        };
        let left = MARGIN + widest(&names, &|bar| bar.name.clone()) + 12;
        let right = left + PLOT_WIDTH;
        let width = right + 10 + widest(&numbers, &|bar| short(bar.value)) + MARGIN;
        let width = width.max(2 * MARGIN + Pen::bold(TITLE_SIZE, INK).width(&self.title));
        let top = MARGIN + TITLE_HEIGHT;
        let height = ROW_HEIGHT.saturating_mul(self.bars.len() as u32);
        let mut image = blank(width, height.saturating_add(top + BELOW + MARGIN / 2))?;

        let title_at = (i64::from(MARGIN), i64::from(MARGIN) + 16);
        Pen::bold(TITLE_SIZE, INK).write(&mut image, title_at, Align::Start, &self.title);
        let axis = Axis::for_bars(self.scale, self.bars.iter().map(|bar| bar.value));
        let pixel = |place: f64| left + (place.clamp(0.0, 1.0) * f64::from(PLOT_WIDTH - 1)).round() as u32;
        let bottom = top + height;
        let pen = Pen::regular(TICK_SIZE, FAINT_INK);
        for line in axis.grid(8) {
            let x = pixel(line.place);
            fill(&mut image, x, top, 1, height, if line.words.is_some() { GRID } else { FINE_GRID });
            if let Some(words) = &line.words {
                pen.write(&mut image, (i64::from(x), i64::from(bottom) + 18), Align::Middle, words);
            }
        }
        let value_name_at = (i64::from(left + PLOT_WIDTH / 2), i64::from(bottom + BELOW) - 8);
        names.write(&mut image, value_name_at, Align::Middle, &self.value_name);

        let foot = if self.scale == AxisScale::Linear { pixel(axis.place(0.0).unwrap_or(0.0)) } else { left };
        let lower = i64::from(ROW_HEIGHT / 2) + (names.digit_height() / 2.0).round() as i64;
        let mut tally = Tally::default();
        for (index, bar) in self.bars.iter().enumerate() {
            let row = top + ROW_HEIGHT * index as u32;
            let baseline = i64::from(row) + lower;
            names.write(&mut image, (i64::from(left) - 10, baseline), Align::End, &bar.name);
            let mut end = foot;
            match axis.place(bar.value) {
                Some(place) => {
                    let x = pixel(place);
                    end = x.max(foot);
                    let colour = if bar.marked { MARKED } else { PLAIN };
                    let bar_top = row + (ROW_HEIGHT - BAR_HEIGHT) / 2;
                    fill(&mut image, x.min(foot), bar_top, end - x.min(foot) + 1, BAR_HEIGHT, colour);
                }
                None if bar.value.is_finite() => tally.out_of_range += 1,
                None => tally.not_finite += 1,
            }
            numbers.write(&mut image, (i64::from(end) + 9, baseline), Align::Start, &short(bar.value));
        }
        fill(&mut image, foot, top, 1, height, INK);
        Ok(Picture { image, tally })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn bars(values: &[f64]) -> BarChart {
        BarChart {
            title: "Errors".into(),
            value_name: "mean squared error".into(),
            scale: AxisScale::Logarithmic,
            bars: values
                .iter()
                .enumerate()
                .map(|(index, &value)| Bar { name: format!("field {index}"), value, marked: index == 0 })
                .collect(),
        }
    }

    fn area(picture: &Picture, colour: Rgb<u8>) -> u32 {
        picture.image.pixels().filter(|&&pixel| pixel == colour).count() as u32 / BAR_HEIGHT
    }

    #[test]
    fn a_decade_is_as_long_everywhere() {
        let [one, two, three] = [[1e-4, 1e-1], [1e-3, 1e-1], [1e-2, 1e-1]].map(|values| {
            let mut chart = bars(&values);
            chart.bars.push(Bar { name: String::new(), value: 1e-4, marked: false });
            area(&chart.draw().unwrap(), MARKED)
        });
        assert!((two - one).abs_diff(three - two) <= 1, "{one} {two} {three}");
    }

    #[test]
    fn what_has_no_place_has_no_bar_and_is_counted() {
        let picture = bars(&[0.0, f64::NAN, 0.5]).draw().unwrap();
        assert_eq!(picture.tally, Tally { not_finite: 1, out_of_range: 1 });
        assert_eq!(area(&picture, MARKED), 0);
        assert!(area(&picture, PLAIN) > 0);
    }

    #[test]
    fn an_empty_chart_is_refused_with_the_file_named() {
        let message = format!("{:#}", bars(&[]).save(Path::new("errors.png")).unwrap_err());
        assert!(message.contains("errors.png"), "{message}");
    }
}
