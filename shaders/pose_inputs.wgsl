// Purpose: poses in world coordinates to the network's inputs. Positions are held in the box of the voxel centres; an
// invalid pose gets the inputs of some pose, and NaN for its value later.
//
// One invocation computes every (invocations)-th row.
//   poses    from `sweep.base`
//   samples  [rows][INPUTS]

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<uniform> world: World;
@group(0) @binding(2) var<uniform> sweep: Sweep;
@group(0) @binding(3) var<storage, read> poses: array<Pose>;
@group(0) @binding(4) var<storage, read_write> samples: array<f32>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var row = id.x; row < batch.rows; row += groups.x * LINEAR_GROUP) {
        let pose = poses[sweep.base + row];
        let position = held_tip(pose, world.low.xyz, world.high.xyz);
        var angles = vec2<f32>();
        if is_pose(pose) {
            angles = angles_of(axis_of(pose));
        }
        let unit = (position - world.origin.xyz) / world.size.xyz;
        let at = row * INPUTS;
        samples[at] = 2.0 * unit.x - 1.0;
        samples[at + 1u] = 2.0 * unit.y - 1.0;
        samples[at + 2u] = 2.0 * unit.z - 1.0;
        samples[at + 3u] = angles.x / PI - 1.0;
        samples[at + 4u] = angles.y / (0.5 * PI) - 1.0;
    }
}
