// Purpose: how a pose's value in a factored field changes with the tip's position, from the delta of the network's first layer:
// by the position and the angle that it sees, and by the turn of the frame.
//
// One invocation computes every (invocations)-th row.
//   parameters  whole network, padded layout
//   first       Δ of the first layer [padded_rows][outputs]
//   poses, values from `sweep.base`
//   gradients   from `sweep.base`, two vec4 a pose, of which the first is written: value and ∂/∂x, ∂/∂y, ∂/∂z; the second is
//               ∂/∂d

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<uniform> world: World;
@group(0) @binding(2) var<uniform> sweep: Sweep;
@group(0) @binding(3) var<uniform> symmetry: Symmetry;
@group(0) @binding(4) var<uniform> descent: Descent;
@group(0) @binding(5) var<storage, read> parameters: array<f32>;
@group(0) @binding(6) var<storage, read> first: array<f32>;
@group(0) @binding(7) var<storage, read> poses: array<Pose>;
@group(0) @binding(8) var<storage, read> values: array<f32>;
@group(0) @binding(9) var<storage, read_write> gradients: array<vec4<f32>>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var row = id.x; row < batch.rows; row += groups.x * LINEAR_GROUP) {
        let pose = poses[sweep.base + row];
        let value = values[sweep.base + row];
        let at = 2u * (sweep.base + row);
        if !is_pose(pose) {
            gradients[at] = vec4<f32>(value);
            continue;
        }
        var slopes = vec3<f32>();
        // By the angle's cosine and sine; weights of padding without an axis.
        var by_turn = vec2<f32>();
        for (var neuron = 0u; neuron < descent.neurons; neuron += 1u) {
            let weights = descent.first_weights + neuron * descent.first_stride;
            let delta = first[row * descent.neurons + neuron];
            slopes += delta * vec3<f32>(parameters[weights], parameters[weights + 1u], parameters[weights + 2u]);
            by_turn += delta * vec2<f32>(parameters[weights + 3u], parameters[weights + 4u]);
        }
        slopes *= 2.0 / longest(world.size);
        let place = place_of(held_tip(pose, world.low.xyz, world.high.xyz));
        if symmetry.along != NO_AXIS {
            let local = to_local(place, axis_of(pose));
            let by_direction = to_local(place, gradients[at + 1u].xyz);
            // As the frame turns by an angle, a direction of the world turns back by it.
            let by_frame = local.y * by_direction.x - local.x * by_direction.y;
            let by_angle = ANGLE * (place.turn.x * by_turn.y - place.turn.y * by_turn.x) + by_frame;
            slopes += by_angle * angle_slopes(place);
        }
        let position = held_slopes(pose, world.low.xyz, world.high.xyz, slopes * place.signs);
        gradients[at] = vec4<f32>(value, position);
    }
}
