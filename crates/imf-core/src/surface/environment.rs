//! The collision environment of a tool at a surface: the part and its fixtures.

use std::sync::Arc;

use glam::DMat4;

use crate::field::solid::SolidVoxels;
use crate::grid::Grid;
use crate::mesh::Mesh;
use crate::occupancy::Occupancy;
use crate::scene::{Bodies, SceneError, SceneSpec};
use crate::voxelize::voxelize_with;

/// One body, as two sets of voxels on one grid.
#[derive(Clone, Debug)]
pub struct SolidBody {
    /// By the rule of voxel centres: what a cutter must not cut into.
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

/// A part and its fixtures on one grid, prepared for any number of tools.
#[derive(Clone)]
pub struct CollisionEnvironment {
    pub(super) part: SolidVoxels,
    /// The fixtures together, for the cutter; `None` where there are none.
    pub(super) fixtures: Option<SolidVoxels>,
    /// Everything, for shank and holder.
    pub(super) keep_out: SolidVoxels,
    /// For cutter, and for shank and holder: the part, then each fixture.
    pub(super) bodies: Vec<[SolidVoxels; 2]>,
}

impl CollisionEnvironment {
    /// Of a part, and of fixtures on the part's grid.
    ///
    /// # Panics
    /// If the grids differ.
    #[must_use]
    pub fn new(part: &SolidBody, fixtures: &[SolidBody]) -> Self {
        let grid = &part.centres.grid;
        let all = || std::iter::once(part).chain(fixtures);
        assert!(
            all().all(|b| b.centres.grid == *grid && b.keep_out.grid == *grid),
            "bodies must lie on one grid"
        );
        let prepared = |body: &SolidBody| {
            let centres = SolidVoxels::from(body.centres.clone());
            let same = Arc::ptr_eq(&body.centres, &body.keep_out);
            [centres.clone(), if same { centres } else { body.keep_out.clone().into() }]
        };
        let bodies: Vec<[SolidVoxels; 2]> = all().map(prepared).collect();
        let union = |of: &dyn Fn(&SolidBody) -> Arc<Occupancy>, bodies: &[SolidBody]| {
            let mut union = Occupancy::empty(*grid);
            for body in bodies {
                union.solid.iter_mut().zip(&of(body).solid).for_each(|(all, one)| *all |= one);
            }
            union
        };
        let held = !fixtures.is_empty();
        Self {
            part: bodies[0][0].clone(),
            fixtures: held.then(|| Arc::new(union(&|b| b.centres.clone(), fixtures)).into()),
            keep_out: if held {
                let mut whole = union(&|b| b.keep_out.clone(), fixtures);
                whole.solid.iter_mut().zip(&part.keep_out.solid).for_each(|(all, one)| *all |= one);
                Arc::new(whole).into()
            } else {
                bodies[0][1].clone()
            },
            bodies,
        }
    }

    /// Part and fixtures of a scene as tools meet them, of `bodies` that were made of it; and all that is solid by the rule of voxel
    /// centres.
    ///
    /// # Errors
    /// [`SceneError::Cancelled`] when the scene's control asks to stop.
    #[doc(hidden)]
    pub fn of_bodies(spec: &SceneSpec<'_>, bodies: &Bodies) -> Result<(Self, Occupancy), SceneError> {
        let grid = &bodies.part.grid;
        let body = |voxels: &Occupancy, mesh: &Mesh, transform: &DMat4| -> Result<SolidBody, SceneError> {
            let mut keep_out = Occupancy::empty(*grid);
            keep_out.add(voxels);
            let keep_out = Arc::new(keep_out);
            let centres = match spec.conservative {
                true => {
                    Arc::new(voxelize_with(&mesh.transformed(transform), grid, false, spec.control)?.solid)
                }
                false => keep_out.clone(),
            };
            Ok(SolidBody { centres, keep_out })
        };
        let part = body(&bodies.part, spec.mesh, &spec.transform)?;
        let fixtures = spec.fixtures.iter().zip(&bodies.fixtures);
        let fixtures = fixtures.map(|(fixture, (_, voxels))| body(voxels, fixture.mesh, &fixture.transform));
        let fixtures: Vec<SolidBody> = fixtures.collect::<Result<_, _>>()?;
        let mut solid = Occupancy::clone(&part.centres);
        for fixture in &fixtures {
            solid.solid.iter_mut().zip(&fixture.centres.solid).for_each(|(all, one)| *all |= one);
        }
        Ok((Self::new(&part, &fixtures), solid))
    }

    /// Part and fixtures of a scene as tools meet them on the larger voxels of twice the pitch of `grid`: what is reached there tells how
    /// far an answer has converged.
    ///
    /// # Errors
    /// As [`SceneSpec::bodies`].
    #[doc(hidden)]
    pub fn at_twice_the_pitch(spec: &SceneSpec<'_>, grid: &Grid) -> Result<Self, SceneError> {
        let coarse = Grid { pitch: 2.0 * grid.pitch, dims: grid.dims.map(|n| n.div_ceil(2)), ..*grid };
        // Larger voxels that are touched reach farther.
        let coarse = if spec.conservative { coarse.padded([1; 3], [1; 3])? } else { coarse };
        // A part that is too thin for the larger voxels has none, which says that nothing has converged.
        match spec.bodies(&coarse) {
            Ok(bodies) => Ok(Self::of_bodies(spec, &bodies)?.0),
            Err(SceneError::NoSolid { .. } | SceneError::ThinFixture { .. }) => {
                Ok(Self::new(&Arc::new(Occupancy::empty(coarse)).into(), &[]))
            }
            Err(error) => Err(error),
        }
    }

    /// Edge of a voxel.
    #[must_use]
    pub fn pitch(&self) -> f64 {
        self.part.occupancy().grid.pitch
    }
}
