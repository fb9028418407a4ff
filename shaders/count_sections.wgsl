// Purpose: the overlaps of every job over the slab, to be read back.
//
// One invocation computes every (invocations)-th value.
//   jobs      [jobs]
//   overlaps  [nx][ny][nz] for each job, over its own box
//   sections  [jobs][slab's nx][ny][nz]

@group(0) @binding(0) var<uniform> counting: Counting;
@group(0) @binding(1) var<storage, read> jobs: array<Job>;
@group(0) @binding(2) var<storage, read> overlaps: array<u32>;
@group(0) @binding(3) var<storage, read_write> sections: array<u32>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let voxels = counting.nx * counting.ny * counting.nz;
    for (var item = id.x; item < counting.jobs * voxels; item += groups.x * LINEAR_GROUP) {
        sections[item] = overlap(jobs[item / voxels], slab_voxel(item % voxels));
    }
}
