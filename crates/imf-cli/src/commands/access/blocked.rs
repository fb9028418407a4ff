//! What blocks the space that is not reached: at the best pose of every voxel, which elements of the tool collide.
//!
//! "The holder hits" is mended by a longer tool, "the cutter hits" is not: so every element has two volumes, where it
//! collides at all, and where it is the only one.

use imf_core::access::Volume;
use imf_core::section::ElementMeasures;
use imf_core::tool::ElementKind;
use serde::Serialize;

use super::Findings;
use super::setup::Setup;

/// One element and the empty voxels that it keeps from being reached.
#[derive(Debug, PartialEq, Serialize)]
pub(super) struct BlockedRow {
    pub(super) element: String,
    /// Where it collides at the best pose.
    pub(super) hits: Volume,
    /// Where nothing else does.
    pub(super) alone: Volume,
}

/// Which voxels no pose reaches, and what collides there: the elements of one tool, or of each voxel's best tool.
struct Tally {
    kinds: Vec<ElementKind>,
    hits: Vec<usize>,
    alone: Vec<usize>,
}

impl Tally {
    fn new(elements: &[&ElementMeasures]) -> Self {
        let mut kinds: Vec<ElementKind> = elements.iter().flat_map(|e| e.kinds.iter().copied()).collect();
        kinds.sort_by_key(|kind| kind.rank());
        kinds.dedup();
        Self { hits: vec![0; kinds.len()], alone: vec![0; kinds.len()], kinds }
    }

    fn add(&mut self, elements: &ElementMeasures, voxel: usize) {
        let colliding = || {
            let all = elements.kinds.iter().zip(&elements.values);
            all.filter(|(_, values)| values[voxel] > 0.0).map(|(kind, _)| kind)
        };
        let only = colliding().count() == 1;
        for kind in colliding() {
            if let Some(place) = self.kinds.iter().position(|k| k == kind) {
                self.hits[place] += 1;
                self.alone[place] += usize::from(only);
            }
        }
    }

    fn rows(&self, voxel_volume: f64) -> Vec<BlockedRow> {
        let measure = |voxels: usize| Volume::new(voxels, voxel_volume);
        self.kinds
            .iter()
            .zip(self.hits.iter().zip(&self.alone))
            .map(|(kind, (&hits, &alone))| BlockedRow {
                element: kind.to_string(),
                hits: measure(hits),
                alone: measure(alone),
            })
            .collect()
    }
}

/// Empty voxels whose measure is above τ.
fn unreached<'a>(setup: &'a Setup, imf: &'a [f32]) -> impl Iterator<Item = usize> + 'a {
    let blocked = |&v: &usize| setup.solid.solid[v] == 0 && f64::from(imf[v]) > setup.tau;
    (0..imf.len()).filter(blocked)
}

/// What of one tool keeps it from the voxels that it does not reach; nothing for a mesh.
pub(super) fn by_tool(setup: &Setup, findings: &Findings, tool: usize) -> Vec<BlockedRow> {
    let elements = &findings.elements[tool];
    let mut tally = Tally::new(&[elements]);
    unreached(setup, &findings.tools[tool].imf.value).for_each(|voxel| tally.add(elements, voxel));
    tally.rows(setup.query.voxel_volume())
}

/// What of its best tool keeps all tools from every voxel that none reaches.
pub(super) fn together(setup: &Setup, findings: &Findings) -> Vec<BlockedRow> {
    let mut tally = Tally::new(&findings.elements.iter().collect::<Vec<_>>());
    for voxel in unreached(setup, &findings.together.imf.value) {
        if let Some(elements) = findings.elements.get(findings.together.tool[voxel] as usize) {
            tally.add(elements, voxel);
        }
    }
    tally.rows(setup.query.voxel_volume())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elements_that_collide_together_are_none_alone() {
        let elements = ElementMeasures {
            kinds: vec![ElementKind::Cutter, ElementKind::Holder(0)],
            values: vec![vec![0.1, 0.0, 0.2], vec![0.0, 0.3, 0.1]],
        };
        let other = ElementMeasures { kinds: vec![ElementKind::Shank], values: vec![vec![0.5, 0.0, 0.0]] };
        let mut tally = Tally::new(&[&elements, &other]);
        (0..3).for_each(|voxel| tally.add(&elements, voxel));
        tally.add(&other, 0);
        let rows = tally.rows(8.0);
        let found: Vec<_> =
            rows.iter().map(|r| (r.element.as_str(), r.hits.voxels, r.alone.volume)).collect();
        assert_eq!(found, [("cutter", 2, 8.0), ("shank", 1, 8.0), ("holder 1", 2, 8.0)]);
    }
}
