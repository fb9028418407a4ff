//! Sections, of a part or of a saved field: one array of collision measures for each orientation, written as they are finished.

use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::Result;
use imf_core::field_files::{NamedField, write_npy, write_vti};
use imf_core::orientation::Orientation;
use imf_core::section::ElementPlans;
use serde_json::{Value, json};

use super::elements::{self, ElementBuffers, ElementRow};
use super::{Measure, ORIENTATIONS, Outside, SUMMARY, Values, Work, angles_text};
use crate::interrupt;
use crate::output::{print_written, same_digits, table, write_json};
use crate::slices::MidPlanes;

/// At most this many sections share one .vti file …
const SHARED_SECTIONS: usize = 16;
/// … and only where they take no more memory than this together: they are retained until all are there.
const SHARED_BYTES: usize = 128 << 20;
/// Sections in the picture.
const PICTURED: usize = 6;
/// Sections in the table.
const LISTED: usize = 20;

/// What is retained of a section once it is written.
struct WrittenSection {
    index: usize,
    outside: Option<Outside>,
    largest: f32,
    planes: Option<MidPlanes>,
    /// Everything that the shared file is to hold, by name.
    values: Vec<(String, Vec<f32>)>,
    elements: Vec<ElementRow>,
}

#[derive(Default)]
struct ThreadState {
    kept: Vec<WrittenSection>,
    measures: ElementBuffers,
}

pub(super) fn run(work: &Work<'_>) -> Result<()> {
    let (grid, set) = (&work.scene.record.grid, work.set);
    let arrays = 1 + work.elements().map_or(0, |plans| plans.elements().count());
    let shared = set.len() <= SHARED_SECTIONS && 4 * set.len() * arrays * grid.len() <= SHARED_BYTES;
    let files = files(work, shared);
    let measure = work.measure();
    let name = |index| name(&measure, index);
    let keeping = interrupt::stop_cleanly();
    let begin = || -> Result<()> {
        work.folder.begin(work.session)?;
        // First, so that sections saved before Ctrl-C can be identified, and are found by the next run.
        work.write_orientations()?;
        let begun = work.summary("sections", json!({ "finished": false, "files": files }));
        write_json(&work.folder.file(SUMMARY), &begun)
    };
    let written = AtomicUsize::new(0);
    let visit = |own: &mut ThreadState, index: usize, cmf: &[f32]| -> Result<()> {
        write_npy(work.folder.file(&format!("{}.npy", name(index))), grid.dims, cmf)?;
        let measured = own.measures.measure(work, index)?;
        let elements = elements::write(work, &name(index), &measured, index == 0)?;
        if !shared {
            let vti = work.folder.file(&format!("{}.vti", name(index)));
            let mut fields = vec![NamedField::new(&measure.section, cmf)];
            for (row, (_, values)) in elements.iter().zip(&measured) {
                fields.push(NamedField::new(&row.array, *values));
            }
            write_vti(vti, grid, &fields)?;
        }
        let mut values = Vec::new();
        if shared {
            values.push((name(index), cmf.to_vec()));
            let of_elements = measured.iter().zip(&elements);
            values.extend(of_elements.map(|((_, values), row)| (row.array.clone(), values.to_vec())));
        }
        own.kept.push(WrittenSection {
            index,
            outside: work.accessible_outside(cmf),
            largest: cmf.iter().copied().fold(f32::NEG_INFINITY, f32::max),
            planes: (index < PICTURED)
                .then(|| MidPlanes::new(angles_text(&set.orientations[index]), cmf, grid)),
            values,
            elements,
        });
        written.fetch_add(1, Ordering::Relaxed);
        Ok(())
    };
    let parts = work.stream(begin, ThreadState::default, visit).map_err(|error| {
        let (written, folder) = (written.load(Ordering::Relaxed), work.folder.path.display());
        interrupt::explained(error, || {
            format!("{written} of {} sections are finished and kept in {folder}", set.len())
        })
    })?;
    // All sections are written: from here on Ctrl-C ends the program at once.
    drop(keeping);
    let mut kept: Vec<WrittenSection> = parts.into_iter().flat_map(|own| own.kept).collect();
    kept.sort_by_key(|section| section.index);
    let mut finish = || -> Result<()> {
        if shared {
            write_shared(work, &kept)?;
        }
        draw(work, &mut kept)?;
        if let Some(first) = kept.first_mut().filter(|_| work.elements().is_some()) {
            elements::draw(work, first.elements.iter_mut(), "section 0, by element")?;
        }
        Ok(())
    };
    let finished = finish();

    let vti = if shared { "sections.vti" } else { "one .vti for each section" };
    let summary = work.summary(
        "sections",
        json!({ "finished": finished.is_ok(), "sections": list(work, &kept), "vti": vti, "files": files }),
    );
    let written = finished.and_then(|()| work.folder.write_summary(&summary));
    // Rows of orientations that differ in nothing else would look alike.
    let rolls = set.orientations.iter().any(|orientation| orientation.roll != 0.0);
    let accessible = match work.values {
        Values::Exact(_) => "accessible outside the part",
        Values::Saved(_) => "called free outside the part",
    };
    let largest = format!("largest {}", measure.short);
    let head = ["section", "θ", "φ", "ψ", &largest, accessible];
    let head: Vec<&str> = head.into_iter().filter(|&title| rolls || title != "ψ").collect();
    let rows: Vec<Vec<String>> = kept.iter().take(LISTED).map(|section| row(work, section, rolls)).collect();
    let mut text = table(&head, &rows);
    if kept.len() > LISTED {
        text += &format!("… and {} more, see {SUMMARY}\n", kept.len() - LISTED);
    }
    text += &measure.held(work.scene.record.unit).map(|line| line + "\n").unwrap_or_default();
    text += &work.checked().map(|line| line + "\n").unwrap_or_default();
    if let Some(trust) = work.trust() {
        text += &format!("{trust}guarantee: {}\n", work.guarantee());
    }
    // Those of the elements begin like their section's.
    let pictures = if work.elements().is_some() { "slices.png, elements.png" } else { "slices.png" };
    if written.is_ok() {
        text += &format!(
            "written to {}: {}-*.npy, {vti}, {pictures}, {ORIENTATIONS}, {SUMMARY}\n",
            work.folder.path.display(),
            measure.section
        );
    }
    print_written(work.session, &summary, &text, written)
}

