// Purpose: one Adam step with coupled L2 (Kingma and Ba 2015, algorithm 1; PyTorch's `weight_decay`):
//   g ← ∂w + λ·w;  m ← β₁·m + (1 − β₁)·g;  v ← β₂·v + (1 − β₂)·g²
//   w ← w − η·(m / (1 − β₁ᵗ)) / (√(v / (1 − β₂ᵗ)) + ε)
// Where w, ∂w, m and v are zero, as in all padding, they stay zero: ε > 0.
//
// One invocation computes every (invocations)-th vec4 of a span; what another optimiser steps lies between the spans.
//   gradient, parameters, first_moment, second_moment  [parameters]

@group(0) @binding(0) var<uniform> step: Step;
@group(0) @binding(1) var<uniform> span: Span;
@group(0) @binding(2) var<storage, read> gradient: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> parameters: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> first_moment: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> second_moment: array<vec4<f32>>;

@compute @workgroup_size(LINEAR_GROUP)
fn main(@builtin(global_invocation_id) id: vec3<u32>, @builtin(num_workgroups) groups: vec3<u32>) {
    for (var i = span.first + id.x; i < span.end; i += groups.x * LINEAR_GROUP) {
        let w = parameters[i];
        let g = gradient[i] + step.weight_decay * w;
        let m = step.beta1 * first_moment[i] + step.one_minus_beta1 * g;
        let v = step.beta2 * second_moment[i] + step.one_minus_beta2 * g * g;
        first_moment[i] = m;
        second_moment[i] = v;
        parameters[i] = w - step.learning_rate * (m * step.correction1) / (sqrt(v * step.correction2) + step.epsilon);
    }
}
