//! Signed penetration depth: how far a colliding tool must be moved to be free; below zero, how far a free one may be moved.
//!
//! In one orientation the positions where the tool collides are a set of voxels, known exactly by a section. The depth at
//! a position is its distance to the nearest position of the other kind less half a pitch, the surface between them lying
//! half-way: above 0 where the tool collides, below 0 where it is free. It changes by at most a pitch from voxel to voxel
//! and crosses zero with slope one, where an overlap leaves zero slowly, shallow contact having almost no volume. So
//! an error of a tenth of a voxel in a learnt depth moves its decisions by a tenth of a voxel.
//!
//! Moves by whole voxels resolve a depth to about a voxel: the nearest move that collides may lie beside the shortest of all. Depths
//! are looked for within eight pitches (`DEPTH_CAP`), so that they end at 7.5; positions as far around the grid count as well, so that its
//! faces make no difference.

use pulp::Arch;
use serde::{Deserialize, Serialize};

use super::{SectionError, SectionPlan, SectionScratch};
use crate::grid::Grid;
use crate::orientation::Orientation;
use crate::vectorised::vectorised;

/// What a field's values are. Both are the lower the better, so that the minimum over orientations is the best of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Quantity {
    /// The fraction of the tool's volume that lies in the obstacle, in [0, 1].
    #[default]
    Overlap,
    /// The signed penetration depth, in the grid's unit.
    Depth,
}

impl Quantity {
    /// A value as fields give it on a grid of this pitch: clamped to [`Quantity::bounds`].
    #[inline]
    #[must_use]
    pub fn clamp(self, value: f32, pitch: f64) -> f32 {
        match self {
            Self::Overlap => value.clamp(0.0, 1.0),
            Self::Depth => {
                let most = (MOST * pitch) as f32;
                value.clamp(-most, most)
            }
        }
    }

    /// Lower and upper bound of the values, on a grid of this pitch.
    #[must_use]
    pub fn bounds(self, pitch: f64) -> [f64; 2] {
        match self {
            Self::Overlap => [0.0, 1.0],
            Self::Depth => [-MOST * pitch, MOST * pitch],
        }
    }

    /// True of overlaps.
    #[must_use]
    pub fn is_overlap(&self) -> bool {
        *self == Self::Overlap
    }
}

/// Positions of the other kind are looked for so many pitches away, so that depths end half a pitch before. A wider range gives no better decisions (a harmonic fit of degree 14
/// errs as much near contact with 6 as without a limit), and needs as wide a margin around the grid.
pub const DEPTH_CAP: usize = 8;
/// Its square: distances beyond it are this.
const LIMIT: u8 = (DEPTH_CAP * DEPTH_CAP) as u8;
/// The largest depth in pitches.
const MOST: f64 = DEPTH_CAP as f64 - 0.5;

/// What is computed once for depths of many orientations.
pub struct DepthPlan {
    /// Over the grid and what is around it.
    sections: SectionPlan,
    grid: Grid,
    arch: Arch,
}

/// Working memory of one thread.
#[derive(Default)]
pub struct DepthScratch {
    sections: SectionScratch,
    values: Vec<f32>,
    /// Squared distances in voxels, over fewer voxels after each axis.
    all: Vec<u8>,
    by_x: Vec<u8>,
    by_y: Vec<u8>,
    /// To the nearest colliding, and to the nearest free position.
    to_colliding: Vec<u8>,
    to_free: Vec<u8>,
}

impl DepthPlan {
    /// Depths at the voxels of another plan, of its tool and obstacle.
    ///
    /// # Errors
    /// None for a plan that was made.
    pub fn of(plan: &SectionPlan) -> Result<Self, SectionError> {
        let grid = *plan.grid();
        let margin = glam::DVec3::splat(DEPTH_CAP as f64 * grid.pitch);
        let around = Grid {
            origin: grid.origin - margin,
            dims: grid.dims.map(|n| n + 2 * DEPTH_CAP),
            pitch: grid.pitch,
        };
        Ok(Self { sections: plan.over(&around)?, grid, arch: Arch::new() })
    }

    /// No depth is larger than this, in units of length, nor smaller than its negative.
    #[must_use]
    pub fn bound(&self) -> f32 {
        Quantity::Depth.bounds(self.grid.pitch)[1] as f32
    }

    /// The grid whose voxels a section covers.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The depths of one orientation in the grid's unit, C-ordered into `depths`.
    ///
    /// # Errors
    /// As [`SectionPlan::cmf`].
    ///
    /// # Panics
    /// If `depths` has not the grid's length.
    pub fn depths(
        &self,
        orientation: &Orientation,
        scratch: &mut DepthScratch,
        depths: &mut [f32],
    ) -> Result<(), SectionError> {
        assert_eq!(depths.len(), self.grid.len(), "one depth for each voxel of the grid");
        let DepthScratch { sections, values, all, by_x, by_y, to_colliding, to_free } = scratch;
        values.resize(self.sections.grid().len(), 0.0);
        self.sections.cmf(orientation, sections, values)?;
        for (colliding, out) in [(true, &mut *to_colliding), (false, &mut *to_free)] {
            all.clear();
            all.extend(values.iter().map(|&value| if (value > 0.0) == colliding { 0 } else { LIMIT }));
            self.squared_distances(all, by_x, by_y, out);
        }
        let pitch = self.grid.pitch;
        // Of the two distances one is 0: to the kind that the position is of.
        let of = std::array::from_fn::<f32, { LIMIT as usize + 1 }, _>(|squared| {
            (((squared as f64).sqrt() - 0.5) * pitch) as f32
        });
        for ((depth, &colliding), &free) in depths.iter_mut().zip(&*to_colliding).zip(&*to_free) {
            *depth = if free > 0 { of[usize::from(free)] } else { -of[usize::from(colliding)] };
        }
        Ok(())
    }

