//! The scenes of a regime, each made once.

use std::collections::BTreeMap;

use anyhow::Result;
use imf_core::regime::{SceneSettings, Stage};
use imf_core::scene::Scene;

use crate::arguments::clearance::{ClearanceArguments, ContactArguments};
use crate::arguments::scene::{AroundKind, SceneArguments};
use crate::session::Session;

/// Scenes by part and resolution.
pub(crate) struct Scenes<'a> {
    settings: &'a SceneSettings,
    made: BTreeMap<(String, u64), Scene>,
}

impl<'a> Scenes<'a> {
    pub(crate) fn new(settings: &'a SceneSettings) -> Self {
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
        let part = stage.part.clone().unwrap_or_else(|| self.settings.part.clone());
        self.of_part(session, &part, resolution)
    }

    /// The scene of a part at a share of the full resolution.
    pub(crate) fn of_part(&mut self, session: &Session, part: &str, resolution: f64) -> Result<Scene> {
        let key = (part.to_owned(), resolution.to_bits());
        if let Some(scene) = self.made.get(&key) {
            return Ok(scene.clone());
        }
        let given = SceneArguments {
            part: part.to_owned(),
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
        let scene = scaled.scene_with(session, &contact)?;
        self.made.insert(key, scene.clone());
        Ok(scene)
    }
}
