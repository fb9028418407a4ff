//! `imf parts`: the built-in reference parts as OBJ files.

use std::str::FromStr;

use anyhow::Result;
use imf_core::mesh::topology::MeshReport;
use imf_core::mesh::write::write_obj;
use imf_core::parts::ReferencePart;
use serde_json::json;

use crate::arguments::PartsArguments;
use crate::exit::WrongArgument;
use crate::output::{OutputFolder, print_result, table};
use crate::session::Session;

pub(crate) fn run(session: &Session, arguments: &PartsArguments) -> Result<()> {
    let parts = match &arguments.only {
        Some(name) => {
            vec![ReferencePart::from_str(name).map_err(|error| WrongArgument(error.to_string()))?]
        }
        None => ReferencePart::ALL.to_vec(),
    };
    let folder = OutputFolder::check(&arguments.folder)?;
    folder.create_locked()?;
    let (mut rows, mut answers) = (Vec::new(), Vec::new());
    for part in parts {
        let mesh = part.mesh();
        let report = MeshReport::new(&mesh);
        let path = folder.file(&format!("{part}.obj"));
        write_obj(&mesh, &path, &header(part))?;
        let [x, y, z] = report.extents.to_array();
        rows.push(vec![
            path.display().to_string(),
            report.triangles.to_string(),
            if report.closed { "closed".into() } else { format!("open, {} edges", report.boundary_edges) },
            format!("{x:.1} × {y:.1} × {z:.1} mm"),
            part.dims().map(|d| d.to_string()).join("×"),
            origin(part).into(),
        ]);
        answers.push(json!({
            "name": part.name(),
            "file": path.display().to_string(),
            "description": part.description(),
            "papers_own": part.is_papers_own(),
            "unit": "mm",
            "dims": part.dims(),
            "mesh": report,
        }));
    }
    folder.complete();
    let table = table(&["file", "triangles", "surface", "extents", "grid", "whose"], &rows);
    print_result(session, &answers, &table)
}

/// The comment at the head of a part's file.
fn header(part: ReferencePart) -> String {
    let [x, y, z] = part.dims();
    format!(
        "{part}: {}\n{}\nunit: mm; reference grid: {x} x {y} x {z} voxels of 1 mm",
        part.description(),
        origin(part)
    )
}

/// Whose part it is.
pub(super) fn origin(part: ReferencePart) -> &'static str {
    if part.is_papers_own() { "the paper's own part" } else { "ours, in the paper's style" }
}
