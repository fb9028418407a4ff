//! Spheres against bytes of distance.

use super::super::SolidVoxels;
use super::{Items, LANES, Piece, Places, SLACK, at, bit, keep_items};
use crate::distance::DistanceField;

/// Short pieces that are tried together.
pub(super) const LEAVES: usize = 8;

/// A sphere that bounds a piece of the tool, and one inscribed in the tool, around one point of the axis; in voxels.
#[derive(Clone, Copy)]
pub(super) struct Sphere {
    pub(super) height: f32,
    pub(super) around: f32,
    pub(super) inside: f32,
}

/// Eight short pieces; the last comes more than once where there are fewer.
pub(super) struct Leaves {
    first: u32,
    count: u32,
    height: [f32; LEAVES],
    around: [f32; LEAVES],
    inside: [f32; LEAVES],
}

impl Leaves {
    /// Of up to eight pieces, which are listed from `first` on.
    pub(super) fn new(first: u32, leaves: &[Sphere]) -> Self {
        let spheres: [Sphere; LEAVES] = std::array::from_fn(|leaf| leaves[leaf.min(leaves.len() - 1)]);
        Self {
            first,
            count: leaves.len() as u32,
            height: spheres.map(|sphere| sphere.height),
            around: spheres.map(|sphere| sphere.around),
            inside: spheres.map(|sphere| sphere.inside),
        }
    }
}

/// What lookups need of the voxels.
pub(super) struct Lookup<'a> {
    pub(super) distances: &'a DistanceField,
    bytes: &'a [u8],
    last: [f32; 3],
    strides: [i32; 2],
    pub(super) part: f32,
}

/// Several spheres' middles: place in the grid of the nearest voxel, its byte, squared distance from its centre, and that from the
/// box of centres.
pub(super) struct NearestVoxels<const N: usize> {
    index: [i32; N],
    byte: [f32; N],
    from_centre: [f32; N],
    outside: [f32; N],
}

impl<const N: usize> NearestVoxels<N> {
    /// True where a sphere may hold a solid centre.
    #[inline(always)]
    pub(super) fn may_hold(&self, lane: usize, radius: f32, part: f32) -> bool {
        let wide = (radius + SLACK) * (radius + SLACK);
        let within = (self.byte[lane] * part - self.from_centre[lane].sqrt() - SLACK).max(0.0);
        self.outside[lane] + within * within <= wide
    }

    /// True where a sphere holds a solid centre.
    #[inline(always)]
    fn holds(&self, lane: usize, radius: f32, part: f32) -> bool {
        let upper = (self.byte[lane] + 1.0) * part + self.from_centre[lane].sqrt() + SLACK;
        // A full byte says nothing of how far it is.
        (upper < radius) & (self.byte[lane] < 255.0) & (self.outside[lane] == 0.0)
    }
}

/// Points of the axes of sixteen places, from one place on.
#[inline(always)]
fn on_axes(places: &Places, from: usize, height: f32) -> [[f32; LANES]; 3] {
    let mut middle = [[0.0; LANES]; 3];
    for axis in 0..3 {
        let tip = &places.tip[axis][from..from + LANES];
        let along = &places.axis[axis][from..from + LANES];
        for lane in 0..LANES {
            middle[axis][lane] = tip[lane] + along[lane] * height;
        }
    }
    middle
}

impl<'a> Lookup<'a> {
    pub(super) fn new(voxels: &'a SolidVoxels, parts: u32) -> Self {
        let dims = voxels.occupancy().grid.dims;
        Self {
            distances: voxels.distances(),
            bytes: voxels.bytes(parts),
            last: dims.map(|n| (n - 1) as f32),
            strides: [(dims[1] * dims[2]) as i32, dims[2] as i32],
            part: 1.0 / parts as f32,
        }
    }

    #[inline(always)]
    fn index<const N: usize>(&self, middle: [[f32; N]; 3]) -> NearestVoxels<N> {
        /// Adding it rounds to whole numbers, which the lowest bits then hold.
        const ROUND: f32 = 12_582_912.0;
        let mut found =
            NearestVoxels { index: [0; N], byte: [0.0; N], from_centre: [0.0; N], outside: [0.0; N] };
        for axis in 0..3 {
            for lane in 0..N {
                let at = middle[axis][lane];
                let held = at.max(0.0).min(self.last[axis]);
                let rounded = held + ROUND;
                let (whole, off) = (rounded - ROUND, at - held);
                let whole_bits = (rounded.to_bits() as i32).wrapping_sub(ROUND.to_bits() as i32);
                found.outside[lane] += off * off;
                found.from_centre[lane] += (held - whole) * (held - whole);
                found.index[lane] = match axis {
                    0 => whole_bits * self.strides[0],
                    1 => found.index[lane] + whole_bits * self.strides[1],
                    _ => found.index[lane] + whole_bits,
                };
            }
        }
        found
    }

