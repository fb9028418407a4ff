//! What a tool reaches of a part's surface, piece by piece, so that progress can be shown between the pieces.

use imf_core::control::Control;
use imf_core::orientation::Orientation;
use imf_core::surface::{
    CollisionEnvironment, ObstructedAreas, SampleReach, SurfaceSamples, SurfaceTool, Verdict,
    default_tolerance, surface_access,
};
use wasm_bindgen::JsError;
use wasm_bindgen::prelude::wasm_bindgen;

use crate::part::corners;
use crate::scene::PartScene;

/// Triangles that a surface is cut into, at most.
const MOST_SAMPLES: usize = 2_000_000;

/// The surface of a part, cut into triangles of about the same size, and the verdict on each.
#[wasm_bindgen]
pub struct SurfaceAccess {
    samples: SurfaceSamples,
    tool: SurfaceTool,
    directions: Vec<Orientation>,
    reach: Vec<SampleReach>,
}

#[wasm_bindgen]
impl SurfaceAccess {
    /// Cuts the surface into at least about `samples` triangles; nothing is decided yet. `directions` is the text of a set, such as
    /// `axes+normals+fibonacci:64`.
    ///
    /// # Errors
    /// A text that names no set; a tool without a cutter; more than two million samples.
    #[wasm_bindgen(constructor)]
    pub fn new(scene: &PartScene, directions: &str, samples: usize) -> Result<SurfaceAccess, JsError> {
        if samples > MOST_SAMPLES {
            let error = format!("{samples} triangles are too many: {MOST_SAMPLES} at most");
            return Err(JsError::new(&error));
        }
        let directions = scene.set(directions)?.orientations;
        let record = &scene.scene.record;
        let solid = scene.solid_voxels();
        let samples = SurfaceSamples::new(&scene.mesh, &solid, samples);
        let environment = CollisionEnvironment::new(&solid.into(), &[]).with_surfaces(&[&scene.mesh]);
        let tolerance = default_tolerance(record.grid.pitch, record.unit);
        let tool = SurfaceTool::new(&environment, &record.assembly()?, tolerance)?;
        Ok(Self { samples, tool, directions, reach: Vec::new() })
    }

    /// Decides the next `count` triangles; gives back how many are left.
    ///
    /// # Errors
    /// None that can be expected: the work is never cancelled from inside.
    pub fn advance(&mut self, count: usize) -> Result<usize, JsError> {
        let all = &self.samples.samples;
        let start = self.reach.len();
        let piece = &all[start..all.len().min(start + count)];
        let found = surface_access(&self.tool, piece, &self.directions, Control::quiet())?;
        self.reach.extend(found.reach);
        Ok(all.len() - self.reach.len())
    }

    /// Number of triangles.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn triangles(&self) -> usize {
        self.samples.samples.len()
    }

    /// Three corners of each triangle.
    #[must_use]
    pub fn corners(&self) -> Vec<f32> {
        corners(&self.samples.mesh)
    }

    /// By triangle: 0 reached, 1 something is in the way, 2 the cutter does not fit, 3 no direction faces it.
    #[must_use]
    pub fn verdicts(&self) -> Vec<u8> {
        self.reach.iter().map(|reach| reach.verdict() as u8).collect()
    }

    /// Areas by verdict, in the order of [`SurfaceAccess::verdicts`].
    #[must_use]
    pub fn areas(&self) -> Vec<f64> {
        let mut areas = vec![0.0; Verdict::NotFaced as usize + 1];
        for (reach, sample) in self.reach.iter().zip(&self.samples.samples) {
            areas[reach.verdict() as usize] += sample.area;
        }
        areas
    }

    /// Elements of the tool with the area that they obstruct, the name, a tabulator and the area in one text, the largest first. Several may obstruct one
    /// place.
    #[must_use]
    pub fn obstructed_by(&self) -> Vec<String> {
        let reach = self.reach.iter().zip(&self.samples.samples);
        let found = ObstructedAreas::new(reach.map(|(reach, sample)| (&self.tool, *reach, sample.area)));
        let mut hits = found.hits;
        hits.sort_by(|one, other| other.2.total_cmp(&one.2));
        // There is no fixture here: all of them hit the part.
        hits.into_iter().map(|(kind, _, area)| format!("{kind}\t{area}")).collect()
    }
}
