//! Measures of cutter, shank and each holder segment beside the whole tool's: what collides.

use anyhow::Result;
use imf_core::field_files::write_npy;
use imf_core::section::{ElementScratch, Imf, elements_at_best};
use imf_core::tool::ElementKind;
use serde::Serialize;

use super::Work;
use crate::output::element_name;
use crate::slices::MidPlanes;

pub(super) const PICTURE: &str = "elements.png";

#[derive(Debug, Serialize)]
pub(super) struct ElementRow {
    pub(super) element: String,
    /// Name of its array in the .vti file, and of its .npy file without the ending.
    pub(super) array: String,
    pub(super) largest: f32,
    /// Voxels outside the part where it collides.
    pub(super) hits: usize,
    /// For the picture.
    #[serde(skip)]
    planes: Option<MidPlanes>,
}

/// Working memory of one thread.
#[derive(Default)]
pub(super) struct ElementBuffers {
    scratch: ElementScratch,
    measures: Vec<Vec<f32>>,
}

impl ElementBuffers {
    /// Every element's section of orientation `index`; none unless requested.
    pub(super) fn measure(&mut self, work: &Work<'_>, index: usize) -> Result<Vec<(ElementKind, &[f32])>> {
        let Some(plans) = work.elements() else { return Ok(Vec::new()) };
        let voxels = work.scene.record.grid.len();
        self.measures.resize_with(plans.elements().count(), || vec![0.0; voxels]);
        plans.measures(&work.set.orientations[index], &mut self.scratch, &mut self.measures)?;
        Ok(plans.elements().zip(self.measures.iter().map(Vec::as_slice)).collect())
    }
}

/// Every element's measure at the best orientation of each voxel; none unless requested.
pub(super) fn at_best(work: &Work<'_>, imf: &Imf) -> Result<Vec<(ElementKind, Vec<f32>)>> {
    let Some(plans) = work.elements() else { return Ok(Vec::new()) };
    let found = work.session.staged("elements", "orientations", work.set.len() as u64, |control| {
        elements_at_best(plans, &work.set.orientations, imf, control)
    })?;
    Ok(found.kinds.into_iter().zip(found.values).collect())
}

/// Writes `PREFIX-ELEMENT.npy` for each element, and retains its mid-planes where they are to be drawn.
pub(super) fn write(
    work: &Work<'_>,
    prefix: &str,
    measures: &[(ElementKind, &[f32])],
    pictured: bool,
) -> Result<Vec<ElementRow>> {
    let grid = &work.scene.record.grid;
    let row = |&(kind, values): &(ElementKind, &[f32])| {
        let array = array(prefix, kind);
        write_npy(work.folder.file(&format!("{array}.npy")), grid.dims, values)?;
        let outside = values.iter().zip(&work.scene.obstacle.solid).filter(|&(_, &solid)| solid == 0);
        Ok(ElementRow {
            element: kind.to_string(),
            array,
            largest: values.iter().copied().fold(0.0, f32::max),
            hits: outside.filter(|&(&value, _)| value > 0.0).count(),
            planes: pictured.then(|| MidPlanes::new(kind.to_string(), values, grid)),
        })
    };
    measures.iter().map(row).collect()
}

pub(super) fn array(prefix: &str, kind: ElementKind) -> String {
    format!("{prefix}-{}", element_name(kind))
}

/// Draws the elements' mid-planes in one scale.
pub(super) fn draw<'a>(
    work: &Work<'_>,
    rows: impl Iterator<Item = &'a mut ElementRow>,
    what: &str,
) -> Result<()> {
    let planes: Vec<MidPlanes> = rows.filter_map(|row| row.planes.take()).collect();
    let note = format!("{what}; they sum to the whole tool's measure; outlined: the part");
    work.draw("fraction of the collision measure", &planes, vec![note], PICTURE)
}
