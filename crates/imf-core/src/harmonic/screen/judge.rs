//! Candidates confirmed by exact answers.

use rayon::prelude::*;

use super::CANDIDATES;
use super::candidates::Candidates;
use crate::control::Control;
use crate::field::{Turned, VoxelMeasures};
use crate::orientation::Orientation;
use crate::section::SectionError;

/// A value above ten times the largest error of the fields measured is hardly free.
const FREE_BELOW: f32 = 0.3;

/// Exact answers for a set of orientations, until they are cancelled.
pub(super) struct Judge<'a> {
    measures: &'a VoxelMeasures<'a>,
    turned: Vec<Turned>,
    pub(super) control: Control<'a>,
}

impl<'a> Judge<'a> {
    pub(super) fn new(
        measures: &'a VoxelMeasures<'a>,
        orientations: &[Orientation],
        control: Control<'a>,
    ) -> Result<Self, SectionError> {
        let turned = orientations.par_iter().map(|orientation| Ok(measures.turned(orientation)?));
        Ok(Self { measures, turned: turned.collect::<Result<_, SectionError>>()?, control })
    }

    fn go_on(&self) -> Result<(), SectionError> {
        if self.control.is_cancelled() { Err(SectionError::Cancelled) } else { Ok(()) }
    }

    /// The first candidate that is free, which is cheap to ask.
    pub(super) fn free_of(
        &self,
        voxel: usize,
        candidates: &Candidates<CANDIDATES>,
        counted: &mut u64,
    ) -> Result<Option<u32>, SectionError> {
        self.go_on()?;
        if candidates.values[0] >= FREE_BELOW {
            return Ok(None);
        }
        Ok(candidates.known().find(|&index| {
            *counted += 1;
            self.measures.is_free(voxel, &self.turned[index as usize])
        }))
    }

    /// First whether any candidate is free; only then how much each overlaps.
    pub(super) fn best_of(
        &self,
        voxel: usize,
        candidates: &Candidates<CANDIDATES>,
        counted: &mut u64,
    ) -> Result<(f32, u32), SectionError> {
        if let Some(index) = self.free_of(voxel, candidates, counted)? {
            return Ok((0.0, index));
        }
        let mut found = (f32::INFINITY, u32::MAX);
        for index in candidates.known() {
            *counted += 1;
            let value = self.measures.measure(voxel, &self.turned[index as usize]);
            if value < found.0 || (value == found.0 && index < found.1) {
                found = (value, index);
            }
        }
        Ok(found)
    }

    /// The least measure over all the orientations; looks no further than the first that is free.
    pub(super) fn least(&self, voxel: usize) -> Result<f32, SectionError> {
        let mut least = f32::INFINITY;
        for turned in &self.turned {
            self.go_on()?;
            least = least.min(self.measures.measure(voxel, turned));
            if least == 0.0 {
                break;
            }
        }
        Ok(least)
    }
}
