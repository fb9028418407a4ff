//! The families as the comparison sees them: whole sections and their minimum, whatever they are made of.

use anyhow::Result;
use imf_cli::engine::Evaluated;
use imf_cli::session::Session;
use imf_core::control::Control;
use imf_core::orientation::Orientation;
use imf_core::section::{Imf, SectionPlan, SectionScratch, imf};
use imf_fields::factored::FactoredField;
use imf_fields::harmonic::{DirectionWeights, HarmonicField};
use rayon::prelude::*;

use crate::interpolation::{CoarseTable, StoredSections};

/// A field that can be asked for many sections at once, in the way that is fastest for it.
pub(super) trait Rival {
    /// `[orientation][voxel]` into `values`.
    fn sections(&mut self, orientations: &[Orientation], values: &mut [f32]) -> Result<()>;

    /// The least over the orientations.
    fn least(&mut self, orientations: &[Orientation]) -> Result<Imf>;
}

/// Counting.
pub(super) struct Exact<'a> {
    pub(super) session: &'a Session,
    pub(super) plan: &'a SectionPlan,
}

impl Rival for Exact<'_> {
    fn sections(&mut self, orientations: &[Orientation], values: &mut [f32]) -> Result<()> {
        let voxels = self.plan.grid().len();
        values
            .par_chunks_exact_mut(voxels)
            .zip(orientations)
            .try_for_each_init(SectionScratch::default, |scratch, (values, orientation)| {
                self.plan.cmf(orientation, scratch, values)
            })?;
        Ok(())
    }

    fn least(&mut self, orientations: &[Orientation]) -> Result<Imf> {
        Ok(imf(self.plan, orientations, self.session.control(&|_| {}))?)
    }
}

impl Rival for HarmonicField {
    fn sections(&mut self, orientations: &[Orientation], values: &mut [f32]) -> Result<()> {
        HarmonicField::sections(self, &self.direction_weights(orientations), values);
        Ok(())
    }

    fn least(&mut self, orientations: &[Orientation]) -> Result<Imf> {
        Ok(self.minimum(&self.direction_weights(orientations)))
    }
}

impl Rival for FactoredField {
    fn sections(&mut self, orientations: &[Orientation], values: &mut [f32]) -> Result<()> {
        let heads: DirectionWeights = self.direction_weights(orientations);
        self.evaluator().sections(&heads, values);
        Ok(())
    }

    fn least(&mut self, orientations: &[Orientation]) -> Result<Imf> {
        Ok(self.evaluator().minimum(&self.direction_weights(orientations)))
    }
}

impl Rival for Evaluated {
    fn sections(&mut self, orientations: &[Orientation], values: &mut [f32]) -> Result<()> {
        Ok(self.field.sections(orientations, values)?)
    }

    fn least(&mut self, orientations: &[Orientation]) -> Result<Imf> {
        Ok(self.field.minimum(orientations, Control::quiet())?)
    }
}

/// A table of sections, answering one orientation at a time.
pub(super) enum Table<'a> {
    Nearest(&'a StoredSections),
    Linear(&'a StoredSections),
    Coarse(&'a CoarseTable),
}

impl Table<'_> {
    fn section(&self, orientation: &Orientation, values: &mut [f32]) {
        match self {
            Self::Nearest(stored) => stored.nearest(orientation, values),
            Self::Linear(stored) => stored.linear(orientation, values),
            Self::Coarse(table) => table.section(orientation, values),
        }
    }
}

/// A table with the number of voxels that it answers for.
pub(super) struct Tabulated<'a> {
    pub(super) table: Table<'a>,
    pub(super) voxels: usize,
}

impl Rival for Tabulated<'_> {
    fn sections(&mut self, orientations: &[Orientation], values: &mut [f32]) -> Result<()> {
        for (values, orientation) in values.chunks_exact_mut(self.voxels).zip(orientations) {
            self.table.section(orientation, values);
        }
        Ok(())
    }

    fn least(&mut self, orientations: &[Orientation]) -> Result<Imf> {
        let mut least = Imf::new(self.voxels);
        let mut values = vec![0.0; self.voxels];
        for (index, orientation) in orientations.iter().enumerate() {
            self.table.section(orientation, &mut values);
            least.lower_to(index, &values);
        }
        Ok(least)
    }
}
