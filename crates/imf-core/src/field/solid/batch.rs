//! Many poses at once: bounding and inscribed spheres against a distance field of one byte a voxel, sixteen poses at a time.
//!
//! A pose is free where every bounding sphere is, by a lower bound of the distance at its middle, and colliding where an inscribed
//! sphere holds a solid centre, by an upper bound. The lookups do not depend on each other, and the bytes of a part fit the
//! cache. What is left open, within a voxel or so of contact, is decided pose by pose.

use glam::DVec3;

use super::inscribed::InscribedSpheres;
use super::sphere_tree::SphereTree;
use super::{Body, SolidField};
use crate::parallel::make_once;
use crate::pose::Pose;
use crate::vectorised::vectorised;

/// Poses that are decided together.
const LANES: usize = 16;
/// Poses whose places are retained while both passes visit them.
const BLOCK: usize = 256;
/// Farther from the grid's corner than this, in voxels, single precision is too coarse.
const FARTHEST: f64 = 2000.0;
/// More than all rounding in single precision up to there, in voxels, and than the slack of the tool's predicate.
const SLACK: f32 = 4e-3;

/// Height on the axis, and radius.
type Sphere = [f32; 2];

/// The spheres of one tool.
pub(super) struct BatchSpheres {
    /// Bounding spheres that together cover it, and their pieces.
    around: Vec<Sphere>,
    pieces: Vec<u32>,
    /// Inscribed ones.
    inside: Vec<Sphere>,
    /// Bytes count distances in units of 1/`parts` voxel.
    parts: u32,
}

/// Largest length² over radius of the pieces that get a bounding sphere, and the spacing of inscribed spheres as a
/// fraction of their radius. Few spheres do best: from 15 to 60, and from 1 to 2, uniform poses around the three
/// parts take the same time within a tenth; at 100 they take a third longer, at 0.7 a fifth.
const SLENDER: f64 = 40.0;
const APART: f64 = 1.4;

impl BatchSpheres {
    pub(super) fn new(bodies: &[Body], tree: &SphereTree) -> Self {
        let single = |spheres: Vec<(f64, f64)>| -> Vec<Sphere> {
            spheres.into_iter().map(|(height, radius)| [height as f32, radius as f32]).collect()
        };
        let mut pieces = tree.level(SLENDER);
        // The widest are the first to touch.
        let bound = |index: u32| tree.piece(index).bound;
        pieces.sort_by(|&a, &b| bound(b).radius.total_cmp(&bound(a).radius));
        let around = pieces.iter().map(|&index| bound(index)).map(|sphere| (sphere.middle, sphere.radius));
        let around = single(around.collect());
        let widest = around.iter().map(|sphere| sphere[1]).fold(0.0, f32::max);
        let parts = [8, 4, 2, 1].into_iter().find(|&parts| widest + 1.5 < 255.0 / parts as f32).unwrap_or(1);
        Self { around, pieces, inside: single(InscribedSpheres::new(bodies).apart(APART)), parts }
    }
}

/// The bit of a bounding sphere; all from the last bit's on share it.
fn bit(sphere: usize) -> u32 {
    1 << sphere.min(31)
}

/// Places of up to [`BLOCK`] poses in voxels, each coordinate by itself.
struct Places {
    tip: [[f32; BLOCK]; 3],
    axis: [[f32; BLOCK]; 3],
    /// Which pose each is.
    pose: [u16; BLOCK],
    /// Which bounding spheres are open, by bits.
    open: [u32; BLOCK],
    count: usize,
}

impl Places {
    /// Retains those at which a sphere is open.
    #[inline(always)]
    fn retain(&mut self) {
        let mut kept = 0;
        for lane in 0..self.count {
            if self.open[lane] != 0 {
                for axis in 0..3 {
                    self.tip[axis][kept] = self.tip[axis][lane];
                    self.axis[axis][kept] = self.axis[axis][lane];
                }
                self.pose[kept] = self.pose[lane];
                self.open[kept] = self.open[lane];
                kept += 1;
            }
        }
        self.count = kept;
    }
}

/// What a lookup needs of the bytes.
struct Lookup<'a> {
    bytes: &'a [u8],
    last: [f32; 3],
    strides: [i32; 2],
    part: f32,
}

/// Sixteen spheres' middles: byte of the nearest voxel, squared distance from its centre, and that from the box of centres.
struct NearestVoxels {
    byte: [f32; LANES],
    from_centre: [f32; LANES],
    outside: [f32; LANES],
}

