//! From exact sections to coefficients, by least squares.
//!
//! Sections at N orientations spread evenly, N a few times the number K of functions, determine every voxel's K
//! coefficients as the sum of squares' minimum: `c = G⁻¹ Bᵀ s`, B the N × K values of the functions, G = BᵀB, s the
//! voxel's N exact values. One matrix serves all voxels, so the work is sections (which cost milliseconds) and one dense
//! product. This is the series of `radial` with its tail averaged out rather than cut off, it is divided by the
//! voxels counted as exact sections are, and it asks nothing of the tool.
//!
//! Coefficients are kept along their principal axes: a sample of voxels tells the mean and the covariance, whose leading
//! eigenvectors U turn the solution into `z = Uᵀ(G⁻¹ Bᵀ s − μ)`. Where memory holds all sections
//! ([`FitSettings::one_pass`]), they are counted once; else a first pass looks at the sample alone, and a second makes the
//! compressed coefficients as it goes.
//!
//! Directions are fitted in fours (`fours`), which cuts B and G into four classes. Where all axes are kept, one pass uses
//! this (`classes`): axes are then the functions themselves, class by class. Nothing then has to be known of all voxels
//! before the first is solved for, and where sections are counted plane by plane, the fit goes through the grid with them
//! (`parts`): what is held of the sections stays in the caches.
//!
//! Where obstacle and grid are their own mirror image, one side is fitted for both (`mirrored`).

mod classes;
mod kept;
pub(super) mod mirrored;
mod parts;
mod passes;
mod sample;
pub(crate) mod solve;
pub(crate) mod source;

use serde::{Deserialize, Serialize};

use super::basis::{Basis, Domain};
use super::coefficients::Precision;
use super::{HarmonicError, HarmonicField};
use imf_core::control::Control;
use imf_core::grid::Grid;
use imf_core::section::{Quantity, SectionPlan};
use mirrored::Mirrored;
use passes::{Fitted, Start};
use solve::row_major;
use source::Source;

/// What a harmonic field is made by.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FitSettings {
    /// What is fitted. Files of overlaps do not name it: they are what all were before.
    #[serde(skip_serializing_if = "Quantity::is_overlap")]
    pub quantity: Quantity,
    /// Highest degree L of the functions.
    pub degree: usize,
    /// Sections for each function, at least 1.
    pub sections_per_function: f64,
    /// Principal axes kept; all functions where there are fewer.
    pub axes: usize,
    /// How coefficients are kept.
    pub precision: Precision,
    /// Voxels of the sample that decides on the axes.
    pub sample: usize,
    /// Random orientations, none of the N, at which the sample tells the error to expect.
    pub held_out: usize,
    /// Seed of the held-out orientations.
    pub seed: u64,
    /// One pass over the sections, which stay in memory; else two: less memory, twice the time, the same field to the
    /// rounding of sections kept in 16 bits. Not kept in files.
    #[serde(skip)]
    pub one_pass: bool,
}

impl Default for FitSettings {
    fn default() -> Self {
        Self {
            quantity: Quantity::Overlap,
            degree: 14,
            sections_per_function: 4.0,
            axes: 128,
            precision: Precision::default(),
            sample: 8192,
            // Their mean error over the sample is that of 256 within a sixth, in a quarter of the time of 64.
            held_out: 16,
            seed: 0,
            one_pass: true,
        }
    }
}

impl FitSettings {
    /// Functions, sections and axes of a field over a domain.
    #[must_use]
    pub fn sizes(&self, domain: Domain) -> Sizes {
        let functions = Basis::count(domain, self.degree);
        let sections = (functions as f64 * self.sections_per_function).ceil() as usize;
        let sections = Basis::fitted_count(domain, sections, functions);
        Sizes { functions, sections, axes: self.axes.clamp(1, functions) }
    }

    /// Bytes at the peak of making a field over `voxels` voxels, and of the field itself; where all functions of directions
    /// are kept it may be less ([`FitSettings::memory_with`]).
    #[must_use]
    pub fn memory(&self, domain: Domain, voxels: usize) -> (u64, u64) {
        let Sizes { functions, sections, axes } = self.sizes(domain);
        let field = (voxels * axes) as u64 * self.precision.bytes();
        let made = (voxels * axes * 4) as u64 + if self.precision == Precision::F32 { 0 } else { field };
        let batch = (batch_size(voxels, sections) * voxels * 4) as u64;
        let sampled = self.sample_bytes(domain, voxels);
        let peak = if self.one_pass {
            kept::KeptSections::memory(sections, voxels) + field.max(sampled)
        } else {
            made.max(sampled) + batch
        };
        (peak + square_bytes(functions), field)
    }

