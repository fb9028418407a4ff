// Purpose: reads a job's overlap at a voxel of the slab.
//
//   jobs      [jobs]
//   overlaps  [nx][ny][nz] for each job, over its own box

@group(0) @binding(0) var<uniform> counting: Counting;
@group(0) @binding(1) var<storage, read> jobs: array<Job>;
@group(0) @binding(2) var<storage, read> overlaps: array<u32>;

/// A voxel of the slab in the obstacle's grid.
fn slab_voxel(index: u32) -> vec3<i32> {
    let z = index % counting.nz;
    let y = index / counting.nz % counting.ny;
    let x = index / counting.nz / counting.ny;
    return vec3(counting.lower_x, counting.lower_y, counting.lower_z) + vec3<i32>(vec3(x, y, z));
}

/// Zero where no difference was taken: there the tool has left the obstacle.
fn overlap(job: Job, voxel: vec3<i32>) -> u32 {
    // A difference upwards led to the next voxel.
    let step = vec3<i32>(vec3(0u, 1u, 2u) == vec3(job.axis)) * i32(job.upwards);
    let at = voxel - step - vec3(job.lower_x, job.lower_y, job.lower_z);
    let dims = vec3<i32>(vec3(job.nx, job.ny, job.nz));
    if any(at < vec3(0)) || any(at >= dims) {
        return 0u;
    }
    return overlaps[job.differences + (u32(at.x) * job.ny + u32(at.y)) * job.nz + u32(at.z)];
}
