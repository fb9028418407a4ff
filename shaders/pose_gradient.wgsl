// Purpose: how a pose's value changes with the tip's position and with the direction of the axis, from the deltas of the
// layers that see the network's inputs.
//
// One invocation computes every (invocations)-th row.
//   parameters  whole network, padded layout
//   first       Δ of the first layer [padded_rows][outputs]
//   skipped     Δ of the layer behind the skip, likewise; the first again where there is none
//   poses, values from `sweep.base`
//   gradients   from `sweep.base`, two vec4 a pose: value and ∂/∂x, ∂/∂y, ∂/∂z; ∂/∂d, tangent to the sphere at d, and 0

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<uniform> world: World;
@group(0) @binding(2) var<uniform> sweep: Sweep;
@group(0) @binding(3) var<uniform> descent: Descent;
@group(0) @binding(4) var<storage, read> parameters: array<f32>;
@group(0) @binding(5) var<storage, read> first: array<f32>;
@group(0) @binding(6) var<storage, read> skipped: array<f32>;
@group(0) @binding(7) var<storage, read> poses: array<Pose>;
@group(0) @binding(8) var<storage, read> values: array<f32>;
@group(0) @binding(9) var<storage, read_write> gradients: array<vec4<f32>>;

/// Below this sine of φ the slope in θ is not divided further, as on the CPU.
const POLE: f32 = 1e-3;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var row = id.x; row < batch.rows; row += groups.x * LINEAR_GROUP) {
        let pose = poses[sweep.base + row];
        let value = values[sweep.base + row];
        let at = 2u * (sweep.base + row);
        if !is_pose(pose) {
            gradients[at] = vec4<f32>(value);
            gradients[at + 1u] = vec4<f32>(value);
            continue;
        }
        // By the network's five inputs.
        var slopes = array<f32, INPUTS>();
        for (var neuron = 0u; neuron < descent.neurons; neuron += 1u) {
            let delta = first[row * descent.neurons + neuron];
            let weights = descent.first_weights + neuron * descent.first_stride;
            for (var input = 0u; input < INPUTS; input += 1u) {
                slopes[input] += delta * parameters[weights + input];
            }
        }
        for (var neuron = 0u; neuron < descent.skip_neurons; neuron += 1u) {
            let delta = skipped[row * descent.skip_neurons + neuron];
            let weights = descent.skip_weights + neuron * descent.skip_stride;
            for (var input = 0u; input < INPUTS; input += 1u) {
                slopes[input] += delta * parameters[weights + input];
            }
        }
        let across = vec3<f32>(slopes[0], slopes[1], slopes[2]) * 2.0 / world.size.xyz;
        let position = held_slopes(pose, world.low.xyz, world.high.xyz, across);
        // From inputs, which are θ/π − 1 and φ/(π/2) − 1, to radians.
        let axis = axis_of(pose);
        let angles = angles_of(axis);
        let by_theta = select(slopes[3] / PI, 0.0, is_vertical(axis));
        let by_phi = slopes[4] / (0.5 * PI);
        let theta = sine_cosine(vec4<f32>(angles.x));
        let phi = sine_cosine(vec4<f32>(angles.y));
        let along_theta = vec3<f32>(-theta.sine.x, theta.cosine.x, 0.0);
        let along_phi = vec3<f32>(phi.cosine.x * theta.cosine.x, phi.cosine.x * theta.sine.x, -phi.sine.x);
        let turn = along_theta * (by_theta / max(phi.sine.x, POLE)) + along_phi * by_phi;
        gradients[at] = vec4<f32>(value, position);
        gradients[at + 1u] = vec4<f32>(turn - axis * dot(turn, axis), 0.0);
    }
}
