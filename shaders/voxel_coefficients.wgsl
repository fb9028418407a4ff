// Purpose: a harmonic field's coefficients at the points of poses.
//
// One invocation computes every (invocations)-th vec4 of the coefficients.
//   coefficients  [rows][columns], zeros behind the axes

@group(0) @binding(6) var<storage, read_write> coefficients: array<vec4<f32>>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let quads = lattice.columns / 4u;
    for (var i = id.x; i < batch.rows * quads; i += groups.x * LINEAR_GROUP) {
        let quad = i % quads;
        var sum = vec4<f32>();
        if 4u * quad < lattice.stride {
            let cell = cell_of(poses[sweep.base + i / quads]);
            for (var corner = 0u; corner < 8u; corner += 1u) {
                let weight = corner_weights(cell, corner);
                sum += weight.x * weight.y * weight.z * voxels[corner_begins(cell, corner) / 4u + quad];
            }
        }
        coefficients[i] = sum;
    }
}
