//! One tool among the stock: what its cutter takes, and what of it must not touch.

use glam::DVec3;

use super::super::elements::{DeepestCentre, DepthElement, Shape, Step, Track};
use super::super::motions::Motion;
use super::super::{CheckError, CheckSettings, Collision, HitBody};
use super::voxels::{BLOCK, BitLines, StockVoxels};
use crate::field::solid::BodyLines;
use crate::pose::Pose;
use crate::tool::{Element, ElementKind, Tool, ToolShape, snapped};

/// How far a body is away for sure where it is looked at by blocks, and by voxels, in pitches.
const ROOM: [f64; 2] = [4.0, 1.0];
/// From a block's centre to the farthest centre in it, in pitches: three halves along each axis.
const BLOCK_REACH: f64 = 0.5 * (BLOCK - 1) as f64 * 1.732_050_81;
/// Taken off what is proven, in pitches: more than any rounding.
const MARGIN: f64 = 1e-3;

/// How long a body stays away from stock that only becomes less: where the body, offset by some room, holds nothing, it holds
/// nothing as long as no point of it has moved by as much.
struct Approach {
    /// The body offset, for blocks and for voxels; none where the outline is too intricate.
    offset: [Option<BodyLines>; 2],
    /// What may still be moved, in the grid's unit.
    free_for: f64,
}

impl Approach {
    fn new(element: &Element, pitch: f64) -> Self {
        let by_blocks = element.offset((BLOCK_REACH + ROOM[0]) * pitch);
        let by_voxels = element.offset(ROOM[1] * pitch);
        let offset = [BodyLines::new(&by_blocks, BLOCK as f64 * pitch), BodyLines::new(&by_voxels, pitch)];
        Self { offset, free_for: 0.0 }
    }

    /// True where the body surely holds no stock at this pose, to which it has moved so far.
    fn is_away(&mut self, stock: &StockVoxels, pose: &Pose, moved: f64) -> bool {
        self.free_for -= moved;
        if self.free_for > 0.0 {
            return true;
        }
        let levels = [stock.blocks(), stock.fine()].into_iter().zip(&self.offset).zip(ROOM);
        for ((level, lines), room) in levels {
            let Some(lines) = lines else { continue };
            let mut free = true;
            lines.visit(&level.grid, pose, &mut |x, y, from, to| {
                free = !level.holds_any(x, y, from, to);
                free
            });
            if free {
                self.free_for = (room - MARGIN) * stock.fine().grid.pitch;
                return true;
            }
        }
        false
    }
}

/// A body of the tool that must not touch the stock.
struct Guard {
    element: Element,
    measured: DepthElement,
    lines: BodyLines,
    approach: Approach,
    /// Distances from the axis between which stock is let be: where the cutter's own flank has just passed.
    rubs: Option<(f64, f64)>,
}

/// The cutter: what it holds goes.
struct Cutter {
    element: Element,
    /// Its upper end is surface.
    exposed: bool,
    lines: BodyLines,
    approach: Approach,
    /// Its points deeper than what is accepted, which a rapid must keep out of the stock.
    deep: BodyLines,
    rapid: Approach,
}

/// The bodies of one tool.
pub(super) struct StockTool {
    cutter: Option<Cutter>,
    guards: Vec<Guard>,
}

/// Of a pose, in continuous voxel coordinates.
struct Place {
    tip: DVec3,
    axis: DVec3,
    pitch: f64,
}

impl Place {
    fn of(stock: &StockVoxels, pose: &Pose) -> Option<Self> {
        let grid = &stock.fine().grid;
        Some(Self { tip: snapped(grid, pose.position), axis: pose.axis()?, pitch: grid.pitch })
    }

    /// Height of a voxel's centre on the axis, and its distance from it.
    fn height_and_radius(&self, voxel: [usize; 3]) -> (f64, f64) {
        let offset = (DVec3::from_array(voxel.map(|v| v as f64)) - self.tip) * self.pitch;
        let height = offset.dot(self.axis);
        (height, (offset.length_squared() - height * height).max(0.0).sqrt())
    }
}

impl StockTool {
    pub(super) fn new(tool: &Tool, settings: &CheckSettings, pitch: f64) -> Result<Self, CheckError> {
        let ToolShape::Revolved(elements) = &tool.shape else {
            return Err(CheckError::StockMesh(tool.name.clone()));
        };
        let intricate = || CheckError::Outline(tool.name.clone());
        let accepted = settings.accepted_in_stock();
        let cutter = match tool.cutter() {
            None => None,
            Some((element, exposed)) => {
                let contact = settings.contact;
                let deep = element
                    .eroded(accepted, exposed)
                    .ok_or_else(|| CheckError::Contact { tool: tool.name.clone(), contact })?;
                Some(Cutter {
                    lines: BodyLines::new(&element, pitch).ok_or_else(intricate)?,
                    approach: Approach::new(&element, pitch),
                    deep: BodyLines::new(&deep, pitch).ok_or_else(intricate)?,
                    rapid: Approach::new(&deep, pitch),
                    element,
                    exposed,
                })
            }
        };
        let widest = cutter.as_ref().map(|cutter| cutter.element.max_radius());
        let offset = tool.offset_elements(&settings.clearance)?;
        let stay_out = elements.iter().zip(offset).filter(|(own, _)| own.kind != ElementKind::Cutter);
        let guard = |(own, element): (&Element, Element)| {
            let clearance = settings.clearance.of(own.kind);
            let name = own.kind.to_string();
            let shape = Shape::Revolved(vec![(element.clone(), true)]);
            let rubs = widest.filter(|_| own.kind == ElementKind::Shank && clearance == 0.0);
            Ok(Guard {
                measured: DepthElement { name, clearance, shape },
                lines: BodyLines::new(&element, pitch).ok_or_else(intricate)?,
                approach: Approach::new(&element, pitch),
                rubs: rubs.map(|widest| (widest - accepted, widest + settings.contact)),
                element,
            })
        };
        let guards = stay_out.map(guard).collect::<Result<_, CheckError>>()?;
        Ok(Self { cutter, guards })
    }

