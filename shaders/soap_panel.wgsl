// Purpose: the next SOAP_PANEL reflections of a QR decomposition by Householder's method: reflection i, I − 2·v·vᵀ, leaves
// nothing of axis i behind its number i. Axes behind the panel are left to `soap_reflect.wgsl`.
//
// One workgroup of SOAP_GROUP invocations a matrix (y): SOAP_GROUP / SOAP_PANEL of them for every axis of the panel.
//   reflections  axes [matrices][number][axis], those of the panel as the reflections before it leave them
//   vectors      v, of length 1 or 0, in the rows of the axes' numbers: [matrices][axis][number], zero and idle before number i

@group(0) @binding(0) var<uniform> panel: Panel;
@group(0) @binding(1) var<storage, read> sides: array<Side>;
@group(0) @binding(2) var<storage, read_write> reflections: array<f32>;
@group(0) @binding(3) var<storage, read_write> vectors: array<f32>;

var<workgroup> partial: array<f32, SOAP_GROUP>;

/// The sum, or the largest, of every invocation's value.
fn reduced(index: u32, value: f32, largest: bool) -> f32 {
    partial[index] = value;
    workgroupBarrier();
    for (var half = SOAP_GROUP / 2u; half > 0u; half /= 2u) {
        if index < half {
            let a = partial[index];
            let b = partial[index + half];
            partial[index] = select(a + b, max(a, b), largest);
        }
        workgroupBarrier();
    }
    let result = partial[0];
    workgroupBarrier();
    return result;
}

@compute @workgroup_size(SOAP_GROUP)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) index: u32) {
    let side = sides[group.y];
    let first = square(side, group.y);
    // Behind the panel's end, or the last axis, there is nothing to do.
    let end = min(panel.end, side.size);
    let other = panel.first + index % SOAP_PANEL;
    let lane = index / SOAP_PANEL;
    let lanes = SOAP_GROUP / SOAP_PANEL;
    for (var i = panel.first; i < end; i += 1u) {
        let column = first + place(side, i);
        let row = first + place(side, i) * side.stride;
        var most = 0.0;
        for (var k = i + index; k < side.size; k += SOAP_GROUP) {
            most = max(most, abs(reflections[column + place(side, k) * side.stride]));
        }
        // Over the largest number, so that no square is lost. An axis that has nothing there gets the vector 0.
        let largest = reduced(index, most, true);
        let scale = select(0.0, 1.0 / largest, largest > 1e-37);
        var squares = 0.0;
        for (var k = i + index; k < side.size; k += SOAP_GROUP) {
            let value = scale * reflections[column + place(side, k) * side.stride];
            squares += value * value;
        }
        let square_sum = reduced(index, squares, false);
        let root = sqrt(square_sum);
        let lead = scale * reflections[column + place(side, i) * side.stride];
        // The squares of v: what is added to its first number has that number's sign.
        let length = 2.0 * (square_sum + abs(lead) * root);
        let unit = select(0.0, inverseSqrt(length), length > 0.0);
        for (var k = i + index; k < side.size; k += SOAP_GROUP) {
            var value = scale * reflections[column + place(side, k) * side.stride];
            if k == i {
                value += select(root, -root, lead < 0.0);
            }
            vectors[row + place(side, k)] = unit * value;
        }
        storageBarrier();
        let reflects = other > i && other < end;
        let aim = first + place(side, other);
        var along = 0.0;
        if reflects {
            for (var k = i + lane; k < side.size; k += lanes) {
                let at = place(side, k);
                along += vectors[row + at] * reflections[aim + at * side.stride];
            }
        }
        partial[index] = along;
        workgroupBarrier();
        var twice = 0.0;
        for (var l = 0u; l < lanes; l += 1u) {
            twice += partial[l * SOAP_PANEL + index % SOAP_PANEL];
        }
        twice *= 2.0;
        if reflects {
            for (var k = i + lane; k < side.size; k += lanes) {
                let at = place(side, k);
                reflections[aim + at * side.stride] -= twice * vectors[row + at];
            }
        }
        storageBarrier();
        workgroupBarrier();
    }
}
