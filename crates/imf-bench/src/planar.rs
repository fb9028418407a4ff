//! One rotation in a plane: the field of a 2D part and a 2D tool, as the comparison of interpolations requires.
//!
//! The part is one layer of voxels, a grid with a single voxel along z. The tool lies in the plane: at angle θ it is the cut
//! through its axis at (θ, φ = 90°), as voxels, with its tip on a voxel's centre. `CMF(x, θ)` is the number of pixels shared,
//! divided by those of the tool at θ. The direct sum over pixels is the definition (`direct_count` of the tests); the layer's
//! 3D sections count the same, because only the tool's voxels of that layer can meet a part that is one layer thick.

use glam::DVec3;
use imf_cli::picture::Axes;
use imf_cli::slices;
use imf_core::grid::Grid;
use imf_core::occupancy::Occupancy;
use imf_core::orientation::Orientation;
use imf_core::section::{SectionError, SectionPlan, SectionScratch, overlap_fraction};
use imf_core::tool::{Tool, ToolError, ToolVoxels};
use imf_core::unit::LengthUnit;

/// The layer `index` at right angles to `axis` as a part of its own: the other two axes in their order become x and y.
///
/// # Panics
/// If the layer does not exist.
pub(crate) fn layer(part: &Occupancy, axis: usize, index: usize) -> Occupancy {
    let voxels = slices::mask(part, axis, index);
    let Axes { start: [x, y], pitch, .. } = slices::axes(&part.grid, LengthUnit::Mm, axis);
    let grid = Grid { origin: DVec3::new(x, y, 0.0), pitch, dims: [voxels.nrows(), voxels.ncols(), 1] };
    Occupancy { grid, solid: voxels.into_iter().collect() }
}

/// The tool in the plane at θ.
fn lying(theta: f64) -> Orientation {
    Orientation { theta, phi: 90.0, roll: 0.0 }
}

/// Pixels of the tool in the plane at θ degrees, relative to the pixel its tip is on.
///
/// # Errors
/// A tool that holds no pixel, or is too large.
pub(crate) fn silhouette(tool: &Tool, theta: f64, pitch: f64) -> Result<Vec<[i32; 2]>, ToolError> {
    let rotated = ToolVoxels::new(tool, &lying(theta), pitch)?;
    let [nx, ny, nz] = rotated.dims;
    let middle = usize::try_from(-rotated.lower[2]).unwrap_or(usize::MAX);
    let mut pixels = Vec::new();
    for x in 0..nx {
        for y in 0..ny {
            if middle < nz && rotated.solid[(x * ny + y) * nz + middle] != 0 {
                pixels.push([rotated.lower[0] + x as i32, rotated.lower[1] + y as i32]);
            }
        }
    }
    if pixels.is_empty() {
        return Err(ToolError::TooSmall { name: tool.name.clone(), pitch });
    }
    Ok(pixels)
}

/// The collision measure at every pixel of a part of one layer with the tool at θ degrees, C-ordered into `cmf`. The tool is
/// one of revolution, the plan is of its tip.
///
/// # Errors
/// A tool that does not fit the grid, or a failed spot check.
///
/// # Panics
/// If the part is more than one layer, the tool has no axis of symmetry, or `cmf` has not the grid's length.
pub(crate) fn section(
    plan: &SectionPlan,
    theta: f64,
    scratch: &mut SectionScratch,
    cmf: &mut [f32],
) -> Result<(), SectionError> {
    let grid = plan.grid();
    assert!(grid.dims[2] == 1, "a part of one layer, not {:?}", grid.dims);
    assert!(plan.tool().is_axisymmetric(), "a cut through the axis of a tool of revolution");
    let (_, counts) = plan.counts_in(&lying(theta), grid, scratch)?;
    let pixels = silhouette(plan.tool(), theta, grid.pitch)?.len() as u32;
    assert_eq!(cmf.len(), counts.len(), "one value for each pixel");
    cmf.iter_mut().zip(counts).for_each(|(value, &count)| *value = overlap_fraction(count, pixels));
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use imf_core::section::ToolPoints;

    /// Pixels shared by the part and the tool's `silhouette` with the tip at a pixel: the definition.
    fn direct_count(part: &Occupancy, silhouette: &[[i32; 2]], tip: [usize; 2]) -> u32 {
        let [nx, ny, _] = part.grid.dims;
        let shared = silhouette.iter().filter(|[dx, dy]| {
            let (x, y) = (tip[0] as i64 + i64::from(*dx), tip[1] as i64 + i64::from(*dy));
            (0..nx as i64).contains(&x) && (0..ny as i64).contains(&y) && {
                part.solid[x as usize * ny + y as usize] != 0
            }
        });
        shared.count() as u32
    }

    fn part() -> Occupancy {
        let grid = Grid { origin: DVec3::ZERO, pitch: 4.0, dims: [11, 13, 1] };
        let solid = (0..grid.len()).map(|i| u8::from(i.wrapping_mul(2_654_435_761) >> 7 & 3 == 0)).collect();
        Occupancy { grid, solid }
    }

    #[test]
    fn sections_are_direct_sums_over_pixels() {
        let (part, tool) = (part(), Tool::paper());
        let plan = SectionPlan::new(&part, &tool, ToolPoints::Tip).unwrap();
        let mut scratch = SectionScratch::default();
        for theta in [0.0, 12.5, 90.0, 217.0, 360.0] {
            let pixels = silhouette(&tool, theta, 4.0).unwrap();
            let mut cmf = vec![9.0; part.grid.len()];
            section(&plan, theta, &mut scratch, &mut cmf).unwrap();
            assert!(cmf.iter().any(|&v| v > 0.0));
            for (pixel, &value) in cmf.iter().enumerate() {
                let count = direct_count(&part, &pixels, [pixel / 13, pixel % 13]);
                assert_eq!(value, overlap_fraction(count, pixels.len() as u32), "θ = {theta}, pixel {pixel}");
            }
        }
    }

    #[test]
    fn the_lying_tool_has_the_area_of_its_profile_and_turns_around_its_tip() {
        let tool = Tool::paper();
        // Ball end of radius 5 (half a disc), 30 of shaft 10 wide, 48 of holder 29 wide.
        let area = std::f64::consts::PI * 12.5 + 30.0 * 10.0 + 48.0 * 29.0;
        for theta in [0.0, 33.0, 90.0, 301.0] {
            let pixels = silhouette(&tool, theta, 0.5).unwrap();
            let found = pixels.len() as f64 * 0.25;
            // Half a pixel all around, where edges lie on the centres of pixels: 0.25 of a perimeter of 195.
            assert!((found - area).abs() < 0.25 * 195.0, "{found} of {area} at {theta}°");
            let (sin, cos) = theta.to_radians().sin_cos();
            assert!(pixels.iter().all(|[x, y]| f64::from(*x) * cos + f64::from(*y) * sin > -1e-6));
        }
    }

    #[test]
    fn a_layer_keeps_the_other_axes_in_order() {
        let grid = Grid { origin: DVec3::new(1.0, 2.0, 3.0), pitch: 0.5, dims: [3, 4, 5] };
        let part = Occupancy { grid, solid: (0..grid.len()).map(|i| u8::from(i % 7 == 0)).collect() };
        let cut = layer(&part, 1, 2);
        assert_eq!((cut.grid.dims, cut.grid.origin), ([3, 5, 1], DVec3::new(1.0, 3.0, 0.0)));
        for x in 0..3 {
            for z in 0..5 {
                assert_eq!(cut.solid[x * 5 + z], part.solid[grid.index([x, 2, z])]);
            }
        }
    }
}
