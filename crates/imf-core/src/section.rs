//! Exact sections of the collision measure field: one orientation, every voxel of the query grid.
//!
//! `overlap(x) = Σ_o O[x + o]·RT[o] / count(RT)`: a correlation of two sets of voxels. `direct` is its definition;
//! `convolution` computes the same whole numbers by real FFTs. The collision measure is the least overlap over the
//! tool's sharp points, `CMF(x) = min_k overlap(x − R k)`, read by trilinear means of the whole-number sections
//! where `R k` is no whole number of voxels.

mod convolution;
mod direct;
mod elements;
mod imf;
mod size;

pub use direct::{direct_cmf, direct_count};
pub use elements::ElementPlans;
pub use imf::{Imf, imf, stream_sections};

use std::sync::OnceLock;

use glam::DVec3;
use thiserror::Error;

use crate::control::Control;
use crate::grid::Grid;
use crate::occupancy::Occupancy;
use crate::orientation::Orientation;
use crate::tool::{RotatedTool, Tool, ToolError};

use convolution::{Convolver, Scratch};
use size::{CircularSize, QueryBox};

/// Why a section cannot be computed.
#[derive(Debug, Error)]
pub enum SectionError {
    /// The tool does not fit the grid.
    #[error(transparent)]
    Tool(#[from] ToolError),
    /// A direct sum disagreed with the convolution: a defect of this program or of the machine.
    #[error(
        "the convolution gave {found} at voxel {voxel:?}, a direct sum {expected}: please report this; \
         the machine's memory may be faulty"
    )]
    SpotCheck {
        /// The voxel.
        voxel: [i64; 3],
        /// What the convolution gave.
        found: u32,
        /// What the direct sum gave.
        expected: u32,
    },
    /// The voxels of the query grid are not those of the obstacle's grid.
    #[error(
        "the query grid (origin {query}, pitch {query_pitch}) does not lie on the voxels of the obstacle's grid \
         (origin {obstacle}, pitch {pitch}): both need one pitch and a distance of whole voxels"
    )]
    QueryGrid {
        /// Origin of the query grid.
        query: DVec3,
        /// Pitch of the query grid.
        query_pitch: f64,
        /// Origin of the obstacle's grid.
        obstacle: DVec3,
        /// Pitch of the obstacle's grid.
        pitch: f64,
    },
    /// The caller's [`Control`] asked to stop.
    #[error("interrupted")]
    Cancelled,
}

/// What is computed once for an obstacle and a tool, and used for any number of orientations.
///
/// Plan once, run many: sections take `&self` and a [`SectionScratch`] of the calling thread.
pub struct SectionPlan {
    obstacle: Occupancy,
    tool: Tool,
    sharp_points: Vec<DVec3>,
    grid: Grid,
    /// Voxel (0, 0, 0) of `grid` in the obstacle's grid.
    offset: [i64; 3],
    query: QueryBox,
    size: CircularSize,
    single: Option<Convolver<f32>>,
    double: OnceLock<Convolver<f64>>,
}

/// Working memory of one thread; buffers grow at the first use and are kept.
#[derive(Default)]
pub struct SectionScratch {
    single: Scratch<f32>,
    double: Scratch<f64>,
    counts: Vec<u32>,
}

impl SectionPlan {
    /// Plans sections of `tool` around `obstacle` at every voxel of the obstacle's grid. The tool's lengths must be
    /// in the grid's unit ([`Tool::in_unit`]).
    ///
    /// # Errors
    /// A tool without volume.
    pub fn new(obstacle: &Occupancy, tool: &Tool) -> Result<Self, SectionError> {
        Self::with_query(obstacle, &obstacle.grid, tool)
    }

