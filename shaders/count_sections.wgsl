// Purpose: the overlaps of every job over the slab, to be read back.
//
// One invocation computes every (invocations)-th value.
//   sections  [jobs][slab's nx][ny][nz]

@group(0) @binding(3) var<storage, read_write> sections: array<u32>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let voxels = counting.nx * counting.ny * counting.nz;
    for (var item = id.x; item < counting.jobs * voxels; item += groups.x * LINEAR_GROUP) {
        sections[item] = overlap(jobs[item / voxels], slab_voxel(item % voxels));
    }
}