    /// Bytes at the peak of making a field of what `plan`'s sections are, and of the field itself.
    #[must_use]
    pub fn memory_with(&self, plan: &SectionPlan, domain: Domain) -> (u64, u64) {
        self.memory_over(plan, &fitted_grid(plan, domain, self.quantity), domain)
    }

    /// The same where `fitted`, the whole grid or one side of it, is what is fitted.
    pub(super) fn memory_over(&self, plan: &SectionPlan, fitted: &Grid, domain: Domain) -> (u64, u64) {
        let voxels = fitted.len();
        let (mut peak, own) = self.memory(domain, voxels);
        let Sizes { functions, sections, .. } = self.sizes(domain);
        if self.one_pass
            && self.in_classes(domain)
            && let Some(parts) = parts::memory(plan, fitted.dims, sections)
        {
            peak = parts + own + self.sample_bytes(domain, voxels) + square_bytes(functions);
        }
        if voxels == plan.grid().len() {
            return (peak, own);
        }
        let field = own / voxels as u64 * plan.grid().len() as u64;
        // What is judged on one side for the others as well.
        let sides = plan.grid().len().div_ceil(voxels);
        let judged = (self.sample.min(voxels) * self.held_out * (sides - 1) * 4) as u64;
        ((peak + judged).max(own + field), field)
    }

    /// Bytes at the peak of deciding on a field's functions by a sample of its `voxels` voxels.
    #[must_use]
    pub fn outline_memory(&self, domain: Domain, voxels: usize) -> u64 {
        self.sample_bytes(domain, voxels) + square_bytes(self.sizes(domain).functions)
    }

    /// What the sample of voxels takes, by estimate.
    fn sample_bytes(&self, domain: Domain, voxels: usize) -> u64 {
        let Sizes { functions, sections, .. } = self.sizes(domain);
        (self.sample.min(voxels) * (sections + self.held_out + functions) * 4) as u64
    }

    /// True where functions are kept as they are and fall into classes, of values that begin at 0.
    fn in_classes(&self, domain: Domain) -> bool {
        let Sizes { functions, axes, .. } = self.sizes(domain);
        domain == Domain::Directions && axes == functions && self.quantity.is_overlap()
    }

    pub(crate) fn check(&self) -> Result<(), HarmonicError> {
        let refuse = |what: String| Err(HarmonicError::Settings(what));
        if self.degree > MOST_DEGREE {
            return refuse(format!("a degree of {} is above {MOST_DEGREE}", self.degree));
        }
        if !(1.0..=100.0).contains(&self.sections_per_function) {
            return refuse(format!(
                "sections_per_function must be from 1 to 100, not {}",
                self.sections_per_function
            ));
        }
        if self.axes == 0 || self.sample == 0 || self.held_out == 0 {
            return refuse("axes, sample and held_out must be at least 1".into());
        }
        Ok(())
    }
}

/// Higher degrees are refused as a slip of the keyboard: 1681 functions of a direction already.
pub(super) const MOST_DEGREE: usize = 40;

/// How large a field becomes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizes {
    /// Functions of the orientation, K.
    pub functions: usize,
    /// Exact sections, N.
    pub sections: usize,
    /// Axes kept.
    pub axes: usize,
}

/// What making a field told of its errors, on the sample's voxels.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FitReport {
    /// Functions of the orientation, K.
    pub functions: usize,
    /// Exact sections, N.
    pub sections: usize,
    /// Mean squared error that the dropped axes make.
    pub dropped: f64,
    /// Mean squared error at the held-out orientations, all functions kept.
    pub held_out_mse: f64,
    /// Largest error there.
    pub held_out_mpe: f64,
}

/// Sections held at a time: enough to fill the products, within this memory.
const BATCH_BYTES: usize = 256 << 20;
/// Products reach full speed with about as many columns.
const MOST_AT_ONCE: usize = 128;
/// Voxels of a product's block.
const BLOCK: usize = 1024;

/// The matrices of all functions together.
fn square_bytes(functions: usize) -> u64 {
    (functions * functions * 8 * 8) as u64
}

