// Purpose: the points of poses as a factored field's network sees them: the grid's middle is 0, its longest edge [−1, 1]; with an
// axis of symmetry the angle about it, too. Positions are held in the box of the voxel centres; an invalid pose gets some point, and NaN for its value later.
//
// One invocation computes every (invocations)-th row.
//   poses    from `sweep.base`
//   samples  [rows][POINT_INPUTS, or 2 more with an axis]

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<uniform> world: World;
@group(0) @binding(2) var<uniform> sweep: Sweep;
@group(0) @binding(3) var<uniform> symmetry: Symmetry;
@group(0) @binding(4) var<storage, read> poses: array<Pose>;
@group(0) @binding(5) var<storage, read_write> samples: array<f32>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let inputs = select(POINT_INPUTS + 2u, POINT_INPUTS, symmetry.along == NO_AXIS);
    for (var row = id.x; row < batch.rows; row += groups.x * LINEAR_GROUP) {
        let place = place_of(held_tip(poses[sweep.base + row], world.low.xyz, world.high.xyz));
        let point = ((place.position - world.origin.xyz) - 0.5 * world.size.xyz) * (2.0 / longest(world.size));
        let at = row * inputs;
        samples[at] = point.x;
        samples[at + 1u] = point.y;
        samples[at + 2u] = point.z;
        if inputs > POINT_INPUTS {
            samples[at + 3u] = ANGLE * place.turn.x;
            samples[at + 4u] = ANGLE * place.turn.y;
        }
    }
}
