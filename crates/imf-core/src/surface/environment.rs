//! The collision environment of a tool at a surface: the part and its fixtures.

use std::sync::Arc;

use crate::field::solid::SolidVoxels;
use crate::occupancy::Occupancy;

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
}