fn batch_size(voxels: usize, sections: usize) -> usize {
    (BATCH_BYTES / (4 * voxels.max(1))).clamp(8, MOST_AT_ONCE).min(sections.max(1))
}

/// Makes a field of what `plan`'s sections are: the overlap at the tip where the tip alone is sharp, else the least over
/// the sharp points; or of the depth of that. One unit of progress is one section; there are [`section_count`] of them.
///
/// # Errors
/// Settings out of range, a failed section, or cancellation.
pub fn fit(
    plan: &SectionPlan,
    domain: Domain,
    settings: &FitSettings,
    control: Control<'_>,
) -> Result<HarmonicField, HarmonicError> {
    begin(plan, domain, settings, control, |source, start, mirrored| {
        let Fitted { axes, mean, coefficients, report } = match settings.one_pass {
            true if settings.in_classes(domain) => {
                start.class_by_class(source, settings.precision, control)?
            }
            true => start.in_one_pass(source, settings.precision, control)?,
            false => start.in_two_passes(source, settings.precision, settings.in_classes(domain), control)?,
        };
        Ok(HarmonicField {
            quantity: settings.quantity,
            grid: *plan.grid(),
            coefficients: mirrored.unfolded(coefficients, &start.parities_of(&axes)),
            basis: start.basis,
            axes: row_major(&axes),
            mean: mean.iter().map(|&v| v as f32).collect(),
            report,
        })
    })
}

/// What every way to fit begins with: of one side of what is its own mirror image.
fn begin<T>(
    plan: &SectionPlan,
    domain: Domain,
    settings: &FitSettings,
    control: Control<'_>,
    go_on: impl FnOnce(&Source<'_>, Start, Mirrored) -> Result<T, HarmonicError>,
) -> Result<T, HarmonicError> {
    settings.check()?;
    let mirrored = Mirrored::of(plan, domain, settings.quantity);
    let side = mirrored.plan(plan)?;
    let source = Source::new(side.as_ref().unwrap_or(plan), settings.quantity)?;
    let start = Start::new(&source, domain, settings, &mirrored, control)?;
    go_on(&source, start, mirrored)
}

/// The voxels that a fit solves for: the whole grid, or one side of what is its own mirror image.
pub(super) fn fitted_grid(plan: &SectionPlan, domain: Domain, quantity: Quantity) -> Grid {
    Mirrored::of(plan, domain, quantity).side()
}

/// What a fit with these settings would err, told by the sample's voxels alone. One unit of progress is one section,
/// each but the held-out ones computed once.
///
/// # Errors
/// As [`fit`].
pub fn estimate(
    plan: &SectionPlan,
    domain: Domain,
    settings: &FitSettings,
    control: Control<'_>,
) -> Result<FitReport, HarmonicError> {
    begin(plan, domain, settings, control, |source, start, _| start.estimated(source, control))
}

/// The functions of a field without its coefficients: what a sample of voxels tells of them.
pub struct Outline {
    /// The functions of the orientation.
    pub basis: Basis,
    /// U: `[K][axes]`, orthonormal columns.
    pub axes: Vec<f32>,
    /// μ: `[K]`.
    pub mean: Vec<f32>,
    /// Root mean square of the coefficients along the axes; 1 where all are 0.
    pub scale: f32,
    /// What is known of their errors.
    pub report: FitReport,
}

/// Decides on functions, mean and scale by a sample of voxels, and keeps no section. Progress as [`estimate`].
///
/// # Errors
/// As [`fit`].
pub fn outline(
    plan: &SectionPlan,
    domain: Domain,
    settings: &FitSettings,
    control: Control<'_>,
) -> Result<Outline, HarmonicError> {
    begin(plan, domain, settings, control, |source, start, _| {
        let (solved, axes, report) = start.sampled(&start.dense()?, source, control)?;
        let kept = (axes.transpose() * &solved.covariance * &axes).trace().max(0.0) / axes.ncols() as f64;
        Ok(Outline {
            basis: start.basis,
            axes: row_major(&axes),
            mean: solved.mean.iter().map(|&v| v as f32).collect(),
            scale: if kept > 0.0 { kept.sqrt() as f32 } else { 1.0 },
            report,
        })
    })
}

/// Sections that [`fit`] computes.
#[must_use]
pub fn section_count(domain: Domain, settings: &FitSettings) -> usize {
    let passes = if settings.one_pass { 1 } else { 2 };
    passes * settings.sizes(domain).sections + settings.held_out
}
