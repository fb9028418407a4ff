// Purpose: reflections that `soap_panel.wgsl` found, taken to other axes: to those behind their panel, in their order; or, on the
// way back, to the unit matrix, from the last to the first: that makes the new axes. Axis j ends with reflection j.
//
// One invocation for every axis (x) of matrix y, so that what a workgroup reads at a time lies side by side.
//   vectors  v [matrices][axis][number]
//   axes     [matrices][number][axis]

@group(0) @binding(0) var<uniform> panel: Panel;
@group(0) @binding(1) var<storage, read> sides: array<Side>;
@group(0) @binding(2) var<storage, read> vectors: array<f32>;
@group(0) @binding(3) var<storage, read_write> axes: array<f32>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let side = sides[id.y];
    let axis = panel.behind + id.x;
    if axis >= side.size {
        return;
    }
    let first = square(side, id.y);
    let column = first + place(side, axis);
    // Backwards axis j, which is behind `first`, meets the reflections j, j − 1, …
    let end = select(min(panel.end, side.size), min(panel.end, axis + 1u), panel.backwards == 1u);
    for (var step = panel.first; step < end; step += 1u) {
        let i = select(step, panel.first + end - 1u - step, panel.backwards == 1u);
        let row = first + place(side, i) * side.stride;
        var twice = 0.0;
        for (var k = i; k < side.size; k += 1u) {
            let at = place(side, k);
            twice += vectors[row + at] * axes[column + at * side.stride];
        }
        twice *= 2.0;
        for (var k = i; k < side.size; k += 1u) {
            let at = place(side, k);
            axes[column + at * side.stride] -= twice * vectors[row + at];
        }
    }
}
