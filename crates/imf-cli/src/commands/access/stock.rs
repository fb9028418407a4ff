//! What is cut: stock that neither part nor fixtures hold, and the warning where it does not hold the part.

use anyhow::{Context as _, Result, ensure};
use imf_core::grid::Grid;
use imf_core::mesh::Mesh;
use imf_core::occupancy::Occupancy;
use imf_core::scene::Bodies;
use imf_core::unit::LengthUnit;

use crate::arguments::fixture::{self, BESIDE};
use crate::session::Session;

/// Fraction of the part outside the stock above which a warning is given: a face on the stock's own may lose some
/// voxels to rounding.
const OUTSIDE: f64 = 0.01;

pub(super) struct Stock {
    pub(super) name: String,
    /// Stock that neither part nor fixtures hold, on a grid of its own.
    pub(super) solid: Occupancy,
}

impl Stock {
    /// On a grid of the same voxels as those of the bodies, which are by the rule of voxel centres; `part` is the part's mesh in the world.
    pub(super) fn new(
        session: &Session,
        stock: fixture::Stock,
        grid: &Grid,
        bodies: &Bodies,
        (part, unit): (&Mesh, LengthUnit),
    ) -> Result<Self> {
        let mut solid = stock.voxels(session, grid, session.control(&|_| {}))?;
        let on_grid = |voxels: &Occupancy| voxels.on(grid).context("the grids of part and stock do not meet");
        let own = on_grid(&bodies.part)?;
        let within = own.solid.iter().zip(&solid.solid).filter(|(part, stock)| **part & **stock == 1).count();
        let outside = 1.0 - within as f64 / bodies.part.count().max(1) as f64;
        if outside > OUTSIDE && fixture::Stock::is_beside(&solid, &bodies.part) {
            session.warn(&format!("the stock '{}' {BESIDE}", stock.name));
        } else if outside > OUTSIDE {
            session.warn(&format!(
                "{:.1} % of the part lies outside the stock '{}': check where it stands, and its unit",
                100.0 * outside,
                stock.name
            ));
        }
        let held = on_grid(&bodies.obstacle())?;
        solid.solid.iter_mut().zip(&held.solid).for_each(|(stock, &held)| *stock &= 1 - held);
        ensure!(solid.count() > 0, "the stock '{}' holds nothing beside the part", stock.name);
        if outside == 0.0 && bodies.fixtures.is_empty() {
            stock.compare_volumes(session, [solid.volume(), grid.voxel_volume()], part, unit);
        }
        Ok(Self { name: stock.name, solid })
    }
}
