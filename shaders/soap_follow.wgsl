// Purpose: the second moments in the order that SOAP's axes have since the last look.
//
// Workgroups (MATRIX_GROUPS, matrices). One invocation copies every (invocations)-th number of matrix y.
//   rows_order, columns_order  where each axis stood before, [matrices][rows] and [matrices][columns]
//   second_moment              [parameters]
//   ordered                    [matrices][rows][columns], what lies behind a matrix's own columns is idle

@group(0) @binding(0) var<uniform> between: Between;
@group(0) @binding(1) var<storage, read> places: array<MatrixPlace>;
@group(0) @binding(2) var<storage, read> rows_order: array<u32>;
@group(0) @binding(3) var<storage, read> columns_order: array<u32>;
@group(0) @binding(4) var<storage, read> second_moment: array<f32>;
@group(0) @binding(5) var<storage, read_write> ordered: array<f32>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    let own = places[group.y];
    let count = between.rows * own.columns;
    for (var i = group.x * LINEAR_GROUP + index; i < count; i += MATRIX_GROUPS * LINEAR_GROUP) {
        let row = group.y * between.rows + i / own.columns;
        let column = i % own.columns;
        let source = rows_order[row] * own.columns + columns_order[group.y * between.columns + column];
        ordered[row * between.columns + column] = second_moment[own.weights + source];
    }
}
