//! The collision environment of a tool at a surface: the part and its fixtures.

use std::sync::Arc;

use crate::access::cavities;
use crate::field::solid::{SolidField, SolidVoxels};
use crate::grid::Grid;
use crate::mesh::Mesh;
use crate::occupancy::Occupancy;
use crate::scene::{Bodies, Resolution, SceneError, SceneSpec};
use crate::tool::{Clearance, Element, ElementKind, Tool, ToolShape};
use crate::voxelize::voxelize_with;

/// A part, as two sets of voxels on one grid.
#[derive(Clone, Debug)]
pub struct SolidBody {
    /// By the rule of voxel centres: what a cutter touches and must not cut into.
    pub centres: Arc<Occupancy>,
    /// What shank and holder must stay out of, which may be larger.
    pub keep_out: Arc<Occupancy>,
}

/// The same voxels for cutter, shank and holder.
impl From<Arc<Occupancy>> for SolidBody {
    fn from(centres: Arc<Occupancy>) -> Self {
        Self { keep_out: centres.clone(), centres }
    }
}

/// An element of shank or holder as it is held against voxels and points of surfaces, and how deep points may lie in that. A shank may
/// be as wide as its cutter, and touches what that does as deep as `contact`, unless it has a clearance.
pub(super) fn as_met(element: &Element, clearance: &Clearance, contact: f64, pitch: f64) -> (Element, f64) {
    match element.kind {
        ElementKind::Shank if clearance.shank == 0.0 => element.touching(contact, pitch),
        ElementKind::Shank => (element.clone(), contact),
        _ => (element.clone(), 0.0),
    }
}

/// A part and its fixtures on one grid, prepared for any number of tools.
#[derive(Clone)]
pub struct CollisionEnvironment {
    /// By the rule of voxel centres, for the cutter.
    pub(super) part: SolidVoxels,
    /// The fixtures together; `None` where there are none.
    pub(super) fixtures: Option<SolidVoxels>,
    /// Everything, for shank and holder.
    pub(super) keep_out: SolidVoxels,
    /// The same body by body: the part, then each fixture.
    pub(super) bodies: Vec<SolidVoxels>,
    points_apart: f64,
    closed_off: usize,
}

impl CollisionEnvironment {
    /// Of a part, and of what tools must stay out of in fixtures, on the part's grid. A cavity that they close off on all sides counts as
    /// solid: no tool gets in.
    ///
    /// # Panics
    /// If the grids differ.
    #[must_use]
    pub fn new(part: &SolidBody, fixtures: &[Arc<Occupancy>]) -> Self {
        let grid = &part.centres.grid;
        let all = || std::iter::once(&part.keep_out).chain(fixtures);
        assert!(all().all(|body| body.grid == *grid), "bodies must lie on one grid");
        let same = Arc::ptr_eq(&part.centres, &part.keep_out);
        let mut closing = Occupancy::clone(&part.centres);
        // Larger voxels may close a mouth that a tool passes.
        fixtures.iter().filter(|_| same).for_each(|body| closing.add(body));
        let closed_off = cavities(&closing);
        let filled = |body: &Arc<Occupancy>| match &closed_off {
            Some(closed_off) => {
                let mut body = Occupancy::clone(body);
                body.add(closed_off);
                Arc::new(body)
            }
            None => body.clone(),
        };
        let centres = filled(&part.centres);
        let part =
            &SolidBody { keep_out: if same { centres.clone() } else { filled(&part.keep_out) }, centres };
        let all = || std::iter::once(&part.keep_out).chain(fixtures);
        let centres = SolidVoxels::from(part.centres.clone());
        let whole = if same { centres.clone() } else { part.keep_out.clone().into() };
        let bodies: Vec<SolidVoxels> =
            std::iter::once(whole).chain(fixtures.iter().map(|body| body.clone().into())).collect();
        let union = |bodies: &mut dyn Iterator<Item = &Arc<Occupancy>>| {
            let mut union = Occupancy::empty(*grid);
            bodies.for_each(|body| union.add(body));
            SolidVoxels::from(Arc::new(union))
        };
        let held = !fixtures.is_empty();
        let keep_out = if held { union(&mut all()) } else { bodies[0].clone() };
        Self {
            part: centres,
            fixtures: held.then(|| union(&mut fixtures.iter())),
            keep_out,
            bodies,
            points_apart: f64::INFINITY,
            closed_off: closed_off.map_or(0, |closed_off| closed_off.count()),
        }
    }

