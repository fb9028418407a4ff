//! The scenes of a regime, each made once.

use std::collections::BTreeMap;

use anyhow::Result;
use imf_core::regime::{SceneSettings, Stage};
use imf_core::scene::Scene;

use crate::arguments::clearance::{ClearanceArguments, ContactArguments};
use crate::arguments::scene::{AroundKind, SceneArguments};
use crate::session::Session;

/// Scenes by part and resolution.
pub(super) struct Scenes<'a> {
    settings: &'a SceneSettings,
    made: BTreeMap<(String, u64), Scene>,
}

impl<'a> Scenes<'a> {
    pub(super) fn new(settings: &'a SceneSettings) -> Self {
        Self { settings, made: BTreeMap::new() }
    }

    /// The scene of a stage at full resolution: what its network stands for.
    pub(super) fn full(&mut self, session: &Session, stage: &Stage) -> Result<Scene> {
        self.at(session, stage, 1.0)
    }

    /// The scene that a stage's sections are made of.
    pub(super) fn of_sections(&mut self, session: &Session, stage: &Stage) -> Result<Scene> {
        self.at(session, stage, stage.resolution)
    }

    fn at(&mut self, session: &Session, stage: &Stage, resolution: f64) -> Result<Scene> {
        let part = stage.part.as_ref().unwrap_or(&self.settings.part);
        let key = (part.clone(), resolution.to_bits());
        if let Some(scene) = self.made.get(&key) {
            return Ok(scene.clone());
        }
        let given = SceneArguments {
            part: part.clone(),
            unit: self.settings.unit.clone(),
            pitch: self.settings.pitch,
            dims: None,
            margin: self.settings.margin,
            transform: None,
            conservative: self.settings.conservative,
            tool: vec![self.settings.tool.clone()],
            fixture: Vec::new(),
            around: AroundKind::Part,
            clearance: ClearanceArguments::from(self.settings.clearance),
        };
        let contact = ContactArguments::from(self.settings.contact);
        let scaled = given.scaled(session, self.settings.scale * resolution)?;
        let scene = scaled.scene_with(session, &contact, false)?;
        self.made.insert(key, scene.clone());
        Ok(scene)
    }
}
