//! What would free the places that shank or holder obstruct: a longer stick-out, a slimmer holder.

use anyhow::Result;
use imf_core::surface::{ElementCollision, StickOutTool, shortest_stick_outs};
use imf_core::tool::{Assembly, Element, ElementKind, ToolShape};
use imf_core::unit::LengthUnit;
use serde::Serialize;

use super::{AccessRun, Surface, SurfaceSettings, Verdict};
use crate::output::length;
use crate::session::Session;

/// By sample the minimum stick-out with which its best tool reaches it, infinite where none helps; `None` for those
/// that were not examined, or whose tool has no holder.
pub(super) fn stick_outs(
    session: &Session,
    run: &AccessRun,
    settings: &SurfaceSettings,
    surface: &Surface,
) -> Result<Vec<Option<f64>>> {
    let samples = &surface.samples.samples;
    let mut found = vec![None; samples.len()];
    for (index, assembly) in run.tools.iter().enumerate() {
        let is_obstructed = |&sample: &usize| {
            // Where the machine alone obstructs, no length is known to help.
            let in_the_way = surface.blame.nearest[sample].is_some_and(|at| at.voxels > 0 || at.surface > 0);
            surface.best[sample] == (Verdict::Obstructed, index) && in_the_way
        };
        let own: Vec<usize> = (0..samples.len()).filter(is_obstructed).collect();
        if own.is_empty() || assembly.tool().stick_out().is_none() {
            continue;
        }
        let tool = StickOutTool::new(&settings.environment, assembly, settings.tolerance)?;
        let chosen: Vec<_> = own.iter().map(|&sample| samples[sample]).collect();
        let directions = &run.orientations.orientations;
        let least = session.staged("what would help", "directions", directions.len() as u64, |control| {
            shortest_stick_outs(&tool, &chosen, directions, control)
        })?;
        own.into_iter().zip(least).for_each(|(sample, least)| found[sample] = Some(least.length()));
    }
    Ok(found)
}

/// A stick-out that frees some of a patch.
#[derive(Debug, PartialEq, Serialize)]
pub(super) struct LongerStickOut {
    /// To set the tool to, in the part's unit.
    length: f64,
    /// The fraction of the examined places that it frees.
    frees: f64,
    /// The length before it was rounded up.
    #[serde(skip)]
    needed: f64,
}

impl LongerStickOut {
    /// From the minimum stick-outs of places, infinite where none helps, each with the reserve of an edge; `None` where less than a
    /// hundredth is freed, which is not a remedy.
    pub(super) fn new(lengths: impl Iterator<Item = f64>, edge: f64, unit: LengthUnit) -> Option<Self> {
        let all: Vec<f64> = lengths.collect();
        let freed: Vec<f64> = all.iter().copied().filter(|length| length.is_finite()).collect();
        let longest = freed.iter().copied().reduce(f64::max)?;
        let frees = freed.len() as f64 / all.len() as f64;
        (100 * freed.len() >= all.len()).then(|| Self {
            length: length::rounded_up(longest + edge, unit),
            frees,
            needed: longest + edge,
        })
    }

    /// In words.
    pub(super) fn text(&self, assembly: &Assembly, unit: LengthUnit, on_machine: bool) -> Option<String> {
        let given = assembly.tool().stick_out()?;
        let what = match self.frees {
            frees if frees < 1.0 => format!("{:.0} % of it", (100.0 * frees).floor()),
            _ => "it".into(),
        };
        let near = |value: f64| length::nearest(value, unit);
        let beyond = match assembly.tool().overall_length {
            Some(overall) if self.needed > overall => {
                format!(", more than its overall length of {}", near(overall))
            }
            _ => String::new(),
        };
        let of = if on_machine { " of part and fixtures" } else { "" };
        let (enough, given) = (near(self.length), near(given));
        Some(format!("a stick-out of {enough} {unit} instead of {given}{beyond} frees {what}{of}"))
    }
}

/// By how much the diameter of the holder would have to be smaller to be free at a pose where nothing else collides; `None` where that
/// would leave nothing around the shank.
pub(super) fn slimmer(hits: &[ElementCollision], assembly: &Assembly) -> Option<f64> {
    if hits.is_empty() || !hits.iter().all(|hit| matches!(hit.kind, ElementKind::Holder(_))) {
        return None;
    }
    let ToolShape::Revolved(elements) = &assembly.tool().shape else { return None };
    let widest = |holder: bool| {
        let own = elements.iter().filter(|e| matches!(e.kind, ElementKind::Holder(_)) == holder);
        own.map(Element::max_radius).fold(0.0, f64::max)
    };
    let by = hits.iter().map(|hit| hit.slimmer).fold(0.0, f64::max);
    (by < widest(true) - widest(false)).then_some(2.0 * by)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_stick_out_that_frees_next_to_nothing_is_no_remedy() {
        let of = |freed: usize| {
            let all = (0..1000).map(move |at| if at < freed { 20.0 + at as f64 } else { f64::INFINITY });
            LongerStickOut::new(all, 0.34, LengthUnit::Mm)
        };
        assert_eq!((of(0), of(1), of(9)), (None, None, None));
        assert_eq!(of(10), Some(LongerStickOut { length: 29.4, frees: 0.01, needed: 29.34 }));
        assert_eq!(LongerStickOut::new(std::iter::empty(), 0.0, LengthUnit::Mm), None);
    }
}
