//! The scenes of a recipe, each made once.

use std::collections::BTreeMap;

use anyhow::Result;
use imf_cli::arguments::clearance::{ClearanceArguments, ContactArguments};
use imf_cli::arguments::scene::SceneArguments;
use imf_cli::session::Session;
use imf_core::scene::{Around, Scene};

use crate::recipe::{SceneSettings, Stage};

/// Scenes by settings, part and resolution.
#[derive(Default)]
pub(crate) struct Scenes {
    made: BTreeMap<(String, u64), Scene>,
}

impl Scenes {
    /// The scene of a stage at full resolution: what its network stands for.
    pub(super) fn full(
        &mut self,
        session: &Session,
        settings: &SceneSettings,
        stage: &Stage,
    ) -> Result<Scene> {
        self.at(session, settings, stage, 1.0)
    }

    /// The scene that a stage's sections are made of.
    pub(super) fn of_sections(
        &mut self,
        session: &Session,
        settings: &SceneSettings,
        stage: &Stage,
    ) -> Result<Scene> {
        self.at(session, settings, stage, stage.resolution)
    }

    fn at(
        &mut self,
        session: &Session,
        settings: &SceneSettings,
        stage: &Stage,
        resolution: f64,
    ) -> Result<Scene> {
        let part = stage.part.as_ref().unwrap_or(&settings.part);
        self.of_part(session, settings, part, resolution)
    }

    /// The scene of a part at a share of the full resolution.
    pub(crate) fn of_part(
        &mut self,
        session: &Session,
        settings: &SceneSettings,
        part: &str,
        resolution: f64,
    ) -> Result<Scene> {
        let settings = SceneSettings { part: part.to_owned(), ..settings.clone() };
        let key = (serde_json::to_string(&settings)?, resolution.to_bits());
        if let Some(scene) = self.made.get(&key) {
            return Ok(scene.clone());
        }
        let given = SceneArguments {
            part: settings.part,
            unit: settings.unit.as_deref().map(str::parse).transpose()?,
            pitch: settings.pitch,
            dims: None,
            margin: settings.margin,
            transform: None,
            conservative: settings.conservative,
            tool: vec![settings.tool],
            fixture: Vec::new(),
            around: Around::Part,
            clearance: ClearanceArguments::from(settings.clearance),
        };
        let contact = ContactArguments::from(settings.contact);
        let scaled = given.scaled(session, settings.scale * resolution)?;
        let scene = scaled.scene_with(session, &contact)?;
        self.made.insert(key, scene.clone());
        Ok(scene)
    }
}
