// Purpose: the minimum collision measure over orientations so far, jobs in ascending order of orientation. Of equal
// values the first orientation stays. Values are floats ≥ 0 as their bits, which are in the order of the values; the
// host has made the value of every possible count, so that nothing is rounded here.
//
// One invocation computes every (invocations)-th voxel of the slab.
//   shares    [count + 1] for each job, the value of every count
//   least     [slab's nx][ny][nz], the minimum so far; all ones before the first
//   best      [slab's nx][ny][nz], its orientation

@group(0) @binding(3) var<storage, read> shares: array<u32>;
@group(0) @binding(4) var<storage, read_write> least: array<u32>;
@group(0) @binding(5) var<storage, read_write> best: array<u32>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    let voxels = counting.nx * counting.ny * counting.nz;
    for (var item = id.x; item < voxels; item += groups.x * LINEAR_GROUP) {
        let voxel = slab_voxel(item);
        var value = least[item];
        var orientation = best[item];
        for (var index = 0u; index < counting.jobs; index += 1u) {
            let job = jobs[index];
            let candidate = shares[job.shares + overlap(job, voxel)];
            if candidate < value {
                value = candidate;
                orientation = job.orientation;
            }
        }
        least[item] = value;
        best[item] = orientation;
    }
}
