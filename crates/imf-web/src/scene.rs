//! A part and a tool: sections, and the exact checker.

use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use imf_core::mesh::Mesh;
use imf_core::occupancy::Occupancy;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::pose::Pose;
use imf_core::scene::{BuiltScene, Scene};
use imf_core::section::{SectionPlan, SectionScratch, ToolPoints};
use imf_core::tool::{Clearance, Tool};
use imf_core::world::Checker;
use wasm_bindgen::JsError;
use wasm_bindgen::prelude::wasm_bindgen;

use crate::part::{Part, corners};

/// Sides of a tool of revolution in the picture.
const SIDES: usize = 48;

/// A part, voxelised, and a tool around it.
#[wasm_bindgen]
pub struct PartScene {
    pub(crate) scene: Scene,
    pub(crate) mesh: Mesh,
    warnings: Vec<String>,
    checker: Checker,
    plan: SectionPlan,
    scratch: SectionScratch,
}

/// What a colliding tool hits.
#[wasm_bindgen]
pub struct Contact {
    element: String,
    /// How deep the deepest solid voxel's centre lies below the element's surface.
    pub depth: f64,
    /// That centre.
    pub x: f64,
    /// Along y.
    pub y: f64,
    /// Along z.
    pub z: f64,
}

#[wasm_bindgen]
impl Contact {
    /// `cutter`, `shank` or `holder 1`; `tool` of a mesh.
    #[wasm_bindgen(getter)]
    #[must_use]
    pub fn element(&self) -> String {
        self.element.clone()
    }
}

#[wasm_bindgen]
impl PartScene {
    /// Voxelises a part. `tool` is the text of a tool file (TOML). Without a pitch one is chosen, and a built-in part has its own.
    /// The checker lets the cutter reach one pitch below the part's surface.
    ///
    /// # Errors
    /// A tool file that is wrong; as `SceneBuilder::build` of `imf-core`.
    #[wasm_bindgen(constructor)]
    pub fn new(part: &Part, tool: &str, pitch: Option<f64>) -> Result<PartScene, JsError> {
        let tool = Tool::parse(tool, Path::new("tool"))?;
        let builder = match part.reference {
            Some(reference) => Scene::builder().reference(reference),
            None => Scene::builder().part(&part.name, part.mesh.clone(), part.unit),
        };
        let builder = builder.tool(&tool);
        let BuiltScene { scene, mesh, bodies, warnings, .. } = match pitch {
            Some(pitch) => builder.pitch(pitch).build()?,
            None => builder.build()?,
        };
        let touching = scene.clone().with_contact(&bodies, scene.record.grid.pitch);
        Ok(Self {
            checker: Checker::of_scene(&touching, &Clearance::default())?,
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

    /// What the tool, its tip at a point and its axis along (i, j, k), hits; nothing where it is free.
    ///
    /// # Errors
    /// Numbers that are not finite, or an axis of no length.
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
        // Most poses are free, which is known sooner than what is hit.
        if self.checker.is_free(&pose) {
            return Ok(None);
        }
        let Some(contact) = self.checker.contact(&pose)? else { return Ok(None) };
        let at = contact.point.unwrap_or(pose.position);
        Ok(Some(Contact {
            element: contact.element.map_or_else(|| "tool".to_owned(), |element| element.to_string()),
            depth: contact.depth,
            x: at.x,
            y: at.y,
            z: at.z,
        }))
    }

    /// The tool's surface with its tip at the origin and its axis along z: three corners of each triangle.
    #[must_use]
    pub fn tool_corners(&self) -> Vec<f32> {
        corners(&self.scene.record.bare_tool().surface(SIDES))
    }

    /// The collision measure at every voxel for the direction (θ, φ), in [0, 1]: `[x, y, z]` with z side by side.
    ///
    /// # Errors
    /// A tool that does not fit the grid.
    pub fn section(&mut self, theta: f64, phi: f64) -> Result<Vec<f32>, JsError> {
        let mut values = vec![0.0; self.plan.grid().len()];
        self.plan.cmf(&Orientation::new(theta, phi), &mut self.scratch, &mut values)?;
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
