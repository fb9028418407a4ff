//! Finished pieces of work, one JSON file each, so that an interrupted command repeats nothing that was finished.
//!
//! A cell is keyed by what made it: settings, scene, device, version. Its file's name carries a checksum of the key, and the
//! key stands in the file; where it is another one, the cell is made again. The CPU's name stands in the cell alone: cells that several
//! machines made on the same kind of device can be laid together in one folder.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Error, Result};
use imf_cli::engine::Device;
use imf_cli::interrupt::{Interruption, is_cancelled};
use imf_cli::output::{prepare_folder, write_json};
use imf_cli::session::Session;
use imf_core::mesh::Mesh;
use imf_core::parts::ReferencePart;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::measurement::Machine;
use crate::recipe::GO_ON;

/// Where cells are saved.
pub(crate) struct Cells<'a> {
    session: &'a Session,
    out: PathBuf,
    folder: PathBuf,
    /// What every key holds beside its own.
    common: Value,
    /// In words: times are of it.
    machine: String,
    any_found: std::cell::Cell<bool>,
}

/// A finished piece of work.
#[derive(Serialize, Deserialize)]
pub(crate) struct Cell<T> {
    made_by: Value,
    /// The machine that finished it.
    pub(crate) made_on: String,
    pub(crate) value: T,
}

/// Where networks run, in words.
pub(crate) fn device_name(device: &Device) -> String {
    match device {
        Device::Cpu => "networks on the CPU".to_owned(),
        Device::Gpu(gpu) => format!("networks on {}", gpu.describe()),
    }
}

impl<'a> Cells<'a> {
    /// Cells in `out/cells`.
    pub(crate) fn new(session: &'a Session, device: &Device, out: &Path) -> Result<Self> {
        let folder = out.join("cells");
        prepare_folder(&folder)?;
        let common = json!({ "program": env!("CARGO_PKG_VERSION"), "device": device_name(device) });
        let mut machine = Machine::new(session.threads()).name();
        if let Device::Gpu(gpu) = device {
            machine = format!("{}, {machine}", gpu.describe());
        }
        Ok(Self { session, out: out.to_owned(), folder, common, machine, any_found: false.into() })
    }

    /// All that decides a cell, and its checksum.
    fn key(&self, key: &impl Serialize) -> Result<(Value, String)> {
        let mut made_by = json!({ "common": self.common, "cell": serde_json::to_value(key)? });
        // Of the parts the bracket is a saved file, which may be made again under its name.
        if made_by["cell"].to_string().contains("\"bracket\"") {
            made_by["bracket"] = checksum(&ReferencePart::Bracket.mesh()).into();
        }
        let mark = crc32fast::hash(&serde_json::to_vec(&made_by)?);
        Ok((made_by, format!("{mark:08x}")))
    }

    /// Whether any saved cell was found.
    pub(crate) fn any_found(&self) -> bool {
        self.any_found.get()
    }

    /// What distinguishes the files of this key from those of others.
    pub(crate) fn mark(&self, key: &impl Serialize) -> Result<String> {
        Ok(self.key(key)?.1)
    }

    /// The saved cell of that name and key, if there is one.
    pub(crate) fn find<T: DeserializeOwned>(
        &self,
        name: &str,
        key: &impl Serialize,
    ) -> Result<Option<Cell<T>>> {
        let (made_by, mark) = self.key(key)?;
        let file = self.file(name, &mark);
        let Ok(text) = std::fs::read_to_string(&file) else { return Ok(None) };
        let kept = serde_json::from_str(&text).ok().filter(|cell: &Cell<T>| cell.made_by == made_by);
        if kept.is_some() {
            self.session.note(&format!("{name}: kept"));
            self.any_found.set(true);
        } else {
            let what = "is damaged or of another version, and counts as not made";
            self.session.warn(&format!("{} {what}", file.display()));
        }
        Ok(kept)
    }