    #[inline(always)]
    pub(super) fn at<const N: usize>(&self, middle: [[f32; N]; 3]) -> NearestVoxels<N> {
        let mut found = self.index(middle);
        /// The lowest bits of this number's hold whole numbers.
        const WHOLE: f32 = 8_388_608.0;
        let mut bits = [0_u32; N];
        for lane in 0..N {
            let byte = self.bytes.get(found.index[lane] as usize).copied().unwrap_or(0);
            bits[lane] = WHOLE.to_bits() | u32::from(byte);
        }
        for lane in 0..N {
            found.byte[lane] = f32::from_bits(bits[lane]) - WHOLE;
        }
        found
    }

    /// Which pieces are open at every place, and which places are known to collide.
    #[inline(always)]
    pub(super) fn try_pieces(&self, pieces: &[Piece], places: &mut Places) {
        for from in (0..places.count).step_by(LANES) {
            let (mut open, mut collides) = ([0_u32; LANES], [0_u32; LANES]);
            for (index, &Piece { sphere, .. }) in pieces.iter().enumerate() {
                let bit = bit(index);
                let found = self.at(on_axes(places, from, sphere.height));
                for lane in 0..LANES {
                    open[lane] |= if found.may_hold(lane, sphere.around, self.part) { bit } else { 0 };
                    collides[lane] |= u32::from(found.holds(lane, sphere.inside, self.part));
                }
            }
            places.open[from..from + LANES].copy_from_slice(&open);
            for lane in 0..LANES {
                places.collides[from + lane] = collides[lane] != 0;
            }
        }
    }

    /// Finds the solid voxel nearest to the middle of every item, of which `height` gives the height.
    #[inline(always)]
    pub(super) fn find_nearest(&self, items: &mut Items, height: impl Fn(usize) -> f32, places: &Places) {
        items.nearest.clear();
        for listed in items.listed.chunks(LANES) {
            let mut middle = [[0.0; LANES]; 3];
            for (lane, &(place, piece)) in listed.iter().enumerate() {
                let (place, height) = (at(place), height(piece as usize));
                for axis in 0..3 {
                    middle[axis][lane] = places.tip[axis][place] + places.axis[axis][place] * height;
                }
            }
            let index = self.index(middle).index;
            items.nearest.extend_from_slice(&index.map(|index| index as u32)[..listed.len()]);
        }
        // The reads, which the inner caches do not hold, wait for nothing but themselves.
        for nearest in &mut items.nearest {
            *nearest = self.distances.nearest_or_none(*nearest as usize);
        }
    }

    /// Tries the short pieces of every item whose place is not known to collide, and lists those that stay open.
    #[inline(always)]
    pub(super) fn try_leaves(
        &self,
        pieces: &[Piece],
        items: &mut Items,
        places: &mut Places,
        open: &mut Items,
    ) {
        // Eight bits for eight leaves.
        let Items { listed, bits, .. } = items;
        keep_items(listed, |_, place| !places.collides[at(place)]);
        bits.clear();
        for &(place, piece) in &*listed {
            let place = at(place);
            for leaves in &pieces[piece as usize].leaves {
                let mut middle = [[0.0; LEAVES]; 3];
                for axis in 0..3 {
                    let (tip, along) = (places.tip[axis][place], places.axis[axis][place]);
                    for leaf in 0..LEAVES {
                        middle[axis][leaf] = tip + along * leaves.height[leaf];
                    }
                }
                let found = self.at(middle);
                let (mut may_hold, mut holds) = ([0_u32; LEAVES], [0_u32; LEAVES]);
                for leaf in 0..LEAVES {
                    may_hold[leaf] = u32::from(found.may_hold(leaf, leaves.around[leaf], self.part)) << leaf;
                    holds[leaf] = u32::from(found.holds(leaf, leaves.inside[leaf], self.part));
                }
                places.collides[place] |= holds.iter().fold(0, |a, b| a | b) != 0;
                bits.push(may_hold.iter().fold(0, |a, b| a | b) & ((1 << leaves.count) - 1));
            }
        }
        open.listed.clear();
        let mut next = bits.iter();
        for &(place, piece) in &*listed {
            for (leaves, &bits) in pieces[piece as usize].leaves.iter().zip(next.by_ref()) {
                let mut bits = if places.collides[at(place)] { 0 } else { bits };
                while bits != 0 {
                    open.listed.push((place, leaves.first + bits.trailing_zeros()));
                    bits &= bits - 1;
                }
            }
        }
    }