fn name(measure: &Measure, index: usize) -> String {
    format!("{}-{index:05}", measure.section)
}

fn files(work: &Work<'_>, shared: bool) -> Vec<String> {
    let mut files = Vec::new();
    let measure = work.measure();
    for section in (0..work.set.len()).map(|index| name(&measure, index)) {
        let elements = work.elements().into_iter().flat_map(ElementPlans::elements);
        files.extend(elements.map(|kind| format!("{}.npy", elements::array(&section, kind))));
        files.push(format!("{section}.npy"));
        files.extend((!shared).then(|| format!("{section}.vti")));
    }
    files.extend(shared.then(|| "sections.vti".to_owned()));
    files.push("slices.png".into());
    files.extend(work.elements().map(|_| elements::PICTURE.to_owned()));
    files.extend([ORIENTATIONS, SUMMARY].map(str::to_owned));
    files
}

/// All sections as named arrays of one file.
fn write_shared(work: &Work<'_>, kept: &[WrittenSection]) -> Result<()> {
    let grid = &work.scene.record.grid;
    let mut fields = Vec::new();
    for (name, values) in kept.iter().flat_map(|section| &section.values) {
        fields.push(NamedField::new(name, &values[..]));
    }
    fields.push(NamedField::new("solid", &work.scene.obstacle.solid[..]));
    Ok(write_vti(work.folder.file("sections.vti"), grid, &fields)?)
}

/// Mid-planes of the first sections.
fn draw(work: &Work<'_>, kept: &mut [WrittenSection]) -> Result<()> {
    let planes: Vec<MidPlanes> = kept.iter_mut().filter_map(|section| section.planes.take()).collect();
    let mut notes = vec![format!("outlined: the part; {}", work.exactness())];
    if kept.len() > planes.len() {
        notes.push(format!("the first {} of {} sections", planes.len(), kept.len()));
    }
    work.draw(&work.measure().section_label, &planes, notes, "slices.png")
}

fn list(work: &Work<'_>, kept: &[WrittenSection]) -> Vec<Value> {
    let entry = |section: &WrittenSection| {
        json!({
            "index": section.index,
            "orientation": work.set.orientations[section.index],
            "file": format!("{}.npy", name(&work.measure(), section.index)),
            "largest": same_digits(section.largest),
            "accessible_outside": section.outside.map(|outside| outside.accessible),
            "inaccessible_outside": section.outside.map(|outside| outside.inaccessible),
            "elements": section.elements,
        })
    };
    kept.iter().map(entry).collect()
}

/// A line of the table, with the roll where any orientation has one.
fn row(work: &Work<'_>, section: &WrittenSection, rolls: bool) -> Vec<String> {
    let Orientation { theta, phi, roll } = work.set.orientations[section.index];
    let angles = [Some(theta), Some(phi), rolls.then_some(roll)];
    let mut row = vec![section.index.to_string()];
    row.extend(angles.into_iter().flatten().map(|angle| format!("{angle:.1}°")));
    row.extend([
        work.measure().largest(section.largest),
        section.outside.map_or_else(|| "no threshold".to_owned(), |outside| outside.text("")),
    ]);
    row
}
