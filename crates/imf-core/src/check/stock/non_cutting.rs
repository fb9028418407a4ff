//! A body that must not touch the stock: whether it does at a pose, and how deep.

use glam::{DQuat, DVec3};

use super::super::HitBody;
use super::super::deepest::{DeepestCentre, DepthElement, Shape};
use super::super::elements::Track;
use super::super::motions::Step;
use super::voxels::{BLOCK, BitLines, StockScanner, StockVoxels};
use crate::field::solid::BodyLines;
use crate::mesh::distance::distance_to_mesh;
use crate::pose::Pose;
use crate::tool::{Element, snapped};
use crate::voxelize::winding_number;

/// Distance that a test by blocks, and one by voxels, proves between body and stock, in pitches.
const ROOM: [f64; 2] = [4.0, 1.0];
/// From a block's centre to the farthest centre in it, in pitches: three halves along each axis.
const BLOCK_REACH: f64 = 0.5 * (BLOCK - 1) as f64 * 1.732_050_81;
/// Taken off what is proven, in pitches: more than any rounding.
const MARGIN: f64 = 1e-3;

/// How long a body stays away from stock that only becomes less: where the body, offset by some room, holds nothing, it holds
/// nothing as long as no point of it has moved by as much.
pub(super) struct Approach {
    /// The body offset, for blocks and for voxels; none where the outline is too intricate.
    offset: [Option<BodyLines>; 2],
    /// What may still be moved, in the grid's unit.
    free_for: f64,
    /// Poses at which it is not tried again, as it was close at the last try.
    close_for: u32,
}

/// A test costs as much as the body's own check: where the last one found it close, the next follows after this many
/// poses.
const CLOSE_FOR: u32 = 7;

impl Approach {
    pub(super) fn new(element: &Element, pitch: f64) -> Self {
        let by_blocks = element.offset((BLOCK_REACH + ROOM[0]) * pitch);
        let by_voxels = element.offset(ROOM[1] * pitch);
        let offset = [BodyLines::new(&by_blocks, BLOCK as f64 * pitch), BodyLines::new(&by_voxels, pitch)];
        Self { offset, free_for: 0.0, close_for: 0 }
    }

    /// The body's previous place is unknown.
    pub(super) fn forget(&mut self) {
        self.free_for = 0.0;
    }

    /// True where the body surely holds no stock at this pose; it has moved by `moved` since the last.
    pub(super) fn is_away(&mut self, stock: &StockVoxels, pose: &Pose, moved: f64) -> bool {
        self.free_for -= moved;
        if self.free_for > 0.0 {
            return true;
        }
        if self.close_for > 0 {
            self.close_for -= 1;
            return false;
        }
        let [by_blocks, by_voxels] = &self.offset;
        let blocks = stock.blocks();
        let mut free = [by_blocks.is_some(), by_voxels.is_some()];
        if let Some(lines) = by_blocks {
            lines.visit(&blocks.grid, pose, &mut |x, y, from, to| {
                free[0] = !blocks.holds_any(x, y, from, to);
                free[0]
            });
        }
        if let (Some(lines), false) = (by_voxels, free[0]) {
            let line = |x, y, from, to| {
                free[1] = !stock.fine().holds_any(x, y, from, to);
                free[1]
            };
            lines.visit(&stock.fine().grid, pose, &mut StockScanner { stock, line });
        }
        for (room, free) in ROOM.into_iter().zip(free) {
            if free {
                self.free_for = (room - MARGIN) * stock.fine().grid.pitch;
                return true;
            }
        }
        self.close_for = CLOSE_FOR;
        false
    }
}

/// A body that must not touch the stock.
pub(super) struct NonCuttingBody {
    measured: DepthElement,
    /// Of its points that must not hold stock; of a bar around a mesh.
    lines: BodyLines,
    pub(super) approach: Approach,
    /// Distances from the axis between which stock is accepted: where the cutter's own flank has just passed.
    rubs: Option<(f64, f64)>,
}

/// A pose in continuous voxel coordinates.
struct Place {
    tip: DVec3,
    axis: DVec3,
    rotation: DQuat,
    pitch: f64,
}