    /// Keeps the items whose places are not known to collide and whose spheres may hold a solid centre, by all voxels around their
    /// middles, as [`DistanceField::squared_around`] has it.
    #[inline(always)]
    pub(super) fn keep_near(&self, items: &mut Items, sphere: impl Fn(usize) -> Sphere, places: &Places) {
        let Items { listed, bits: near, .. } = items;
        keep_items(listed, |_, place| !places.collides[at(place)]);
        near.clear();
        for listed in listed.chunks(LANES) {
            let (mut middle, mut wide) = ([[0.0; LANES]; 3], [0.0; LANES]);
            for (lane, &(place, piece)) in listed.iter().enumerate() {
                let (place, sphere) = (at(place), sphere(piece as usize));
                wide[lane] = sphere.around + SLACK;
                for axis in 0..3 {
                    middle[axis][lane] = places.tip[axis][place] + places.axis[axis][place] * sphere.height;
                }
            }
            // Of the two voxels beside each coordinate: how far on from the grid's corner they are, and their weights.
            let (mut low, mut up) = ([[0_i32; LANES]; 3], [[0_i32; LANES]; 3]);
            let mut part = [[0.0_f32; LANES]; 3];
            let (mut spread, mut outside) = ([0.0_f32; LANES], [0.0_f32; LANES]);
            for axis in 0..3 {
                let stride = if axis == 2 { 1 } else { self.strides[axis] };
                for lane in 0..LANES {
                    let held = middle[axis][lane].max(0.0).min(self.last[axis]);
                    let off = middle[axis][lane] - held;
                    let whole = held as i32;
                    let rest = held - whole as f32;
                    low[axis][lane] = whole * stride;
                    up[axis][lane] = if (whole as f32) < self.last[axis] { stride } else { 0 };
                    part[axis][lane] = rest;
                    spread[lane] += rest * (1.0 - rest);
                    outside[lane] += off * off;
                }
            }
            let mut inside = [0.0; LANES];
            for corner in 0..8 {
                let upper = [corner >> 2 & 1, corner >> 1 & 1, corner & 1];
                let (mut index, mut weight) = ([0; LANES], [1.0; LANES]);
                for axis in 0..3 {
                    for lane in 0..LANES {
                        let on = part[axis][lane];
                        weight[lane] *= if upper[axis] == 1 { on } else { 1.0 - on };
                        index[lane] += low[axis][lane] + upper[axis] * up[axis][lane];
                    }
                }
                let mut away = [0.0; LANES];
                for lane in 0..LANES {
                    away[lane] = self.distances.to_solid(index[lane] as usize);
                }
                for lane in 0..LANES {
                    inside[lane] += weight[lane] * (away[lane] * away[lane]);
                }
            }
            let mut holds = [0; LANES];
            for lane in 0..LANES {
                let squared = outside[lane] + (inside[lane] - spread[lane]).max(0.0);
                holds[lane] = u32::from(squared <= wide[lane] * wide[lane]);
            }
            near.extend_from_slice(&holds[..listed.len()]);
        }
        keep_items(listed, |index, _| near[index] != 0);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DVec3;

    use super::super::{BLOCK, Items};
    use super::*;
    use crate::grid::Grid;
    use crate::occupancy::Occupancy;

    #[test]
    fn near_spheres_are_those_of_the_bound_around_their_middles() {
        let grid = Grid { origin: DVec3::ZERO, pitch: 1.0, dims: [23, 19, 27] };
        let solid = |voxel| grid.index(voxel).wrapping_mul(2_654_435_761) >> 9 & 127 == 0;
        let occupancy = Occupancy::of(grid, solid);
        let voxels = SolidVoxels::from(Arc::new(occupancy));
        let lookup = Lookup::new(&voxels, 8);
        let mut places = Places { count: BLOCK, ..Places::EMPTY };
        let mut items = Items::default();
        for place in 0..BLOCK {
            let put = |step: f64| ((place as f64 * step).fract() * 40.0 - 8.0) as f32;
            for (axis, step) in [0.618, 0.755, 0.57].into_iter().enumerate() {
                places.tip[axis][place] = put(step);
                places.axis[axis][place] = 0.577_350_26;
            }
            places.collides[place] = place % 5 == 0;
            items.listed.push((place as u16, (place % 7) as u32));
        }
        // One on a voxel, one on the last corner.
        for axis in 0..3 {
            places.tip[axis][1] = 3.0 - 0.577_350_26;
            places.tip[axis][2] = lookup.last[axis] - 2.0 * 0.577_350_26;
        }
        let sphere = |piece: usize| Sphere { height: piece as f32, around: 0.4 + piece as f32, inside: 0.0 };
        let listed = items.listed.clone();
        lookup.keep_near(&mut items, sphere, &places);
        let mut kept = items.listed.iter().peekable();
        let mut far = 0;
        for item in listed.iter().filter(|(place, _)| place % 5 != 0) {
            let (place, sphere) = (usize::from(item.0), sphere(item.1 as usize));
            let middle = [0, 1, 2].map(|a| places.tip[a][place] + places.axis[a][place] * sphere.height);
            let bound = lookup.distances.squared_around(DVec3::from_array(middle.map(f64::from))).sqrt();
            let beyond = bound - f64::from(sphere.around);
            match kept.next_if(|kept| *kept == item) {
                Some(_) => assert!(beyond < 0.01, "{item:?} at {middle:?}: {beyond}"),
                None => assert!(beyond > 0.0, "{item:?} at {middle:?}: {beyond}"),
            }
            far += usize::from(beyond > 0.0);
        }
        assert!(kept.next().is_none() && far > 50 && items.listed.len() > 50, "{far}");
    }
}
