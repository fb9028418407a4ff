// Purpose: values of poses, y = max(open(s), 0), and the delta ∂y/∂s that starts the way back to the inputs.
//
// One invocation computes every (invocations)-th row.
//   poses   from `sweep.base`
//   sums    s [padded_rows][outputs], column 0
//   deltas  [padded_rows][outputs], columns past 0 and rows of padding are 0
//   values  from `sweep.base`; NaN for an invalid pose

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<uniform> layer: Layer;
@group(0) @binding(2) var<uniform> sweep: Sweep;
@group(0) @binding(3) var<storage, read> poses: array<Pose>;
@group(0) @binding(4) var<storage, read> sums: array<f32>;
@group(0) @binding(5) var<storage, read_write> deltas: array<f32>;
@group(0) @binding(6) var<storage, read_write> values: array<f32>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var row = id.x; row < batch.padded_rows; row += groups.x * LINEAR_GROUP) {
        var delta = 0.0;
        if row < batch.rows {
            let open = open_output(sums[row * layer.outputs]);
            let y = output_value(open);
            delta = select(0.0, open_slope(open), open > 0.0);
            values[sweep.base + row] = select(bitcast<f32>(world_nan(sweep.base)), y, is_pose(poses[sweep.base + row]));
        }
        deltas[row * layer.outputs] = delta;
        for (var column = 1u; column < layer.outputs; column += 1u) {
            deltas[row * layer.outputs + column] = 0.0;
        }
    }
}
