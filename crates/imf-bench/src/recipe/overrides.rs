//! Values of a recipe changed by path, before it is read: so a change is checked as the file itself is.

use super::RecipeError;

/// Sets the value at `path`, such as `network.width` or `stage.coarse.training.batch`; `stage.*.…` means every stage.
/// Tables on the way are made where they are missing; a stage is not.
///
/// # Errors
/// A stage that is not there, or a path through a plain value. Whether the key exists is seen when the recipe is read.
pub(crate) fn set(table: &mut toml::Table, path: &str, value: toml::Value) -> Result<(), RecipeError> {
    let fail = |what: String| RecipeError::Value(format!("cannot set '{path}': {what}"));
    let keys: Vec<&str> = path.split('.').collect();
    if keys.iter().any(|key| key.is_empty()) {
        return Err(fail("a path is names with dots between, such as network.width".into()));
    }
    let ["stage", name, rest @ ..] = keys.as_slice() else {
        return place(table, &keys, value).map_err(fail);
    };
    if rest.is_empty() {
        return Err(fail("say what of the stage, such as stage.NAME.training.batch".into()));
    }
    let stages = table.get_mut("stage").and_then(toml::Value::as_array_mut);
    let stages = stages.ok_or_else(|| fail("there is no stage".into()))?;
    let mut found = false;
    for stage in stages.iter_mut().filter_map(toml::Value::as_table_mut) {
        if *name == "*" || stage.get("name").and_then(toml::Value::as_str) == Some(name) {
            place(stage, rest, value.clone()).map_err(fail)?;
            found = true;
        }
    }
    if found { Ok(()) } else { Err(fail(format!("there is no stage '{name}'"))) }
}

fn place(table: &mut toml::Table, keys: &[&str], value: toml::Value) -> Result<(), String> {
    match keys {
        [] => Err("it names nothing".into()),
        [key] => {
            table.insert((*key).to_owned(), value);
            Ok(())
        }
        [key, rest @ ..] => {
            let inner = table.entry(*key).or_insert_with(|| toml::Value::Table(toml::Table::new()));
            let inner = inner.as_table_mut().ok_or_else(|| format!("'{key}' is a plain value"))?;
            place(inner, rest, value)
        }
    }
}

/// Path and value of a text such as `network.width=128` or `stage.*.start=random`. What is no TOML value is a text.
///
/// # Errors
/// A text without `=`.
pub(crate) fn assignment(text: &str) -> Result<(String, toml::Value), RecipeError> {
    let Some((path, value)) = text.split_once('=') else {
        return Err(RecipeError::Value(format!("'{text}' sets nothing: write KEY=VALUE")));
    };
    let (path, value) = (path.trim(), value.trim());
    let parsed = format!("value = {value}").parse::<toml::Table>().ok().and_then(|mut t| t.remove("value"));
    Ok((path.to_owned(), parsed.unwrap_or_else(|| toml::Value::String(value.to_owned()))))
}
