// Purpose: Adam's moments along SOAP's axes, and in the gradient's place their step, but for its length:
//   m ← κ·m + (1 − κ)·g;  v ← κ·v + (1 − κ)·g²;  g ← (m / (1 − κᵗ)) / (√(v / (1 − κᵗ)) + SOAP_EPSILON)
//
// Workgroups (MATRIX_GROUPS, matrices). One invocation computes every (invocations)-th vec4 of matrix y.
//   along                        g [matrices][rows][columns], what lies behind a matrix's own columns is idle
//   first_moment, second_moment  [parameters]

@group(0) @binding(0) var<uniform> between: Between;
@group(0) @binding(1) var<uniform> step: Step;
@group(0) @binding(2) var<storage, read> places: array<MatrixPlace>;
@group(0) @binding(3) var<storage, read_write> along: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> first_moment: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> second_moment: array<vec4<f32>>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    let own = places[group.y];
    let quads = own.columns / 4u;
    for (var i = group.x * LINEAR_GROUP + index; i < between.rows * quads; i += MATRIX_GROUPS * LINEAR_GROUP) {
        let at = own.weights / 4u + i;
        let here = ((group.y * between.rows + i / quads) * between.columns) / 4u + i % quads;
        let g = along[here];
        let m = between.beta * first_moment[at] + between.one_minus_beta * g;
        let v = between.beta * second_moment[at] + between.one_minus_beta * g * g;
        first_moment[at] = m;
        second_moment[at] = v;
        along[here] = m * step.matrix_correction / (sqrt(v * step.matrix_correction) + SOAP_EPSILON);
    }
}
