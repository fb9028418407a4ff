//! A part and a tool: sections, and the exact checker.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use imf_core::check::{CheckBodies, CheckError, CheckSettings, PoseChecker};
use imf_core::grid::Grid;
use imf_core::mesh::Mesh;
use imf_core::occupancy::Occupancy;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::pose::Pose;
use imf_core::scene::{BuiltScene, Scene};
use imf_core::section::{SectionPlan, SectionScratch, ToolPoints};
use imf_core::tool::Tool;
use wasm_bindgen::JsError;
use wasm_bindgen::prelude::wasm_bindgen;

use crate::part::{Part, corners};

/// What a module can take: addresses of 32 bits reach 4 GiB, and memory is in pieces.
const MOST_BYTES: f64 = 3e9;
/// A voxel's share of memory beside the sections' own: solid voxels, distances, copies.
const BYTES_PER_VOXEL: u64 = 24;
/// Sides of a tool of revolution in the picture.
const SIDES: usize = 48;

/// A part, voxelised, and a tool around it.
#[wasm_bindgen]
pub struct PartScene {
    pub(crate) scene: Scene,
    pub(crate) mesh: Mesh,
    warnings: Vec<String>,
    /// Of a cutter that is too thin for it why there is none.
    checker: Result<PoseChecker, CheckError>,
    plan: SectionPlan,
    scratch: SectionScratch,
}

/// What a colliding tool hits.
#[wasm_bindgen]
pub struct Contact {
    element: String,
    /// How deep it is in the part, as `imf check` says it: to half a voxel or so.
    pub depth: f64,
    /// The place that is so deep: a voxel's centre, or a point of the part's surface.
    pub x: f64,
    /// Along y.
    pub y: f64,
    /// Along z.
    pub z: f64,
}

#[wasm_bindgen]
impl Contact {
    /// `cutter`, `shank` or `holder 1`.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn element(&self) -> String {
        self.element.clone()
    }
}

#[wasm_bindgen]
impl PartScene {
    /// Voxelises a part. `tool` is the text of a tool file (TOML). Without a pitch one is chosen, and a built-in part has its own.
    ///
    /// # Errors
    /// A tool file that is wrong, voxels that do not fit the memory; as `SceneBuilder::build` of `imf-core`.
    #[wasm_bindgen(constructor)]
    pub fn new(part: &Part, tool: &str, pitch: Option<f64>) -> Result<PartScene, JsError> {
        let tool = Tool::parse(tool, Path::new("tool"))?;
        if let Some(pitch) = pitch {
            require_memory(&part.mesh, &tool.in_unit(part.unit), pitch)?;
        }
        let builder = match part.reference {
            Some(reference) => Scene::builder().reference(reference),
            None => Scene::builder().part(&part.name, part.mesh.clone(), part.unit),
        };
        let builder = builder.tool(&tool);
        let BuiltScene { scene, mesh, bodies, warnings, .. } = match pitch {
            Some(pitch) => builder.pitch(pitch).build()?,
            None => builder.build()?,
        };
        let surfaces = [&mesh];
        let bodies = CheckBodies { surfaces: &surfaces, ..CheckBodies::of_part(&bodies.part) };
        let settings = CheckSettings::of_scene(&scene.record, None, None);
        Ok(Self {
            checker: PoseChecker::new(bodies, scene.record.bare_tool(), &settings),
            plan: SectionPlan::of_scene(&scene, ToolPoints::SharpPoints)?,
            scratch: SectionScratch::default(),
            warnings: warnings.iter().map(ToString::to_string).collect(),
            mesh,
            scene,
        })
    }

