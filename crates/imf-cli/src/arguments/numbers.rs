//! Numbers and names on the command line: what each may be, so that another is refused beside the option that it was given to.

use std::str::FromStr;

use clap::Command;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use serde::de::DeserializeOwned;
use serde_json::Value;

/// Inputs are from −1 to 1: above it a sine turns several times within a voxel of a grid of a thousand, and nothing is learnt.
const MAX_OMEGA: f32 = 1e4;

/// A command whose options take numbers below 0, as do those of its subcommands: whoever reads the number says why it cannot be.
pub fn with_negative_numbers(command: Command) -> Command {
    command
        .mut_args(|argument| {
            let is_option = !argument.is_positional() && argument.get_action().takes_values();
            argument.allow_negative_numbers(is_option)
        })
        .mut_subcommands(with_negative_numbers)
}

/// One of a library's values by the names that it has in files.
pub fn named<T: DeserializeOwned + Clone + Send + Sync + 'static>(
    names: &'static [&'static str],
) -> impl TypedValueParser<Value = T> {
    PossibleValuesParser::new(names).try_map(|name| serde_json::from_value(Value::String(name)))
}

/// A number that is as it must be, or the words for what is wanted.
pub(super) fn number<T: FromStr>(text: &str, is: impl Fn(&T) -> bool, wanted: &str) -> Result<T, String> {
    text.parse().ok().filter(is).ok_or_else(|| wanted.to_owned())
}

/// Three of them with commas between.
pub(super) fn three<T: FromStr>(text: &str, is: impl Fn(&T) -> bool, wanted: &str) -> Result<[T; 3], String> {
    let all: Result<Vec<T>, String> = text.split(',').map(|text| number(text.trim(), &is, wanted)).collect();
    all?.try_into().map_err(|_| wanted.to_owned())
}

/// A measure above which a pose counts as colliding.
pub(super) fn parse_threshold(text: &str) -> Result<f64, String> {
    number(text, |share| (0.0..1.0).contains(share), "a measure of at least 0 and below 1, such as 0.001")
}

/// A value of a field, which its quantity bounds.
pub(super) fn parse_value(text: &str) -> Result<f64, String> {
    number(text, |value: &f64| value.is_finite(), "a finite number, such as 0.001 or -0.5")
}

/// A length that there must be.
pub(super) fn parse_length(text: &str) -> Result<f64, String> {
    number(text, |&length| length > 0.0 && length < f64::INFINITY, "a length above 0, such as 0.05")
}

/// A length that may be 0.
pub(super) fn parse_room(text: &str) -> Result<f64, String> {
    number(text, |length| (0.0..f64::INFINITY).contains(length), "a length of at least 0, such as 0.5")
}

/// How many of something that there must be.
pub fn parse_count(text: &str) -> Result<usize, String> {
    number(text, |&count| count > 0, "a whole number of at least 1")
}

/// A learning rate; at 0 nothing would be learnt.
pub(super) fn parse_rate(text: &str) -> Result<f32, String> {
    number(text, |&rate| rate > 0.0 && rate < f32::INFINITY, "a learning rate above 0, such as 1e-3")
}

/// A frequency factor.
pub(super) fn parse_omega(text: &str) -> Result<f32, String> {
    let wanted = format!("a frequency factor above 0 and up to {MAX_OMEGA}, such as 30");
    number(text, |&omega| omega > 0.0 && omega <= MAX_OMEGA, &wanted)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ends_of_ranges_are_where_they_are_said_to_be() {
        assert_eq!((parse_threshold("0"), parse_threshold("0.999")), (Ok(0.0), Ok(0.999)));
        assert_eq!((parse_count("1"), parse_rate("1e38")), (Ok(1), Ok(1e38)));
        assert_eq!(parse_omega("10000"), Ok(MAX_OMEGA));
        for text in ["nan", "inf", "-inf", "-1", "", "x"] {
            assert!(parse_threshold(text).is_err() && parse_count(text).is_err(), "{text}");
            assert!(parse_rate(text).is_err() && parse_omega(text).is_err(), "{text}");
        }
        assert!(parse_threshold("1").is_err() && parse_count("0").is_err());
        // The second is 0 in single precision.
        assert!(parse_rate("0").is_err() && parse_rate("1e-60").is_err());
        assert!(parse_omega("0").is_err() && parse_omega("10001").is_err());
    }
}
