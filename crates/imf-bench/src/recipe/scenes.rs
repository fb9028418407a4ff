//! The scenes of recipes, each made once.

use std::collections::BTreeMap;

use anyhow::Result;
use imf_cli::arguments::clearance::{ClearanceArguments, ContactArguments};
use imf_cli::arguments::scene::SceneArguments;
use imf_cli::session::Session;
use imf_core::scene::{GridExtent, Scene};

use super::definition::SceneSettings;

/// Scenes by settings and resolution.
#[derive(Default)]
pub(crate) struct Scenes(BTreeMap<(String, u64), Scene>);

impl Scenes {
    /// The scene of a part, the settings' own where none is named, at a fraction of the full resolution.
    pub(crate) fn get(
        &mut self,
        session: &Session,
        settings: &SceneSettings,
        part: Option<&str>,
        resolution: f64,
    ) -> Result<Scene> {
        let part = part.unwrap_or(&settings.part).to_owned();
        let settings = SceneSettings { part, ..settings.clone() };
        let key = (serde_json::to_string(&settings)?, resolution.to_bits());
        if let Some(scene) = self.0.get(&key) {
            return Ok(scene.clone());
        }
        let arguments = SceneArguments {
            part: settings.part,
            unit: settings.unit.as_deref().map(str::parse).transpose()?,
            scale: 1.0,
            pitch: settings.pitch,
            dims: None,
            margin: settings.margin,
            transform: None,
            conservative: settings.conservative,
            // Protocols at a fraction of the resolution are coarse on purpose; it is warned about.
            allow_coarse: true,
            tool: vec![settings.tool],
            fixture: Vec::new(),
            around: GridExtent::Part,
            clearance: ClearanceArguments::from(settings.clearance),
        };
        let contact = ContactArguments { contact: settings.contact };
        let scene = arguments.scaled(session, settings.scale * resolution)?.scene_with(session, &contact)?;
        self.0.insert(key, scene.clone());
        Ok(scene)
    }
}
