//! What a scene is made from, and its voxels.

use glam::{DMat4, DVec3};

use super::resolution::solid_voxels;
use super::saved::crc32;
use super::{Bodies, Fixture, GridExtent, Resolution, Scene, SceneError, SceneRecord, TransformFault};
use crate::control::Control;
use crate::grid::Grid;
use crate::mesh::Mesh;
use crate::mesh::topology::MeshReport;
use crate::occupancy::Occupancy;
use crate::parts::ReferencePart;
use crate::tool::{Clearance, Tool};
use crate::unit::LengthUnit;
use crate::voxelize::{VoxelizeResult, voxelize_with};

/// Everything that a scene is made from.
#[derive(Clone, Debug)]
pub struct SceneSpec<'a> {
    /// Name of the part.
    pub part: &'a str,
    /// The part in its own coordinates.
    pub mesh: &'a Mesh,
    /// Unit of the mesh.
    pub unit: LengthUnit,
    /// Set-up of the part.
    pub transform: DMat4,
    /// Grid.
    pub resolution: Resolution,
    /// Empty voxels on each side of the part.
    pub margin: usize,
    /// Also make every voxel solid that the surface touches.
    pub conservative: bool,
    /// A tool that passes between the voxels' centres is not an error.
    pub allow_coarse: bool,
    /// The tool, in any unit.
    pub tool: &'a Tool,
    /// What holds the part.
    pub fixtures: &'a [Fixture<'a>],
    /// What the grid is chosen around.
    pub around: GridExtent,
    /// Receives progress, one unit a row of voxels of part and fixtures, and may cancel.
    pub control: Control<'a>,
}

impl<'a> SceneSpec<'a> {
    /// A reference part on `dims` voxels, however few, alone and as it lies. `mesh` is the part's own.
    #[must_use]
    pub fn of_reference(part: ReferencePart, mesh: &'a Mesh, dims: [usize; 3], tool: &'a Tool) -> Self {
        Self {
            part: part.name(),
            mesh,
            unit: LengthUnit::Mm,
            transform: DMat4::IDENTITY,
            resolution: Resolution::Dims(dims),
            margin: 0,
            conservative: false,
            allow_coarse: true,
            tool,
            fixtures: &[],
            around: GridExtent::Part,
            control: Control::quiet(),
        }
    }

    /// The grid that the scene will have. With [`GridExtent::All`] and [`Resolution::Dims`] the pitch is the smallest
    /// at which everything fits. With `conservative` it holds every voxel that the surface touches: with a given
    /// pitch it has a voxel more on a side where a surface lies on its face; with given dimensions its pitch is
    /// larger by 10⁻⁴.
    ///
    /// # Errors
    /// A mesh without triangles, or a grid that cannot be made.
    pub fn grid(&self) -> Result<Grid, SceneError> {
        let (mut lower, mut upper) = self.part_bounds()?;
        for (_, low, high) in self.fixture_boxes()?.into_iter().filter(|_| self.around == GridExtent::All) {
            (lower, upper) = (lower.min(low), upper.max(high));
        }
        match self.resolution {
            Resolution::Pitch(pitch) => {
                let grid = Grid::with_pitch(lower, upper, pitch, self.margin)?;
                if self.conservative { self.padded_for_touch(&grid) } else { Ok(grid) }
            }
            Resolution::Dims(dims) => {
                let is_tight = self.conservative && self.margin == 0;
                let room = if is_tight { 0.5e-4 * (upper - lower) } else { DVec3::ZERO };
                Ok(Grid::with_dims(lower - room, upper + room, dims, self.margin)?)
            }
        }
    }

    /// Voxelises part and fixtures on the scene's grid.
    ///
    /// # Errors
    /// As [`SceneSpec::grid`], [`SceneSpec::check_tool`] and [`SceneSpec::bodies`]; a fixture that sticks out of the grid.
    pub fn scene(&self) -> Result<Scene, SceneError> {
        Ok(self.scene_alone()?.0)
    }

    /// As [`SceneSpec::scene`], with part and fixtures apart.
    ///
    /// # Errors
    /// As [`SceneSpec::scene`].
    pub fn scene_alone(&self) -> Result<(Scene, Bodies), SceneError> {
        let grid = self.grid()?;
        self.check_tool(self.tool, &grid)?;
        let bodies = self.bodies_within(&grid)?;
        Ok((self.scene_of(grid, &bodies), bodies))
    }