    /// Plans sections at every voxel of `query_grid`, which lies on the obstacle's voxels and may be a part of its grid,
    /// stick out of it or stand beside it. The obstacle counts as a whole, space outside its grid is empty.
    ///
    /// # Errors
    /// A tool without volume, or a query grid with other voxels than the obstacle's.
    pub fn with_query(obstacle: &Occupancy, query_grid: &Grid, tool: &Tool) -> Result<Self, SectionError> {
        tool.check()?;
        let offset = obstacle.grid.offset_of(query_grid).ok_or(SectionError::QueryGrid {
            query: query_grid.origin,
            query_pitch: query_grid.pitch,
            obstacle: obstacle.grid.origin,
            pitch: obstacle.grid.pitch,
        })?;
        let sharp_points = tool.sharp_point_positions();
        let (query, size) = Self::sizes(&obstacle.grid, offset, query_grid.dims, tool);
        let mut plan = Self {
            obstacle: obstacle.clone(),
            tool: tool.clone(),
            sharp_points,
            grid: *query_grid,
            offset,
            query,
            size,
            single: None,
            double: OnceLock::new(),
        };
        let upright = RotatedTool::new(tool, &Orientation::default(), obstacle.grid.pitch)?;
        // The count varies by a few per cent with the orientation; every section checks its own.
        if size.error_bound::<f32>(obstacle.count(), upright.count as usize) < 0.5 {
            plan.single = Some(Convolver::new(&plan.obstacle, query, size));
        }
        Ok(plan)
    }

    fn sizes(grid: &Grid, offset: [i64; 3], dims: [usize; 3], tool: &Tool) -> (QueryBox, CircularSize) {
        let farthest = tool.sharp_point_positions().iter().map(|k| k.length()).fold(0.0, f64::max);
        let grow = if farthest > 0.0 { (farthest / grid.pitch).ceil() as i64 + 1 } else { 0 };
        let query = QueryBox::around(offset, dims, grow);
        (query, CircularSize::new(grid.dims, query, tool.reach() / grid.pitch))
    }

    /// Bytes that a plan with this many threads will take: known before anything is allocated.
    #[must_use]
    pub fn memory_estimate(grid: &Grid, tool: &Tool, threads: usize) -> u64 {
        Self::memory_estimate_with_query(grid, grid, tool, threads)
    }

    /// The same for a query grid of its own ([`SectionPlan::with_query`]).
    #[must_use]
    pub fn memory_estimate_with_query(grid: &Grid, query_grid: &Grid, tool: &Tool, threads: usize) -> u64 {
        let offset = grid.offset_of(query_grid).unwrap_or_default();
        let (query, size) = Self::sizes(grid, offset, query_grid.dims, tool);
        let complex = |bytes: u64| 2 * bytes;
        let points: u64 = size.n.iter().map(|&n| n as u64).product();
        let spectrum = complex(4) * points / 2;
        let rotated = (2.0 * tool.reach() / grid.pitch + 3.0).powi(3).min(1e18) as u64;
        let per_thread = spectrum * 3 / 2 + rotated + 16 * query.len() as u64;
        spectrum + threads as u64 * per_thread + 2 * grid.len() as u64
    }

    /// The grid whose voxels a section covers.
    #[must_use]
    pub fn grid(&self) -> &Grid {
        &self.grid
    }

    /// The obstacle.
    #[must_use]
    pub fn obstacle(&self) -> &Occupancy {
        &self.obstacle
    }

    /// The tool, in the grid's unit.
    #[must_use]
    pub fn tool(&self) -> &Tool {
        &self.tool
    }

    /// One line for people: transform size and precision.
    #[must_use]
    pub fn describe(&self) -> String {
        let [x, y, z] = self.size.n;
        let precision = if self.single.is_some() { "f32" } else { "f64" };
        format!("real FFT {x}×{y}×{z} in {precision}")
    }

