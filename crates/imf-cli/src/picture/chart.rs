//! Curves over axes that are each linear or logarithmic, with a legend above.

use std::path::Path;

use anyhow::{Context as _, Result, ensure};
use image::{Rgb, RgbImage};

use super::axis::{Axis, AxisScale, GridLine};
use super::text::{Align, Pen};
use super::{FAINT_INK, INK, MARGIN, Picture, Tally, blank, fill, frame};

const WIDTH: u32 = 960;
const HEIGHT: u32 = 540;
const TITLE_HEIGHT: u32 = 34;
const LEGEND_HEIGHT: u32 = 28;
/// Height of every further line of the legend.
const LEGEND_LINE: u32 = 20;
/// Room below the plot for numbers and the axis' name.
const BELOW: u32 = 48;
const TITLE_SIZE: f32 = 20.0;
const NAME_SIZE: f32 = 14.0;
const TICK_SIZE: f32 = 12.5;
const LINE_RADIUS: f64 = 1.1;
const MARKER_RADIUS: f64 = 3.6;
const GRID: Rgb<u8> = Rgb([214, 214, 214]);
const FINE_GRID: Rgb<u8> = Rgb([240, 240, 240]);
/// Colours of Okabe and Ito, which colour-blind readers tell apart too.
const SERIES_COLOURS: [Rgb<u8>; 6] = [
    Rgb([0, 114, 178]),
    Rgb([213, 94, 0]),
    Rgb([0, 158, 115]),
    Rgb([204, 121, 167]),
    Rgb([230, 159, 0]),
    Rgb([86, 180, 233]),
];

/// A named curve.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// In the legend.
    pub name: String,
    /// (x, value) in drawing order. What has no place on its axis breaks the curve and is counted.
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

/// The rectangle of the plot in pixels.
#[derive(Clone, Copy)]
struct Plot {
    left: u32,
    top: u32,
    width: u32,
    height: u32,
}

impl Chart {
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
    /// No series.
    pub(crate) fn draw(&self) -> Result<Picture> {
        ensure!(!self.series.is_empty(), "a chart without curves");
        let mut image = blank(WIDTH, HEIGHT)?;
        let points = || self.series.iter().flat_map(|series| &series.points);
        let across = Axis::around(self.x_scale, points().map(|point| point.0), 0.01);
        let up = Axis::around(self.value_scale, points().map(|point| point.1), 0.04);
        let (columns, rows) = (across.grid(8), up.grid(8));

        let pen = Pen::regular(TICK_SIZE, FAINT_INK);
        let numbers =
            rows.iter().filter_map(|line| line.words.as_deref()).map(|words| pen.width(words)).max();
        let left = MARGIN + 26 + numbers.unwrap_or(0) + 8;
        let places = self.legend_places(left);
        let lines = places.last().map_or(0, |&(_, line)| line);
        let top = MARGIN + TITLE_HEIGHT + LEGEND_HEIGHT + lines * LEGEND_LINE;
        ensure!(top + BELOW + MARGIN < HEIGHT, "too many curves for one chart");
        let plot =
            Plot { left, top, width: WIDTH - left - MARGIN, height: HEIGHT - top - BELOW - MARGIN / 2 };

        let title_at = (i64::from(left), i64::from(MARGIN) + 16);
        Pen::bold(TITLE_SIZE, INK).write(&mut image, title_at, Align::Start, &self.title);
        self.legend(&mut image, &places, MARGIN + TITLE_HEIGHT);
        plot.grid(&mut image, &columns, &rows);
        let mut tally = Tally::default();
        for (series, colour) in self.series.iter().zip(SERIES_COLOURS.into_iter().cycle()) {
            tally += plot.curve(&mut image, series, colour, &across, &up);
        }
        frame(&mut image, plot.left, plot.top, plot.width, plot.height, INK);

        let pen = Pen::regular(NAME_SIZE, INK);
        let (middle, bottom) =
            (i64::from(plot.left + plot.width / 2), i64::from(plot.top + plot.height + BELOW));
        pen.write(&mut image, (middle, bottom - 8), Align::Middle, &self.x_name);
        let middle = i64::from(plot.top + plot.height / 2);
        pen.write_upwards(&mut image, (i64::from(MARGIN) + 10, middle), Align::Middle, &self.value_name);
        Ok(Picture { image, tally })
    }

