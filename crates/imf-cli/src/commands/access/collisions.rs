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

/// In how many unreached voxels an element collides, of one tool or of each voxel's best tool.
struct Tally {
    kind: ElementKind,
    hits: usize,
    alone: usize,
    bodies: [usize; 2],
}

/// What one tool hits: of all that is solid, and of the fixtures.
type Hits<'a> = (&'a ElementMeasures, Option<&'a ElementMeasures>);

/// Counts the elements that collide in voxels that no pose reaches, each with what a tool hits.
fn tally<'a>(
    elements: &[&ElementMeasures],
    unreached: impl Iterator<Item = (Hits<'a>, usize)>,
) -> Vec<Tally> {
    let mut kinds: Vec<ElementKind> = elements.iter().flat_map(|e| e.kinds.iter().copied()).collect();
    kinds.sort_by_key(|kind| kind.order());
    kinds.dedup();
    let mut all: Vec<Tally> =
        kinds.into_iter().map(|kind| Tally { kind, hits: 0, alone: 0, bodies: [0; 2] }).collect();
    for ((elements, fixtures), voxel) in unreached {
        let of = |measures: &ElementMeasures, kind: ElementKind| {
            let place = measures.kinds.iter().position(|&own| own == kind)?;
            Some(measures.values[place][voxel])
        };
        let only = elements.values.iter().filter(|values| values[voxel] > 0.0).count() == 1;
        for own in &mut all {
            let Some(whole) = of(elements, own.kind).filter(|&whole| whole > 0.0) else { continue };
            own.hits += 1;
            own.alone += usize::from(only);
            // Counts over one number: what is more than the fixtures' is the part's.
            let held = fixtures.and_then(|fixtures| of(fixtures, own.kind)).unwrap_or(0.0);
            own.bodies[0] += usize::from(whole > held);
            own.bodies[1] += usize::from(held > 0.0);
        }
    }
    all
}

fn rows(all: &[Tally], voxel_volume: f64, with_fixtures: bool) -> Vec<CollisionRow> {
    let measure = |voxels: usize| Volume::new(voxels, voxel_volume);
    let row = |own: &Tally| CollisionRow {
        element: own.kind.to_string(),
        hits: measure(own.hits),
        alone: measure(own.alone),
        part_and_fixtures: with_fixtures.then(|| own.bodies.map(measure)),
    };
    all.iter().map(row).collect()
}

/// Which elements obstruct the voxels whose measure `imf` is above τ: those of the tool of each; nothing for a mesh.
fn of_unreached(
    run: &AccessRun,
    findings: &Findings,
    elements: &[&ElementMeasures],
    imf: &[f32],
    tool: impl Fn(usize) -> usize,
) -> Vec<CollisionRow> {
    let unreached = |&v: &usize| run.solid.solid[v] == 0 && f64::from(imf[v]) > run.tau;
    let found = (0..imf.len()).filter(unreached).filter_map(|voxel| {
        let tool = tool(voxel);
        Some(((findings.elements.get(tool)?, findings.at_fixtures.get(tool)?.as_ref()), voxel))
    });
    let with_fixtures = findings.at_fixtures.iter().all(Option::is_some);
    rows(&tally(elements, found), run.query.voxel_volume(), with_fixtures)
}

/// Which elements of one tool obstruct the voxels that it does not reach.
pub(super) fn by_tool(run: &AccessRun, findings: &Findings, tool: usize) -> Vec<CollisionRow> {
    of_unreached(run, findings, &[&findings.elements[tool]], &findings.tools[tool].imf.value, |_| tool)
}

/// For every voxel that no tool reaches, which elements of its best tool obstruct it.
pub(super) fn together(run: &AccessRun, findings: &Findings) -> Vec<CollisionRow> {
    let (elements, best) = (findings.elements.iter().collect::<Vec<_>>(), &findings.together);
    of_unreached(run, findings, &elements, &best.imf.value, |voxel| best.tool[voxel] as usize)
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
        let unreached = (0..3).map(|voxel| ((&elements, Some(&fixtures)), voxel));
        let rows = rows(&tally(&[&elements, &other], unreached.chain([((&other, None), 0)])), 8.0, true);
        let found: Vec<_> =
            rows.iter().map(|r| (r.element.as_str(), r.hits.voxels, r.alone.volume)).collect();
        assert_eq!(found, [("cutter", 2, 8.0), ("shank", 1, 8.0), ("holder 1", 2, 8.0)]);
        let bodies: Vec<_> = rows.iter().map(|r| r.part_and_fixtures.unwrap().map(|v| v.voxels)).collect();
        assert_eq!(bodies, [[2, 0], [1, 0], [1, 2]]);
    }
}
