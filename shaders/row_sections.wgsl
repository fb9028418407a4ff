// Purpose: values of points as sections, one orientation behind the other, to be read back: the columns of a product without its
// padding.
//
// One invocation moves every (invocations)-th value.
//   values    [padded_rows][outputs], the columns past `sweep.directions` are padding
//   sections  [directions][rows]

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<uniform> layer: Layer;
@group(0) @binding(2) var<uniform> sweep: Sweep;
@group(0) @binding(3) var<storage, read> values: array<f32>;
@group(0) @binding(4) var<storage, read_write> sections: array<f32>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var place = id.x; place < batch.rows * sweep.directions; place += groups.x * LINEAR_GROUP) {
        let direction = place / batch.rows;
        let row = place - direction * batch.rows;
        sections[place] = values[row * layer.outputs + direction];
    }
}
