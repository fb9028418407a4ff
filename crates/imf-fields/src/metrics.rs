//! Errors of a field against the exact one, accumulated section by section.

use serde::{Deserialize, Serialize};

/// Sums from which errors follow; add in any order, merge by [`Errors::merge`] in a fixed one for equal bits.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Errors {
    count: u64,
    squared: f64,
    absolute: f64,
    largest: f64,
    exact_sum: f64,
    exact_squared: f64,
    colliding: u64,
    free: u64,
    false_free: u64,
    false_colliding: u64,
    both: u64,
    either: u64,
}

/// What is reported. MSE and MPE as in the paper; decisions call a pose colliding where the field exceeds `threshold`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ErrorReport {
    /// Values compared.
    pub count: u64,
    /// Mean squared error.
    pub mse: f64,
    /// Mean absolute error.
    pub mae: f64,
    /// Largest absolute error at a point.
    pub mpe: f64,
    /// Variance of the exact values: the MSE of the best constant.
    pub variance: f64,
    /// Values above which a pose is called colliding by the field; exactly, colliding is CMF > 0.
    pub threshold: f64,
    /// Fraction of the colliding poses that the field calls free.
    pub false_free: f64,
    /// Fraction of the free poses that the field calls colliding.
    pub false_colliding: f64,
    /// Intersection over union of the configuration-space obstacle, exact and by the field, of the tool that the field is of.
    pub iou: f64,
}

impl Errors {
    /// Compares a section (or any run of values) with the exact one.
    ///
    /// # Panics
    /// If the lengths differ.
    pub fn add(&mut self, exact: &[f32], field: &[f32], threshold: f64) {
        self.add_beside(exact, exact, field, threshold);
    }

    /// As [`Self::add`], for a field of an offset tool: `exact` is of the offset tool, `bare` of the true one. A pose
    /// collides if the true tool does and is clear if the offset one is free; poses between count as neither.
    ///
    /// # Panics
    /// If the lengths differ.
    pub fn add_beside(&mut self, exact: &[f32], bare: &[f32], field: &[f32], threshold: f64) {
        let lengths = [bare.len(), field.len()];
        assert_eq!(lengths, [exact.len(); 2], "one value of the field for each exact one");
        for ((&e, &f), &bare) in exact.iter().zip(field).zip(bare) {
            let (e, f) = (f64::from(e), f64::from(f));
            let error = (f - e).abs();
            self.squared += error * error;
            self.absolute += error;
            self.largest = larger(self.largest, error);
            self.exact_sum += e;
            self.exact_squared += e * e;
            let (collides, clear, blocked) = (bare > 0.0, e <= 0.0, f > threshold);
            self.both += u64::from(!clear && blocked);
            self.either += u64::from(!clear || blocked);
            self.colliding += u64::from(collides);
            self.free += u64::from(clear);
            self.false_free += u64::from(collides && !blocked);
            self.false_colliding += u64::from(clear && blocked);
        }
        self.count += exact.len() as u64;
    }

    /// Takes other sums in.
    pub fn merge(&mut self, other: &Self) {
        self.count += other.count;
        self.squared += other.squared;
        self.absolute += other.absolute;
        self.largest = if other.largest.is_nan() { f64::NAN } else { self.largest.max(other.largest) };
        self.exact_sum += other.exact_sum;
        self.exact_squared += other.exact_squared;
        self.colliding += other.colliding;
        self.free += other.free;
        self.false_free += other.false_free;
        self.false_colliding += other.false_colliding;
        self.both += other.both;
        self.either += other.either;
    }

    /// The errors; all zero where nothing was compared.
    pub fn report(&self, threshold: f64) -> ErrorReport {
        let n = self.count.max(1) as f64;
        let share = |part: u64, whole: u64| if whole == 0 { 0.0 } else { part as f64 / whole as f64 };
        let mean = self.exact_sum / n;
        ErrorReport {
            count: self.count,
            mse: self.squared / n,
            mae: self.absolute / n,
            mpe: self.largest,
            variance: (self.exact_squared / n - mean * mean).max(0.0),
            threshold,
            false_free: share(self.false_free, self.colliding),
            false_colliding: share(self.false_colliding, self.free),
            iou: if self.either == 0 { 1.0 } else { share(self.both, self.either) },
        }
    }
}

