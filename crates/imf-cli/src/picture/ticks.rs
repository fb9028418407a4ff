//! Round numbers for axes, and how they are written.

/// Multiples of 1, 2 or 5 times a power of ten in [`low`, `high`], at most `most` of them, with the number of decimals that
/// tells them apart; of 4 times one where otherwise there would be one tick alone, which tells no scale.
pub(super) fn ticks(low: f64, high: f64, most: usize) -> (Vec<f64>, usize) {
    let span = high - low;
    if !(span.is_finite() && span > 0.0) {
        return (vec![low], 0);
    }
    let mut exponent = (span / most.max(1) as f64).log10().floor() as i32;
    loop {
        let decimals = usize::try_from(-exponent).unwrap_or(0);
        for step in [1.0, 2.0, 4.0, 5.0] {
            let found = multiples(low, high, step * 10f64.powi(exponent));
            if found.len() > most.max(1) {
                continue;
            }
            // Fours look odd where fives do as well.
            let fives = (step == 4.0).then(|| multiples(low, high, 5.0 * 10f64.powi(exponent)));
            return (fives.filter(|fives| fives.len() > 1).unwrap_or(found), decimals);
        }
        exponent += 1;
    }
}

fn multiples(low: f64, high: f64, step: f64) -> Vec<f64> {
    // A tick that rounding puts a hair outside still belongs to the end.
    let first = (low / step - 1e-9).ceil() as i64;
    let last = (high / step + 1e-9).floor() as i64;
    (first..=last).map(|count| count as f64 * step).collect()
}

/// A number with a true minus sign.
pub(super) fn label(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    // "-0.0" is zero.
    let zero = text.trim_start_matches('-').chars().all(|letter| matches!(letter, '0' | '.'));
    if zero { text.trim_start_matches('-').to_owned() } else { text.replace('-', "−") }
}

/// A power of ten as "10⁻³".
pub(super) fn power_of_ten(exponent: i32) -> String {
    let raise = |letter| match letter {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        digit => char::from_u32('⁰' as u32 + digit.to_digit(10).unwrap_or(0)).unwrap_or('⁰'),
    };
    format!("10{}", exponent.to_string().chars().map(raise).collect::<String>())
}

/// One digit times a power of ten: "0.05", "5·10⁻⁵".
pub(super) fn one_digit(digit: u32, exponent: i32) -> String {
    if (-3..4).contains(&exponent) {
        let decimals = usize::try_from(-exponent).unwrap_or(0);
        label(f64::from(digit) * 10f64.powi(exponent), decimals)
    } else {
        format!("{digit}·{}", power_of_ten(exponent))
    }
}

/// Three significant digits: "0.0123", "1.23·10⁻⁵".
pub(super) fn short(value: f64) -> String {
    if !value.is_finite() || value == 0.0 {
        return value.to_string();
    }
    let exponent = value.abs().log10().floor() as i32;
    if (-2..4).contains(&exponent) {
        label(value, usize::try_from(2 - exponent).unwrap_or(0))
    } else {
        format!("{}·{}", label(value / 10f64.powi(exponent), 2), power_of_ten(exponent))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_inside_and_few() {
        assert_eq!(ticks(0.0, 1.0, 6), (vec![0.0, 0.2, 0.4, 0.6000000000000001, 0.8, 1.0], 1));
        assert_eq!(ticks(-3.0, 61.0, 5).0, [0.0, 20.0, 40.0, 60.0]);
        assert_eq!(ticks(0.0, 0.0123, 4), (vec![0.0, 0.005, 0.01], 3));
        assert_eq!(ticks(2.0, 2.0, 4).0, [2.0]);
        assert_eq!(ticks(-0.0047, 0.0047, 3), (vec![-0.004, 0.0, 0.004], 3));
        assert_eq!(ticks(-0.0057, 0.0057, 3), (vec![-0.005, 0.0, 0.005], 3));
        for most in 1..10 {
            assert!(ticks(-17.3, 1234.5, most).0.len() <= most);
        }
    }

    #[test]
    fn numbers_are_written_with_true_signs() {
        assert_eq!(label(-0.5, 1), "−0.5");
        assert_eq!(label(-0.001, 1), "0.0");
        assert_eq!(power_of_ten(-12), "10⁻¹²");
        assert_eq!(power_of_ten(40), "10⁴⁰");
        assert_eq!(short(0.012345), "0.0123");
        assert_eq!(short(-1.2345e-5), "−1.23·10⁻⁵");
        assert_eq!(short(432.1), "432");
        assert_eq!(one_digit(5, -2), "0.05");
        assert_eq!(one_digit(2, 3), "2000");
        assert_eq!(one_digit(2, -5), "2·10⁻⁵");
    }
}
