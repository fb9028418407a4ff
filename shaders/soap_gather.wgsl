// Purpose: the matrices between hidden layers out of an array in the layout of the parameters, beside each other.
//
// Workgroups (MATRIX_GROUPS, matrices). One invocation copies every (invocations)-th vec4 of matrix y.
//   parameters  [parameters]: a gradient or moments
//   matrices    [matrices][rows][columns], zeros behind a matrix's own columns

@group(0) @binding(0) var<uniform> between: Between;
@group(0) @binding(1) var<storage, read> places: array<MatrixPlace>;
@group(0) @binding(2) var<storage, read> parameters: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> matrices: array<vec4<f32>>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    let own = places[group.y];
    let quads = between.columns / 4u;
    let count = between.rows * quads;
    for (var i = group.x * LINEAR_GROUP + index; i < count; i += MATRIX_GROUPS * LINEAR_GROUP) {
        let column = 4u * (i % quads);
        var value = vec4<f32>();
        if column < own.columns {
            value = parameters[(own.weights + (i / quads) * own.columns + column) / 4u];
        }
        matrices[group.y * count + i] = value;
    }
}
