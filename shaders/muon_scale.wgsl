// Purpose: Muon's direction over its Frobenius norm, X = u/‖u‖; zeros stay zeros.
//
// Workgroups (MATRIX_GROUPS, matrices). One invocation computes every (invocations)-th vec4 of matrix y; each adds the sums of
// squares for itself, in the same order.
//   squares     [matrices][MATRIX_GROUPS]
//   directions  u, becomes X [matrices][rows][columns]

@group(0) @binding(0) var<uniform> between: Between;
@group(0) @binding(1) var<storage, read> squares: array<f32>;
@group(0) @binding(2) var<storage, read_write> directions: array<vec4<f32>>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    var sum = 0.0;
    for (var i = 0u; i < MATRIX_GROUPS; i += 1u) {
        sum += squares[group.y * MATRIX_GROUPS + i];
    }
    let norm = select(1.0, sqrt(sum), sum > 0.0);
    let count = between.rows * between.columns / 4u;
    for (var i = group.x * LINEAR_GROUP + index; i < count; i += MATRIX_GROUPS * LINEAR_GROUP) {
        directions[group.y * count + i] /= norm;
    }
}