    /// Where each series' key begins, and in which line of the legend: a key that would leave the picture goes on a
    /// line of its own.
    fn legend_places(&self, left: u32) -> Vec<(u32, u32)> {
        let pen = Pen::regular(NAME_SIZE, INK);
        let (mut x, mut line) = (left, 0);
        let mut places = Vec::with_capacity(self.series.len());
        for series in &self.series {
            let width = 29 + pen.width(&series.name);
            if x > left && x + width > WIDTH - MARGIN {
                (x, line) = (left, line + 1);
            }
            places.push((x, line));
            x += width + 24;
        }
        places
    }

    fn legend(&self, image: &mut RgbImage, places: &[(u32, u32)], first: u32) {
        let pen = Pen::regular(NAME_SIZE, INK);
        let keys = self.series.iter().zip(SERIES_COLOURS.into_iter().cycle());
        for ((series, colour), &(x, line)) in keys.zip(places) {
            let top = first + line * LEGEND_LINE;
            let mut ink = Coverage::new(Plot { left: x, top, width: 22, height: 18 });
            let (start, middle) = (f64::from(x), f64::from(top) + 8.0);
            ink.segment((start, middle), (start + 22.0, middle), LINE_RADIUS);
            if series.markers {
                ink.segment((start + 11.0, middle), (start + 11.0, middle), MARKER_RADIUS);
            }
            ink.blend(image, colour);
            pen.write(image, (i64::from(x) + 29, i64::from(top) + 13), Align::Start, &series.name);
        }
    }
}

impl Plot {
    /// Grid lines with their numbers, below and at the left.
    fn grid(&self, image: &mut RgbImage, columns: &[GridLine], rows: &[GridLine]) {
        let pen = Pen::regular(TICK_SIZE, FAINT_INK);
        let lower = (pen.digit_height() / 2.0).round() as i64;
        let colour = |line: &GridLine| if line.words.is_some() { GRID } else { FINE_GRID };
        for line in columns {
            let (x, _) = self.pixel(line.place, 0.0);
            let x = x as u32;
            fill(image, x, self.top, 1, self.height, colour(line));
            if let Some(words) = &line.words {
                let at = (i64::from(x), i64::from(self.top + self.height) + 17);
                pen.write(image, at, Align::Middle, words);
            }
        }
        for line in rows {
            let (_, y) = self.pixel(0.0, line.place);
            let y = y as u32;
            fill(image, self.left, y, self.width, 1, colour(line));
            if let Some(words) = &line.words {
                pen.write(image, (i64::from(self.left) - 7, i64::from(y) + lower), Align::End, words);
            }
        }
    }

    /// Pixel of a place, each in [0, 1], right and up.
    fn pixel(&self, across: f64, up: f64) -> (f64, f64) {
        (
            f64::from(self.left) + across * f64::from(self.width - 1),
            f64::from(self.top) + (1.0 - up) * f64::from(self.height - 1),
        )
    }

    fn curve(
        &self,
        image: &mut RgbImage,
        series: &Series,
        colour: Rgb<u8>,
        across: &Axis,
        up: &Axis,
    ) -> Tally {
        let mut tally = Tally::default();
        let mut ink = Coverage::new(*self);
        let mut previous = None;
        for &(x, value) in &series.points {
            let here = across.place(x).zip(up.place(value)).map(|(across, up)| self.pixel(across, up));
            match here {
                Some(here) => {
                    ink.segment(previous.unwrap_or(here), here, LINE_RADIUS);
                    if series.markers {
                        ink.segment(here, here, MARKER_RADIUS);
                    }
                }
                None if x.is_finite() && value.is_finite() => tally.out_of_range += 1,
                None => tally.not_finite += 1,
            }
            previous = here;
        }
        ink.blend(image, colour);
        tally
    }
}

/// How much of each pixel of the plot a curve covers; where it crosses itself nothing is covered twice.
struct Coverage {
    plot: Plot,
    /// `[height][width]`
    values: Vec<f32>,
}

impl Coverage {
    fn new(plot: Plot) -> Self {
        Self { plot, values: vec![0.0; (plot.width * plot.height) as usize] }
    }

