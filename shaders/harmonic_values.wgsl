// Purpose: values of poses in a factored or harmonic field: the sum of the functions of their direction, in the frame of the
// place, or of their rotation, by the weights that their points give them.
//
// One invocation computes every (invocations)-th row.
//   poses    from `sweep.base`
//   steps    see `harmonics.wgsl` and `rotations.wgsl`
//   weights  [padded_rows][stride], of function k in column k
//   values   from `sweep.base`; NaN for an invalid pose

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<uniform> world: World;
@group(0) @binding(2) var<uniform> sweep: Sweep;
@group(0) @binding(3) var<uniform> symmetry: Symmetry;
@group(0) @binding(4) var<uniform> harmonics: Harmonics;
@group(0) @binding(5) var<storage, read> poses: array<Pose>;
@group(0) @binding(6) var<storage, read> steps: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> weights: array<f32>;
@group(0) @binding(8) var<storage, read_write> values: array<f32>;

var<private> row_begins: u32;
var<private> sum: f32;

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
