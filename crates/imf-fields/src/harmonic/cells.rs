//! Orientations in cells around evenly spread centres: what a search looks at first, and what it looks at then.

use rayon::prelude::*;

use super::basis::Domain;
use imf_core::orientation::Orientation;

/// Every orientation of a set in the cell of the centre nearest to it.
pub(super) struct Cells {
    /// Indices of orientations; any first part of them is spread evenly as well.
    pub(super) centres: Vec<u32>,
    /// Indices of all orientations, cell by cell.
    pub(super) members: Vec<u32>,
    /// `[cells + 1]`: where the members of each begin.
    pub(super) starts: Vec<usize>,
}

/// Orientations whose cosine is this near 1 are one.
const SAME: f32 = 1.0 - 1e-7;
/// Orientations that one thread compares at a time.
const PART: usize = 2048;

impl Cells {
    /// At most `count` cells: each centre is the orientation farthest from all centres before it.
    pub(super) fn new(orientations: &[Orientation], domain: Domain, count: usize) -> Self {
        let places: Vec<[f32; 9]> = orientations.iter().map(|o| place(o, domain)).collect();
        // How near the nearest centre is, and which it is.
        let mut nearest = vec![(f32::NEG_INFINITY, 0u32); places.len()];
        let mut centres = Vec::with_capacity(count);
        let mut next = 0;
        while centres.len() < count.min(places.len()) {
            let (cell, centre) = (centres.len() as u32, places[next]);
            centres.push(next as u32);
            let parts = nearest.par_chunks_mut(PART).zip(places.par_chunks(PART)).enumerate();
            let farthest = parts.map(|(part, (nearest, places))| {
                let mut farthest = (f32::INFINITY, 0);
                for (index, (nearest, place)) in nearest.iter_mut().zip(places).enumerate() {
                    let cosine: f32 = place.iter().zip(&centre).map(|(a, b)| a * b).sum();
                    if cosine > nearest.0 {
                        *nearest = (cosine, cell);
                    }
                    if nearest.0 < farthest.0 {
                        farthest = (nearest.0, part * PART + index);
                    }
                }
                farthest
            });
            // The first of equally far ones, whatever the number of threads.
            let none = || (f32::INFINITY, usize::MAX);
            let farthest = farthest.reduce(none, |a, b| if (b.0, b.1) < (a.0, a.1) { b } else { a });
            if farthest.0 >= SAME {
                break;
            }
            next = farthest.1;
        }
        let mut members: Vec<u32> = (0..places.len() as u32).collect();
        members.sort_by_key(|&index| nearest[index as usize].1);
        let cells = 0..=centres.len() as u32;
        let starts =
            cells.map(|cell| members.partition_point(|&index| nearest[index as usize].1 < cell)).collect();
        Self { centres, members, starts }
    }

    /// The orientations of a cell.
    pub(super) fn of(&self, cell: usize) -> std::ops::Range<usize> {
        self.starts[cell]..self.starts[cell + 1]
    }
}

/// A point of a unit sphere; the nearer two orientations, the larger their points' product.
fn place(orientation: &Orientation, domain: Domain) -> [f32; 9] {
    let mut place = [0.0; 9];
    match domain {
        Domain::Directions => {
            place[..3].copy_from_slice(&orientation.direction().as_vec3().to_array());
        }
        Domain::Rotations => {
            let scale = 1.0 / 3f64.sqrt();
            place = orientation.rotation().to_cols_array().map(|v| (v * scale) as f32);
        }
    }
    place
}

#[cfg(test)]
mod tests {
    use super::*;
    use imf_core::orientation::OrientationSet;

    #[test]
    fn every_orientation_is_in_the_cell_of_its_nearest_centre() {
        for (spec, domain) in [("fibonacci:700", Domain::Directions), ("so3:700", Domain::Rotations)] {
            let set = OrientationSet::parse(spec).unwrap().orientations;
            let cells = Cells::new(&set, domain, 70);
            assert_eq!((cells.centres.len(), cells.starts.len()), (70, 71));
            let mut all = cells.members.clone();
            all.sort_unstable();
            assert_eq!(all, (0..700).collect::<Vec<_>>());
            let cosine = |a: u32, b: u32| {
                let [a, b] = [a, b].map(|index| place(&set[index as usize], domain));
                a.iter().zip(&b).map(|(a, b)| a * b).sum::<f32>()
            };
            for cell in 0..70 {
                assert!(cells.members[cells.of(cell)].contains(&cells.centres[cell]));
                for &member in &cells.members[cells.of(cell)] {
                    let own = cosine(member, cells.centres[cell]);
                    assert!(cells.centres.iter().all(|&centre| cosine(member, centre) <= own + 1e-6));
                }
            }
            // Each centre was the farthest orientation when it was chosen, so no two centres are nearer to each other than
            // an orientation may be to its own.
            let pairs = (1..70).flat_map(|a| (0..a).map(move |b| (a, b)));
            let nearest = pairs.map(|(a, b)| cosine(cells.centres[a], cells.centres[b])).fold(-1.0, f32::max);
            let own = |cell: usize| cells.members[cells.of(cell)].iter().map(move |&member| (member, cell));
            let farthest = (0..70).flat_map(own).map(|(member, cell)| cosine(member, cells.centres[cell]));
            let farthest = farthest.fold(1.0, f32::min);
            assert!(nearest <= farthest + 1e-6, "{spec}: {nearest} {farthest}");
        }
    }

    #[test]
    fn orientations_that_are_one_share_a_cell() {
        let set = OrientationSet::parse("grid:4").unwrap().orientations;
        let cells = Cells::new(&set, Domain::Directions, 100);
        // The pole four times, and four directions at each of three angles; none at 180°.
        assert_eq!((cells.centres.len(), cells.of(0).len()), (13, 4));
    }
}
