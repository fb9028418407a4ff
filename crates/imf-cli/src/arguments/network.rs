//! A network on the command line: hidden layers, their width, and the frequency factor.

use imf_fields::siren::SirenShape;

use super::numbers::parse_omega;

/// A network's shape as typed.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Network {
    pub(super) layers: Option<(usize, usize)>,
    pub(super) omega: Option<f32>,
}

/// Layers and width, ω, or both.
pub(super) fn parse_network(text: &str) -> Result<Network, String> {
    let fault = || "layers and width, and perhaps ω, such as 5x128, 5x128:10 or :10".to_owned();
    let (layers, omega) = match text.split_once(':') {
        Some((layers, omega)) => (layers, Some(parse_omega(omega)?)),
        None => (text, None),
    };
    let layers = match layers.split_once('x') {
        Some((hidden, width)) => hidden.parse().ok().zip(width.parse().ok()).map(Some).ok_or_else(fault)?,
        None if layers.is_empty() && omega.is_some() => None,
        None => return Err(fault()),
    };
    if let Some((hidden, width)) = layers {
        SirenShape { hidden, width, ..SirenShape::default() }.check().map_err(|error| error.to_string())?;
    }
    Ok(Network { layers, omega })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn networks_are_read_in_parts() {
        let network = |layers, omega| Ok(Network { layers, omega });
        assert_eq!(parse_network("5x128"), network(Some((5, 128)), None));
        assert_eq!(parse_network("3x24:10"), network(Some((3, 24)), Some(10.0)));
        assert_eq!(parse_network(":12.5"), network(None, Some(12.5)));
        for text in ["", ":", "5", "x", "5x", "5xmany", "5x128:", "5x128:nan", "128", "3x0", "0x24", "3x9000"]
        {
            assert!(parse_network(text).is_err(), "{text}");
        }
    }
}
