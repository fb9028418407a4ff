//! Curves over axes that are each linear or logarithmic, and named values as level bars.

use std::path::Path;

use anyhow::{Result, ensure};
use image::RgbImage;
use plotters::chart::SeriesLabelPosition;
use plotters::element::{Circle, PathElement, Rectangle};
use plotters::style::{Color as _, RGBColor};

use super::axis::{Axis, AxisScale, BELOW, GRIDS, NAME_SIZE, plot};
use super::canvas::{BACKGROUND, INK, Lines, MARGIN, bold, on_canvas, save, text, width, write};

const WIDTH: u32 = 960;
const HEIGHT: u32 = 540;
pub(super) const TITLE_SIZE: f64 = 23.0;
/// Room for the bars themselves, and for one of them.
const BARS_WIDTH: u32 = 600;
const ROW_HEIGHT: u32 = 40;
/// Part of a row that its bar covers.
const BAR: f64 = 0.6;
const PLAIN: RGBColor = RGBColor(158, 172, 186);
const MARKED: RGBColor = RGBColor(0, 114, 178);
/// Colours of Okabe and Ito, which colour-blind readers distinguish too.
const SERIES_COLOURS: [RGBColor; 6] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(230, 159, 0),
    RGBColor(86, 180, 233),
];

/// A named curve.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// In the legend.
    pub name: String,
    /// (x, value) in drawing order.
    pub points: Vec<(f64, f64)>,
    /// A dot on every point, for curves of few points.
    pub markers: bool,
}

/// Curves in one plot.
#[derive(Clone, Debug, PartialEq)]
pub struct Chart {
    /// Written on top.
    pub title: String,
    /// Name of the axis to the right, with its unit.
    pub x_name: String,
    /// Spread of that axis.
    pub x_scale: AxisScale,
    /// Name of the value axis, with its unit.
    pub value_name: String,
    /// Spread of the value axis.
    pub value_scale: AxisScale,
    /// The curves; six have distinct colours.
    pub series: Vec<Series>,
}

impl Chart {
    /// Draws the chart and writes it as a PNG file. What has no place on an axis breaks its curve.
    ///
    /// # Errors
    /// No series, or a file that cannot be written; the error names the file.
    pub fn save(&self, path: &Path) -> Result<()> {
        save(self.draw(), path)
    }

    fn draw(&self) -> Result<RgbImage> {
        ensure!(!self.series.is_empty(), "a chart without curves");
        let points = || self.series.iter().flat_map(|series| &series.points);
        let across = Axis::around(self.x_scale, points().map(|point| point.0), 0.01);
        let up = Axis::around(self.value_scale, points().map(|point| point.1), 0.04);
        let legend = self.legend_position([&across, &up]);
        let title = Lines::new(&self.title, bold(TITLE_SIZE), WIDTH - 2 * MARGIN);
        on_canvas((WIDTH, HEIGHT), |area| {
            title.draw(area, (MARGIN, MARGIN))?;
            let top = MARGIN + title.height() + 8;
            let area = area.clone().shrink((MARGIN, top), (WIDTH - 2 * MARGIN, HEIGHT - top - MARGIN / 2));
            let (room, names) = ([up.room(), BELOW], [&self.x_name[..], &self.value_name]);
            let mut chart = plot(&area, room, [across, up], names, true)?;
            for (series, colour) in self.series.iter().zip(SERIES_COLOURS.into_iter().cycle()) {
                let place =
                    |&(x, value): &(f64, f64)| self.x_scale.place(x).zip(self.value_scale.place(value));
                let places: Vec<_> = series.points.iter().map(place).collect();
                let runs = places.split(Option::is_none).map(|run| run.iter().flatten().copied());
                let radius = if series.markers { 4 } else { 1 };
                let dots = places.iter().flatten().map(|&at| Circle::new(at, radius, colour.filled()));
                chart.draw_series(dots)?;
                chart
                    .draw_series(
                        runs.map(|run| PathElement::new(run.collect::<Vec<_>>(), colour.stroke_width(2))),
                    )?
                    .label(&series.name)
                    .legend(move |(x, y)| PathElement::new([(x, y), (x + 22, y)], colour.stroke_width(2)));
            }
            chart
                .configure_series_labels()
                .position(legend)
                .background_style(BACKGROUND.mix(0.85))
                .border_style(GRIDS[0])
                .label_font(text(NAME_SIZE, INK))
                .draw()?;
            Ok(())
        })
    }

