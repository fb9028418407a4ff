// Purpose: the running minimum over orientations of a field that is a sum of functions, parts of the list in ascending order. Of equal values
// the first orientation stays.
//
// One invocation computes every (invocations)-th row, a point.
//   values  [padded_rows][outputs], the columns past `sweep.directions` are padding
//   least   [rows], the minimum so far, not clipped
//   best    [rows], index of its orientation in the whole list

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<uniform> layer: Layer;
@group(0) @binding(2) var<uniform> sweep: Sweep;
@group(0) @binding(3) var<storage, read> values: array<f32>;
@group(0) @binding(4) var<storage, read_write> least: array<f32>;
@group(0) @binding(5) var<storage, read_write> best: array<u32>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var row = id.x; row < batch.rows; row += groups.x * LINEAR_GROUP) {
        let at = row * layer.outputs;
        var value = values[at];
        var index = sweep.first_direction;
        if sweep.first_direction > 0u && !(value < least[row]) {
            value = least[row];
            index = best[row];
        }
        for (var direction = 1u; direction < sweep.directions; direction += 1u) {
            let candidate = values[at + direction];
            if candidate < value {
                value = candidate;
                index = sweep.first_direction + direction;
            }
        }
        least[row] = value;
        best[row] = index;
    }
}
