// Purpose: as `harmonic_values.wgsl`, with the derivatives by how the tool stands, and with the functions themselves, from which
// the way back to the point begins.
//
// One invocation computes every (invocations)-th row.
//   gradients  from `sweep.base`, two vec4 a pose, of which the second is written: ∂/∂d, tangent to the sphere at d, and the
//              change for a turn about d, 0 where the tool's roll does not count
//   functions  [padded_rows][stride], zeros behind the functions and for an invalid pose

@group(0) @binding(9) var<storage, read_write> gradients: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read_write> functions: array<f32>;

fn take(place: u32, value: f32) {
    functions[row_begins + place] = value;
    sum += weights[row_begins + place] * value;
}

fn value_and_weight(place: u32) -> vec2<f32> {
    return vec2<f32>(functions[row_begins + place], weights[row_begins + place]);
}

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var row = id.x; row < batch.rows; row += groups.x * LINEAR_GROUP) {
        let pose = poses[sweep.base + row];
        row_begins = row * harmonics.stride;
        sum = bitcast<f32>(world_nan(sweep.base));
        var turn = vec4<f32>(sum);
        var written = 0u;
        if is_pose(pose) {
            let place = place_of(held_tip(pose, world.low.xyz, world.high.xyz));
            sum = 0.0;
            each_function(harmonics.degree, facing_of(place, pose));
            let axis = to_local(place, axis_of(pose));
            let turns = turns_of(harmonics.degree);
            turn = vec4<f32>(to_world(place, cross(turns, axis)), ROLLS * dot(turns, axis));
            written = begins_of(harmonics.degree + 1u);
        }
        for (var place = written; place < harmonics.stride; place += 1u) {
            functions[row_begins + place] = 0.0;
        }
        values[sweep.base + row] = sum;
        gradients[2u * (sweep.base + row) + 1u] = turn;
    }
}
