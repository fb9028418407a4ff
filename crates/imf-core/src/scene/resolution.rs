//! Which tools and parts a grid resolves: one rule for all queries.

use std::f64::consts::SQRT_2;
use std::fmt;

use glam::{DMat4, DVec3};

use super::lost_surface::LostSurface;
use super::{Bodies, SceneError, SceneSpec, SceneWarning};
use crate::control::Control;
use crate::grid::Grid;
use crate::mesh::Mesh;
use crate::mesh::topology::boundary_chain;
use crate::occupancy::Occupancy;
use crate::tool::{Assembly, Clearance, Tool};
use crate::unit::{DisplayLength, LengthUnit, proportion_check};
use crate::voxelize::{VoxelizeResult, voxelize_with};

/// Voxels across a tool at which it is resolved: between the columns of centres there is room for a cylinder of the
/// diagonal of a voxel's face.
pub(super) const VOXELS_THICK: f64 = SQRT_2;

/// Voxels along a disc of the tool at which it is resolved: as thick, it holds a layer of centres however it stands.
const DISC_THICK: f64 = 1.0;
/// Minimum number of voxels by which a disc stands out of its neighbours: a cone's rim, which is thin, is missed by
/// less.
pub(super) const DISC_OUT: f64 = 2.0;

/// A part that is nowhere thicker than this many voxels is thin.
const THIN: usize = 3;

/// Fraction of undecided centres ([`VoxelizeResult::undecided`]) above which a mesh is refused.
///
/// Measured at 20 voxels along the longest side: a cube without its lid has 0.3, a sphere that lacks a fifth of its triangles 0.4, a
/// hemisphere without its disc 0.8, and all their solid voxels are right. Triangles that share no corners and of which a fifth
/// face the wrong way have 0.98, and lose up to a quarter of the solid; half of them, 1.0 and nearly all of it. A box without two opposite
/// sides (0.96) or a shallow tray without its lid (0.99) may as well be a sheet.
pub(super) const MAX_UNDECIDED: f64 = 0.9;

/// Solid voxels of a mesh that says what is inside; `name` is for the error.
///
/// # Errors
/// A mesh that does not; [`SceneError::Cancelled`].
#[doc(hidden)]
pub fn solid_voxels(
    name: &str,
    mesh: &Mesh,
    grid: &Grid,
    conservative: bool,
    control: Control<'_>,
) -> Result<VoxelizeResult, SceneError> {
    decided(name, voxelize_with(mesh, grid, conservative, control)?)
}

/// Voxels of a mesh that says what is inside.
pub(crate) fn decided(name: &str, voxels: VoxelizeResult) -> Result<VoxelizeResult, SceneError> {
    if voxels.undecided > MAX_UNDECIDED {
        return Err(SceneError::Undecided { name: name.to_owned(), fraction: voxels.undecided });
    }
    Ok(voxels)
}

/// A tool of which an element passes between the centres of voxels.
#[derive(Clone, Debug, PartialEq)]
pub struct CoarseTool {
    /// The tool.
    pub tool: String,
    /// The thinnest of its elements.
    pub element: String,
    /// Its largest diameter, that of the ball that its slender tip holds near its end, or the length of its thinnest disc, in `unit`.
    pub thickness: f64,
    /// Voxels across it at which it is resolved.
    pub voxels: f64,
    /// The grid's pitch, in `unit`.
    pub pitch: f64,
    /// The part's unit.
    pub unit: LengthUnit,
}

impl CoarseTool {
    /// What passes between the centres of voxels of a pitch, of a tool in `unit`; `None` where all of it is seen.
    #[must_use]
    pub fn of(tool: &Tool, pitch: f64, unit: LengthUnit) -> Option<Self> {
        let thin = |(element, thickness): (String, f64), voxels: f64| {
            // Equal up to rounding is equal.
            let coarse = thickness * (1.0 + 1e-9) < voxels * pitch;
            coarse.then(|| Self { tool: tool.name.clone(), element, thickness, voxels, pitch, unit })
        };
        let tip = || {
            let is_resolved = tool.is_thick_at_tip(VOXELS_THICK * pitch);
            let slender = if is_resolved { None } else { tool.slender_tip() };
            slender.map(|thickness| ("slender tip".to_owned(), thickness))
        };
        thin(tool.thinnest(), VOXELS_THICK)
            .or_else(|| thin(tip()?, VOXELS_THICK))
            .or_else(|| tool.thinnest_disc(DISC_OUT * pitch).and_then(|disc| thin(disc, DISC_THICK)))
    }

    /// The largest pitch that resolves the element.
    #[must_use]
    pub fn most(&self) -> f64 {
        self.thickness / self.voxels
    }
}

impl fmt::Display for CoarseTool {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { tool, element, thickness, pitch, unit, .. } = self;
        // Rounded down, so that it may be chosen.
        let digits = 10f64.powi(3 - self.most().log10().floor() as i32);
        let most = (self.most() * digits).floor() / digits;
        write!(
            f,
            "the {element} of the tool '{tool}' is {} {unit} thick at most and passes between the centres of \
             voxels of {} {unit} unseen: choose a pitch of at most {}, or check the tool's unit",
            DisplayLength(*thickness),
            DisplayLength(*pitch),
            DisplayLength(most)
        )
    }
}