    /// Voxels shared by obstacle and rotated tool with the tip at every voxel of the grid, C-ordered into `counts`,
    /// and the rotated tool's own count. Whole numbers, equal to [`direct_count`].
    ///
    /// # Errors
    /// A tool that does not fit the grid, or a failed spot check.
    ///
    /// # Panics
    /// If `counts` has not the grid's length.
    pub fn counts(
        &self,
        orientation: &Orientation,
        scratch: &mut SectionScratch,
        counts: &mut [u32],
    ) -> Result<u32, SectionError> {
        assert_eq!(counts.len(), self.grid.len(), "one count for each voxel of the grid");
        let rotated = self.box_counts(orientation, scratch)?;
        let [nx, ny, nz] = self.grid.dims;
        let [ox, oy, oz] = self.offset;
        for x in 0..nx {
            for y in 0..ny {
                let from = self.query.index([x as i64 + ox, y as i64 + oy, oz]);
                counts[(x * ny + y) * nz..][..nz].copy_from_slice(&scratch.counts[from..from + nz]);
            }
        }
        Ok(rotated)
    }

    /// The collision measure field of one orientation, C-ordered into `cmf`, in [0, 1].
    ///
    /// # Errors
    /// A tool that does not fit the grid, or a failed spot check.
    ///
    /// # Panics
    /// If `cmf` has not the grid's length.
    pub fn cmf(
        &self,
        orientation: &Orientation,
        scratch: &mut SectionScratch,
        cmf: &mut [f32],
    ) -> Result<(), SectionError> {
        assert_eq!(cmf.len(), self.grid.len(), "one value for each voxel of the grid");
        let normaliser = f64::from(self.box_counts(orientation, scratch)?);
        let rotation = orientation.rotation();
        for (index, &sharp) in self.sharp_points.iter().enumerate() {
            let shift = rotation * sharp / self.obstacle.grid.pitch;
            self.read_shifted(&scratch.counts, -shift, normaliser, index == 0, cmf);
        }
        Ok(())
    }

    /// Counts over the whole query box into `scratch.counts`; returns the rotated tool's own count.
    fn box_counts(
        &self,
        orientation: &Orientation,
        scratch: &mut SectionScratch,
    ) -> Result<u32, SectionError> {
        let rotated = RotatedTool::new(&self.tool, orientation, self.obstacle.grid.pitch)?;
        scratch.counts.resize(self.query.len(), 0);
        // A deviation from whole numbers near ½ would be ambiguous: a quarter is already a reason for f64.
        let settled = self.single.as_ref().is_some_and(|convolver| {
            let bound = self.size.error_bound::<f32>(convolver.obstacle_count(), rotated.count as usize);
            bound < 0.5 && convolver.correlate(&rotated, &mut scratch.single, &mut scratch.counts) < 0.25
        });
        if !settled {
            let convolver = self.double.get_or_init(|| Convolver::new(&self.obstacle, self.query, self.size));
            convolver.correlate(&rotated, &mut scratch.double, &mut scratch.counts);
        }
        self.spot_check(&rotated, &scratch.counts)?;
        Ok(rotated.count)
    }

    /// Compares a few voxels, other ones for every orientation, with direct sums.
    fn spot_check(&self, rotated: &RotatedTool, counts: &[u32]) -> Result<(), SectionError> {
        const CHECKS: u64 = 3;
        let seed = u64::from(rotated.count).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ rotated.solid.len() as u64;
        for check in 0..CHECKS {
            let mixed = (seed ^ (check << 17)).wrapping_mul(0xBF58_476D_1CE4_E5B9) >> 20;
            let index = (mixed % counts.len() as u64) as usize;
            let voxel = self.query.voxel(index);
            let expected = direct_count(&self.obstacle, rotated, voxel);
            if counts[index] != expected {
                return Err(SectionError::SpotCheck { voxel, found: counts[index], expected });
            }
        }
        Ok(())
    }

