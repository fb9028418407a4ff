//! Places at which a tool is tried: one for many samples where a mesh is finer than samples have to be.

use crate::control::{Cancelled, Control};
use crate::mesh::topology::{EdgeUse, NONE, beside};
use crate::parallel;

use super::SurfaceSample;

/// Cosine of the angle by which normals at one place may differ: five degrees.
const NEARLY_ALIKE: f64 = 0.9962;

/// By triangle of a mesh the one in whose middle a tool is tried for it: of connected ones that face nearly alike, no farther than
/// `radius` from the first, that one. A triangle without a sample stands for itself.
pub(super) fn places(edges: &[EdgeUse], samples: &[Option<SurfaceSample>], radius: f64) -> Vec<u32> {
    let beside = beside(edges, samples.len());
    let mut places = vec![NONE; samples.len()];
    let mut waiting = Vec::new();
    for first in 0..samples.len() {
        if places[first] != NONE {
            continue;
        }
        places[first] = first as u32;
        let Some(middle) = &samples[first] else { continue };
        waiting.push(first);
        while let Some(triangle) = waiting.pop() {
            for next in beside[triangle].into_iter().filter(|&next| next != NONE) {
                let Some(sample) = &samples[next as usize] else { continue };
                // A flat facet stands for no curved one.
                let is_alike = sample.normal.dot(middle.normal) > NEARLY_ALIKE
                    && (sample.bend == 0.0) == (middle.bend == 0.0)
                    && sample.point.distance_squared(middle.point) <= radius * radius;
                if is_alike && places[next as usize] == NONE {
                    places[next as usize] = first as u32;
                    waiting.push(next as usize);
                }
            }
        }
    }
    places
}

/// The samples by place.
pub(super) fn by_place(samples: &[SurfaceSample]) -> Vec<&[SurfaceSample]> {
    samples.chunk_by(SurfaceSample::is_tried_with).collect()
}

/// What was found for each run, for each of its items.
pub(super) fn for_each<T, V: Clone>(runs: &[&[T]], found: Vec<V>) -> Vec<V> {
    runs.iter().zip(found).flat_map(|(run, found)| std::iter::repeat_n(found, run.len())).collect()
}

/// What is found for each item, once for those side by side that are `alike`; they are taken in chunks that share a working memory. One
/// unit of progress is one item.
pub(super) fn map_alike<T: Sync, M, V: Clone + Send>(
    items: &[T],
    alike: impl FnMut(&T, &T) -> bool,
    (chunk, control): (usize, Control<'_>),
    memory: impl Fn() -> M + Sync + Send,
    value: impl Fn(&mut M, &T) -> V + Sync + Send,
) -> Result<Vec<V>, Cancelled> {
    let runs: Vec<&[T]> = items.chunk_by(alike).collect();
    let found = parallel::map_in_chunks(&runs, chunk, control, memory, |memory, run| {
        let found = value(memory, &run[0]);
        (control.progress)(run.len() as u64 - 1);
        found
    })?;
    Ok(for_each(&runs, found))
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU64, Ordering};

    use super::*;

    #[test]
    fn what_is_alike_is_found_once_and_counts_as_many() {
        let (found, told) = (AtomicU64::new(0), AtomicU64::new(0));
        let progress = |items: u64| _ = told.fetch_add(items, Ordering::Relaxed);
        let control = Control { progress: &progress, ..Control::quiet() };
        let square = |_: &mut (), &item: &i32| {
            found.fetch_add(1, Ordering::Relaxed);
            item * item
        };
        let items = [1, 1, -1, 2, 2, 2, 3, 1];
        let squares = map_alike(&items, i32::eq, (2, control), || (), square).unwrap();
        assert_eq!(squares, items.map(|item| item * item));
        assert_eq!((found.into_inner(), told.into_inner()), (5, 8));
    }
}
