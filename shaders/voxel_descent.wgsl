// Purpose: how a pose's value in a harmonic field changes with the tip's position, from its slopes by the coefficients.
//
// One invocation computes every (invocations)-th row.
//   values      from `sweep.base`
//   slopes      [padded_rows][columns], as vec4
//   gradients   from `sweep.base`, two vec4 a pose, of which the first is written: value and ∂/∂x, ∂/∂y, ∂/∂z

@group(0) @binding(6) var<storage, read> slopes: array<vec4<f32>>;
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
        let cell = cell_of(pose);
        var across = vec3<f32>();
        for (var corner = 0u; corner < 8u; corner += 1u) {
            let begins = corner_begins(cell, corner) / 4u;
            var sum = 0.0;
            for (var quad = 0u; quad < lattice.stride / 4u; quad += 1u) {
                sum += dot(slopes[row * lattice.columns / 4u + quad], voxels[begins + quad]);
            }
            let weight = corner_weights(cell, corner);
            let sign = select(vec3<f32>(-1.0), vec3<f32>(1.0), is_upper(corner));
            across += sum * sign * vec3<f32>(weight.y * weight.z, weight.x * weight.z, weight.x * weight.y);
        }
        let position = held_slopes(pose, world.low.xyz, world.high.xyz, across / lattice.pitch);
        gradients[at] = vec4<f32>(value, position);
    }
}
