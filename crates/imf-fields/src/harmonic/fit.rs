//! From exact sections to coefficients, by least squares.
//!
//! Sections at N orientations spread evenly, N a few times the number K of functions, determine every voxel's K
//! coefficients as the sum of squares' minimum: `c = G⁻¹ Bᵀ s`, B the N × K values of the functions, G = BᵀB, s the
//! voxel's N exact values. One matrix serves all voxels, so the work is sections (which cost milliseconds) and one dense
//! product. This is the series of `radial` with its tail averaged out rather than cut off, it is divided by the
//! voxels counted as exact sections are, and it makes no assumption about the tool.
//!
//! Coefficients are held along their principal components: a sample of voxels gives the mean and the covariance,
//! whose leading eigenvectors U turn the solution into `z = Uᵀ(G⁻¹ Bᵀ s − μ)`. Where memory holds all sections
//! ([`FitSettings::one_pass`]), they are counted once; else a first pass computes the sample alone, and a second the
//! compressed coefficients, some sections at a time.
//!
//! Directions are fitted in fours (`quadrature`), which cuts B and G into four classes. Where all components are
//! retained, axes are the functions themselves, class by class, and no pass decides on them. Where memory holds all
//! sections too, nothing has to be known of all voxels before the first is solved for, and where sections are counted
//! plane by plane, the fit goes through the grid with them (`sections`): what is held of the sections stays in the
//! caches.
//!
//! Where obstacle and grid are their own mirror image, one side is fitted for both ([`super::mirror`]).

mod memory;
mod passes;
pub(super) mod quadrature;
mod sample;
mod sections;
mod solve;
mod source;

use super::basis::Domain;
use super::mirror::Planes;
use super::settings::FitSettings;
use super::{HarmonicError, HarmonicField};
use crate::metrics::Validation;
use crate::parallel::*;
use imf_core::control::Control;
use imf_core::grid::Grid;
use imf_core::section::{Quantity, SectionPlan};
use passes::{FitResult, Start, count_sections};
use sample::section_error;
use solve::row_major;
use source::Source;

/// Sections held at a time: enough to fill the products, within this memory.
const BATCH_BYTES: usize = 256 << 20;
/// Products reach full speed with about as many columns.
const MOST_AT_ONCE: usize = 128;
/// Voxels of a product's block.
const BLOCK: usize = 1024;
/// Orientations at which a sample of voxels gives the functions' means.
const ROUGH: usize = 16;
/// Sections that a finished field is held against at a time.
const VALIDATED_AT_ONCE: usize = 8;
/// Separates validation's orientations from those of the sample.
const VALIDATION: u64 = 0x5641_4c49_4441_5445;

fn batch_size(voxels: usize, sections: usize) -> usize {
    (BATCH_BYTES / (4 * voxels.max(1))).clamp(8, MOST_AT_ONCE).min(sections.max(1))
}

/// Makes a field of what `plan`'s sections are: the overlap at the tip where the tip alone is sharp, else the minimum
/// over the sharp points; or of the depth of that. One unit of progress is one section; there are [`section_count`]
/// of them.
///
/// # Errors
/// Settings out of range, directions alone for a tool that is not round, a failed section, or cancellation.
pub fn fit(
    plan: &SectionPlan,
    domain: Domain,
    settings: &FitSettings,
    control: Control<'_>,
) -> Result<HarmonicField, HarmonicError> {
    settings.check()?;
    if domain == Domain::Directions && Domain::of_tool(plan.tool()) == Domain::Rotations {
        let name = &plan.tool().name;
        return Err(HarmonicError::Settings(format!(
            "the tool '{name}' is not round, so that its roll matters: choose functions of rotations (Domain::of_tool says which)"
        )));
    }
    // Restricted to one side where the scene is its own mirror image.
    let planes = Planes::of_plan(plan, domain, settings.quantity);
    let grid = Grid { dims: planes.side(), ..*plan.grid() };
    let side = if planes.is_empty() { None } else { Some(plan.over(&grid)?) };
    let source = Source::new(side.as_ref().unwrap_or(plan), settings.quantity)?;
    let start = Start::new(&source, domain, settings, planes, control)?;
    let in_classes = settings.in_classes(domain);
    let FitResult { components, mean, coefficients, report } = match settings.one_pass {
        true if in_classes => start.class_by_class(&source, settings.precision, control)?,
        true => start.in_one_pass(&source, settings.precision, control)?,
        false => start.in_batches(&source, settings.precision, in_classes, control)?,
    };
    drop(source);
    drop(side);
    let mut field = HarmonicField {
        quantity: settings.quantity,
        grid: *plan.grid(),
        coefficients: start.planes.unfolded(coefficients, &start.parities_of(&components)),
        basis: start.basis,
        components: row_major(&components),
        mean: mean.iter().map(|&v| v as f32).collect(),
        report,
    };
    field.report.validation = validation(&field, plan, settings, control)?;
    Ok(field)
}

/// Compares a finished field with exact sections over the whole grid at random orientations, a few at a time: the
/// errors that queries at other directions will see.
fn validation(
    field: &HarmonicField,
    plan: &SectionPlan,
    settings: &FitSettings,
    control: Control<'_>,
) -> Result<Validation, HarmonicError> {
    let source = Source::new(plan, settings.quantity)?;
    let set = field.basis.random_set(settings.held_out, settings.seed ^ VALIDATION)?.orientations;
    let voxels = field.grid.len();
    let mut exact = vec![0.0; voxels * VALIDATED_AT_ONCE.min(set.len())];
    let mut found = exact.clone();
    let mut errors = Vec::with_capacity(set.len());
    for set in set.chunks(VALIDATED_AT_ONCE) {
        let (exact, found) = (&mut exact[..voxels * set.len()], &mut found[..voxels * set.len()]);
        count_sections(&source, set, exact, control)?;
        field.sections(&field.direction_weights(set), found);
        let pairs = found.par_chunks(voxels).zip(exact.par_chunks(voxels));
        let of_each: Vec<_> =
            pairs.map(|(found, exact)| section_error(found.iter().copied(), exact)).collect();
        errors.extend(of_each);
    }
    Ok(Validation::of(&errors))
}

/// The voxels that a fit solves for: the whole grid, or one side where the scene is its own mirror image.
fn fitted_grid(plan: &SectionPlan, domain: Domain, quantity: Quantity) -> Grid {
    Grid { dims: Planes::of_plan(plan, domain, quantity).side(), ..*plan.grid() }
}

/// Sections that [`fit`] computes.
pub fn section_count(domain: Domain, settings: &FitSettings) -> usize {
    let passes = if settings.one_pass || settings.in_classes(domain) { 1 } else { 2 };
    passes * settings.sizes(domain).sections + rough_count(domain, settings) + settings.held_out
}

/// Sections at which a sample of voxels gives the functions' means.
fn rough_count(domain: Domain, settings: &FitSettings) -> usize {
    if settings.in_classes(domain) { ROUGH } else { 0 }
}
