//! Why space is not reached: which elements of the tool collide at the best pose of every voxel.
//!
//! "The holder hits" is mended by a longer tool, "the cutter hits" is not: so every element has two volumes, where it
//! collides at all, and where it is the only one.

use imf_core::section::ElementMeasures;
use imf_core::tool::ElementKind;
use serde::Serialize;

use super::run::AccessRun;
use super::{Findings, Volume};

/// One element and the empty voxels that it obstructs.
#[derive(Debug, PartialEq, Serialize)]
pub(super) struct CollisionRow {
    pub(super) element: String,
    /// Where it collides at the best pose.
    pub(super) hits: Volume,
    /// Where nothing else does.
    pub(super) alone: Volume,
    /// Where it hits the part, and where a fixture; both in one place count twice. Nothing without fixtures.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub(super) part_and_fixtures: Option<[Volume; 2]>,
}

/// Which voxels no pose reaches, and what collides there: the elements of one tool, or of each voxel's best tool.
struct Tally {
    kinds: Vec<ElementKind>,
    hits: Vec<usize>,
    alone: Vec<usize>,
    bodies: Vec<[usize; 2]>,
}

/// What one tool hits: of all that is solid, and of the fixtures.
type Hits<'a> = (&'a ElementMeasures, Option<&'a ElementMeasures>);

fn hits(findings: &Findings, tool: usize) -> Option<Hits<'_>> {
    Some((findings.elements.get(tool)?, findings.at_fixtures.get(tool)?.as_ref()))
}

impl Tally {
    fn new(elements: &[&ElementMeasures]) -> Self {
        let mut kinds: Vec<ElementKind> = elements.iter().flat_map(|e| e.kinds.iter().copied()).collect();
        kinds.sort_by_key(|kind| kind.order());
        kinds.dedup();
        let none = vec![0; kinds.len()];
        Self { hits: none.clone(), alone: none, bodies: vec![[0; 2]; kinds.len()], kinds }
    }

    fn add(&mut self, (elements, fixtures): Hits<'_>, voxel: usize) {
        let colliding = || {
            let all = elements.kinds.iter().zip(&elements.values);
            all.filter(|(_, values)| values[voxel] > 0.0).map(|(kind, values)| (kind, values[voxel]))
        };
        let of_fixtures = |kind: &ElementKind| {
            let fixtures = fixtures?;
            let place = fixtures.kinds.iter().position(|k| k == kind)?;
            Some(fixtures.values[place][voxel])
        };
        let only = colliding().count() == 1;
        for (kind, whole) in colliding() {
            if let Some(place) = self.kinds.iter().position(|k| k == kind) {
                self.hits[place] += 1;
                self.alone[place] += usize::from(only);
                // Counts over one number: what is more than the fixtures' is the part's.
                let held = of_fixtures(kind).unwrap_or(0.0);
                self.bodies[place][0] += usize::from(whole > held);
                self.bodies[place][1] += usize::from(held > 0.0);
            }
        }
    }

    fn rows(&self, voxel_volume: f64, with_fixtures: bool) -> Vec<CollisionRow> {
        let measure = |voxels: usize| Volume::new(voxels, voxel_volume);
        self.kinds
            .iter()
            .zip(self.hits.iter().zip(&self.alone).zip(&self.bodies))
            .map(|(kind, ((&hits, &alone), bodies))| CollisionRow {
                element: kind.to_string(),
                hits: measure(hits),
                alone: measure(alone),
                part_and_fixtures: with_fixtures.then(|| bodies.map(measure)),
            })
            .collect()
    }
}

/// Empty voxels whose measure is above τ.
fn unreached<'a>(run: &'a AccessRun, imf: &'a [f32]) -> impl Iterator<Item = usize> + 'a {
    let blocked = |&v: &usize| run.solid.solid[v] == 0 && f64::from(imf[v]) > run.tau;
    (0..imf.len()).filter(blocked)
}

/// Which elements of one tool obstruct the voxels that it does not reach; nothing for a mesh.
pub(super) fn by_tool(run: &AccessRun, findings: &Findings, tool: usize) -> Vec<CollisionRow> {
    let mut tally = Tally::new(&[&findings.elements[tool]]);
    if let Some(hits) = hits(findings, tool) {
        unreached(run, &findings.tools[tool].imf.value).for_each(|voxel| tally.add(hits, voxel));
    }
    tally.rows(run.query.voxel_volume(), findings.at_fixtures.iter().all(Option::is_some))
}

/// For every voxel that no tool reaches, which elements of its best tool obstruct it.
pub(super) fn together(run: &AccessRun, findings: &Findings) -> Vec<CollisionRow> {
    let mut tally = Tally::new(&findings.elements.iter().collect::<Vec<_>>());
    for voxel in unreached(run, &findings.together.imf.value) {
        if let Some(hits) = hits(findings, findings.together.tool[voxel] as usize) {
            tally.add(hits, voxel);
        }
    }
    tally.rows(run.query.voxel_volume(), findings.at_fixtures.iter().all(Option::is_some))
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
        // Of the holder's hits the second is a fixture's alone, the third both's.
        let fixtures =
            ElementMeasures { kinds: vec![ElementKind::Holder(0)], values: vec![vec![0.0, 0.3, 0.05]] };
        let mut tally = Tally::new(&[&elements, &other]);
        (0..3).for_each(|voxel| tally.add((&elements, Some(&fixtures)), voxel));
        tally.add((&other, None), 0);
        let rows = tally.rows(8.0, true);
        let found: Vec<_> =
            rows.iter().map(|r| (r.element.as_str(), r.hits.voxels, r.alone.volume)).collect();
        assert_eq!(found, [("cutter", 2, 8.0), ("shank", 1, 8.0), ("holder 1", 2, 8.0)]);
        let bodies: Vec<_> = rows.iter().map(|r| r.part_and_fixtures.unwrap().map(|v| v.voxels)).collect();
        assert_eq!(bodies, [[2, 0], [1, 0], [1, 2]]);
    }
}
