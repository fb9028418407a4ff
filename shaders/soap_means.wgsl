// Purpose: the means along SOAP's axes, and the axes put aside: a look at new ones begins. M are the means of the rows' or the
// columns' products, Q their axes, one a column; a product before this kernel makes M·Q.
//
// One invocation for every axis (x) of matrix y.
//   axes    Q [matrices][stride][stride]
//   turned  M·Q, likewise
//   before  Q, padding and all
//   line    qᵀ·M·q of every axis [matrices][stride], one after the other

@group(0) @binding(0) var<storage, read> sides: array<Side>;
@group(0) @binding(1) var<storage, read> axes: array<f32>;
@group(0) @binding(2) var<storage, read> turned: array<f32>;
@group(0) @binding(3) var<storage, read_write> before: array<f32>;
@group(0) @binding(4) var<storage, read_write> line: array<f32>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let side = sides[id.y];
    let first = square(side, id.y);
    if id.x < side.stride {
        for (var k = 0u; k < side.stride; k += 1u) {
            let at = first + k * side.stride + id.x;
            before[at] = axes[at];
        }
    }
    if id.x < side.size {
        var sum = 0.0;
        for (var k = 0u; k < side.size; k += 1u) {
            let at = first + place(side, k) * side.stride + place(side, id.x);
            sum += axes[at] * turned[at];
        }
        line[id.y * side.stride + id.x] = sum;
    }
}