    /// `cmf[x] = min(cmf[x], overlap(x + shift))` with `shift` in voxels; the first call of a section sets.
    fn read_shifted(&self, counts: &[u32], shift: DVec3, normaliser: f64, first: bool, cmf: &mut [f32]) {
        let whole = shift.floor();
        let fraction = shift - whole;
        let [ox, oy, oz] = self.offset;
        let base = [whole.x as i64 + ox, whole.y as i64 + oy, whole.z as i64 + oz];
        // Corners of weight zero are not read: a whole shift reads one voxel.
        let corners: Vec<([i64; 3], f64)> = (0..8)
            .map(|corner: i64| {
                let bits = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
                let weight: f64 = (0..3)
                    .map(|axis| if bits[axis] == 1 { fraction[axis] } else { 1.0 - fraction[axis] })
                    .product();
                ([0, 1, 2].map(|axis| base[axis] + bits[axis]), weight / normaliser)
            })
            .filter(|&(_, weight)| weight > 0.0)
            .collect();
        let [nx, ny, nz] = self.grid.dims;
        for x in 0..nx {
            for y in 0..ny {
                let line = &mut cmf[(x * ny + y) * nz..][..nz];
                let starts: Vec<(usize, f64)> = corners
                    .iter()
                    .map(|&([dx, dy, dz], w)| (self.query.index([x as i64 + dx, y as i64 + dy, dz]), w))
                    .collect();
                for (z, value) in line.iter_mut().enumerate() {
                    let overlap: f64 = starts.iter().map(|&(from, w)| w * f64::from(counts[from + z])).sum();
                    let overlap = (overlap as f32).clamp(0.0, 1.0);
                    *value = if first { overlap } else { value.min(overlap) };
                }
            }
        }
    }
}

