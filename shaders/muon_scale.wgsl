// Purpose: Muon's direction over its Frobenius norm, X = u/‖u‖; zeros stay zeros.
//
// Workgroups (MUON_GROUPS, matrices). One invocation computes every (invocations)-th vec4 of matrix y; each adds the sums of
// squares for itself, in the same order.
//   squares     [matrices][MUON_GROUPS]
//   directions  u, becomes X [matrices][rows][columns]

@group(0) @binding(0) var<uniform> muon: Muon;
@group(0) @binding(1) var<storage, read> squares: array<f32>;
@group(0) @binding(2) var<storage, read_write> directions: array<vec4<f32>>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    var sum = 0.0;
    for (var i = 0u; i < MUON_GROUPS; i += 1u) {
        sum += squares[group.y * MUON_GROUPS + i];
    }
    let norm = select(1.0, sqrt(sum), sum > 0.0);
    let count = muon.rows * muon.columns / 4u;
    for (var i = group.x * LINEAR_GROUP + index; i < count; i += MUON_GROUPS * LINEAR_GROUP) {
        directions[group.y * count + i] /= norm;
    }
}
