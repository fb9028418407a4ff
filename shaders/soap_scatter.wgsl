// Purpose: the way back of `soap_gather.wgsl`: matrices that stand beside each other into the layout of the parameters.
//
// Workgroups (MATRIX_GROUPS, matrices). One invocation copies every (invocations)-th vec4 of matrix y.
//   matrices    [matrices][rows][columns], what lies behind a matrix's own columns is idle
//   parameters  [parameters]: moments

@group(0) @binding(0) var<uniform> between: Between;
@group(0) @binding(1) var<storage, read> places: array<MatrixPlace>;
@group(0) @binding(2) var<storage, read> matrices: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> parameters: array<vec4<f32>>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    let own = places[group.y];
    let quads = own.columns / 4u;
    for (var i = group.x * LINEAR_GROUP + index; i < between.rows * quads; i += MATRIX_GROUPS * LINEAR_GROUP) {
        let at = ((group.y * between.rows + i / quads) * between.columns) / 4u + i % quads;
        parameters[own.weights / 4u + i] = matrices[at];
    }
}