impl SceneSpec<'_> {
    /// Warnings about a tool (in any unit, without clearance) on a grid.
    ///
    /// # Errors
    /// A tool that [`Tool::check`] refuses; [`SceneError::Coarse`] of a tool thinner than √2 voxels, its tip too, or with a disc thinner than one, unless the spec allows it.
    pub fn check_tool(&self, tool: &Tool, grid: &Grid) -> Result<Vec<SceneWarning>, SceneError> {
        tool.check()?;
        let tool = tool.in_unit(self.unit);
        let (lower, upper) = self.part_bounds()?;
        let proportion = proportion_check((upper - lower).max_element(), tool.thinnest().1, self.unit);
        let mut warnings: Vec<SceneWarning> = proportion.map(SceneWarning::Proportion).into_iter().collect();
        warnings.extend(SceneWarning::of_frame(&tool, grid.pitch));
        if let Some(coarse) = CoarseTool::of(&tool, grid.pitch, self.unit) {
            if !self.allow_coarse {
                return Err(SceneError::Coarse(coarse));
            }
            warnings.push(SceneWarning::Coarse(coarse));
        }
        Ok(warnings)
    }

    /// A tool (in any unit) with its clearance, in the part's unit, and its warnings on a grid: those of [`SceneSpec::check_tool`], and of
    /// a holder or shank that is wider than the cutter by less than a voxel.
    ///
    /// # Errors
    /// As [`SceneSpec::check_tool`]; a clearance that the tool cannot have.
    pub fn assembly(
        &self,
        tool: &Tool,
        clearance: &Clearance,
        grid: &Grid,
    ) -> Result<(Assembly, Vec<SceneWarning>), SceneError> {
        let mut warnings = self.check_tool(tool, grid)?;
        let assembly = tool.in_unit(self.unit).offset(clearance)?;
        if !self.conservative {
            warnings.extend(SceneWarning::of_step(&assembly, grid.pitch));
        }
        Ok((assembly, warnings))
    }

    /// Warnings about part and fixtures on their grid: coordinates of few digits, voxels left undecided by openings of their meshes, a part
    /// of few voxels across, walls that lie between the centres, fixtures that overlap the part.
    ///
    /// # Errors
    /// As [`SceneSpec::bodies`].
    pub fn warnings(&self, bodies: &Bodies) -> Result<Vec<SceneWarning>, SceneError> {
        let grid = bodies.part.grid;
        let mut warnings = SceneWarning::of_body(self.part, self.mesh, &bodies.part, bodies.undecided);
        let fixtures = self.fixtures.iter().map(|fixture| (fixture.name, fixture.mesh, &fixture.transform));
        for (name, mesh, transform) in
            std::iter::once((self.part, self.mesh, &self.transform)).chain(fixtures)
        {
            let scale = transform.x_axis.truncate().length();
            warnings.extend(SceneWarning::of_rounding(name, mesh, scale, grid.pitch, self.unit));
        }
        let lost = |name: &str, mesh: &Mesh, transform: &DMat4, solid: &Occupancy| {
            SceneWarning::of_lost_surface(name, &mesh.transformed(transform), solid, &grid, self.unit)
        };
        warnings.extend(lost(self.part, self.mesh, &self.transform, &bodies.part));
        let part = self.part_bounds()?;
        let boxes = self.fixture_boxes()?;
        let placed = self.fixtures.iter().zip(&bodies.fixtures).zip(&bodies.fixtures_undecided);
        for (((fixture, (_, voxels)), &undecided), (name, low, high)) in placed.zip(boxes) {
            warnings.extend(SceneWarning::of_openings(name, fixture.mesh, undecided));
            warnings.extend(lost(name, fixture.mesh, &fixture.transform, voxels));
            let (lower, upper) = (low.max(part.0), high.min(part.1));
            // Faces that touch overlap in no volume.
            if (upper - lower).min_element() <= 1e-6 * grid.pitch {
                continue;
            }
            let both = |a: &Occupancy, b: &Occupancy| {
                a.solid.iter().zip(&b.solid).filter(|(a, b)| **a & **b == 1).count()
            };
            let shared = if self.conservative {
                // Faces that touch have common voxels, but no common centre.
                let common = grid.covering(lower, upper, 0)?;
                let solid = |mesh: &Mesh, transform: &DMat4| {
                    voxelize_with(&mesh.transformed(transform), &common, false, self.control)
                };
                let own = solid(self.mesh, &self.transform)?;
                both(&own.solid, &solid(fixture.mesh, &fixture.transform)?.solid)
            } else {
                bodies.part.on(&voxels.grid).map_or(0, |part| both(&part, voxels))
            };
            if shared > 0 {
                let volume = shared as f64 * grid.voxel_volume();
                warnings.push(SceneWarning::Overlap { fixture: name.to_owned(), volume, unit: self.unit });
            }
        }
        Ok(warnings)
    }

    /// Refuses a grid that drops voxels which the surface touches, by padding it: with `conservative` a face on the grid's own makes
    /// the voxels on both sides solid. Fixtures count where they lie within the grid.
    pub(super) fn padded_for_touch(&self, grid: &Grid) -> Result<Grid, SceneError> {
        let (lower, upper) = (grid.origin, grid.origin + grid.size());
        let near = DVec3::splat(1e-5 * grid.pitch);
        let within =
            |low: DVec3, high: DVec3| low.cmpge(lower - near).all() && high.cmple(upper + near).all();
        let (mut before, mut after) = ([0; 3], [0; 3]);
        let fixtures = self.fixture_boxes()?.into_iter().map(|(_, low, high)| (low, high));
        for (low, high) in [self.part_bounds()?].into_iter().chain(fixtures) {
            if within(low, high) {
                for axis in 0..3 {
                    before[axis] |= i64::from(low[axis] <= lower[axis] + near[axis]);
                    after[axis] |= i64::from(high[axis] >= upper[axis] - near[axis]);
                }
            }
        }
        Ok(grid.padded(before, after)?)
    }
}