    /// What is not as expected; the scene can be used all the same.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        self.warnings.clone()
    }

    /// The unit of all lengths.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn unit(&self) -> String {
        self.scene.record.unit.to_string()
    }

    /// Edge of a voxel.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn pitch(&self) -> f64 {
        self.scene.record.grid.pitch
    }

    /// Voxels along x, y and z.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn dims(&self) -> Vec<u32> {
        self.scene.record.grid.dims.map(|count| count as u32).to_vec()
    }

    /// Lower corner of voxel (0, 0, 0).
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn origin(&self) -> Vec<f64> {
        self.scene.record.grid.origin.to_array().to_vec()
    }

    /// What the tool, its tip at a point and its axis along (i, j, k), hits, the deepest of it; nothing where it is free. As by `imf check`:
    /// it may touch the part, and be 0.05 mm deep in it.
    ///
    /// # Errors
    /// Numbers that are not finite, or an axis of no length; a cutter that is too thin for the voxels.
    pub fn contact(
        &self,
        x: f64,
        y: f64,
        z: f64,
        i: f64,
        j: f64,
        k: f64,
    ) -> Result<Option<Contact>, JsError> {
        let pose = Pose::along(DVec3::new(x, y, z), DVec3::new(i, j, k));
        let checker = self.checker.as_ref().map_err(|error| JsError::new(&error.to_string()))?;
        let deepest =
            checker.collisions(&pose)?.into_iter().max_by(|one, other| one.depth.total_cmp(&other.depth));
        Ok(deepest.map(|hit| {
            let [x, y, z] = hit.contact;
            Contact { element: hit.element, depth: hit.depth, x, y, z }
        }))
    }

    /// The tool's surface with its tip at the origin and its axis along z: three corners of each triangle.
    #[must_use]
    pub fn tool_corners(&self) -> Vec<f32> {
        corners(&self.scene.record.bare_tool().surface(SIDES))
    }

    /// The collision measure at every voxel for the direction (θ, φ) in degrees, in [0, 1]: `[x, y, z]` with z side by side.
    ///
    /// # Errors
    /// Angles that are not finite; a tool that does not fit the grid.
    pub fn section(&mut self, theta: f64, phi: f64) -> Result<Vec<f32>, JsError> {
        let mut values = vec![0.0; self.plan.grid().len()];
        self.plan.cmf(&direction(theta, phi)?, &mut self.scratch, &mut values)?;
        Ok(values)
    }

    /// Shared voxels of part and tool, summed over all voxels of the grid, for each direction of a set: whole numbers, the same on
    /// every machine.
    ///
    /// # Errors
    /// A text that names no set; a tool that does not fit the grid.
    pub fn section_sums(&mut self, directions: &str) -> Result<Vec<f64>, JsError> {
        let set = self.set(directions)?;
        let mut sums = Vec::with_capacity(set.len());
        for orientation in &set.orientations {
            let (_, counts) = self.plan.counts_in(orientation, self.plan.grid(), &mut self.scratch)?;
            sums.push(counts.iter().map(|&count| u64::from(count)).sum::<u64>() as f64);
        }
        Ok(sums)
    }

    pub(crate) fn set(&self, text: &str) -> Result<OrientationSet, JsError> {
        let normals = || self.mesh.machining_directions().iter().map(|found| found.direction).collect();
        Ok(OrientationSet::parse_for(text, normals)?)
    }

    pub(crate) fn solid_voxels(&self) -> Arc<Occupancy> {
        Arc::new(self.scene.obstacle.clone())
    }
}

/// The direction (θ, φ) in degrees.
///
/// # Errors
/// Angles that are not finite.
pub(crate) fn direction(theta: f64, phi: f64) -> Result<Orientation, JsError> {
    if theta.is_finite() && phi.is_finite() {
        Ok(Orientation::new(theta, phi))
    } else {
        Err(JsError::new(&format!("the angles {theta}, {phi} are no direction: both must be finite")))
    }
}

/// Where memory runs out the module ends without a word: what is known to be too much is refused.
fn require_memory(mesh: &Mesh, tool: &Tool, pitch: f64) -> Result<(), JsError> {
    let Some((low, high)) = mesh.bounds() else { return Ok(()) };
    let grid = Grid::with_pitch(low, high, pitch, 2)?;
    let needed = SectionPlan::memory_estimate(&grid, tool, 1) + BYTES_PER_VOXEL * grid.len() as u64;
    if needed as f64 > MOST_BYTES {
        let [x, y, z] = grid.dims;
        return Err(JsError::new(&format!(
            "{x}×{y}×{z} voxels need about {:.1} GB of memory, and a browser has {:.0} GB for them: choose larger voxels",
            needed as f64 / 1e9,
            MOST_BYTES / 1e9
        )));
    }
    Ok(())
}