/// A mean squared error at orientations drawn at random, and how sure it is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Validation {
    /// Orientations, drawn at random and apart from those that the field was made from.
    pub orientations: usize,
    /// Mean squared error.
    pub mse: f64,
    /// Its standard error: the standard deviation of the orientations' own errors over the root of their number; 0 of one.
    pub standard_error: f64,
    /// Largest error met.
    pub mpe: f64,
}

impl Validation {
    /// Of the errors of every orientation: its mean squared one, and its largest.
    pub fn of(errors: &[(f64, f64)]) -> Self {
        let n = errors.len().max(1) as f64;
        let mse = errors.iter().map(|(mse, _)| mse).sum::<f64>() / n;
        let spread =
            errors.iter().map(|(own, _)| (own - mse) * (own - mse)).sum::<f64>() / (n - 1.0).max(1.0);
        Self {
            orientations: errors.len(),
            mse,
            standard_error: (spread / n).sqrt(),
            mpe: errors.iter().fold(0.0, |most, &(_, largest)| larger(most, largest)),
        }
    }
}

/// The larger of two errors; a NaN does not vanish in it.
pub(crate) fn larger(a: f64, b: f64) -> f64 {
    if a.is_nan() || b <= a { a } else { b }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grown_tools_poses_between_may_be_called_either_way() {
        let (exact, bare) = ([0.0, 0.2, 0.5, 0.4], [0.0, 0.0, 0.3, 0.0]);
        let mut errors = Errors::default();
        errors.add_beside(&exact, &bare, &[0.3, 0.0, 0.05, 0.9], 0.1);
        let r = errors.report(0.1);
        assert_eq!((r.false_free, r.false_colliding, r.iou), (1.0, 1.0, 0.25));
    }

    #[test]
    fn the_standard_error_is_that_of_a_mean() {
        let of = Validation::of(&[(1.0, 2.0), (3.0, 5.0), (2.0, 1.0), (2.0, 4.0)]);
        assert_eq!((of.orientations, of.mse, of.mpe), (4, 2.0, 5.0));
        assert!((of.standard_error - (2.0_f64 / 3.0 / 4.0).sqrt()).abs() < 1e-15);
        assert_eq!(Validation::of(&[(1.0, 1.0)]).standard_error, 0.0);
    }

    #[test]
    fn errors_of_a_small_case_by_hand() {
        let mut errors = Errors::default();
        errors.add(&[0.0, 0.0, 0.5, 1.0], &[0.1, 0.0, 0.0, 1.0], 0.01);
        let r = errors.report(0.01);
        assert!((r.mse - 0.26 / 4.0).abs() < 1e-8);
        assert!((r.mae - 0.6 / 4.0).abs() < 1e-8);
        assert!((r.mpe - 0.5).abs() < 1e-12);
        assert!((r.variance - (1.25 / 4.0 - 0.140_625)).abs() < 1e-12);
        assert_eq!((r.false_free, r.false_colliding), (0.5, 0.5));
        assert!((r.iou - 1.0 / 3.0).abs() < 1e-12);
    }

    #[test]
    fn merging_is_adding_and_nan_is_not_hidden() {
        let mut whole = Errors::default();
        whole.add(&[0.0, 0.3, 0.7], &[0.1, 0.2, 0.9], 0.0);
        let (mut first, mut second) = (Errors::default(), Errors::default());
        first.add(&[0.0], &[0.1], 0.0);
        second.add(&[0.3, 0.7], &[0.2, 0.9], 0.0);
        first.merge(&second);
        assert!((first.report(0.0).mse - whole.report(0.0).mse).abs() < 1e-15);
        whole.add(&[0.1], &[f32::NAN], 0.0);
        assert!(whole.report(0.0).mpe.is_nan() && whole.report(0.0).mse.is_nan());
    }
}
