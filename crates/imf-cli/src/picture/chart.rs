//! Curves over axes that are each linear or logarithmic.

use std::path::Path;

use anyhow::{Result, ensure};
use image::RgbImage;
use plotters::chart::{ChartBuilder, SeriesLabelPosition};
use plotters::element::{Circle, PathElement};
use plotters::style::{Color as _, RGBColor};

use super::axis::{Axis, AxisScale};
use super::paper::{FAINT_INK, INK, Lines, MARGIN, PAPER, bold, on_paper, save, text, width};

const WIDTH: u32 = 960;
const HEIGHT: u32 = 540;
/// Size of a picture's title.
pub(super) const TITLE_SIZE: f64 = 23.0;
/// Size of names of axes and curves.
pub(super) const NAME_SIZE: f64 = 16.0;
/// Size of the numbers along the axes.
pub(super) const TICK_SIZE: f64 = 14.5;
/// Room below a plot for numbers and the axis' name.
pub(super) const BELOW: u32 = 46;
/// Grid lines at numbers, and between them.
pub(super) const GRIDS: [RGBColor; 2] = [RGBColor(214, 214, 214), RGBColor(240, 240, 240)];
/// By how much plotters writes the numbers of an axis upwards too high.
pub(super) const LOWER: i32 = 3;
/// Colours of Okabe and Ito, which colour-blind readers tell apart too.
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
    /// The curves; six are told apart by colour.
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
        let (names, ticks) = (text(NAME_SIZE, INK), text(TICK_SIZE, FAINT_INK));
        let numbers = up.labels().map(|label| width(&label, &ticks)).max().unwrap_or(0);
        let title = Lines::new(&self.title, bold(TITLE_SIZE), WIDTH - 2 * MARGIN);
        on_paper((WIDTH, HEIGHT), |area| {
            title.draw(area, (MARGIN, MARGIN))?;
            let mut chart = ChartBuilder::on(area)
                .margin(MARGIN)
                .margin_top(MARGIN + title.height() + 8)
                .margin_bottom(MARGIN / 2)
                .x_label_area_size(BELOW)
                .y_label_area_size(numbers + 36)
                .build_cartesian_2d(across, up)?;
            chart
                .configure_mesh()
                .bold_line_style(GRIDS[0])
                .light_line_style(GRIDS[1])
                .axis_style(INK)
                .label_style(ticks)
                .y_label_offset(LOWER)
                .axis_desc_style(names.clone())
                .x_desc(&self.x_name)
                .y_desc(&self.value_name)
                .draw()?;
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
                .position(SeriesLabelPosition::UpperRight)
                .background_style(PAPER.mix(0.85))
                .border_style(GRIDS[0])
                .label_font(names)
                .draw()?;
            Ok(())
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::paper::pixel;

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
        assert_eq!(*picture.get_pixel(WIDTH - 1, HEIGHT - 1), pixel(PAPER));
        chart.series[0].markers = true;
        assert!(count(&chart.draw().unwrap()) > count(&picture));
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
        let edge = |x: u32| x < MARGIN / 2 || x >= WIDTH - MARGIN / 2;
        assert!(image.enumerate_pixels().all(|(x, _, found)| !edge(x) || *found == pixel(PAPER)));
    }
}