/// Runs the sections of a set one after the other on the calling thread's pool and writes each into its own array.
///
/// # Errors
/// As [`SectionPlan::cmf`]; [`SectionError::Cancelled`] when the control asks to stop.
pub fn sections(
    plan: &SectionPlan,
    orientations: &[Orientation],
    control: Control<'_>,
) -> Result<Vec<Vec<f32>>, SectionError> {
    let parts = stream_sections(plan, orientations, control, Vec::new, |list: &mut Vec<_>, index, cmf| {
        list.push((index, cmf.to_vec()));
    })?;
    let mut all: Vec<(usize, Vec<f32>)> = parts.into_iter().flatten().collect();
    all.sort_by_key(|&(index, _)| index);
    Ok(all.into_iter().map(|(_, cmf)| cmf).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::orientation::OrientationSet;
    use crate::tool::{Element, ElementKind, Segment, SharpPoints, ToolShape};
    use crate::unit::LengthUnit;

    const DIMS: [usize; 3] = [13, 11, 17];

    /// A cylinder of the given radius and height with its tip at the origin.
    fn cylinder(radius: f64, height: f64) -> Tool {
        let line = Segment::Line { from: 0.0, to: height, radius_from: radius, radius_to: radius };
        Tool {
            name: "cylinder".into(),
            unit: LengthUnit::Mm,
            shape: ToolShape::Revolved(vec![Element { kind: ElementKind::Cutter, profile: vec![line] }]),
            sharp_points: SharpPoints::Tip,
        }
    }

    fn scattered(dims: [usize; 3]) -> Occupancy {
        let grid = Grid { origin: DVec3::new(0.3, -1.0, 2.0), pitch: 1.0, dims };
        let solid = (0..grid.len()).map(|i| u8::from(i.wrapping_mul(2_654_435_761) >> 7 & 3 == 0)).collect();
        Occupancy { grid, solid }
    }

    fn counts_equal_direct(plan: &SectionPlan, orientation: &Orientation) {
        let mut scratch = SectionScratch::default();
        let mut counts = vec![u32::MAX; plan.grid().len()];
        plan.counts(orientation, &mut scratch, &mut counts).unwrap();
        let rotated = RotatedTool::new(plan.tool(), orientation, plan.grid().pitch).unwrap();
        for (index, &count) in counts.iter().enumerate() {
            let voxel = plan.grid().voxel(index).map(|v| v as i64);
            assert_eq!(count, direct_count(plan.obstacle(), &rotated, voxel), "{orientation:?} {voxel:?}");
        }
    }

    #[test]
    fn counts_are_direct_sums_for_tools_smaller_and_larger_than_the_grid() {
        let mut orientations = OrientationSet::parse("random:6:1").unwrap().orientations;
        orientations.extend(OrientationSet::parse("0,0;0,180;90,90;45,45").unwrap().orientations);
        for tool in [cylinder(2.0, 6.0), cylinder(4.0, 45.0), cylinder(0.6, 1.0)] {
            for dims in [DIMS, [1, 5, 2]] {
                let plan = SectionPlan::new(&scattered(dims), &tool).unwrap();
                orientations.iter().for_each(|o| counts_equal_direct(&plan, o));
            }
        }
    }

    #[test]
    fn a_query_grid_of_its_own_sees_the_whole_obstacle() {
        let obstacle = scattered(DIMS);
        let points = SharpPoints::Points(vec![DVec3::new(0.3, -0.4, 0.7)]);
        let sharp = Tool { sharp_points: points, ..cylinder(1.5, 5.0) };
        // Within, sticking out on one side, around it all, and beside it: nearer and farther than the tool reaches.
        let grids = [
            ([-4, -3, -6], [-5, -4, -7]),
            ([3, -2, 4], [-9, -6, 0]),
            ([5, 6, 7], [8, 4, 3]),
            ([-15, 0, 0], [9, 0, 0]),
            ([0, 0, 60], [0, 0, -70]),
        ];
        for (before, after) in grids {
            let query = obstacle.grid.grown(before, after).unwrap();
            // The same obstacle on a grid that holds the query grid too, where the definition reads every voxel.
            let all = obstacle.grid.grown(before.map(|b| b.max(0)), after.map(|a| a.max(0))).unwrap();
            let (whole, shift) = (obstacle.on(&all).unwrap(), all.offset_of(&query).unwrap());
            for tool in [&cylinder(2.0, 9.0), &sharp] {
                let plan = SectionPlan::with_query(&obstacle, &query, tool).unwrap();
                let (mut scratch, mut counts) = (SectionScratch::default(), vec![u32::MAX; query.len()]);
                let mut cmf = vec![f32::NAN; query.len()];
                for orientation in OrientationSet::parse("random:3:8").unwrap().orientations {
                    let total = plan.counts(&orientation, &mut scratch, &mut counts).unwrap();
                    plan.cmf(&orientation, &mut scratch, &mut cmf).unwrap();
                    let rotated = RotatedTool::new(tool, &orientation, 1.0).unwrap();
                    assert_eq!(total, rotated.count);
                    for index in 0..query.len() {
                        let voxel = query.voxel(index);
                        let voxel = [0, 1, 2].map(|axis| voxel[axis] as i64 + shift[axis]);
                        assert_eq!(counts[index], direct_count(&whole, &rotated, voxel), "{voxel:?}");
                        let voxel = voxel.map(|v| v as usize);
                        let expected = direct_cmf(&whole, tool, &orientation, voxel).unwrap();
                        assert!((f64::from(cmf[index]) - expected).abs() < 1e-6);
                    }
                }
            }
        }
        let moved = Grid { origin: obstacle.grid.origin + 0.5, ..obstacle.grid };
        let refusal = SectionPlan::with_query(&obstacle, &moved, &sharp).err().unwrap();
        assert!(refusal.to_string().contains("whole voxels"), "{refusal}");
    }

    #[test]
    fn both_precisions_give_the_same_whole_numbers() {
        let mut plan = SectionPlan::new(&scattered(DIMS), &cylinder(3.0, 9.0)).unwrap();
        assert!(plan.single.is_some());
        plan.single = None;
        counts_equal_direct(&plan, &Orientation::new(33.0, 71.0));
    }

    #[test]
    fn sharp_points_are_read_by_trilinear_means() {
        let tool = Tool {
            sharp_points: SharpPoints::Points(vec![DVec3::new(1.3, -0.4, 0.7), DVec3::ZERO]),
            ..cylinder(2.5, 7.0)
        };
        let plan = SectionPlan::new(&scattered(DIMS), &tool).unwrap();
        let mut scratch = SectionScratch::default();
        let mut cmf = vec![f32::NAN; plan.grid().len()];
        for orientation in OrientationSet::parse("0,0;20,50;110,130").unwrap().orientations {
            plan.cmf(&orientation, &mut scratch, &mut cmf).unwrap();
            for (index, &value) in cmf.iter().enumerate() {
                let expected =
                    direct_cmf(plan.obstacle(), &tool, &orientation, plan.grid().voxel(index)).unwrap();
                assert!((f64::from(value) - expected).abs() < 1e-6, "{value} {expected}");
            }
        }
    }

    #[test]
    fn a_box_of_voxels_under_a_one_voxel_line_is_counted_in_closed_form() {
        // A line of 5 voxels going up over a block that fills z < 4: overlap = clamp(4 − z, 0, 5).
        let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [4, 4, 8] };
        let solid = (0..grid.len()).map(|i| u8::from(i % 8 < 4)).collect();
        let plan = SectionPlan::new(&Occupancy { grid, solid }, &cylinder(0.4, 4.5)).unwrap();
        let mut cmf = vec![0.0; grid.len()];
        plan.cmf(&Orientation::default(), &mut SectionScratch::default(), &mut cmf).unwrap();
        for (index, &value) in cmf.iter().enumerate() {
            let z = index % 8;
            assert_eq!(value, (4usize.saturating_sub(z)) as f32 / 5.0);
        }
    }

    #[test]
    fn the_imf_is_the_least_section_with_the_first_index_at_a_tie() {
        let plan = SectionPlan::new(&scattered(DIMS), &cylinder(2.0, 6.0)).unwrap();
        let mut orientations = OrientationSet::parse("fibonacci:9").unwrap().orientations;
        orientations.extend(orientations.clone());
        let all = sections(&plan, &orientations, Control::quiet()).unwrap();
        for threads in [1, 3] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let result = pool.install(|| imf(&plan, &orientations, Control::quiet())).unwrap();
            for voxel in 0..plan.grid().len() {
                let mut expected = (f32::INFINITY, u32::MAX);
                for (index, section) in all.iter().enumerate() {
                    if section[voxel] < expected.0 {
                        expected = (section[voxel], index as u32);
                    }
                }
                assert_eq!((result.value[voxel], result.best[voxel]), expected);
            }
        }
    }

    #[test]
    fn cancelling_stops_the_stream() {
        let plan = SectionPlan::new(&scattered(DIMS), &cylinder(2.0, 6.0)).unwrap();
        let stop = std::sync::atomic::AtomicBool::new(true);
        let control = Control { progress: &|_| {}, cancelled: &stop };
        let orientations = OrientationSet::parse("fibonacci:9").unwrap().orientations;
        assert!(matches!(imf(&plan, &orientations, control), Err(SectionError::Cancelled)));
    }

    #[test]
    fn the_papers_scene_fits_f32_and_its_estimate_is_near_the_truth() {
        let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [58, 76, 121] };
        let estimate = SectionPlan::memory_estimate(&grid, &Tool::paper(), 2) as f64 / 1e6;
        // One spectrum of 16 MB, and about 35 MB of scratch a thread.
        assert!((40.0..200.0).contains(&estimate), "{estimate} MB");
        assert!(
            CircularSize::new(grid.dims, QueryBox::grown(grid.dims, 0), 84.3)
                .error_bound::<f32>(120_000, 33_000)
                < 0.5
        );
    }
}
