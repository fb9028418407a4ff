// Purpose: functions of a rotation, √(2l+1) M^l_mn, all up to a degree, by the recurrence of `imf_fields::harmonic::rotations`, where
// A, B, f and g are defined: polynomials in a unit quaternion, so that nothing is singular where Euler's angles are. What becomes
// of a function stands in the file that follows, which defines
//   take(place, value)   place begins_of(l) + (l + m)·(2l + 1) + l + n
//
//   steps  in the order of use: (a, b, e, 0) of `f_l = a·((c − b)·f_(l−1) − e·f_(l−2))`, and `g_l` with c + b; where l = m:
//          a is what both begin with

/// Whether the tool's roll counts.
const ROLLS: f32 = 1.0;

/// Columns of the functions of a degree: n from −l to l.
fn columns_of(l: u32) -> u32 {
    return 2u * l + 1u;
}

/// Where the functions of a degree begin.
fn begins_of(l: u32) -> u32 {
    return (4u * l * l * l - l) / 3u;
}

/// What the functions are of. Fields over rotations know no symmetry: every place's frame is the world's.
fn facing_of(place: Place, pose: Pose) -> vec4<f32> {
    return unit_rotation(pose);
}

fn times(u: vec2<f32>, v: vec2<f32>) -> vec2<f32> {
    return vec2<f32>(u.x * v.x - u.y * v.y, u.x * v.y + u.y * v.x);
}

fn conjugate(v: vec2<f32>) -> vec2<f32> {
    return vec2<f32>(v.x, -v.y);
}

/// (−1)^number.
fn sign_of(number: u32) -> f32 {
    return 1.0 - 2.0 * f32(number & 1u);
}

/// The functions ±m, ±n of a degree.
fn take_four(l: u32, m: u32, n: u32, f: vec2<f32>, g: vec2<f32>) {
    let size = columns_of(l);
    let middle = begins_of(l) + l * size + l;
    take(middle + m * size + n, f.x + g.x);
    if n > 0u {
        take(middle + m * size - n, g.y - f.y);
    }
    if m > 0u {
        take(middle - m * size + n, f.y + g.y);
        if n > 0u {
            take(middle - m * size - n, f.x - g.x);
        }
    }
}

fn each_function(degree: u32, q: vec4<f32>) {
    let a = vec2<f32>(q.w, q.z);
    let b = vec2<f32>(q.y, -q.x);
    let c = dot(a, a) - dot(b, b);
    let one = vec2<f32>(1.0, 0.0);
    // A and B to the powers s = m + n and t = m − n.
    var a_s = one;
    var b_s = one;
    var at = 0u;
    for (var s = 0u; s <= 2u * degree; s += 1u) {
        let odd = (s & 1u) == 1u;
        var a_t = select(one, a, odd);
        var b_t = select(one, b, odd);
        let last = min(s, 2u * degree - s);
        for (var t = s & 1u; t <= last; t += 2u) {
            let m = (s + t) / 2u;
            let n = (s - t) / 2u;
            let f_here = times(a_s, b_t);
            let g_here = sign_of(n) * times(a_t, b_s);
            let f_exchanged = sign_of(t) * times(a_s, conjugate(b_t));
            let g_exchanged = sign_of(m) * times(conjugate(a_t), b_s);
            // f and g.
            var both = vec2<f32>();
            var before = vec2<f32>();
            for (var l = m; l <= degree; l += 1u) {
                let step = steps[at];
                at += 1u;
                if l == m {
                    both = vec2<f32>(step.x);
                } else {
                    let next = step.x * (vec2<f32>(c - step.y, c + step.y) * both - step.z * before);
                    before = both;
                    both = next;
                }
                take_four(l, m, n, both.x * f_here, both.y * g_here);
                if t > 0u {
                    take_four(l, n, m, both.x * f_exchanged, both.y * g_exchanged);
                }
            }
            a_t = times(a_t, times(a, a));
            b_t = times(b_t, times(b, b));
        }
        a_s = times(a_s, a);
        b_s = times(b_s, b);
    }
}
