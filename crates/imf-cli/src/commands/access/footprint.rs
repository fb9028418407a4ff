//! The memory that a run takes, known before anything is computed, and what would take less.

use std::cmp::Reverse;

use anyhow::Result;
use imf_core::access::{memory_estimate, removable_memory_estimate};
use imf_core::grid::Grid;
use imf_core::mesh::points_memory_estimate;
use imf_core::scene::SceneSpec;
use imf_core::section::{ElementPlans, SectionPlan};
use imf_core::tool::Assembly;

use super::surface::SurfaceSettings;
use crate::arguments::inputs::mesh_memory_estimate;

/// Bytes, and what takes fewer of them.
pub(super) struct Footprint {
    terms: [(u64, &'static str); 4],
    /// Of the meshes themselves.
    meshes: u64,
}

impl Footprint {
    /// For sections, surface and results; the grids are those of the obstacle, of the query and of the stock.
    pub(super) fn new(
        (obstacle, query, stock): (&Grid, &Grid, Option<&Grid>),
        tools: &[Assembly],
        directions: usize,
        spec: &SceneSpec<'_>,
        threads: usize,
    ) -> Result<Self> {
        let sections = |threads: usize| -> Result<u64> {
            let mut most = 0;
            for assembly in tools {
                let (tool, bare) = (assembly.whole(), assembly.tool());
                let plan = SectionPlan::memory_estimate_with_query(obstacle, query, tool, threads)
                    + ElementPlans::memory_estimate(obstacle, query, tool, threads);
                let streaming = memory_estimate(query.dims, threads);
                let sweep = match stock {
                    Some(stock) => removable_memory_estimate(obstacle, stock, tool, bare, threads)?,
                    None => 0,
                };
                most = most.max((plan + streaming).max(sweep));
            }
            Ok(most)
        };
        // Obstacle, part and fixtures; results of each tool and of all; labels.
        let stock = stock.map_or(0, |stock| stock.len() as u64 * (3 + tools.len() as u64));
        // And up to half a dozen elements of each tool.
        let results = query.len() as u64 * (40 + 32 * tools.len() as u64);
        let bodies = spec.fixture_voxels(obstacle)? + 4 * obstacle.len() as u64;
        // The surface: voxels, counts, distances and nearest voxels of every body, twice of the part where shank and holder have their
        // own, of all fixtures and of everything; and what distances are made from.
        let fixtures = spec.fixtures.len() as u64;
        let each = if spec.conservative { 2 } else { 1 };
        let sets = each + fixtures + if fixtures > 0 { 2 } else { 0 };
        let voxels = (13 * sets + 10) * obstacle.len() as u64;
        // Their points, at twice the pitch too, and as a holder that slides sees them from some directions.
        let placed = spec.placed();
        let points = |times: f64| -> u64 {
            placed.iter().map(|mesh| points_memory_estimate(mesh, times * obstacle.pitch)).sum()
        };
        let samples = |directions| SurfaceSettings::memory_estimate(spec.mesh, directions, tools.len());
        let surface = voxels + 4 * points(1.0) + points(2.0) + samples(directions);
        // What is left of a surface's points at any pitch are the mesh's own vertices.
        let of_mesh = 5 * points(f64::INFINITY) + samples(1);
        let by_directions = samples(directions).saturating_sub(samples(1));
        let (most, alone) = (sections(threads)?, sections(1)?);
        let rest = bodies + results + stock;
        let by_threads = most.saturating_sub(alone);
        let terms = match most > surface {
            true => [rest + most - by_threads, by_threads, 0, 0],
            false => [rest + surface - by_directions - of_mesh, 0, by_directions, of_mesh],
        };
        let remedies = ["a larger --pitch", "fewer --threads", "fewer --orientations", "a coarser mesh"];
        let terms = [0, 1, 2, 3].map(|term| (terms[term], remedies[term]));
        Ok(Self { terms, meshes: mesh_memory_estimate(spec) })
    }

    /// With everything but the meshes held so many times.
    pub(super) fn bytes(&self, times: u64) -> u64 {
        times * self.terms.iter().map(|(bytes, _)| bytes).sum::<u64>() + self.meshes
    }

    /// First what saves most.
    pub(super) fn remedies(&self) -> String {
        let mut terms = self.terms;
        terms[3].0 += self.meshes;
        terms.sort_by_key(|(bytes, _)| Reverse(*bytes));
        let named = terms.iter().filter(|(bytes, _)| *bytes > 0).map(|(_, remedy)| *remedy);
        named.collect::<Vec<_>>().join(" or ")
    }
}
