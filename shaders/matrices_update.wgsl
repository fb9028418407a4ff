// Purpose: the step of the matrices between hidden layers by SOAP, w ← w − η·length·X.
//
// Workgroups (MATRIX_GROUPS, matrices). One invocation computes every (invocations)-th vec4 of matrix y.
//   directions  X [matrices][rows][columns], what lies behind a matrix's own columns is idle
//   parameters  [parameters]

@group(0) @binding(0) var<uniform> between: Between;
@group(0) @binding(1) var<uniform> step: Step;
@group(0) @binding(2) var<storage, read> matrices: array<MatrixPlace>;
@group(0) @binding(3) var<storage, read> directions: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> parameters: array<vec4<f32>>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    let matrix = matrices[group.y];
    let length = step.learning_rate * matrix.length;
    let quads = matrix.columns / 4u;
    for (var i = group.x * LINEAR_GROUP + index; i < between.rows * quads; i += MATRIX_GROUPS * LINEAR_GROUP) {
        let at = ((group.y * between.rows + i / quads) * between.columns) / 4u + i % quads;
        parameters[matrix.weights / 4u + i] -= length * directions[at];
    }
}