    /// Voxels of cavities that part and fixtures close off on all sides.
    #[must_use]
    pub fn closed_off(&self) -> usize {
        self.closed_off
    }

    /// The same with points of the surfaces, which a tool must not hold either: between the centres of voxels it would reach up to a voxel
    /// deep. The meshes are the part's and then those of the fixtures, in the grid's coordinates.
    ///
    /// # Panics
    /// If there are not as many meshes as bodies.
    #[must_use]
    pub fn with_surfaces(self, meshes: &[&Mesh]) -> Self {
        assert_eq!(meshes.len(), self.bodies.len(), "one mesh for each body");
        let of = |(body, mesh): (SolidVoxels, &&Mesh)| body.with_surface_of(mesh);
        let (bodies, apart): (Vec<SolidVoxels>, Vec<f64>) =
            self.bodies.into_iter().zip(meshes).map(of).unzip();
        let all: Vec<_> = bodies.iter().flat_map(|body| body.surfaces().iter().cloned()).collect();
        Self {
            part: self.part.with_surfaces(&all[..1]),
            fixtures: self.fixtures.map(|fixtures| fixtures.with_surfaces(&all[1..])),
            keep_out: self.keep_out.with_surfaces(&all),
            points_apart: apart.into_iter().fold(0.0, f64::max),
            bodies,
            ..self
        }
    }

    /// How far points of the surfaces are apart at the most, in the grid's unit; infinite where there are none.
    #[must_use]
    pub fn points_apart(&self) -> f64 {
        self.points_apart
    }

    /// Part and fixtures of a scene as tools meet them, of `bodies` that were made of it.
    ///
    /// # Errors
    /// [`SceneError::Cancelled`] when the scene's control asks to stop.
    #[doc(hidden)]
    pub fn of_bodies(spec: &SceneSpec<'_>, bodies: &Bodies) -> Result<Self, SceneError> {
        let grid = &bodies.part.grid;
        let on_grid =
            |voxels: &Occupancy| Arc::new(voxels.on(grid).unwrap_or_else(|| Occupancy::empty(*grid)));
        let keep_out = on_grid(&bodies.part);
        let centres = if spec.conservative {
            let mesh = spec.mesh.transformed(&spec.transform);
            Arc::new(voxelize_with(&mesh, grid, false, spec.control)?.solid)
        } else {
            keep_out.clone()
        };
        let fixtures: Vec<_> = bodies.fixtures.iter().map(|(_, voxels)| on_grid(voxels)).collect();
        let placed = spec.placed();
        let meshes: Vec<&Mesh> = placed.iter().collect();
        Ok(Self::new(&SolidBody { centres, keep_out }, &fixtures).with_surfaces(&meshes))
    }

    /// Shank and holder among everything: a shank may be as wide as its cutter, and touches what that does.
    pub(super) fn rest_field(&self, tool: &Tool, clearance: &Clearance, contact: f64) -> SolidField {
        let whole = || SolidField::of_tool(self.keep_out.clone(), tool);
        let ToolShape::Revolved(elements) = &tool.shape else { return whole() };
        let met = elements.iter().map(|element| as_met(element, clearance, contact, self.pitch()));
        let (elements, deep): (Vec<Element>, Vec<f64>) = met.unzip();
        let field = SolidField::of_elements(self.keep_out.clone(), &elements);
        field.map_or_else(whole, |field| field.touching(elements.into_iter().zip(deep)))
    }

    /// The part by the rule of voxel centres.
    #[must_use]
    pub fn part(&self) -> &Occupancy {
        self.part.occupancy()
    }

