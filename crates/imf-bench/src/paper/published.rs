//! The paper's own numbers: Harabin, Mirzendehdel, Behandish, arXiv 2409.02115. MSE and MPE of a network against the exact
//! field. Measured there on a Xeon W-2275 with 64 GB and a Quadro RTX 6000.
//!
//! In the tables of sparsity and of architecture the printed labels of MSE and MPE are swapped; the small numbers are MSE.

/// Mean squared and largest error.
pub(super) type Published = (f64, f64);

/// Sections (0°, 0°) and (12°, 6°), IMF over 225 and over 625.
pub(super) fn parts(part: &str, recipe: &str) -> Option<[Published; 4]> {
    Some(match (recipe, part) {
        ("single", "teapot") => {
            [(7.353e-7, 0.0176), (6.3e-3, 0.7009), (8.188e-9, 0.0019), (2.544e-7, 0.0042)]
        }
        ("single", "bracket") => {
            [(6.803e-7, 0.0207), (4e-4, 0.3713), (1.273e-9, 0.0025), (8.3764e-8, 0.0030)]
        }
        ("single", "screw-gear") => {
            [(5.632e-7, 0.0167), (4.456e-6, 0.0461), (5.344e-8, 0.0031), (1.542e-7, 0.0035)]
        }
        ("multi", "teapot") => [(9.127e-7, 0.0151), (7e-4, 0.2496), (8.125e-9, 0.0019), (1.794e-7, 0.0032)],
        ("multi", "bracket") => {
            [(5.968e-7, 0.0160), (2.351e-5, 0.1017), (1.076e-9, 0.0024), (5.6624e-8, 0.0033)]
        }
        ("multi", "screw-gear") => {
            [(3.871e-7, 0.0142), (1.248e-5, 0.0242), (4.896e-8, 0.0036), (1.184e-7, 0.0034)]
        }
        _ => return None,
    })
}

/// IMF of the plane from 37 sections.
pub(super) fn plane(method: &str) -> Option<Published> {
    Some(match method {
        "network" => (3.7989e-7, 1.3659e-2),
        "trigonometric" => (2.8405e-4, 9.9748e-1),
        "cubic spline" => (2.3194e-4, 1.3398e-1),
        "linear" => (5.4465e-7, 2.5211e-2),
        _ => return None,
    })
}

/// Seconds: training by `single`, 225 sections by the network, 225 by FFT on the GPU.
pub(super) fn seconds(part: &str) -> Option<[f64; 3]> {
    Some(match part {
        "teapot" => [36105.0, 15.5, 7.0],
        "bracket" => [40760.0, 18.0, 9.3],
        "screw-gear" => [56235.0, 17.82, 7.45],
        _ => return None,
    })
}

/// Bytes of the network, as the paper states them.
pub(super) const NETWORK_BYTES: f64 = 2e6;

/// IMF over 225 after fine-tuning, and after as many epochs from random weights.
pub(super) fn transfer(stage: &str) -> Option<Published> {
    match stage {
        "adapted" => Some((2.8595e-8, 0.0028)),
        "control" => Some((1e-7, 0.0036)),
        _ => None,
    }
}

/// IMF over 225 and over 625 of a sweep's variant.
pub(super) fn sweep(variant: &str) -> Option<[Published; 2]> {
    Some(match variant {
        "10-percent" => [(1.641e-8, 0.0019), (8.042e-9, 0.0039)],
        "50-percent" => [(2.347e-8, 0.0016), (2.872e-7, 0.0037)],
        "5x256" => [(5.121e-7, 0.0063), (9.025e-7, 0.0076)],
        "4x512" => [(6.445e-8, 0.0046), (1.702e-7, 0.0045)],
        "6x512" => [(5.388e-8, 0.0026), (5.857e-7, 0.0054)],
        _ => return None,
    })
}
