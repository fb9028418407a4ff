// Purpose: what the kernels that sum functions by their weights have in common.
//
//   poses    from `sweep.base`
//   steps    see `harmonics.wgsl` and `rotations.wgsl`
//   weights  [padded_rows][stride], of function k in column k
//   values   from `sweep.base`; NaN for an invalid pose

@group(0) @binding(0) var<uniform> batch: Batch;
@group(0) @binding(1) var<uniform> world: World;
@group(0) @binding(2) var<uniform> sweep: Sweep;
@group(0) @binding(3) var<uniform> symmetry: Symmetry;
@group(0) @binding(4) var<uniform> harmonics: Harmonics;
@group(0) @binding(5) var<storage, read> poses: array<Pose>;
@group(0) @binding(6) var<storage, read> steps: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> weights: array<f32>;
@group(0) @binding(8) var<storage, read_write> values: array<f32>;

var<private> row_begins: u32;
var<private> sum: f32;
