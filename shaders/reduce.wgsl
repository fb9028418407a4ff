// Purpose: the gradient as the sum of its slices, always in the order of the slices: no float atomics, so the same batch
// gives the same bits. The parts of a batch too large for one pass add up in the gradient.
//
// One invocation computes every (invocations)-th vec4 of the gradient.
//   partials  [slices][parameters]
//   gradient  [parameters]

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<uniform> step: Step;
@group(0) @binding(2) var<storage, read> partials: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> gradient: array<vec4<f32>>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let count = arrayLength(&gradient);
    for (var i = id.x; i < count; i += groups.x * LINEAR_GROUP) {
        var sum = vec4<f32>();
        for (var slice = 0u; slice < batch.slices; slice += 1u) {
            sum += partials[slice * count + i];
        }
        sum /= step.scale;
        if step.first == 0u {
            sum += gradient[i];
        }
        gradient[i] = sum;
    }
}
