//! Registers in and out of slices: whole ones where the slice has room, masked ones at its end, so that a kernel is
//! written once for any width.

use pulp::Simd;

/// Registers of neurons that a kernel takes down the rows side by side: with AVX-512 a panel, whose rows are then read and
/// written whole.
pub const GROUP: usize = 4;

/// The register at `values[at..]`; lanes past the end are 0.
#[inline(always)]
pub fn load<S: Simd>(simd: S, values: &[f32], at: usize) -> S::f32s {
    match values.get(at..at + S::F32_LANES) {
        Some(whole) => S::as_simd_f32s(whole).0[0],
        None => simd.partial_load_f32s(&values[at..]),
    }
}

/// Writes the register to `values[at..]`; lanes past the end are dropped.
#[inline(always)]
pub fn store<S: Simd>(simd: S, values: &mut [f32], at: usize, register: S::f32s) {
    match values.get_mut(at..at + S::F32_LANES) {
        Some(whole) => S::as_mut_simd_f32s(whole).0[0] = register,
        None => simd.partial_store_f32s(&mut values[at..], register),
    }
}

/// The sum of products, in sixteen sums that the compiler holds in registers, the same on every instruction set.
#[inline(always)]
pub fn dot(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0.0f32; 16];
    let (a, a_rest) = a.as_chunks::<16>();
    let (b, b_rest) = b.as_chunks::<16>();
    for (a, b) in a.iter().zip(b) {
        for lane in 0..16 {
            sums[lane] += a[lane] * b[lane];
        }
    }
    let rest: f32 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    // Halves upon halves: sixteen additions one after the other would take longer than the products.
    let mut width = 8;
    while width > 0 {
        for lane in 0..width {
            sums[lane] += sums[lane + width];
        }
        width /= 2;
    }
    sums[0] + rest
}

/// The instruction sets that this machine can run, from the best to the plain one, for tests of what is dispatched.
#[doc(hidden)]
pub fn archs() -> Vec<pulp::Arch> {
    let mut archs = vec![pulp::Arch::new()];
    #[cfg(target_arch = "x86_64")]
    archs.extend(pulp::x86::V3::try_new().map(pulp::Arch::V3));
    archs.push(pulp::Arch::Scalar);
    archs
}