impl Lookup<'_> {
    #[inline(always)]
    fn at(&self, places: &Places, first: usize, height: f32) -> NearestVoxels {
        /// Adding it rounds to whole numbers, which the lowest bits then hold.
        const ROUND: f32 = 12_582_912.0;
        let mut found =
            NearestVoxels { byte: [0.0; LANES], from_centre: [0.0; LANES], outside: [0.0; LANES] };
        let mut index = [0_i32; LANES];
        for axis in 0..3 {
            let tip = &places.tip[axis][first..first + LANES];
            let along = &places.axis[axis][first..first + LANES];
            for lane in 0..LANES {
                let at = tip[lane] + along[lane] * height;
                let held = at.max(0.0).min(self.last[axis]);
                let rounded = held + ROUND;
                let (whole, off) = (rounded - ROUND, at - held);
                let whole_bits = (rounded.to_bits() as i32).wrapping_sub(ROUND.to_bits() as i32);
                found.outside[lane] += off * off;
                found.from_centre[lane] += (held - whole) * (held - whole);
                index[lane] = match axis {
                    0 => whole_bits * self.strides[0],
                    1 => index[lane] + whole_bits * self.strides[1],
                    _ => index[lane] + whole_bits,
                };
            }
        }
        let mut bytes = [0_u8; LANES];
        for lane in 0..LANES {
            bytes[lane] = self.bytes.get(index[lane] as usize).copied().unwrap_or(0);
        }
        for lane in 0..LANES {
            found.byte[lane] = f32::from(bytes[lane]);
        }
        found
    }

    /// Which spheres may hold solid centres, at every place.
    #[inline(always)]
    fn outside(&self, spheres: &[Sphere], places: &mut Places) {
        for first in (0..places.count).step_by(LANES) {
            let mut open = [0_u32; LANES];
            for (index, &[height, radius]) in spheres.iter().enumerate() {
                let bit = bit(index);
                let found = self.at(places, first, height);
                let wide = (radius + SLACK) * (radius + SLACK);
                for lane in 0..LANES {
                    let within = found.byte[lane] * self.part - found.from_centre[lane].sqrt() - SLACK;
                    let within = within.max(0.0);
                    let is_open = found.outside[lane] + within * within <= wide;
                    open[lane] |= if is_open { bit } else { 0 };
                }
            }
            places.open[first..first + LANES].copy_from_slice(&open);
        }
    }

    /// True for every place at which a sphere holds a solid centre.
    #[inline(always)]
    fn inside_any(&self, spheres: &[Sphere], places: &Places, colliding: &mut [bool; BLOCK]) {
        for first in (0..places.count).step_by(LANES) {
            let mut best = [f32::INFINITY; LANES];
            for &[height, radius] in spheres {
                let found = self.at(places, first, height);
                for lane in 0..LANES {
                    // A full byte says nothing of how far it is.
                    let far = if found.byte[lane] < 255.0 && found.outside[lane] == 0.0 {
                        0.0
                    } else {
                        f32::INFINITY
                    };
                    let upper = (found.byte[lane] + 1.0) * self.part + found.from_centre[lane].sqrt() + SLACK;
                    best[lane] = best[lane].min(upper + far - radius);
                }
                if best.iter().fold(f32::NEG_INFINITY, |a, &b| a.max(b)) < 0.0 {
                    break;
                }
            }
            for lane in 0..LANES {
                colliding[first + lane] = best[lane] < 0.0;
            }
        }
    }
}

impl SolidField {
    /// [`SolidField::collides`] of every pose; those for which `colliding` is true already are skipped.
    pub(crate) fn collide_all(&self, poses: &[Pose], colliding: &mut [bool]) {
        let bodies = self.bodies();
        let small = self.reach < 0.5 * FARTHEST * self.voxels.occupancy().grid.pitch;
        if bodies.is_empty() || poses.len() < LANES || !small {
            for (pose, colliding) in poses.iter().zip(colliding).filter(|(_, colliding)| !**colliding) {
                *colliding = self.collides(pose);
            }
            return;
        }
        let spheres = make_once(&self.batch, || BatchSpheres::new(bodies, self.spheres(bodies)));
        let bytes = self.voxels.bytes(spheres.parts);
        let dims = self.voxels.occupancy().grid.dims;
        let lookup = Lookup {
            bytes,
            last: dims.map(|n| (n - 1) as f32),
            strides: [(dims[1] * dims[2]) as i32, dims[2] as i32],
            part: 1.0 / spheres.parts as f32,
        };
        for (poses, colliding) in poses.chunks(BLOCK).zip(colliding.chunks_mut(BLOCK)) {
            self.collide_block(spheres, &lookup, poses, colliding);
        }
    }

    fn collide_block(
        &self,
        spheres: &BatchSpheres,
        lookup: &Lookup<'_>,
        poses: &[Pose],
        colliding: &mut [bool],
    ) {
        let mut places = Places {
            tip: [[0.0; BLOCK]; 3],
            axis: [[0.0; BLOCK]; 3],
            pose: [0; BLOCK],
            open: [0; BLOCK],
            count: 0,
        };
        let bodies = self.bodies();
        let mut verdict = [false; BLOCK];
        let grid = &self.voxels.occupancy().grid;
        let (origin, per_pitch) = (grid.origin + 0.5 * grid.pitch, 1.0 / grid.pitch);
        for (index, pose) in poses.iter().enumerate() {
            if colliding[index] {
                continue;
            }
            let tip = (pose.position - origin) * per_pitch;
            let q = pose.rotation;
            let squared = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w;
            let near = tip.abs().cmplt(DVec3::splat(FARTHEST)).all();
            // Far ones, invalid ones, and those with a rotation that is not nearly of length 1, one by one.
            if !(near && (squared - 1.0).abs() < 1e-6) {
                colliding[index] = self.collides(pose);
                continue;
            }
            let axis = DVec3::new(
                2.0 * (q.x * q.z + q.w * q.y),
                2.0 * (q.y * q.z - q.w * q.x),
                q.w * q.w + q.z * q.z - q.x * q.x - q.y * q.y,
            );
            let lane = places.count;
            for a in 0..3 {
                places.tip[a][lane] = tip[a] as f32;
                places.axis[a][lane] = axis[a] as f32;
            }
            places.pose[lane] = index as u16;
            places.count += 1;
        }
        vectorised!(self.arch, lookup.outside(&spheres.around, &mut places));
        places.retain();
        vectorised!(self.arch, lookup.inside_any(&spheres.inside, &places, &mut verdict));
        for lane in 0..places.count {
            let index = usize::from(places.pose[lane]);
            let is_open = |sphere: usize| places.open[lane] & bit(sphere) != 0;
            let open = spheres.pieces.iter().enumerate().filter(|&(sphere, _)| is_open(sphere));
            let pieces = open.map(|(_, &piece)| piece);
            colliding[index] = verdict[lane]
                || self
                    .placed(&poses[index])
                    .is_none_or(|placed| self.bodies_collide(bodies, placed, None, pieces, None));
        }
    }
}