    /// Covers what lies within `radius` of the segment, with an edge one pixel soft.
    fn segment(&mut self, from: (f64, f64), to: (f64, f64), radius: f64) {
        let Plot { left, top, width, height } = self.plot;
        let pixels = |low: f64, high: f64, start: u32, count: u32| {
            let first = (low - radius - 1.0).floor() as i64 - i64::from(start);
            let last = (high + radius + 1.0).ceil() as i64 - i64::from(start);
            first.clamp(0, i64::from(count)) as u32..(last + 1).clamp(0, i64::from(count)) as u32
        };
        let (along_x, along_y) = (to.0 - from.0, to.1 - from.1);
        let squared = along_x * along_x + along_y * along_y;
        for row in pixels(from.1.min(to.1), from.1.max(to.1), top, height) {
            for column in pixels(from.0.min(to.0), from.0.max(to.0), left, width) {
                let (x, y) = (f64::from(left + column) - from.0, f64::from(top + row) - from.1);
                let nearest =
                    if squared > 0.0 { ((x * along_x + y * along_y) / squared).clamp(0.0, 1.0) } else { 0.0 };
                let distance = (x - nearest * along_x).hypot(y - nearest * along_y);
                let covered = (radius + 0.5 - distance).clamp(0.0, 1.0) as f32;
                let value = &mut self.values[(row * width + column) as usize];
                *value = value.max(covered);
            }
        }
    }

    fn blend(&self, image: &mut RgbImage, colour: Rgb<u8>) {
        for (index, &covered) in self.values.iter().enumerate().filter(|&(_, &covered)| covered > 0.0) {
            let (row, column) = (index as u32 / self.plot.width, index as u32 % self.plot.width);
            let pixel = image.get_pixel_mut(self.plot.left + column, self.plot.top + row);
            for (channel, ink) in pixel.0.iter_mut().zip(colour.0) {
                let mixed = f32::from(*channel) + covered * (f32::from(ink) - f32::from(*channel));
                *channel = mixed.round() as u8;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::picture::PAPER;

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

    fn count(image: &RgbImage, colour: Rgb<u8>) -> usize {
        image.pixels().filter(|&&pixel| pixel == colour).count()
    }

    #[test]
    fn a_curve_is_drawn_in_its_colour() {
        let mut chart = chart((0..100).map(|step| (f64::from(step), 0.9f64.powi(step))).collect());
        let picture = chart.draw().unwrap();
        assert_eq!((picture.image.width(), picture.image.height()), (WIDTH, HEIGHT));
        assert_eq!(picture.tally, Tally::default());
        assert!(count(&picture.image, SERIES_COLOURS[0]) > 800);
        assert_eq!(*picture.image.get_pixel(WIDTH - 1, HEIGHT - 1), PAPER);
        chart.series[0].markers = true;
        let dotted = chart.draw().unwrap().image;
        assert!(count(&dotted, SERIES_COLOURS[0]) > count(&picture.image, SERIES_COLOURS[0]));
    }

    #[test]
    fn what_has_no_place_is_counted_and_breaks_the_curve() {
        let broken = chart(vec![(0.0, 1.0), (1.0, 0.0), (2.0, f64::NAN), (3.0, -1.0), (4.0, 0.5)]);
        let picture = broken.draw().unwrap();
        assert_eq!(picture.tally, Tally { not_finite: 1, out_of_range: 2 });
        let whole = chart(vec![(0.0, 1.0), (4.0, 0.5)]).draw().unwrap();
        assert!(count(&picture.image, SERIES_COLOURS[0]) + 300 < count(&whole.image, SERIES_COLOURS[0]));
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
    fn a_legend_of_many_curves_takes_several_lines_and_stays_inside() {
        let one = |index: usize| Series {
            name: format!("b16384-linear and so on {index}"),
            points: vec![(0.0, 1.0), (9.0, 0.1)],
            markers: false,
        };
        let many = Chart { series: (0..12).map(one).collect(), ..chart(vec![]) };
        let places = many.legend_places(80);
        let pen = Pen::regular(NAME_SIZE, INK);
        for (series, &(x, _)) in many.series.iter().zip(&places) {
            assert!(x + 29 + pen.width(&series.name) <= WIDTH - MARGIN, "{places:?}");
        }
        assert!(places.last().is_some_and(|&(_, line)| line > 1) && places.is_sorted_by_key(|p| p.1));
        assert!(many.draw().is_ok());
    }
}