    /// From 0 and `LIMIT` over the wider grid to squared distances from the nearest 0, in voxels, over the grid.
    fn squared_distances(&self, all: &[u8], by_x: &mut Vec<u8>, by_y: &mut Vec<u8>, out: &mut Vec<u8>) {
        let [nx, ny, nz] = self.grid.dims;
        let (wide_y, wide_z) = (ny + 2 * DEPTH_CAP, nz + 2 * DEPTH_CAP);
        by_x.resize(nx * wide_y * wide_z, 0);
        by_y.resize(nx * ny * wide_z, 0);
        out.resize(nx * ny * nz, 0);
        vectorised!(self.arch, {
            lower(all, [1, nx, wide_y * wide_z], by_x);
            lower(by_x, [nx, ny, wide_z], by_y);
            lower(by_y, [nx * ny, nz, 1], out);
        });
    }
}

/// `out[a][i][b] = min over j of values[a][i + j][b] + (j − DEPTH_CAP)²`, j from 0 to twice `DEPTH_CAP`: the middle
/// axis of `values` is longer by twice `DEPTH_CAP` than that of `out`, whose sizes are given.
#[inline(always)]
fn lower(values: &[u8], [outer, length, inner]: [usize; 3], out: &mut [u8]) {
    let wide = (length + 2 * DEPTH_CAP) * inner;
    for a in 0..outer {
        let from = &values[a * wide..][..wide];
        let to = &mut out[a * length * inner..][..length * inner];
        to.fill(LIMIT);
        for j in 0..=2 * DEPTH_CAP {
            let square = (j.abs_diff(DEPTH_CAP) * j.abs_diff(DEPTH_CAP)) as u8;
            for (to, &value) in to.iter_mut().zip(&from[j * inner..]) {
                *to = (*to).min(value + square);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::parts::ReferencePart;
    use crate::scene::{Scene, SceneSpec};
    use crate::section::ToolPoints;
    use crate::tool::{Clearance, Tool};

    fn scene(clearance: f64) -> Scene {
        let part = ReferencePart::Bracket;
        let (mesh, tool) = (part.mesh(), Tool::paper());
        let spec = SceneSpec::of_reference(part, &mesh, [11, 35, 21], &tool);
        let room = Clearance { holder: clearance, shank: clearance, cutter: clearance };
        spec.scene().unwrap().with_clearance(&room).unwrap()
    }

    fn depths(scene: &Scene, orientation: &Orientation) -> Vec<f32> {
        let plan = DepthPlan::of(&SectionPlan::of_scene(scene, ToolPoints::Tip).unwrap()).unwrap();
        let mut depths = vec![f32::NAN; scene.record.grid.len()];
        plan.depths(orientation, &mut DepthScratch::default(), &mut depths).unwrap();
        depths
    }

    #[test]
    fn depth_crosses_zero_with_slope_one_and_follows_a_clearance() {
        let orientation = Orientation::new(40.0, 70.0);
        let (tight, roomy) = (scene(0.0), scene(4.0));
        let (grid, bare, offset) =
            (tight.record.grid, depths(&tight, &orientation), depths(&roomy, &orientation));
        let pitch = grid.pitch as f32;
        let [_, ny, nz] = grid.dims;
        for step in [1, nz, ny * nz] {
            for (index, pair) in bare.windows(step + 1).enumerate() {
                let (a, b) = (grid.voxel(index), grid.voxel(index + step));
                if (0..3).filter(|&axis| a[axis] != b[axis]).count() == 1 {
                    assert!((pair[step] - pair[0]).abs() <= 1.0001 * pitch, "{a:?} {b:?}");
                }
            }
        }
        // Where neither is clamped, a tool offset by δ is deeper by δ, to the voxel that whole positions tell.
        let clamped = (DEPTH_CAP as f32 - 1.5) * pitch;
        let [lowest, highest] = Quantity::Depth.bounds(grid.pitch).map(|bound| bound as f32);
        assert!(bare.iter().chain(&offset).all(|depth| (lowest..=highest).contains(depth)));
        let (mut compared, mut worst) = (0, 0.0_f32);
        for (&a, &b) in bare.iter().zip(&offset) {
            if a < -0.5 * pitch && a > -clamped && b.abs() < clamped {
                compared += 1;
                worst = worst.max((b - a - 4.0).abs());
            }
        }
        assert!(compared > 50 && worst < 1.8 * pitch, "{compared} voxels, {worst} mm");
    }
}
