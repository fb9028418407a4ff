//! Named values as level bars with their numbers: errors beside what they are measured against.

use std::path::Path;

use anyhow::{Result, ensure};
use image::RgbImage;
use plotters::chart::ChartBuilder;
use plotters::element::Rectangle;
use plotters::style::{Color as _, RGBColor};

use super::axis::{Axis, AxisScale};
use super::chart::{BELOW, GRIDS, LOWER, NAME_SIZE, TICK_SIZE, TITLE_SIZE};
use super::paper::{FAINT_INK, INK, Lines, MARGIN, bold, on_paper, save, text, width, write};

const PLOT_WIDTH: u32 = 560;
const ROW_HEIGHT: u32 = 40;
/// Part of a row that its bar covers.
const BAR: f64 = 0.6;
const PLAIN: RGBColor = RGBColor(158, 172, 186);
const MARKED: RGBColor = RGBColor(0, 114, 178);

/// One named value.
#[derive(Clone, Debug, PartialEq)]
pub struct Bar {
    /// At the left of the bar.
    pub name: String,
    /// What is not above 0 gets no bar, only its number.
    pub value: f64,
    /// In the colour of what the chart is about.
    pub marked: bool,
}

/// Bars from top to bottom over a logarithmic axis.
#[derive(Clone, Debug, PartialEq)]
pub struct BarChart {
    /// Written on top.
    pub title: String,
    /// Name of the value axis, with its unit.
    pub value_name: String,
    /// The values.
    pub bars: Vec<Bar>,
}

impl BarChart {
    /// Draws the chart and writes it as a PNG file.
    ///
    /// # Errors
    /// No bars, too many for a picture, or a file that cannot be written; the error names the file.
    pub fn save(&self, path: &Path) -> Result<()> {
        save(self.draw(), path)
    }

    fn draw(&self) -> Result<RgbImage> {
        ensure!(!self.bars.is_empty(), "a chart without bars");
        let (names, ticks) = (text(NAME_SIZE, INK), text(TICK_SIZE, FAINT_INK));
        let number = |bar: &Bar| format!("{:.2e}", bar.value);
        let left = self.bars.iter().map(|bar| width(&bar.name, &names)).max().unwrap_or(0) + 12;
        let right = self.bars.iter().map(|bar| width(&number(bar), &names)).max().unwrap_or(0) + 10;
        let title = Lines::new(&self.title, bold(TITLE_SIZE), left + PLOT_WIDTH + right);
        let axis = Axis::for_bars(self.bars.iter().map(|bar| bar.value));
        let above = MARGIN + title.height() + 8;
        let plot = ROW_HEIGHT.saturating_mul(self.bars.len() as u32);
        let height = plot.saturating_add(above + BELOW + MARGIN / 2);
        on_paper((2 * MARGIN + left + PLOT_WIDTH + right, height), |area| {
            title.draw(area, (MARGIN, MARGIN))?;
            let mut chart = ChartBuilder::on(area)
                .margin_left(MARGIN)
                .margin_top(above)
                .margin_right(right + MARGIN)
                .margin_bottom(MARGIN / 2)
                .x_label_area_size(BELOW)
                .y_label_area_size(left)
                .build_cartesian_2d(axis.clone(), Axis::rows(self.bars.len()))?;
            chart
                .configure_mesh()
                .disable_y_mesh()
                .bold_line_style(GRIDS[0])
                .light_line_style(GRIDS[1])
                .axis_style(INK)
                .x_label_style(ticks)
                .y_label_style(names.clone())
                .y_label_offset(LOWER)
                .axis_desc_style(names.clone())
                .x_desc(&self.value_name)
                .y_label_formatter(&|row| self.bars[*row as usize].name.clone())
                .draw()?;
            for (bar, row) in self.bars.iter().zip(0..) {
                let middle = f64::from(row) + 0.5;
                let end = AxisScale::Logarithmic.place(bar.value);
                let corners = end.map(|end| [(axis.range[0], middle - BAR / 2.0), (end, middle + BAR / 2.0)]);
                let colour = if bar.marked { MARKED } else { PLAIN };
                chart.draw_series(corners.map(|corners| Rectangle::new(corners, colour.filled())))?;
                let (x, y) = chart.backend_coord(&(end.unwrap_or(axis.range[0]), middle));
                write(area, &number(bar), &names, (x as u32 + 9, y as u32 - 5))?;
            }
            Ok(())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::paper::pixel;

    fn bars(values: &[f64]) -> BarChart {
        BarChart {
            title: "Errors".into(),
            value_name: "mean squared error".into(),
            bars: values
                .iter()
                .enumerate()
                .map(|(index, &value)| Bar { name: format!("field {index}"), value, marked: index == 0 })
                .collect(),
        }
    }

    /// Length of the longest bar of a colour.
    fn length(picture: &RgbImage, colour: RGBColor) -> usize {
        let rows = picture.rows();
        rows.map(|row| row.filter(|&&found| found == pixel(colour)).count()).max().unwrap_or(0)
    }

    #[test]
    fn a_decade_is_as_long_everywhere() {
        let [one, two, three] = [[1e-4, 1e-1], [1e-3, 1e-1], [1e-2, 1e-1]].map(|values| {
            let mut chart = bars(&values);
            chart.bars.push(Bar { name: String::new(), value: 1e-4, marked: false });
            length(&chart.draw().unwrap(), MARKED)
        });
        assert!((two - one).abs_diff(three - two) <= 1, "{one} {two} {three}");
    }

    #[test]
    fn what_has_no_place_has_no_bar() {
        let picture = bars(&[0.0, f64::NAN, 0.5]).draw().unwrap();
        assert_eq!(length(&picture, MARKED), 0);
        assert!(length(&picture, PLAIN) > 0);
    }

    #[test]
    fn an_empty_chart_is_refused_with_the_file_named() {
        let message = format!("{:#}", bars(&[]).save(Path::new("errors.png")).unwrap_err());
        assert!(message.contains("errors.png"), "{message}");
    }
}
