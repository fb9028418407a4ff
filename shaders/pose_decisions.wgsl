// Purpose: what is decided of poses by their values: the twin of `imf_fields::field::Field`.
//
// One invocation computes every (invocations)-th pose of `batch.rows`.
//   poses, values
//   decisions  FREE, COLLIDING or UNDECIDED

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<uniform> world: World;
@group(0) @binding(2) var<uniform> thresholds: Thresholds;
@group(0) @binding(3) var<storage, read> poses: array<Pose>;
@group(0) @binding(4) var<storage, read> values: array<f32>;
@group(0) @binding(5) var<storage, read_write> decisions: array<u32>;

fn is_around_axis(position: vec3<f32>) -> bool {
    let first = position[(thresholds.along + 1u) % 3u] - thresholds.first;
    let second = position[(thresholds.along + 2u) % 3u] - thresholds.second;
    return length(vec2<f32>(first, second)) <= thresholds.around;
}

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var at = id.x; at < batch.rows; at += groups.x * LINEAR_GROUP) {
        let pose = poses[at];
        let value = values[at];
        let held = clamp(pose.position.xyz, world.low.xyz, world.high.xyz);
        var decision = UNDECIDED;
        if !is_pose(pose) || !is_finite(vec4<f32>(value)) {
            decision = COLLIDING;
        } else if all(held == pose.position.xyz) && !is_around_axis(pose.position.xyz) {
            if value <= thresholds.free_up_to {
                decision = FREE;
            } else if value >= thresholds.colliding_from {
                decision = COLLIDING;
            }
        }
        decisions[at] = decision;
    }
}
