//! Spheres against bytes of distance.

use super::super::SolidVoxels;
use super::{Items, LANES, Piece, Places, SLACK, at, bit};
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
        items.keep(|_, place| !places.collides[at(place)]);
        // Eight bits for eight leaves.
        let mut bits = std::mem::take(&mut items.nearest);
        bits.clear();
        for &(place, piece) in &items.listed {
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
        for &(place, piece) in &items.listed {
            for (leaves, &bits) in pieces[piece as usize].leaves.iter().zip(next.by_ref()) {
                let mut bits = if places.collides[at(place)] { 0 } else { bits };
                while bits != 0 {
                    open.listed.push((place, leaves.first + bits.trailing_zeros()));
                    bits &= bits - 1;
                }
            }
        }
        items.nearest = bits;
    }
}