    /// Part and fixtures of a scene as tools meet them on the larger voxels of twice the pitch of `grid`: what is
    /// reached there shows how far a result has converged.
    ///
    /// # Errors
    /// As [`SceneSpec::bodies`].
    #[doc(hidden)]
    pub fn at_twice_the_pitch(spec: &SceneSpec<'_>, grid: &Grid) -> Result<Self, SceneError> {
        // The scene's own grid at that pitch: faces lie among its voxels as they would there, on which conservative voxels depend.
        let own = SceneSpec { resolution: Resolution::Pitch(2.0 * grid.pitch), ..spec.clone() }.grid()?;
        // Larger voxels that are touched reach farther.
        let coarse = own.covering(grid.origin, grid.origin + grid.size(), i64::from(spec.conservative))?;
        // A part that is too thin for the larger voxels has none, which says that nothing has converged.
        match spec.bodies(&coarse) {
            Ok(bodies) => Self::of_bodies(spec, &bodies),
            Err(SceneError::NoSolid { .. } | SceneError::ThinFixture { .. }) => {
                Ok(Self::new(&Arc::new(Occupancy::empty(coarse)).into(), &[]))
            }
            Err(error) => Err(error),
        }
    }

    /// Edge of a voxel.
    #[must_use]
    pub fn pitch(&self) -> f64 {
        self.part().grid.pitch
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::mesh::Mesh;
    use crate::parts::ReferencePart;
    use crate::tool::Tool;

    #[test]
    fn a_cavity_that_part_and_fixtures_close_off_is_solid_for_the_whole_tool() {
        let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [10; 3] };
        let mouth = |[x, y, z]: [usize; 3]| x == 5 && y == 5 && z >= 7;
        let hollow = |voxel: [usize; 3]| voxel.iter().all(|v| (4..7).contains(v));
        let made = |is_solid: &dyn Fn([usize; 3]) -> bool| Arc::new(Occupancy::of(grid, is_solid));
        let closed = made(&|v| !hollow(v));
        let open = made(&|v| !hollow(v) && !mouth(v));
        let of = |part: &SolidBody, fixtures: &[Arc<Occupancy>]| {
            let found = CollisionEnvironment::new(part, fixtures);
            [found.closed_off(), found.part().count(), found.keep_out.occupancy().count()]
        };
        assert_eq!(of(&closed.clone().into(), &[]), [27, 1000, 1000]);
        assert_eq!(of(&open.clone().into(), &[]), [0, 970, 970]);
        // A fixture in the mouth, and larger voxels alone, which may close it though a tool passes.
        let plug = made(&|v| mouth(v) && v[2] == 9);
        assert_eq!(of(&open.clone().into(), &[plug]), [29, 999, 1000]);
        assert_eq!(of(&SolidBody { centres: open, keep_out: closed }, &[]), [0, 970, 973]);
    }

    #[test]
    fn at_twice_the_pitch_the_voxels_are_those_of_a_scene_of_that_pitch() {
        // Faces on those of voxels, where conservative voxels on both sides are solid.
        let (cube, tool) = (Mesh::cuboid(DVec3::ZERO, DVec3::splat(12.0)), Tool::paper());
        for conservative in [false, true] {
            let of = |pitch: f64| SceneSpec {
                resolution: Resolution::Pitch(pitch),
                conservative,
                ..SceneSpec::of_reference(ReferencePart::Bracket, &cube, [1; 3], &tool)
            };
            let fine = of(1.0);
            for reach in 0..4 {
                let around = fine.grid().unwrap().padded([reach; 3], [reach; 3]).unwrap();
                let found = CollisionEnvironment::at_twice_the_pitch(&fine, &around).unwrap();
                let coarse = of(2.0);
                let whole = coarse.grid().unwrap().padded([8; 3], [8; 3]).unwrap();
                let own = CollisionEnvironment::of_bodies(&coarse, &coarse.bodies(&whole).unwrap()).unwrap();
                let on = |voxels: &SolidVoxels| voxels.occupancy().on(&whole).unwrap();
                assert_eq!(on(&found.keep_out), on(&own.keep_out), "{conservative}, {reach}");
                assert_eq!(on(&found.part), on(&own.part), "{conservative}, {reach}");
            }
        }
    }
}
