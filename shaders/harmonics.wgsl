// Purpose: real spherical harmonics of a direction, all functions up to a degree, by the recurrence of
// `imf_core::harmonic::sphere`: polynomials in x, y, z, so that nothing is singular at the poles. What becomes of a function
// stands in the file that follows, which defines
//   take(place, value, slope)   place l² + l + m; slope is the polynomial's gradient, not yet tangent to the sphere
//
//   steps  at l·(l + 1)/2 + m: (a, b) of `Q_lm = a·(z·Q_(l−1)m − b·Q_(l−2)m)`; where l = m: (Q_mm, 0) with all factors

fn each_function(degree: u32, d: vec3<f32>) {
    // Re and Im of (x + iy)^m and of (x + iy)^(m−1).
    var power = vec2<f32>(1.0, 0.0);
    var power_before = vec2<f32>();
    for (var m = 0u; m <= degree; m += 1u) {
        var value = steps[m * (m + 1u) / 2u + m].x;
        var before = 0.0;
        var slope = 0.0;
        var slope_before = 0.0;
        for (var l = m; l <= degree; l += 1u) {
            if l > m {
                let step = steps[l * (l + 1u) / 2u + m];
                let next = step.x * (d.z * value - step.y * before);
                let next_slope = step.x * (value + d.z * slope - step.y * slope_before);
                before = value;
                value = next;
                slope_before = slope;
                slope = next_slope;
            }
            let middle = l * l + l;
            let turn = f32(m) * value * power_before;
            take(middle + m, value * power.x, vec3<f32>(turn.x, -turn.y, slope * power.x));
            if m > 0u {
                take(middle - m, value * power.y, vec3<f32>(turn.y, turn.x, slope * power.y));
            }
        }
        power_before = power;
        power = vec2<f32>(d.x * power.x - d.y * power.y, d.x * power.y + d.y * power.x);
    }
}
