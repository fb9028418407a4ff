//! The definition of the harmonic field's coefficients: the tool's radial profiles and a direct sum.
//!
//! A tool of revolution depends on an offset y only through |y| and the angle to its axis d, so
//! `T(R⁻¹y) = Σ_l t_l(|y|) P_l(ŷ·d)` with `t_l(r) = (2l+1)/2 ∫ T(r, u) P_l(u) du`, u the cosine. By the addition theorem
//! `CMF(x, d) = Σ_lm c_lm(x) Y_lm(d)`, `c_lm(x) = 4π/((2l+1) vol T) Σ_o pitch³ t_l(|o − x|) Y_lm(o − x)` over the solid
//! voxel centres o. `vol T` is the analytic volume; exact sections are divided by the voxels counted for a direction.

use std::f64::consts::PI;

use glam::DVec3;

use super::sphere::SphereBasis;
use imf_core::occupancy::Occupancy;
use imf_core::tool::{Tool, ToolShape};

/// Intervals of u = cos α at one radius where the tool is, found by bisection to this width.
const EDGE: f64 = 1e-12;
/// Samples of u among which an edge of the tool is searched; thinner features at a radius are missed.
const SAMPLES: usize = 4096;

/// The tool's angular profile at radius `r`: `t_l(r)` for l = 0 to `degree`, from the tool's geometry.
fn radial_profile(tool: &Tool, radius: f64, degree: usize) -> Vec<f64> {
    let ToolShape::Revolved(elements) = &tool.shape else { panic!("a mesh has no radial profile") };
    let inside = |u: f64| {
        let height = radius * u;
        let flat = radius * (1.0 - u * u).max(0.0).sqrt();
        elements.iter().flat_map(|e| &e.profile).any(|segment| {
            let (from, to) = segment.range();
            (from..=to).contains(&height) && flat <= segment.radius(height)
        })
    };
    let mut profile = vec![0.0; degree + 1];
    let mut was = inside(-1.0);
    let mut start = -1.0;
    let place = |sample: usize| -1.0 + 2.0 * sample as f64 / SAMPLES as f64;
    for sample in 1..=SAMPLES {
        let is = inside(place(sample));
        if is == was {
            continue;
        }
        let (mut low, mut high) = (place(sample - 1), place(sample));
        while high - low > EDGE {
            let middle = 0.5 * (low + high);
            if inside(middle) == was { low = middle } else { high = middle }
        }
        if was {
            add_interval(&mut profile, start, low);
        }
        (was, start) = (is, low);
    }
    if was {
        add_interval(&mut profile, start, 1.0);
    }
    profile
}

/// Adds (2l+1)/2 ∫ P_l over [from, to]: `(2l+1) ∫ P_l = P_(l+1) − P_(l−1)`.
fn add_interval(profile: &mut [f64], from: f64, to: f64) {
    let (mut low, mut high) = ((1.0, from), (1.0, to));
    profile[0] += 0.5 * (to - from);
    for l in 1..profile.len() {
        let n = l as f64;
        let next = |u: f64, (before, now): (f64, f64)| ((2.0 * n + 1.0) * u * now - n * before) / (n + 1.0);
        let (next_low, next_high) = (next(from, low), next(to, high));
        profile[l] += 0.5 * ((next_high - high.0) - (next_low - low.0));
        low = (low.1, next_low);
        high = (high.1, next_high);
    }
}

/// The coefficients `c_lm` at a world position by the direct sum over all solid voxel centres: slow, and the definition.
pub(super) fn direct_coefficients(
    obstacle: &Occupancy,
    tool: &Tool,
    position: DVec3,
    degree: usize,
) -> Vec<f64> {
    let basis = SphereBasis::new(degree);
    let mut values = vec![0.0; basis.len()];
    let mut coefficients = vec![0.0; basis.len()];
    let grid = &obstacle.grid;
    let reach = tool.reach();
    for (index, &solid) in obstacle.solid.iter().enumerate() {
        let offset = grid.centre(grid.voxel(index)) - position;
        let radius = offset.length();
        if solid == 0 || radius > reach {
            continue;
        }
        // At the tip itself every direction is the same.
        basis.values(offset.try_normalize().unwrap_or(DVec3::Z), &mut values);
        let profile = radial_profile(tool, radius, degree);
        for l in 0..=degree {
            let degree_share = 4.0 * PI / (2 * l + 1) as f64 * profile[l];
            for place in l * l..(l + 1) * (l + 1) {
                coefficients[place] += degree_share * values[place];
            }
        }
    }
    let share = grid.voxel_volume() / tool.volume();
    coefficients.iter_mut().for_each(|c| *c *= share);
    coefficients
}

#[cfg(test)]
mod tests {
    use super::*;
    use imf_core::tool::{Element, ElementKind, Segment};

    fn legendre(degree: usize, u: f64) -> f64 {
        let (mut before, mut now) = (1.0, u);
        if degree == 0 {
            return 1.0;
        }
        for l in 1..degree {
            let n = l as f64;
            (before, now) = (now, ((2.0 * n + 1.0) * u * now - n * before) / (n + 1.0));
        }
        now
    }

    #[test]
    fn the_profile_sums_to_the_tool_away_from_its_edges() {
        let tool = Tool::paper();
        let degree = 200;
        // Inside the cutter's ball only near the axis: u from 0.6 on, by r = 6 and radius 5 around height 5.
        let profile = radial_profile(&tool, 6.0, degree);
        let edge = 36.0 / (2.0 * 5.0 * 6.0);
        for (u, expected) in [(1.0, 1.0), (0.9, 1.0), (edge - 0.15, 0.0), (-0.5, 0.0), (-1.0, 0.0)] {
            let sum: f64 = (0..=degree).map(|l| profile[l] * legendre(l, u)).sum();
            // Gibbs ripples of 200 terms; larger where all peaks meet, at the poles.
            let tolerance = if f64::abs(u) == 1.0 { 0.2 } else { 0.03 };
            assert!((sum - expected).abs() < tolerance, "u = {u}: {sum} against {expected}");
        }
    }

    #[test]
    fn a_cone_of_directions_has_its_closed_form() {
        let cone = Segment::Line { from: 0.0, to: 10.0, radius_from: 0.0, radius_to: 10.0 };
        let mut tool = Tool::paper();
        tool.shape = ToolShape::Revolved(vec![Element { kind: ElementKind::Cutter, profile: vec![cone] }]);
        let edge = 0.5f64.sqrt();
        let profile = radial_profile(&tool, 3.0, 3);
        let expected = [
            0.5 * (1.0 - edge),
            0.75 * (1.0 - edge * edge),
            1.25 * (edge - edge.powi(3)),
            // 7/2 ∫ (5u³ − 3u)/2.
            1.75 * (1.25 * (1.0 - edge.powi(4)) - 1.5 * (1.0 - edge * edge)),
        ];
        for (l, (found, expected)) in profile.iter().zip(expected).enumerate() {
            assert!((found - expected).abs() < 1e-9, "t_{l}: {found} against {expected}");
        }
    }
}
