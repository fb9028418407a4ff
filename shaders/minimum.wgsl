// Purpose: the running minimum over directions, parts of the list in ascending order. Of equal values the first
// direction stays.
//
// One invocation computes every (invocations)-th point of the part.
//   values  [directions][points], the network's values of this part, from `base`
//   least   [points], the minimum so far
//   best    [points], index of its direction in the whole list

@group(0) @binding(0) var<uniform> sweep: Sweep;
@group(0) @binding(1) var<storage, read> values: array<f32>;
@group(0) @binding(2) var<storage, read_write> least: array<f32>;
@group(0) @binding(3) var<storage, read_write> best: array<u32>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var point = id.x; point < sweep.points; point += groups.x * LINEAR_GROUP) {
        var value = values[sweep.base + point];
        var index = sweep.first_direction;
        if sweep.first_direction > 0u && !(value < least[point]) {
            value = least[point];
            index = best[point];
        }
        for (var direction = 1u; direction < sweep.directions; direction += 1u) {
            let candidate = values[sweep.base + direction * sweep.points + point];
            if candidate < value {
                value = candidate;
                index = sweep.first_direction + direction;
            }
        }
        least[point] = value;
        best[point] = index;
    }
}
