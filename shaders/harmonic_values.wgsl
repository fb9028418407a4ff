// Purpose: values of poses in a factored or harmonic field: the sum of the functions of their direction, in the frame of the
// place, or of their rotation, by the weights that their points give them.
//
// One invocation computes every (invocations)-th row.

fn take(place: u32, value: f32) {
    sum += weights[row_begins + place] * value;
}

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var row = id.x; row < batch.rows; row += groups.x * LINEAR_GROUP) {
        let pose = poses[sweep.base + row];
        var value = bitcast<f32>(world_nan(sweep.base));
        if is_pose(pose) {
            row_begins = row * harmonics.stride;
            sum = 0.0;
            let place = place_of(held_tip(pose, world.low.xyz, world.high.xyz));
            each_function(harmonics.degree, facing_of(place, pose));
            value = sum;
        }
        values[sweep.base + row] = value;
    }
}
