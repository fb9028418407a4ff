//! The inaccessibility measure: the minimum of the sections over all orientations, and which orientation has it.

use anyhow::Result;
use imf_core::field_files::{NamedField, write_npy, write_vti};
use imf_core::orientation::Orientation;
use imf_core::section::{Imf, Quantity};
use imf_core::tool::ElementKind;
use serde_json::json;

use super::elements::{self, ElementRow};
use super::{ORIENTATIONS, SUMMARY, Values, Work};
use crate::arguments::orientations::suggested_lines;
use crate::output::{print_written, same_digits, shortened};
use crate::slices::MidPlanes;

pub(super) fn run(work: &Work<'_>) -> Result<()> {
    let whole = work.minimum()?;
    let elements = elements::at_best(work, &whole)?;
    let borrowed: Vec<_> = elements.iter().map(|(kind, values)| (*kind, values.as_slice())).collect();
    let measure = work.measure();
    let note = format!(
        "minimum over {} orientations ({}); outlined: the part; {}",
        work.set.len(),
        shortened(&work.set.spec),
        work.exactness()
    );
    let mut rows = Vec::new();
    let write = || -> Result<()> {
        work.folder.begin(work.session)?;
        rows = elements::write(work, &measure.minimum, &borrowed, true)?;
        write_fields(work, &whole, &elements, &rows)?;
        let planes = [MidPlanes::new(String::new(), &whole.value, &work.scene.record.grid)];
        work.draw(&measure.minimum_label, &planes, vec![note], &format!("{}.png", measure.minimum))?;
        if !rows.is_empty() {
            elements::draw(work, rows.iter_mut(), "measures at the best orientation, by element")?;
        }
        Ok(())
    };
    let written = write();
    let outside = work.accessible_outside(&whole.value);
    let largest = whole.value.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let own = [".npy", ".vti", ".png"].map(|ending| format!("{}{ending}", measure.minimum));
    let mut files: Vec<String> = own.into_iter().chain(["best.npy".to_owned()]).collect();
    files.extend(rows.iter().map(|row| format!("{}.npy", row.array)));
    files.extend((!rows.is_empty()).then(|| elements::PICTURE.to_owned()));
    files.extend([ORIENTATIONS, SUMMARY].map(str::to_owned));
    if written.is_err() {
        files.clear();
    }
    let summary = work.summary(
        "imf",
        json!({
            "largest": same_digits(largest),
            "accessible_outside": outside.map(|outside| outside.accessible),
            "inaccessible_outside": outside.map(|outside| outside.inaccessible),
            "elements": rows,
            "files": &files,
        }),
    );
    let written = written.and_then(|()| work.folder.write_summary(&summary));
    let reached = match work.values {
        Values::Exact(_) => "some orientation reaches them freely",
        Values::Saved(_) => "the field's minimum is at most its threshold there, an estimate",
    };
    let suggested = suggested_lines(work.suggested, &work.scene.record.unit.to_string());
    let mut text = format!("orientations  {} ({})\n{suggested}", work.set.len(), shortened(&work.set.spec));
    if let Some(outside) = outside {
        text += &format!(
            "accessible    {}: {reached}\ninaccessible  {} voxels outside the part\n",
            outside.text(" outside the part"),
            outside.inaccessible,
        );
    }
    text += &work.trust().unwrap_or_default();
    let unit = work.scene.record.unit;
    text += &match measure.quantity {
        Quantity::Overlap => format!("largest IMF   {largest:.4}\n"),
        Quantity::Depth => format!("largest depth {} {unit}\n", measure.largest(largest)),
    };
    text += &measure.held(unit).map(|line| format!("{line}\n")).unwrap_or_default();
    text += &format!("guarantee     {}\n", work.guarantee());
    for row in &rows {
        text += &format!(
            "{:<14}collides at the best orientation of {} voxels outside the part\n",
            row.element, row.hits
        );
    }
    text += &work.checked().map(|line| format!("check         {line}\n")).unwrap_or_default();
    if written.is_ok() {
        text += &format!("written to    {}: {}\n", work.folder.path.display(), files.join(", "));
    }
    print_written(work.session, &summary, &text, written)
}

/// One of an orientation's.
type Angle = fn(&Orientation) -> f64;

/// The angles of orientations, in degrees, by their names; the roll where any has one.
fn angles(of: &[Orientation]) -> impl Iterator<Item = (&'static str, Angle)> + use<> {
    let rolls = of.iter().any(|orientation| orientation.roll != 0.0);
    let all: [(_, Angle); 3] = [("theta", |o| o.theta), ("phi", |o| o.phi), ("roll", |o| o.roll)];
    all.into_iter().take(if rolls { 3 } else { 2 })
}

/// The arrays, and the best orientation's angles for viewers that know no list of orientations.
fn write_fields(
    work: &Work<'_>,
    whole: &Imf,
    elements: &[(ElementKind, Vec<f32>)],
    rows: &[ElementRow],
) -> Result<()> {
    let grid = &work.scene.record.grid;
    let set = &work.set.orientations;
    let of_best = |angle: Angle| -> Vec<f32> {
        whole.best.iter().map(|&best| angle(&set[best as usize]) as f32).collect()
    };
    let angles: Vec<(&str, Vec<f32>)> = angles(set).map(|(name, angle)| (name, of_best(angle))).collect();
    let (value, best) = (&whole.value[..], &whole.best[..]);
    let name = &work.measure().minimum;
    write_npy(work.folder.file(&format!("{name}.npy")), grid.dims, value)?;
    write_npy(work.folder.file("best.npy"), grid.dims, best)?;
    let mut fields = vec![NamedField::new(name, value), NamedField::new("best", best)];
    fields.extend(angles.iter().map(|(name, angle)| NamedField::new(name, &angle[..])));
    fields.push(NamedField::new("solid", &work.scene.obstacle.solid[..]));
    for ((_, values), row) in elements.iter().zip(rows) {
        fields.push(NamedField::new(&row.array, &values[..]));
    }
    write_vti(work.folder.file(&format!("{name}.vti")), grid, &fields)?;
    work.write_orientations()
}
