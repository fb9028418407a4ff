// Purpose: makes the inputs of all points × directions of one part on the device, so that only points and directions
// travel. Row = direction · points + point.
//
// One invocation computes every (invocations)-th row.
//   point_features      [points][3], three numbers in [−1, 1]
//   direction_features  [directions][2], likewise
//   signal              [padded_rows][stride], written at columns offset..offset + columns

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<uniform> placement: Placement;
@group(0) @binding(2) var<uniform> sweep: Sweep;
@group(0) @binding(3) var<storage, read> point_features: array<f32>;
@group(0) @binding(4) var<storage, read> direction_features: array<f32>;
@group(0) @binding(5) var<storage, read_write> signal: array<f32>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var row = id.x; row < batch.padded_rows; row += groups.x * LINEAR_GROUP) {
        let at = row * placement.stride + placement.offset;
        let point = row % sweep.points;
        let direction = row / sweep.points;
        for (var column = 0u; column < placement.columns; column += 1u) {
            var value = 0.0;
            if row < batch.rows {
                if column < POINT_INPUTS {
                    value = point_features[point * POINT_INPUTS + column];
                } else if column < INPUTS {
                    value = direction_features[direction * DIRECTION_INPUTS + column - POINT_INPUTS];
                }
            }
            signal[at + column] = value;
        }
    }
}
