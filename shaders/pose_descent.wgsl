// Purpose: how a pose's value in a factored field changes with the tip's position, from the delta of the network's first layer.
//
// One invocation computes every (invocations)-th row.
//   parameters  whole network, padded layout
//   first       Δ of the first layer [padded_rows][outputs]
//   poses, values from `sweep.base`
//   gradients   from `sweep.base`, two vec4 a pose, of which the first is written: value and ∂/∂x, ∂/∂y, ∂/∂z

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<uniform> world: World;
@group(0) @binding(2) var<uniform> sweep: Sweep;
@group(0) @binding(3) var<uniform> descent: Descent;
@group(0) @binding(4) var<storage, read> parameters: array<f32>;
@group(0) @binding(5) var<storage, read> first: array<f32>;
@group(0) @binding(6) var<storage, read> poses: array<Pose>;
@group(0) @binding(7) var<storage, read> values: array<f32>;
@group(0) @binding(8) var<storage, read_write> gradients: array<vec4<f32>>;

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
        for (var neuron = 0u; neuron < descent.neurons; neuron += 1u) {
            let weights = descent.first_weights + neuron * descent.first_stride;
            slopes += first[row * descent.neurons + neuron]
                * vec3<f32>(parameters[weights], parameters[weights + 1u], parameters[weights + 2u]);
        }
        let position = held_slopes(pose, world.low.xyz, world.high.xyz, slopes * (2.0 / longest(world.size)));
        gradients[at] = vec4<f32>(value, position);
    }
}
