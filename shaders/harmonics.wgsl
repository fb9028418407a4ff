// Purpose: real spherical harmonics of a direction, all functions up to a degree, by the recurrence of
// `imf_fields::harmonic::sphere`: polynomials in x, y, z, so that nothing is singular at the poles. What becomes of a function
// stands in the file that follows, which defines
//   take(place, value)   place l² + l + m
//
//   steps  at l·(l + 1)/2 + m: (a, 0, e, 0) of `Q_lm = a·(z·Q_(l−1)m − e·Q_(l−2)m)`; where l = m: Q_mm with all factors

/// Whether the tool's roll counts.
const ROLLS: f32 = 0.0;

/// Columns of the functions of a degree: directions have one, of the orders −l to l.
fn columns_of(l: u32) -> u32 {
    return 1u;
}

/// Where the functions of a degree begin.
fn begins_of(l: u32) -> u32 {
    return l * l;
}

/// What the functions are of: the direction in the frame of the place.
fn facing_of(place: Place, pose: Pose) -> vec3<f32> {
    return to_local(place, axis_of(pose));
}

fn each_function(degree: u32, d: vec3<f32>) {
    // Re and Im of (x + iy)^m.
    var power = vec2<f32>(1.0, 0.0);
    for (var m = 0u; m <= degree; m += 1u) {
        var value = steps[m * (m + 1u) / 2u + m].x;
        var before = 0.0;
        for (var l = m; l <= degree; l += 1u) {
            if l > m {
                let step = steps[l * (l + 1u) / 2u + m];
                let next = step.x * (d.z * value - step.z * before);
                before = value;
                value = next;
            }
            let middle = l * l + l;
            take(middle + m, value * power.x);
            if m > 0u {
                take(middle - m, value * power.y);
            }
        }
        power = vec2<f32>(d.x * power.x - d.y * power.y, d.x * power.y + d.y * power.x);
    }
}
