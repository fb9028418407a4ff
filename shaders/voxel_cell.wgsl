// Purpose: the eight voxels around a point of a harmonic field, as `imf_fields::harmonic` has them: trilinear between voxel
// centres, one-sided on a centre's plane.
//
//   poses   from `sweep.base`
//   voxels  [voxel][stride], as vec4

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<uniform> world: World;
@group(0) @binding(2) var<uniform> sweep: Sweep;
@group(0) @binding(3) var<uniform> lattice: Lattice;
@group(0) @binding(4) var<storage, read> poses: array<Pose>;
@group(0) @binding(5) var<storage, read> voxels: array<vec4<f32>>;

struct Cell {
    low: vec3<u32>,
    high: vec3<u32>,
    fraction: vec3<f32>,
}

/// The cell of a pose's point, which is held in the box of the voxel centres; of some point for an invalid pose.
fn cell_of(pose: Pose) -> Cell {
    let position = held_tip(pose, world.low.xyz, world.high.xyz);
    let at = max((position - world.low.xyz) / lattice.pitch, vec3<f32>());
    let last = vec3<u32>(lattice.nx, lattice.ny, lattice.nz) - 1u;
    let low = min(vec3<u32>(at), max(last, vec3<u32>(1u)) - 1u);
    return Cell(low, min(low + 1u, last), clamp(at - vec3<f32>(low), vec3<f32>(), vec3<f32>(1.0)));
}

/// True along the axes where a corner is the cell's upper one.
fn is_upper(corner: u32) -> vec3<bool> {
    return (vec3<u32>(corner >> 2u, corner >> 1u, corner) & vec3<u32>(1u)) == vec3<u32>(1u);
}

/// Where a corner's coefficients begin.
fn corner_begins(cell: Cell, corner: u32) -> u32 {
    let voxel = select(cell.low, cell.high, is_upper(corner));
    return ((voxel.x * lattice.ny + voxel.y) * lattice.nz + voxel.z) * lattice.stride;
}

/// A corner's weight along each axis.
fn corner_weights(cell: Cell, corner: u32) -> vec3<f32> {
    return select(1.0 - cell.fraction, cell.fraction, is_upper(corner));
}
