//! Whether bodies hold a solid centre: by the sphere tree, and by a count of what it leaves open.

use super::runs::{Lines, Within, count, first_solid};
use super::segment::{PlacedSegment, VoxelPose};
use super::sphere_tree::{FreeBall, OPEN, Piece, Verdict};
use super::{Body, SolidField};

impl SolidField {
    /// Whether these pieces hold a solid centre, each on the lines that `lines` says; the rest of the tool must be known to be free. `last` is a voxel to try first, and becomes one that is found in the tool.
    #[inline]
    pub(super) fn bodies_collide(
        &self,
        bodies: &[Body],
        placed: VoxelPose,
        free_ball: Option<&FreeBall>,
        pieces: impl Iterator<Item = u32>,
        lines: impl Fn(u32) -> Lines,
        last: Option<&mut Option<[f64; 3]>>,
    ) -> bool {
        let contains = |voxel: [f64; 3]| bodies.iter().any(|body| placed.contains(&body.profile, voxel));
        if !placed.tip.is_finite() || last.as_ref().is_some_and(|last| last.is_some_and(contains)) {
            return true;
        }
        let mut open = [0; OPEN];
        match self.spheres(bodies).decide(
            placed,
            bodies,
            self.voxels.distances(),
            free_ball,
            pieces,
            &mut open,
        ) {
            Verdict::Free => false,
            Verdict::Colliding(voxel) => {
                if let Some(last) = last {
                    *last = Some(voxel);
                }
                true
            }
            Verdict::Undecided => bodies.iter().any(|body| self.body_count(body, placed, true) > 0),
            Verdict::Open(found) => {
                let pieces =
                    open[..found].iter().map(|&index| (self.spheres(bodies).piece(index), lines(index)));
                let mut pieces = pieces.peekable();
                while let Some((piece, mut lines)) = pieces.next() {
                    // What lies side by side is counted together: as wide, it mostly lies on the same lines.
                    let mut from = piece.from;
                    while let Some((next, more)) = pieces.next_if(|(next, _)| next.is_below(piece, from)) {
                        (from, lines) = (next.from, lines.join(more));
                    }
                    let segment = open_segment(bodies, placed, piece, from);
                    let within = Within::Obstacle(self.voxels.columns(), lines);
                    if count(self.arch, &segment, within, true) > 0 {
                        if let Some(last) = last {
                            *last = first_solid(&segment, self.voxels.columns());
                        }
                        return true;
                    }
                }
                false
            }
        }
    }
}

/// What the spheres left open of one segment: from a height to a piece's upper end.
fn open_segment<'a>(bodies: &'a [Body], placed: VoxelPose, piece: &Piece, from: f64) -> PlacedSegment<'a> {
    let body = &bodies[piece.body];
    let (world, part) = (&body.profile[piece.segment], &body.parts[piece.segment]);
    // A little over either end, as far as the segment reaches: the next piece's sphere covers its own
    // heights only up to rounding.
    let (lowest, highest) = part.segment.range();
    let (from, to) = ((from - 1e-4).max(lowest), (piece.to + 1e-4).min(highest));
    PlacedSegment::new(placed, world, &part.segment, part.widest, from, to)
}