    /// As [`SceneSpec::bodies`], of a grid that holds all of the fixtures.
    ///
    /// # Errors
    /// As [`SceneSpec::bodies`]; a fixture that sticks out of the grid.
    pub fn bodies_within(&self, grid: &Grid) -> Result<Bodies, SceneError> {
        match self.fixture_outside(grid)? {
            Some(fixture) => Err(SceneError::FixtureOutside(fixture.to_owned())),
            None => self.bodies(grid),
        }
    }

    /// As [`SceneSpec::scene`], but fixtures may stick out of the scene's grid: also gives part and fixtures on a
    /// grid that holds all that a tool can meet which reaches `reach` (in the part's unit) from the scene's voxels.
    /// The scene's own obstacle is as much of them as lies on its grid.
    ///
    /// # Errors
    /// As [`SceneSpec::scene`], but for fixtures that stick out.
    pub fn scene_and_bodies(&self, reach: f64) -> Result<(Scene, Bodies), SceneError> {
        let grid = self.grid()?;
        self.check_tool(self.tool, &grid)?;
        let bodies = self.bodies(&self.wide_grid(&grid, reach)?)?;
        Ok((self.scene_of(grid, &bodies), bodies))
    }

    /// The grid of the bodies that [`SceneSpec::scene_and_bodies`] gives around its scene's `grid`: that one where it holds all
    /// fixtures, so that such a scene is the same here as in [`SceneSpec::scene`].
    ///
    /// # Errors
    /// As [`SceneSpec::obstacle_grid`].
    pub fn wide_grid(&self, grid: &Grid, reach: f64) -> Result<Grid, SceneError> {
        if self.fixture_outside(grid)?.is_none() { Ok(*grid) } else { self.obstacle_grid(grid, reach) }
    }

