// Purpose: Muon's momentum, the direction made of it (Nesterov's), and the sum of the direction's squares:
//   m ← μ·m + (1 − μ)·∂w;  u = μ·m + (1 − μ)·∂w
//
// Workgroups (MATRIX_GROUPS, matrices). One invocation computes every (invocations)-th vec4 of matrix y; workgroup x sums the
// squares of what it computes, in fixed order. Squares below 1e-38 count as 0: gradients below 1e-19 do not move a matrix.
//   gradient, first_moment  [parameters]
//   directions              u [matrices][rows][columns], zeros behind a matrix's own columns
//   squares                 [matrices][MATRIX_GROUPS]

@group(0) @binding(0) var<uniform> between: Between;
@group(0) @binding(1) var<storage, read> matrices: array<MatrixPlace>;
@group(0) @binding(2) var<storage, read> gradient: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> first_moment: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> directions: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> squares: array<f32>;

var<workgroup> partial: array<f32, LINEAR_GROUP>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    let matrix = matrices[group.y];
    let quads = between.columns / 4u;
    let count = between.rows * quads;
    var sum = 0.0;
    for (var i = group.x * LINEAR_GROUP + index; i < count; i += MATRIX_GROUPS * LINEAR_GROUP) {
        let column = 4u * (i % quads);
        var u = vec4<f32>();
        if column < matrix.columns {
            let at = (matrix.weights + (i / quads) * matrix.columns + column) / 4u;
            let g = between.one_minus_kept * gradient[at];
            let m = between.kept * first_moment[at] + g;
            first_moment[at] = m;
            u = between.kept * m + g;
        }
        directions[group.y * count + i] = u;
        sum += dot(u, u);
    }
    partial[index] = sum;
    workgroupBarrier();
    if index == 0u {
        var total = 0.0;
        for (var i = 0u; i < LINEAR_GROUP; i += 1u) {
            total += partial[i];
        }
        squares[group.y * MATRIX_GROUPS + group.x] = total;
    }
}
