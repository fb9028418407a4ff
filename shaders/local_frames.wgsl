// Purpose: coefficients of all functions of the direction, out of the frames of their places to the axes in the order that ends
// with the one of revolution: functions ±m turn by m times the angle, then those that are odd across what was mirrored change
// their sign. The twin in Rust is `imf_fields::factored::symmetry::local`.
//
// One invocation turns the functions ±m of a row, for every (invocations)-th pair of row and m.
//   frames        [rows]
//   coefficients  [padded_rows][stride], of function l² + l + m in that column, in place

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<uniform> harmonics: Harmonics;
@group(0) @binding(2) var<storage, read> frames: array<PlaceFrame>;
@group(0) @binding(3) var<storage, read_write> coefficients: array<f32>;

fn is_odd(number: u32) -> bool {
    return (number & 1u) == 1u;
}

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let orders = harmonics.degree + 1u;
    for (var pair = id.x; pair < batch.rows * orders; pair += groups.x * LINEAR_GROUP) {
        let row = pair / orders;
        let m = pair % orders;
        let frame = frames[row];
        // Cosine and sine of m times the angle.
        var turn = vec2<f32>(1.0, 0.0);
        for (var turned = 0u; turned < m; turned += 1u) {
            turn = vec2<f32>(
                turn.x * frame.cosine - turn.y * frame.sine,
                turn.y * frame.cosine + turn.x * frame.sine,
            );
        }
        let across_x = (frame.mirrored & 1u) != 0u;
        let across_y = (frame.mirrored & 2u) != 0u;
        for (var l = m; l <= harmonics.degree; l += 1u) {
            let across_z = (frame.mirrored & 4u) != 0u && is_odd(l + m);
            let even_changes = (across_x && is_odd(m)) != across_z;
            let odd_changes = (across_x != across_y) != even_changes;
            let middle = row * harmonics.stride + l * l + l;
            let even = coefficients[middle + m];
            if m == 0u {
                coefficients[middle] = select(even, -even, even_changes);
                continue;
            }
            let odd = coefficients[middle - m];
            let new_even = turn.x * even - turn.y * odd;
            let new_odd = turn.y * even + turn.x * odd;
            coefficients[middle + m] = select(new_even, -new_even, even_changes);
            coefficients[middle - m] = select(new_odd, -new_odd, odd_changes);
        }
    }
}