    /// The first fixture that sticks out of a grid.
    fn fixture_outside(&self, grid: &Grid) -> Result<Option<&'a str>, SceneError> {
        let slack = DVec3::splat(1e-6 * grid.pitch);
        let (lower, upper) = (grid.origin - slack, grid.origin + grid.size() + slack);
        let mut boxes = self.fixture_boxes()?.into_iter();
        let out = boxes.find(|&(_, low, high)| low.cmplt(lower).any() || high.cmpgt(upper).any());
        Ok(out.map(|(name, ..)| name))
    }

    fn scene_of(&self, grid: Grid, bodies: &Bodies) -> Scene {
        let obstacle = bodies.obstacle().on(&grid).unwrap_or_else(|| Occupancy::empty(grid));
        let record = SceneRecord {
            part: self.part.to_owned(),
            unit: self.unit,
            transform: self.transform,
            grid,
            margin: self.margin,
            conservative: self.conservative,
            closed: MeshReport::new(self.mesh).closed,
            tool: self.tool.in_unit(self.unit),
            clearance: Clearance::default(),
            bare_tool: None,
            fixtures: self.fixtures.iter().map(|fixture| fixture.name.to_owned()).collect(),
            contact: None,
            obstacle_crc32: crc32(&obstacle.packed()),
        };
        Scene { record, obstacle, layer: None }
    }

    /// The grid of all that a tool can meet which reaches `reach` (in the part's unit) from the voxels of `query`: it
    /// lies on the same voxels, and holds the part, and of the fixtures what is near enough.
    ///
    /// # Errors
    /// A mesh without triangles, or more voxels than can be indexed.
    pub fn obstacle_grid(&self, query: &Grid, reach: f64) -> Result<Grid, SceneError> {
        let (mut lower, mut upper) = self.part_bounds()?;
        let far = reach + 2.0 * query.pitch;
        let (nearest, farthest) = (query.origin - far, query.origin + query.size() + far);
        for (_, low, high) in self.fixture_boxes()? {
            lower = lower.min(low.max(nearest));
            upper = upper.max(high.min(farthest));
        }
        // One voxel more: with `conservative` a surface on a voxel's face makes both sides solid.
        Ok(query.covering(lower, upper, 1)?)
    }

    /// Names of the fixtures whose box does not meet a grid, such as [`SceneSpec::wide_grid`]: nothing there can touch them.
    ///
    /// # Errors
    /// A fixture without triangles.
    pub fn fixtures_out_of(&self, grid: &Grid) -> Result<Vec<&'a str>, SceneError> {
        let (lower, upper) = (grid.origin, grid.origin + grid.size());
        let mut boxes = self.fixture_boxes()?;
        boxes.retain(|(_, low, high)| low.cmpgt(upper).any() || high.cmplt(lower).any());
        Ok(boxes.into_iter().map(|(name, ..)| name).collect())
    }

    /// Voxelises part and fixtures, apart, on a grid.
    ///
    /// # Errors
    /// A mesh without triangles, or that does not say what is inside; a part of which no voxel is left; a fixture that no voxel
    /// centre is in; [`SceneError::Cancelled`].
    pub fn bodies(&self, grid: &Grid) -> Result<Bodies, SceneError> {
        self.part_bounds()?;
        self.fixture_boxes()?;
        let body = |name: &str, mesh: &Mesh, transform: &DMat4| {
            let mesh = mesh.transformed(transform);
            let VoxelizeResult { solid, undecided } =
                solid_voxels(name, &mesh, grid, self.conservative, self.control)?;
            Ok::<_, SceneError>((mesh, solid, undecided))
        };
        let (_, part, undecided) = body(self.part, self.mesh, &self.transform)?;
        if part.count() == 0 {
            return Err(SceneError::NoSolid { part: self.part.to_owned(), pitch: grid.pitch });
        }
        let mut fixtures: Vec<(String, Occupancy)> = Vec::new();
        let mut fixtures_undecided = Vec::new();
        for fixture in self.fixtures {
            let (mesh, solid, undecided) = body(fixture.name, fixture.mesh, &fixture.transform)?;
            // Its surface passes through the grid, and yet it holds none of the centres: it is too thin for them. One that only touches
            // the grid from without is not in it.
            let (lower, upper) = (grid.origin, grid.origin + grid.size());
            let slack = DVec3::splat(1e-6 * grid.pitch);
            let within = |(low, high): (DVec3, DVec3)| {
                low.cmplt(upper - slack).all() && high.cmpgt(lower + slack).all()
            };
            if solid.count() == 0
                && mesh.bounds().is_some_and(within)
                && voxelize_with(&mesh, grid, true, self.control)?.solid.count() > 0
            {
                return Err(SceneError::ThinFixture { fixture: fixture.name.to_owned(), pitch: grid.pitch });
            }
            let before = fixtures.len();
            let same = self.fixtures[..before].iter().filter(|other| other.name == fixture.name).count();
            let number = if same > 0 { format!(" ({})", same + 1) } else { String::new() };
            fixtures.push((format!("{}{number}", fixture.name), solid.cropped()));
            fixtures_undecided.push(undecided);
        }
        Ok(Bodies { part, fixtures, undecided, fixtures_undecided })
    }

    /// Part and fixtures where they are placed, in the order of [`Bodies`].
    #[must_use]
    pub fn placed(&self) -> Vec<Mesh> {
        let part = self.mesh.transformed(&self.transform);
        let fixtures = self.fixtures.iter().map(|fixture| fixture.mesh.transformed(&fixture.transform));
        std::iter::once(part).chain(fixtures).collect()
    }

    /// Voxels of a grid that the fixtures take at most, each on a box of its own.
    ///
    /// # Errors
    /// A fixture without triangles.
    pub fn fixture_voxels(&self, grid: &Grid) -> Result<u64, SceneError> {
        let (lower, upper) = (grid.origin, grid.origin + grid.size());
        let voxels = |(_, low, high): (&str, DVec3, DVec3)| {
            let box_within = (high.min(upper) - low.max(lower)).max(DVec3::ZERO) / grid.pitch;
            (box_within + 2.0).element_product().min(grid.len() as f64) as u64
        };
        Ok(self.fixture_boxes()?.into_iter().map(voxels).sum())
    }

    /// The part's box in the world.
    ///
    /// # Errors
    /// A mesh without triangles, or a transform that does not turn, move, and scale evenly.
    pub fn part_bounds(&self) -> Result<(DVec3, DVec3), SceneError> {
        check_transform(self.part, &self.transform)?;
        let bounds = self.mesh.transformed(&self.transform).bounds();
        bounds.ok_or_else(|| SceneError::NoTriangles(self.part.to_owned()))
    }

    /// Name and box in the world of every fixture.
    pub(super) fn fixture_boxes(&self) -> Result<Vec<(&'a str, DVec3, DVec3)>, SceneError> {
        let boxes = self.fixtures.iter().map(|fixture| {
            check_transform(fixture.name, &fixture.transform)?;
            let bounds = fixture.mesh.transformed(&fixture.transform).bounds();
            let (low, high) =
                bounds.ok_or_else(|| SceneError::NoFixtureTriangles(fixture.name.to_owned()))?;
            Ok((fixture.name, low, high))
        });
        boxes.collect()
    }
}

/// Refuses matrices that do more than turn, move, and scale evenly.
fn check_transform(name: &str, transform: &DMat4) -> Result<(), SceneError> {
    TransformFault::check(transform).map_err(|fault| SceneError::Transform { name: name.to_owned(), fault })
}
