// Purpose: the end of the network, (1 + e)·σ(s) − e with e = STRETCH, which counts as 0 where it is below.
//
// WGSL leaves infinities to the device, so s is clamped where σ is 0 or 1 in f32 for every purpose: e⁸⁰ = 5.5e34 is still finite.

/// Before it is clamped.
fn open_output(s: f32) -> f32 {
    return (1.0 + STRETCH) / (1.0 + exp(-clamp(s, -SIGMOID_LIMIT, SIGMOID_LIMIT))) - STRETCH;
}

/// The collision measure. NaN stays what it is.
fn output_value(open: f32) -> f32 {
    return select(open, 0.0, open < 0.0);
}

/// Its derivative by s, from its value: (1 + e)·σ·(1 − σ).
fn open_slope(open: f32) -> f32 {
    return (open + STRETCH) * (1.0 - open) / (1.0 + STRETCH);
}