    /// The path begins anew: nothing is known of where the tool was.
    pub(super) fn begin(&mut self) {
        let cutter = self.cutter.iter_mut().map(|cutter| &mut cutter.approach);
        cutter.chain(self.guards.iter_mut().map(|guard| &mut guard.approach)).for_each(|a| a.free_for = 0.0);
    }

    /// What the cutter holds of the stock beside the part at a motion at rapid rate, nothing being taken. `begins` where the
    /// motion before was none of these.
    pub(super) fn rapid(
        &mut self,
        motion: &Motion<'_>,
        stock: &StockVoxels,
        part: &BitLines,
        begins: bool,
    ) -> Option<Collision> {
        let Cutter { element, exposed, deep, rapid, .. } = self.cutter.as_mut()?;
        if begins {
            rapid.free_for = 0.0;
        }
        let name = ElementKind::Cutter.to_string();
        let shape = Shape::Revolved(vec![(element.clone(), *exposed)]);
        let measured = DepthElement { name, clearance: 0.0, shape };
        let mut track = Track::default();
        for (index, (fraction, pose)) in (1..).zip(motion.poses()) {
            if rapid.is_away(stock, &pose, motion.step) {
                continue;
            }
            let step = Step { index, fraction, is_last: index == motion.count, length: motion.step };
            follow(deep, &measured, (element, *exposed), None, stock, part, &step, &pose, &mut track);
        }
        track.finish()
    }

    /// Looks at what must not touch at every pose of a motion, and takes away what the cutter holds there.
    pub(super) fn cut(
        &mut self,
        motion: &Motion<'_>,
        stock: &mut StockVoxels,
        part: &BitLines,
        taken: &mut impl FnMut(usize, u64),
    ) -> Vec<Collision> {
        let mut tracks: Vec<Track> = self.guards.iter().map(|_| Track::default()).collect();
        for (index, (fraction, pose)) in (1..).zip(motion.poses()) {
            let step = Step { index, fraction, is_last: index == motion.count, length: motion.step };
            for (guard, track) in self.guards.iter_mut().zip(&mut tracks) {
                let Guard { element, measured, lines, approach, rubs } = guard;
                if !approach.is_away(stock, &pose, motion.step) {
                    follow(lines, measured, (element, true), *rubs, stock, part, &step, &pose, track);
                }
            }
            let Some(cutter) = &mut self.cutter else { continue };
            if !cutter.approach.is_away(stock, &pose, motion.step) {
                let grid = stock.fine().grid;
                cutter.lines.visit(&grid, &pose, &mut |x, y, from, to| {
                    stock.take([x, y], from, to, taken);
                    true
                });
            }
        }
        tracks.into_iter().filter_map(Track::finish).collect()
    }
}

/// Whether a body holds stock beside the part at a pose that is not let be, and how deep.
fn follow(
    lines: &BodyLines,
    measured: &DepthElement,
    (element, exposed): (&Element, bool),
    rubs: Option<(f64, f64)>,
    stock: &StockVoxels,
    part: &BitLines,
    step: &Step,
    pose: &Pose,
    track: &mut Track,
) {
    let grid = &stock.fine().grid;
    let Some(place) = Place::of(stock, pose) else { return };
    let is_let = |radius: f64| rubs.is_some_and(|(inner, outer)| inner < radius && radius <= outer);
    let mut touches = false;
    lines.visit(grid, pose, &mut |x, y, from, to| {
        stock.visit([x, y], from, to, part, &mut |z| {
            touches = rubs.is_none() || !is_let(place.height_and_radius([x, y, z]).1);
            !touches
        })
    });
    if !touches || !track.meets(step, grid.pitch) {
        return;
    }
    let mut found = DeepestCentre::default();
    lines.visit(grid, pose, &mut |x, y, from, to| {
        stock.visit([x, y], from, to, part, &mut |z| {
            let (height, radius) = place.height_and_radius([x, y, z]);
            if !is_let(radius) {
                // The next empty centre is a pitch away, or farther.
                let in_tool = element.depth(height, radius, exposed);
                found.take(grid.index([x, y, z]), in_tool, 0.5 * grid.pitch);
            }
            true
        })
    });
    track.take(found.depth, || found.collision(measured, &HitBody::Stock, grid, step.fraction, pose));
}
