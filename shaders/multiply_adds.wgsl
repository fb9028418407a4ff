// Purpose: fused multiply-adds in f32 and nothing else, what matrix products are measured against.
//
// Every invocation follows 32 chains, each from a number of its own, so that no two are one computation. With a factor and a
// summand of 1, which come from the host so that no compiler knows them, each grows by 2 a turn.
//   sums  [invocations], the chains' together

@group(0) @binding(0) var<uniform> turns: Turns;
@group(0) @binding(1) var<storage, read_write> sums: array<f32>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {
    let factor = vec4<f32>(turns.factor);
    let summand = vec4<f32>(turns.summand);
    let apart = vec4<f32>(4.0);
    var a = vec4<f32>(0.0, 1.0, 2.0, 3.0) + f32(id.x % LINEAR_GROUP);
    var b = a + apart;
    var c = b + apart;
    var d = c + apart;
    var e = d + apart;
    var f = e + apart;
    var g = f + apart;
    var h = g + apart;
    for (var turn = 0u; turn < turns.count; turn += 1u) {
        // `peak.rs` counts these: 64.
        a = fma(a, factor, summand);
        b = fma(b, factor, summand);
        c = fma(c, factor, summand);
        d = fma(d, factor, summand);
        e = fma(e, factor, summand);
        f = fma(f, factor, summand);
        g = fma(g, factor, summand);
        h = fma(h, factor, summand);
        a = fma(a, factor, summand);
        b = fma(b, factor, summand);
        c = fma(c, factor, summand);
        d = fma(d, factor, summand);
        e = fma(e, factor, summand);
        f = fma(f, factor, summand);
        g = fma(g, factor, summand);
        h = fma(h, factor, summand);
    }
    sums[id.x] = dot(((a + b) + (c + d)) + ((e + f) + (g + h)), vec4<f32>(1.0));
}
