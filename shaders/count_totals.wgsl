// Purpose: overlaps from differences, in place. Upwards the differences up to a voxel are the overlap of the next
// voxel; downwards those from a voxel on are the negative of its own.
//
// One invocation sums up every (invocations)-th line along a job's axis.
//   jobs         [jobs]
//   differences  [nx][ny][nz] for each job: differences, then overlaps

@group(0) @binding(0) var<uniform> counting: Counting;
@group(0) @binding(1) var<storage, read> jobs: array<Job>;
@group(0) @binding(2) var<storage, read_write> differences: array<u32>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var item = id.x; item < counting.jobs * counting.lines; item += groups.x * LINEAR_GROUP) {
        let job = jobs[item / counting.lines];
        let line = item % counting.lines;
        // Along z.
        var lines = job.nx * job.ny;
        var length = job.nz;
        var stride = 1u;
        var at = line * job.nz;
        if job.axis == 0u {
            lines = job.ny * job.nz;
            length = job.nx;
            stride = lines;
            at = line;
        } else if job.axis == 1u {
            lines = job.nx * job.nz;
            length = job.ny;
            stride = job.nz;
            at = line / max(1u, job.nz) * job.ny * job.nz + line % max(1u, job.nz);
        }
        if line >= lines {
            continue;
        }
        at += job.differences;
        var total = 0u;
        if job.upwards == 1u {
            for (var step = 0u; step < length; step += 1u) {
                total += differences[at];
                differences[at] = total;
                at += stride;
            }
        } else {
            at += length * stride;
            for (var step = 0u; step < length; step += 1u) {
                at -= stride;
                total -= differences[at];
                differences[at] = total;
            }
        }
    }
}
