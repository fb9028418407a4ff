//! A recipe's file with values changed by path before it is read: so a change is checked as the file itself is.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context as _, Result, bail, ensure};
use serde::Serialize;

use super::definition::{Recipe, VERSION, Variant};

/// The recipes that come with the program, in the order in which they are listed.
pub(crate) const BUILT_IN: [(&str, &str); 5] = [
    ("single", include_str!("../../recipes/single.toml")),
    ("multi", include_str!("../../recipes/multi.toml")),
    ("transfer", include_str!("../../recipes/transfer.toml")),
    ("sparsity", include_str!("../../recipes/sparsity.toml")),
    ("architecture", include_str!("../../recipes/architecture.toml")),
];

/// The text of the built-in recipe of that name.
pub(crate) fn built_in(name: &str) -> Result<&'static str> {
    let found = BUILT_IN.iter().find(|(other, _)| *other == name);
    let names = || BUILT_IN.map(|(name, _)| name).join(", ");
    found.map(|(_, text)| *text).with_context(|| {
        format!(
            "there is no recipe '{name}'; the built-in ones are {}; a file of your own is given by its path",
            names()
        )
    })
}

/// A recipe's table.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Source(toml::Table);

impl Source {
    pub(crate) fn parse(text: &str) -> Result<Self> {
        Ok(Self(text.parse().context("the recipe cannot be read")?))
    }

    /// A file, else the built-in recipe of that name.
    pub(crate) fn open(name: &str) -> Result<Self> {
        let path = Path::new(name);
        // A file of that name wins over a built-in recipe, as with parts.
        let text = if path.is_file() {
            &std::fs::read_to_string(path).with_context(|| format!("cannot read the recipe {name}"))?
        } else if name.contains(['/', '\\', '.']) {
            bail!("there is no recipe file {name}; the built-in ones are listed by: imf-bench recipe list");
        } else {
            built_in(name)?
        };
        Self::parse(text).with_context(|| format!("the recipe {name}"))
    }

    /// The file's text.
    pub(crate) fn text(&self) -> Result<String> {
        toml::to_string(&self.0).context("the recipe cannot be written down")
    }

    /// Reads and checks it.
    pub(crate) fn recipe(&self) -> Result<Recipe> {
        match self.0.get("version").and_then(toml::Value::as_integer) {
            Some(found) if found > i64::from(VERSION) => bail!(
                "the recipe has version {found}, and this program reads version {VERSION}: use a newer imf"
            ),
            Some(found) if found == i64::from(VERSION) => {}
            _ => bail!("the recipe cannot be read: `version = {VERSION}` is missing"),
        }
        let recipe: Recipe = self.0.clone().try_into().context("the recipe cannot be read")?;
        recipe.check().context("recipe")?;
        Ok(recipe)
    }

    /// Each variant by name, with its own values and without variants; the recipe itself, unnamed, where there is none. All
    /// are checked.
    pub(crate) fn variants(&self) -> Result<Vec<(String, Self)>> {
        let recipe = self.recipe()?;
        if recipe.variants.is_empty() {
            return Ok(vec![(String::new(), self.clone())]);
        }
        let changed = |set: &BTreeMap<String, toml::Value>| -> Result<Self> {
            let mut own = self.clone();
            own.0.remove("variant");
            set.iter().try_for_each(|(path, value)| own.set(path, value.clone()))?;
            own.recipe()?;
            Ok(own)
        };
        let variants = recipe.variants.iter().map(|Variant { name, set }| {
            Ok((name.clone(), changed(set).with_context(|| format!("variant '{name}'"))?))
        });
        variants.collect()
    }

    /// Sets a value by a text such as `network.width=128` or `stage.*.start=random`. What is not a TOML value is a
    /// text.
    pub(crate) fn assign(&mut self, text: &str) -> Result<()> {
        let (path, value) =
            text.split_once('=').with_context(|| format!("'{text}' sets nothing: write KEY=VALUE"))?;
        let (path, value) = (path.trim(), value.trim());
        let parsed =
            format!("value = {value}").parse::<toml::Table>().ok().and_then(|mut t| t.remove("value"));
        self.set(path, parsed.unwrap_or_else(|| value.into()))
    }

    /// Sets the value at `path`, such as `network.width` or `stage.coarse.training.batch`; `stage.*.…` means every stage.
    /// Tables on the way are made where they are missing; a stage is not.
    ///
    /// # Errors
    /// A stage that is not there, or a path through a plain value. Whether the key exists is seen when the recipe is read.
    pub(crate) fn set(&mut self, path: &str, value: impl Into<toml::Value>) -> Result<()> {
        self.place(path, value.into()).with_context(|| format!("cannot set '{path}'"))
    }

    fn place(&mut self, path: &str, value: toml::Value) -> Result<()> {
        let keys: Vec<&str> = path.split('.').collect();
        ensure!(!keys.contains(&""), "a path is names with dots between, such as network.width");
        let ["stage", name, rest @ ..] = keys.as_slice() else { return place(&mut self.0, &keys, value) };
        ensure!(!rest.is_empty(), "say what of the stage, such as stage.NAME.training.batch");
        let stages =
            self.0.get_mut("stage").and_then(toml::Value::as_array_mut).context("there is no stage")?;
        let mut found = false;
        for stage in stages.iter_mut().filter_map(toml::Value::as_table_mut) {
            if *name == "*" || stage.get("name").and_then(toml::Value::as_str) == Some(name) {
                place(stage, rest, value.clone())?;
                found = true;
            }
        }
        ensure!(found, "there is no stage '{name}'");
        Ok(())
    }
}

fn place(table: &mut toml::Table, keys: &[&str], value: toml::Value) -> Result<()> {
    match keys {
        [] => bail!("it names nothing"),
        [key] => {
            table.insert((*key).to_owned(), value);
            Ok(())
        }
        [key, rest @ ..] => {
            let inner = table.entry(*key).or_insert_with(|| toml::Value::Table(toml::Table::new()));
            place(inner.as_table_mut().with_context(|| format!("'{key}' is a plain value"))?, rest, value)
        }
    }
}