impl SceneWarning {
    /// Warnings about a body's voxels; `undecided` is the fraction of centres that its mesh leaves undecided.
    pub(crate) fn of_body(part: &str, mesh: &Mesh, solid: &Occupancy, undecided: f64) -> Vec<Self> {
        let (pitch, voxels) = (solid.grid.pitch, thickness(solid, THIN));
        let thin = (voxels <= THIN).then(|| Self::Thin { part: part.to_owned(), voxels, pitch });
        thin.into_iter().chain(Self::of_openings(part, mesh, undecided)).collect()
    }

    /// Of a mesh that leaves a fraction of the centres undecided.
    fn of_openings(part: &str, mesh: &Mesh, undecided: f64) -> Option<Self> {
        // Triangles that meet without sharing corners leave edges open, and nothing undecided.
        (undecided > 0.0).then(|| Self::Open {
            part: part.to_owned(),
            boundary_edges: boundary_chain(mesh).len(),
            fraction: undecided,
        })
    }

    /// Of surface that the voxels of a body in its place lost, within a grid.
    #[doc(hidden)]
    #[must_use]
    pub fn of_lost_surface(
        part: &str,
        mesh: &Mesh,
        solid: &Occupancy,
        grid: &Grid,
        unit: LengthUnit,
    ) -> Option<Self> {
        let LostSurface { area, fraction, at } = LostSurface::of(mesh, solid, grid)?;
        Some(Self::Lost { part: part.to_owned(), area, fraction, at, pitch: grid.pitch, unit })
    }
}

/// Voxels across a part where it is thickest, or as far as it is seen to be thicker than `enough`: the edge of the largest cube of solid
/// voxels, up to 255. A plate along the axes has its own thickness, also where a wall stands on it.
fn thickness(part: &Occupancy, enough: usize) -> usize {
    let [nx, ny, nz] = part.grid.dims;
    // By the voxel that is the cube's last along every axis; one plane and the one before it.
    let (mut before, mut here) = (vec![0_u8; ny * nz], vec![0_u8; ny * nz]);
    let mut most = 0;
    for x in 0..nx {
        for y in 0..ny {
            for z in 0..nz {
                let at = y * nz + z;
                let within = x > 0 && y > 0 && z > 0;
                here[at] = match (part.solid[x * ny * nz + at], within) {
                    (0, _) => 0,
                    (_, false) => 1,
                    (_, true) => {
                        let corner = [at - 1, at - nz, at - nz - 1];
                        let near = corner.iter().flat_map(|&near| [before[near], here[near]]);
                        near.fold(before[at], u8::min).saturating_add(1)
                    }
                };
                most = most.max(here[at]);
            }
        }
        if usize::from(most) > enough {
            break;
        }
        std::mem::swap(&mut before, &mut here);
    }
    most.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_thickness_of_plates_and_of_what_stands_on_them() {
        let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [9, 8, 7] };
        let of = |inside: &dyn Fn([usize; 3]) -> bool| thickness(&Occupancy::of(grid, inside), usize::MAX);
        assert_eq!(of(&|_| false), 0);
        assert_eq!(of(&|_| true), 7);
        for axis in 0..3 {
            assert_eq!(of(&|voxel| (1..4).contains(&voxel[axis])), 3);
        }
        // Two plates side by side, and a wall on a plate: as thick as the thicker.
        assert_eq!(of(&|[x, ..]| !(2..=4).contains(&x)), 4);
        assert_eq!(of(&|[x, _, z]| z < 2 || x == 5), 2);
        // A block of five on a plate of two.
        assert_eq!(of(&|[x, y, z]| z < 2 || (x < 5 && y < 5 && z < 5)), 5);
    }
}