impl Place {
    fn offset(&self, voxel: [usize; 3]) -> DVec3 {
        (DVec3::from_array(voxel.map(|v| v as f64)) - self.tip) * self.pitch
    }

    /// Height of a voxel's centre on the axis, and its distance from it.
    fn height_and_radius(&self, voxel: [usize; 3]) -> (f64, f64) {
        let offset = self.offset(voxel);
        let height = offset.dot(self.axis);
        (height, (offset.length_squared() - height * height).max(0.0).sqrt())
    }

    /// A voxel's centre in the body's own frame.
    fn local(&self, voxel: [usize; 3]) -> DVec3 {
        self.rotation.conjugate() * self.offset(voxel)
    }
}

impl NonCuttingBody {
    /// Of which only `inner` must hold no stock; of a mesh `inner` is a round bar around it. `None` for an outline that runs cannot be
    /// made of.
    pub(super) fn new(
        measured: DepthElement,
        inner: &Element,
        rubs: Option<(f64, f64)>,
        pitch: f64,
    ) -> Option<Self> {
        let (lines, approach) = (BodyLines::new(inner, pitch)?, Approach::new(inner, pitch));
        Some(Self { measured, lines, approach, rubs })
    }

    /// Tests whether it holds stock (not the part's) at a pose that is not accepted, and how deep.
    pub(super) fn look(
        &mut self,
        stock: &StockVoxels,
        part: &BitLines,
        step: &Step,
        pose: &Pose,
        track: &mut Track,
    ) {
        if !self.approach.is_away(stock, pose, step.length) {
            self.look_closely(stock, part, step, pose, track);
        }
    }

    /// The same where it is not away.
    pub(super) fn look_closely(
        &mut self,
        stock: &StockVoxels,
        part: &BitLines,
        step: &Step,
        pose: &Pose,
        track: &mut Track,
    ) {
        let (grid, Some(axis)) = (&stock.fine().grid, pose.axis()) else { return };
        let (tip, rotation) = (snapped(grid, pose.position), pose.rotation.normalize());
        let place = Place { tip, axis, rotation, pitch: grid.pitch };
        let mut touches = false;
        let line = |x, y, from, to| {
            stock.visit([x, y], from, to, part, &mut |z| {
                touches = self.touches(&place, [x, y, z]);
                !touches
            })
        };
        self.lines.visit(grid, pose, &mut StockScanner { stock, line });
        if !touches || !track.meets(step, grid.pitch) {
            return;
        }
        let mut found = DeepestCentre::default();
        let line = |x, y, from, to| {
            stock.visit([x, y], from, to, part, &mut |z| {
                if self.touches(&place, [x, y, z]) {
                    // The next empty centre is a pitch away, or farther.
                    let in_tool = self.depth(&place, [x, y, z]);
                    found.take(grid.index([x, y, z]), in_tool, 0.5 * grid.pitch);
                }
                true
            })
        };
        self.lines.visit(grid, pose, &mut StockScanner { stock, line });
        track.take(found.depth, || {
            found.collision(&self.measured, &HitBody::Stock, grid, step.fraction, pose)
        });
    }

    /// Of a centre on one of its lines.
    fn touches(&self, place: &Place, voxel: [usize; 3]) -> bool {
        match (&self.measured.shape, self.rubs) {
            (Shape::Mesh(tool), _) => {
                tool.mesh().is_some_and(|mesh| winding_number(mesh, place.local(voxel)).abs() > 0.5)
            }
            (Shape::Revolved(_), None) => true,
            (Shape::Revolved(_), Some((inner, outer))) => {
                let (_, radius) = place.height_and_radius(voxel);
                radius <= inner || radius > outer
            }
        }
    }

    fn depth(&self, place: &Place, voxel: [usize; 3]) -> f64 {
        match &self.measured.shape {
            Shape::Mesh(tool) => tool.mesh().map_or(0.0, |mesh| distance_to_mesh(mesh, place.local(voxel))),
            Shape::Revolved(elements) => {
                let (height, radius) = place.height_and_radius(voxel);
                elements.iter().map(|(own, exposed)| own.depth(height, radius, *exposed)).fold(0.0, f64::max)
            }
        }
    }
}