    /// The upper corner that fewer points are in, the right one where they are as many.
    fn legend_position(&self, axes: [&Axis; 2]) -> SeriesLabelPosition {
        let fraction = |axis: &Axis, at: f64| (at - axis.range[0]) / (axis.range[1] - axis.range[0]);
        let [mut left, mut right] = [0, 0];
        for &(x, value) in self.series.iter().flat_map(|series| &series.points) {
            let Some((x, value)) = self.x_scale.place(x).zip(self.value_scale.place(value)) else { continue };
            if fraction(axes[1], value) > 2.0 / 3.0 {
                left += usize::from(fraction(axes[0], x) < 1.0 / 3.0);
                right += usize::from(fraction(axes[0], x) > 2.0 / 3.0);
            }
        }
        if left < right { SeriesLabelPosition::UpperLeft } else { SeriesLabelPosition::UpperRight }
    }
}

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
        let names = text(NAME_SIZE, INK);
        let number = |bar: &Bar| format!("{:.2e}", bar.value);
        let right = self.bars.iter().map(|bar| width(&number(bar), &names)).max().unwrap_or(0) + 10;
        let axis = Axis::for_bars(self.bars.iter().map(|bar| bar.value));
        let rows = Axis::rows(self.bars.iter().map(|bar| bar.name.clone()).collect());
        let [foot, _] = axis.range;
        let inside = rows.room() + BARS_WIDTH;
        let title = Lines::new(&self.title, bold(TITLE_SIZE), inside + right);
        let top = MARGIN + title.height() + 8;
        let height = ROW_HEIGHT.saturating_mul(self.bars.len() as u32).saturating_add(BELOW);
        on_canvas((2 * MARGIN + inside + right, height.saturating_add(top + MARGIN / 2)), |area| {
            title.draw(area, (MARGIN, MARGIN))?;
            let plotted = area.clone().shrink((MARGIN, top), (inside, height));
            let room = [rows.room(), BELOW];
            let mut chart = plot(&plotted, room, [axis, rows], [&self.value_name, ""], true)?;
            for (bar, row) in self.bars.iter().zip(0..) {
                let middle = f64::from(row) + 0.5;
                let end = AxisScale::Logarithmic.place(bar.value);
                let corners = end.map(|end| [(foot, middle - BAR / 2.0), (end, middle + BAR / 2.0)]);
                let colour = if bar.marked { MARKED } else { PLAIN };
                chart.draw_series(corners.map(|corners| Rectangle::new(corners, colour.filled())))?;
                let (x, y) = chart.backend_coord(&(end.unwrap_or(foot), middle));
                write(area, &number(bar), &names, (x as u32 + 9, y as u32 - 5))?;
            }
            Ok(())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::canvas::pixel;

    fn chart(points: Vec<(f64, f64)>) -> Chart {
        Chart {
            title: "Training".into(),
            x_name: "steps".into(),
            x_scale: AxisScale::Linear,
            value_name: "loss".into(),
            value_scale: AxisScale::Logarithmic,
            series: vec![Series { name: "training loss".into(), points, markers: false }],
        }
    }

    fn count(image: &RgbImage) -> usize {
        image.pixels().filter(|&&found| found == pixel(SERIES_COLOURS[0])).count()
    }

    #[test]
    fn a_curve_is_drawn_in_its_colour() {
        let mut chart = chart((0..100).map(|step| (f64::from(step), 0.9f64.powi(step))).collect());
        let picture = chart.draw().unwrap();
        assert_eq!(picture.dimensions(), (WIDTH, HEIGHT));
        assert!(count(&picture) > 800);
        assert_eq!(*picture.get_pixel(WIDTH - 1, HEIGHT - 1), pixel(BACKGROUND));
        chart.series[0].markers = true;
        assert!(count(&chart.draw().unwrap()) > count(&picture));
    }

    #[test]
    fn the_legend_covers_no_end_of_a_curve() {
        let points = |rate: f64| (0..100).map(|step| (f64::from(step), rate.powi(step))).collect();
        let [falling, rising] = [0.9, 1.1].map(|rate| count(&chart(points(rate)).draw().unwrap()));
        assert!(falling.abs_diff(rising) < falling / 20, "{falling} {rising}");
    }

    #[test]
    fn what_has_no_place_breaks_the_curve() {
        let broken = chart(vec![(0.0, 1.0), (1.0, 0.0), (2.0, f64::NAN), (3.0, -1.0), (4.0, 0.5)]);
        let whole = chart(vec![(0.0, 1.0), (4.0, 0.5)]).draw().unwrap();
        assert!(count(&broken.draw().unwrap()) + 300 < count(&whole));
    }

    #[test]
    fn curves_without_points_and_with_one_are_drawn() {
        assert!(chart(vec![]).draw().is_ok());
        assert!(chart(vec![(5.0, 0.1)]).draw().is_ok());
        let none = Chart { series: vec![], ..chart(vec![]) };
        let message = format!("{:#}", none.save(Path::new("loss.png")).unwrap_err());
        assert!(message.contains("loss.png"), "{message}");
    }

    #[test]
    fn a_legend_of_many_curves_and_a_long_title_stay_inside() {
        let one = |index: usize| Series {
            name: format!("b16384-linear and so on {index}"),
            points: vec![(0.0, 1.0), (9.0, 0.1)],
            markers: false,
        };
        let title = "A title of more words than fit into one line of the picture ".repeat(3);
        let many = Chart { title, series: (0..12).map(one).collect(), ..chart(vec![]) };
        let image = many.draw().unwrap();
        let edge = |x: u32| !(MARGIN / 2..WIDTH - MARGIN / 2).contains(&x);
        assert!(image.enumerate_pixels().all(|(x, _, found)| !edge(x) || *found == pixel(BACKGROUND)));
    }

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
