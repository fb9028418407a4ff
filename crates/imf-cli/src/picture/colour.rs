//! Colours of values: a perceptually uniform sequence for measures from zero up, two hues about white for signed
//! differences, and a colour of its own for what is not a number.

use image::Rgb;
use ndarray::ArrayView2;

/// Values that are not finite: in neither sequence.
pub(super) const NOT_FINITE: Rgb<u8> = Rgb([255, 0, 255]);

/// What is free: pale, as no colour of the sequence for measures is.
const FREE: Rgb<u8> = Rgb([214, 234, 248]);

/// A range of values, its colours, and the words beside its colour bar. Panels with equal scales share one bar.
#[derive(Clone, Debug, PartialEq)]
pub struct Scale {
    /// Blue through white to red from minus the limit to the limit, not Viridis from 0 to the limit.
    signed: bool,
    limit: f32,
    /// Beside the colour bar.
    pub(super) label: String,
    /// Names of the classes 0, 1, 2, …; none of a scale of values.
    pub(super) classes: Vec<String>,
    /// Values up to here are free, and have a colour of their own.
    pub(super) free: Option<f64>,
}

impl Scale {
    /// A measure's scale up to the largest finite value of all `slices`; up to 1 if there is none above 0.
    pub fn measure_of(slices: &[ArrayView2<'_, f32>], label: &str) -> Self {
        Self::measure(largest(slices, |value| value), label)
    }

    /// That of a difference where any value lies below 0, else that of a measure.
    pub fn of_values(slices: &[ArrayView2<'_, f32>], label: &str) -> Self {
        match slices.iter().flatten().any(|&value| value < 0.0) {
            true => Self::difference_of(slices, label),
            false => Self::measure_of(slices, label),
        }
    }

    /// A difference's scale up to the largest finite magnitude of all `slices`; up to 1 if there is none above 0.
    pub fn difference_of(slices: &[ArrayView2<'_, f32>], label: &str) -> Self {
        Self { signed: true, ..Self::measure(largest(slices, f32::abs), label) }
    }

    /// From 0 to `max`, for values that know their range.
    pub fn measure(max: f32, label: &str) -> Self {
        Self { signed: false, limit: max, label: label.to_owned(), classes: Vec::new(), free: None }
    }

    /// Values that are the numbers of classes: each has its colour, and its name beside it.
    pub(crate) fn classes(names: &[&str]) -> Self {
        let limit = names.len().saturating_sub(1).max(1) as f32;
        Self { classes: names.iter().map(|&name| name.to_owned()).collect(), ..Self::measure(limit, "") }
    }

    /// The scale with values of at most `tau` marked as free.
    pub(crate) fn with_free(self, tau: f64) -> Self {
        Self { free: Some(tau), ..self }
    }

    /// What has a colour of its own: each class, or what is free, with its name.
    pub(super) fn swatches(&self) -> Vec<(Rgb<u8>, String)> {
        let classes = self.classes.iter().enumerate();
        let classes = classes.map(|(class, name)| (self.colour(class as f32), name.clone()));
        let free = |tau: f64| match tau {
            0.0 => "free: nothing collides".to_owned(),
            tau => format!("free: at most τ = {tau}"),
        };
        classes.chain(self.free.map(|tau| (FREE, free(tau)))).collect()
    }

    /// First and last value.
    pub(super) fn range(&self) -> (f64, f64) {
        let limit = f64::from(self.limit);
        (if self.signed { -limit } else { 0.0 }, limit)
    }

    /// Colour of the part's outline that stands out from this scale's colours.
    pub(super) fn outline(&self) -> Rgb<u8> {
        Rgb([if self.signed { 60 } else { 255 }; 3])
    }

    /// Colour of a value: beyond the scale that at its end, and one of its own where it is not finite.
    pub(super) fn colour(&self, value: f32) -> Rgb<u8> {
        if !value.is_finite() {
            return NOT_FINITE;
        }
        if self.free.is_some_and(|tau| f64::from(value) <= tau) {
            return FREE;
        }
        let (low, high) = self.range();
        let place = (f64::from(value).clamp(low, high) - low) / (high - low);
        let colour = match self.signed {
            false => colorous::VIRIDIS.eval_continuous(place),
            // The sequence begins with red; red shall mean too large.
            true => colorous::RED_BLUE.eval_continuous(1.0 - place),
        };
        Rgb([colour.r, colour.g, colour.b])
    }
}

fn largest(slices: &[ArrayView2<'_, f32>], measure: impl Fn(f32) -> f32) -> f32 {
    let values = slices.iter().flat_map(|slice| slice.iter());
    let largest = values.map(|&value| measure(value)).filter(|value| value.is_finite()).fold(0.0, f32::max);
    if largest > 0.0 { largest } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use ndarray::array;

    use super::*;

    fn difference(limit: f32) -> Scale {
        Scale::difference_of(&[array![[limit]].view()], "")
    }

    #[test]
    fn known_values_have_the_published_colours() {
        let measure = Scale::measure(0.5, "");
        assert_eq!(measure.colour(0.0), Rgb([0x44, 0x01, 0x54]));
        assert_eq!(measure.colour(0.5), Rgb([0xfd, 0xe7, 0x25]));
        let difference = difference(0.1);
        let [red, green, blue] = difference.colour(0.0).0;
        assert!(red > 230 && green > 230 && blue > 230);
        let [red, _, blue] = difference.colour(0.08).0;
        assert!(red > blue + 80, "too large is red");
        let [red, _, blue] = difference.colour(-0.08).0;
        assert!(blue > red + 80, "too small is blue");
    }

    #[test]
    fn what_is_free_differs_from_the_least_that_collides() {
        let scale = Scale::measure(0.5, "").with_free(0.0);
        assert_eq!((scale.colour(0.0), scale.colour(1e-9)), (FREE, Rgb([0x44, 0x01, 0x54])));
        assert_eq!(scale.swatches(), [(FREE, "free: nothing collides".to_owned())]);
    }

    #[test]
    fn values_outside_take_the_colour_at_the_end() {
        let scale = Scale::measure(0.5, "");
        assert_eq!(scale.colour(7.0), scale.colour(0.5));
        assert_eq!(scale.colour(-0.1), scale.colour(0.0));
    }

    #[test]
    fn what_is_not_finite_has_its_own_colour() {
        for scale in [Scale::measure(1.0, ""), difference(1.0)] {
            for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
                assert_eq!(scale.colour(value), NOT_FINITE);
            }
            for step in -100i16..=100 {
                assert_ne!(scale.colour(f32::from(step) / 100.0), NOT_FINITE);
            }
        }
    }

    #[test]
    fn a_scale_is_taken_from_finite_values() {
        let (one, two) = (array![[0.1, f32::NAN]], array![[-0.4], [f32::INFINITY]]);
        assert_eq!(Scale::measure_of(&[one.view(), two.view()], "").range().1, f64::from(0.1f32));
        assert_eq!(Scale::difference_of(&[one.view(), two.view()], "").range().0, f64::from(-0.4f32));
        assert_eq!(Scale::measure_of(&[array![[0.0]].view()], "").range(), (0.0, 1.0));
    }
}
