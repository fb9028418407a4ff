// Purpose: how the sum of functions by their weights changes as what they are of is turned about the axes, by a radian: the twin of
// `imf_fields::harmonic::rotations::sum_with_turns`. A turn acts on the orders m by the angular momentum in real harmonics, column by
// column. Needs `columns_of` and `begins_of`, and of the kernel
//   value_and_weight(place)   of a function

/// Of two functions: value of the first by weight of the second, less the other way.
fn across(first: vec2<f32>, second: vec2<f32>) -> f32 {
    return first.x * second.y - second.x * first.y;
}

fn turns_of(degree: u32) -> vec3<f32> {
    var turns = vec3<f32>();
    for (var l = 1u; l <= degree; l += 1u) {
        let columns = columns_of(l);
        for (var column = 0u; column < columns; column += 1u) {
            let middle = begins_of(l) + l * columns + column;
            // Of the cosine and of the sine of m times the angle, and the same of m − 1.
            var cosine_before = value_and_weight(middle);
            var sine_before = vec2<f32>();
            for (var m = 1u; m <= l; m += 1u) {
                let cosine = value_and_weight(middle + m * columns);
                let sine = value_and_weight(middle - m * columns);
                let by = 0.5 * sqrt(select(1.0, 2.0, m == 1u) * f32((l + m) * (l - m + 1u)));
                turns += vec3<f32>(
                    by * (across(sine, cosine_before) + across(sine_before, cosine)),
                    by * (across(cosine_before, cosine) + across(sine_before, sine)),
                    f32(m) * across(cosine, sine),
                );
                cosine_before = cosine;
                sine_before = sine;
            }
        }
    }
    return turns;
}