    /// The cell of that name and key, read if it is saved, else computed by `make` and saved.
    pub(crate) fn get<T: Serialize + DeserializeOwned>(
        &self,
        name: &str,
        key: &impl Serialize,
        make: impl FnOnce() -> Result<T>,
    ) -> Result<Cell<T>> {
        if let Some(cell) = self.find(name, key)? {
            return Ok(cell);
        }
        self.session.note(&format!("{name}:"));
        let value = make().map_err(|error| interruption(error, &self.out))?;
        self.keep(name, key, value)
    }

    /// Saves what was computed here.
    pub(crate) fn keep<T: Serialize>(&self, name: &str, key: &impl Serialize, value: T) -> Result<Cell<T>> {
        let (made_by, mark) = self.key(key)?;
        let cell = Cell { made_by, made_on: self.machine.clone(), value };
        write_json(&self.file(name, &mark), &cell).with_context(|| format!("the cell {name}"))?;
        Ok(cell)
    }

    fn file(&self, name: &str, mark: &str) -> PathBuf {
        self.folder.join(format!("{name}-{mark}.json"))
    }
}

/// Work that was interrupted leaves what was finished before it.
pub(crate) fn interruption(error: Error, out: &Path) -> Error {
    if is_cancelled(&error) {
        let kept = format!("what was finished is kept in {}; {GO_ON} to go on", out.display());
        return Interruption(kept).into();
    }
    error
}

/// A checksum of a mesh's vertices.
fn checksum(mesh: &Mesh) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    for vertex in &mesh.vertices {
        vertex.to_array().iter().for_each(|v| hasher.update(&v.to_le_bytes()));
    }
    hasher.finalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_of_the_bracket_know_its_shape() {
        let (folder, session) = (tempfile::tempdir().unwrap(), Session::silent());
        let cells = Cells::new(&session, &Device::Cpu, folder.path()).unwrap();
        let of_part = |part: &str| cells.key(&json!({ "scene": { "part": part } })).unwrap().0;
        assert!(of_part("bracket")["bracket"].is_u64());
        assert!(of_part("teapot")["bracket"].is_null());
        let mut mesh = ReferencePart::Bracket.mesh();
        let before = checksum(&mesh);
        mesh.vertices[7].z += 0.001;
        assert_ne!(before, checksum(&mesh));
    }

    #[test]
    fn a_cell_is_made_once_for_each_key() {
        let (folder, session) = (tempfile::tempdir().unwrap(), Session::silent());
        let cells = Cells::new(&session, &Device::Cpu, folder.path()).unwrap();
        let get = |key: u32, value: f64| cells.get("one", &key, || Ok(value)).unwrap().value;
        assert!(cells.find::<f64>("one", &1).unwrap().is_none());
        assert_eq!((get(1, 0.1), get(1, 7.0), get(2, 3.0), get(2, 4.0)), (0.1, 0.1, 3.0, 3.0));
        let mut other = Cells::new(&session, &Device::Cpu, folder.path()).unwrap();
        other.common["device"] = "networks on another".into();
        assert_eq!(other.get("one", &1, || Ok(9.0)).unwrap().value, 9.0);
        // Another machine is not a reason to make it again.
        let mut elsewhere = Cells::new(&session, &Device::Cpu, folder.path()).unwrap();
        let here = std::mem::replace(&mut elsewhere.machine, "elsewhere".into());
        let kept = elsewhere.get("one", &1, || Ok(9.0)).unwrap();
        assert_eq!((kept.value, kept.made_on), (0.1, here));
        // A damaged cell is made again.
        for entry in std::fs::read_dir(folder.path().join("cells")).unwrap() {
            std::fs::write(entry.unwrap().path(), "{").unwrap();
        }
        assert_eq!(get(1, 8.0), 8.0);
        assert!(cells.get::<f64>("two", &1, || anyhow::bail!("no")).is_err());
        assert_eq!(cells.get("two", &1, || Ok(5.0)).unwrap().value, 5.0);
    }
}
