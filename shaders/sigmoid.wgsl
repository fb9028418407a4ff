// Purpose: the output's activation, 1 / (1 + e⁻ˢ).
//
// WGSL leaves infinities to the device, so s is clamped where the value is 0 or 1 in f32 for every purpose:
// e⁸⁰ = 5.5e34 is still finite.

fn sigmoid(s: f32) -> f32 {
    return 1.0 / (1.0 + exp(-clamp(s, -SIGMOID_LIMIT, SIGMOID_LIMIT)));
}
