// Purpose: M·Q with SOAP's axes by falling mean, which reflections are to make orthonormal; they begin with the unit matrix.
//
// One invocation for every axis (x) of matrix y. Padding is left alone.
//   line         means along the axes [matrices][stride], one after the other
//   turned       M·Q [matrices][stride][stride]
//   order        where each axis stood before [matrices][stride]
//   reflections  M·Q in that order, likewise
//   axes         the unit matrix, likewise

@group(0) @binding(0) var<storage, read> sides: array<Side>;
@group(0) @binding(1) var<storage, read> line: array<f32>;
@group(0) @binding(2) var<storage, read> turned: array<f32>;
@group(0) @binding(3) var<storage, read_write> order: array<u32>;
@group(0) @binding(4) var<storage, read_write> reflections: array<f32>;
@group(0) @binding(5) var<storage, read_write> axes: array<f32>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let side = sides[id.y];
    if id.x >= side.size {
        return;
    }
    let first_line = id.y * side.stride;
    let own = line[first_line + id.x];
    var rank = 0u;
    for (var j = 0u; j < side.size; j += 1u) {
        let other = line[first_line + j];
        rank += u32(other > own || (other == own && j < id.x));
    }
    let before = place(side, id.x);
    let now = place(side, rank);
    order[first_line + now] = before;
    for (var k = 0u; k < side.size; k += 1u) {
        let row = square(side, id.y) + place(side, k) * side.stride;
        reflections[row + now] = turned[row + before];
        axes[row + before] = f32(k == id.x);
    }
}
