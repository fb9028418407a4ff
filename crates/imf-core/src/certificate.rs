//! Which points a tool reaches from some direction, and which from none: proven either way.
//!
//! With its tip on a point, a tool of revolution holds a given solid centre for every direction within an angle of
//! the way to it: as far as the circle around the tip, from the tool's axis outwards, stays in the tool's outline. So
//! each solid centre *blocks* a cap of directions, whose angle depends on its distance alone. A point is out of reach
//! where caps cover the sphere; one direction that no solid centre blocks proves that it is reached. The sphere is
//! divided into cells, the faces of a cube first; a cell that no single cap holds, and whose middle is blocked, is
//! divided in four, down to a fifth of a degree: there it stays open.
//!
//! The tip stands on voxel centres and what is solid are voxel centres, as in a section ([`section`](crate::section)).

use std::f64::consts::FRAC_PI_2;

use glam::{DVec2, DVec3, I64Vec3};
use thiserror::Error;

use crate::control::{Cancelled, Control};
use crate::field::solid::{Known, SolidField, SolidVoxels};
use crate::grid::Grid;
use crate::obstacle::Obstacle;
use crate::parallel;
use crate::tool::{Assembly, Element, SharpPoints, Tool, ToolShape, contains};

/// The verdict on a point over all directions.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reachability {
    /// The tool is free with its axis along this unit vector, from tip to holder.
    Reached(DVec3),
    /// No direction frees it: each one is blocked by a solid centre.
    OutOfReach,
    /// A cell of directions is too small to be divided further, or there are too many.
    Open,
}

/// Why nothing is proven.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum CertificateError {
    /// The tool is a mesh, or more of it than its tip is sharp.
    #[error(
        "directions are proven for tools of revolution whose tip is their only sharp point, and '{0}' is not one"
    )]
    Tool(String),
    /// Points between the obstacle's voxels.
    #[error("the points are not voxel centres of the obstacle's grid")]
    Grid,
    /// The caller asked to stop.
    #[error("interrupted")]
    Cancelled(#[from] Cancelled),
}

/// Cells of this level are not divided.
const FINEST: u32 = 8;
/// Cells that one point is given.
const MOST_CELLS: usize = 40_000;
/// Directions and blockers that a thread retains from one point to the next.
const WITNESSES: usize = 16;
const BLOCKERS: usize = 96;
/// Maximum number of caps per point; those not used for longest are dropped first.
const MOST_CAPS: usize = 400;
/// Points that a thread takes at once.
const CHUNK: usize = 64;
/// Taken off every angle, in radians, and what depths are followed down to, in pitches: more than rounding and the slack of the tool's predicate.
const MARGIN: f64 = 1e-6;
const SHALLOW: f64 = 1e-3;

/// The verdicts on some voxels of `grid`, by index, over all directions, on all threads of the current pool; the
/// result does not depend on their number. One unit of progress is one point.
///
/// # Errors
/// A tool that is not a body of revolution or has other sharp points than its tip, a grid between the obstacle's
/// voxels, cancellation.
///
/// # Panics
/// If the grid has no such voxel.
pub fn certify(
    obstacle: &Obstacle,
    assembly: &Assembly,
    grid: &Grid,
    points: &[usize],
    control: Control<'_>,
) -> Result<Vec<Reachability>, CertificateError> {
    points.iter().for_each(|&point| assert!(point < grid.len(), "the grid has no voxel {point}"));
    let offset = obstacle.grid().offset_of(grid).ok_or(CertificateError::Grid)?;
    let blocking = Blocking::all(obstacle, assembly)?;
    let search = || Search::new(&blocking);
    Ok(parallel::map_in_chunks(points, CHUNK, control, search, |search, &point| {
        let [x, y, z] = grid.voxel(point).map(|v| v as i64);
        search.point(I64Vec3::new(x, y, z) + I64Vec3::from_array(offset))
    })?)
}

/// A tool, or shank and holder alone, and the voxels that it must stay out of.
struct Blocking {
    field: SolidField,
    /// By the square of a centre's distance from the tip, in voxels: cosine and sine of the angle that it blocks at least.
    caps: Vec<Option<DVec2>>,
    /// Its length in voxels.
    length: u32,
}

impl Blocking {
    fn all(obstacle: &Obstacle, assembly: &Assembly) -> Result<Vec<Self>, CertificateError> {
        let tool = assembly.tool();
        let refuse = || CertificateError::Tool(tool.name.clone());
        if !matches!(tool.sharp_points, SharpPoints::Tip) {
            return Err(refuse());
        }
        let of = |tool: &Tool, voxels: SolidVoxels| Self::new(tool, voxels).ok_or_else(refuse);
        let mut all = vec![of(assembly.whole(), obstacle.forbidden.clone().into())?];
        if let (Some(cuttable), Some(rest)) = (&obstacle.cuttable, assembly.noncutting()) {
            all.push(of(rest, cuttable.clone().into())?);
        }
        Ok(all)
    }

    fn new(tool: &Tool, voxels: SolidVoxels) -> Option<Self> {
        let ToolShape::Revolved(elements) = &tool.shape else { return None };
        let pitch = voxels.occupancy().grid.pitch;
        let bodies = joined(elements);
        let farthest = (tool.reach() / pitch).ceil() as usize;
        let caps = parallel::map(farthest * farthest + 1, |squared| {
            blocked_angle(&bodies, (squared as f64).sqrt() * pitch, pitch)
                .map(|angle| DVec2::new(angle.cos(), angle.sin()))
        });
        let length = (tool.length() / pitch).ceil() as u32;
        Some(Self { field: SolidField::of_tool(voxels, tool), caps, length })
    }

    /// The cap of directions that a centre blocks, given by the way there in voxels.
    fn cap(&self, way: I64Vec3) -> Option<Cap> {
        let squared = way.length_squared();
        let cap = (*self.caps.get(usize::try_from(squared).ok()?)?)?;
        let middle = way.as_dvec3() / (squared as f64).sqrt();
        Some(Cap { middle, cosine: cap.x, sine: cap.y })
    }
}

/// Directions within an angle of one.
#[derive(Clone, Copy)]
struct Cap {
    middle: DVec3,
    cosine: f64,
    sine: f64,
}

impl Cap {
    /// True where it holds all directions of a cell.
    fn holds(&self, cell: &Cell) -> bool {
        // The cosine of the difference of both angles; a cell that is wider than the cap has none.
        self.cosine <= cell.cosine
            && self.middle.dot(cell.middle) >= self.cosine * cell.cosine + self.sine * cell.sine
    }
}

/// Elements that follow one another without a gap or an overlap as one, so that what lies between them is not a
/// surface.
fn joined(elements: &[Element]) -> Vec<Element> {
    let mut sorted: Vec<&Element> = elements.iter().filter(|e| !e.profile.is_empty()).collect();
    sorted.sort_by(|a, b| a.profile[0].range().0.total_cmp(&b.profile[0].range().0));
    let mut bodies: Vec<Element> = Vec::new();
    for element in sorted {
        let begin = element.profile[0].range().0;
        let follows = |body: &&mut Element| {
            body.profile
                .last()
                .is_some_and(|last| (last.range().1 - begin).abs() <= 1e-9 * begin.abs().max(1.0))
        };
        match bodies.iter_mut().find(follows) {
            Some(body) => body.profile.extend(&element.profile),
            None => bodies.push(element.clone()),
        }
    }
    bodies
}

/// The angle from the axis within which all points at a distance from the tip lie in the tool; `None` where the axis does not. Followed from
/// the axis outwards by steps as long as the surface is away.
fn blocked_angle(bodies: &[Element], distance: f64, pitch: f64) -> Option<f64> {
    let mut angle = 0.0;
    if distance == 0.0 {
        return None;
    }
    while angle < FRAC_PI_2 {
        let at = DVec3::new(distance * f64::sin(angle), 0.0, distance * f64::cos(angle));
        let holds = |body: &&Element| contains(&body.profile, DVec3::Z, at, 0.0);
        let depth = |body: &Element| body.depth(at.z, at.x, true);
        let deepest = bodies.iter().filter(holds).map(depth).fold(0.0, f64::max);
        if deepest <= SHALLOW * pitch {
            break;
        }
        angle += (deepest - 0.5 * SHALLOW * pitch) / distance;
    }
    (angle > MARGIN).then(|| angle.min(FRAC_PI_2) - MARGIN)
}

/// A square on a face of the cube around the sphere.
#[derive(Clone, Copy)]
struct Cell {
    face: u8,
    level: u32,
    place: [u32; 2],
    middle: DVec3,
    /// Of the angle from the middle to its farthest corner.
    cosine: f64,
    sine: f64,
}

impl Cell {
    fn new(face: u8, level: u32, place: [u32; 2]) -> Self {
        let size = 2.0 / f64::from(1_u32 << level);
        let [low_u, low_v] = place.map(|at| f64::from(at) * size - 1.0);
        let direction = |u: f64, v: f64| {
            let side = if face & 1 == 0 { 1.0 } else { -1.0 };
            match face >> 1 {
                0 => DVec3::new(side, u, v),
                1 => DVec3::new(u, side, v),
                _ => DVec3::new(u, v, side),
            }
            .normalize()
        };
        let middle = direction(low_u + 0.5 * size, low_v + 0.5 * size);
        // Of a square the corners are farthest.
        let corners = [(0.0, 0.0), (size, 0.0), (0.0, size), (size, size)];
        let cosines = corners.map(|(u, v)| middle.dot(direction(low_u + u, low_v + v)));
        // A little wider than rounding may make it.
        let cosine = cosines.into_iter().fold(1.0, f64::min) - 1e-12;
        Self { face, level, place, middle, cosine, sine: (1.0 - cosine * cosine).sqrt() }
    }

    fn quarters(&self) -> [Self; 4] {
        let [u, v] = self.place.map(|at| 2 * at);
        [[u, v], [u + 1, v], [u, v + 1], [u + 1, v + 1]]
            .map(|place| Self::new(self.face, self.level + 1, place))
    }
}

/// What one thread knows.
struct Search<'a> {
    blocking: &'a [Blocking],
    faces: [Cell; 6],
    /// Directions that were free, the last one last.
    witnesses: Vec<DVec3>,
    /// Voxels that blocked cells of the points before, with the place of what they block.
    blockers: Vec<(usize, I64Vec3)>,
}

/// The caps of one point, those that served last first.
type Caps = Vec<(usize, I64Vec3, Cap)>;

impl<'a> Search<'a> {
    fn new(blocking: &'a [Blocking]) -> Self {
        let faces = [0, 1, 2, 3, 4, 5].map(|face| Cell::new(face, 0, [0, 0]));
        Self { blocking, faces, witnesses: Vec::new(), blockers: Vec::new() }
    }

    fn point(&mut self, voxel: I64Vec3) -> Reachability {
        if let Some(place) = self.witnesses.iter().rposition(|&direction| self.is_free(voxel, direction)) {
            let direction = self.witnesses.remove(place);
            self.witnesses.push(direction);
            return Reachability::Reached(direction);
        }
        let blocking = self.blocking;
        let known = self
            .blockers
            .iter()
            .filter_map(|&(which, blocker)| Some((which, blocker, blocking[which].cap(blocker - voxel)?)));
        let mut caps: Caps = known.collect();
        let mut cells: Vec<Cell> = self.faces.to_vec();
        let (mut open, mut tried) = (false, 0);
        while let Some(cell) = cells.pop() {
            if tried == MOST_CELLS {
                open = true;
                break;
            }
            tried += 1;
            if let Some(place) = caps.iter().position(|(.., cap)| cap.holds(&cell)) {
                // Caps that served are tried earlier.
                caps.swap(place, place / 2);
                continue;
            }
            match self.blocked(voxel, &cell, &mut caps) {
                Blocked::Whole => {}
                Blocked::Middle if cell.level == FINEST => open = true,
                Blocked::Middle => cells.extend(cell.quarters()),
                Blocked::Not => {
                    if self.witnesses.len() == WITNESSES {
                        self.witnesses.remove(0);
                    }
                    self.witnesses.push(cell.middle);
                    return Reachability::Reached(cell.middle);
                }
            }
        }
        self.blockers.clear();
        self.blockers.extend(caps.into_iter().take(BLOCKERS).map(|(which, blocker, _)| (which, blocker)));
        if open { Reachability::Open } else { Reachability::OutOfReach }
    }

    fn is_free(&self, voxel: I64Vec3, direction: DVec3) -> bool {
        self.blocking.iter().all(|blocking| {
            let grid = &blocking.field.voxels().occupancy().grid;
            let tip = grid.origin + (voxel.as_dvec3() + 0.5) * grid.pitch;
            !blocking.field.meets(tip, direction, Known::default(), None)
        })
    }

    /// Looks along a cell's middle for the centre that blocks it most.
    fn blocked(&self, voxel: I64Vec3, cell: &Cell, caps: &mut Caps) -> Blocked {
        let mut middle = false;
        for (which, blocking) in self.blocking.iter().enumerate() {
            let distances = blocking.field.voxels().distances();
            let mut best: Option<(f64, I64Vec3, Cap)> = None;
            let mut last = None;
            for height in 0..=blocking.length {
                let probe = distances.probe(voxel.as_dvec3() + cell.middle * f64::from(height));
                let witness = distances.nearest(probe.index);
                if witness == last {
                    continue;
                }
                last = witness;
                let Some(witness) = witness else { break };
                let blocker = DVec3::from_array(distances.voxel(witness)).as_i64vec3();
                let Some(cap) = blocking.cap(blocker - voxel) else { continue };
                let dot = cap.middle.dot(cell.middle).min(1.0);
                // The cosine of an angle falls: how much of the cap is left beyond the middle, as a cosine.
                if dot < cap.cosine {
                    continue;
                }
                middle = true;
                if cap.holds(cell) {
                    caps.insert(0, (which, blocker, cap));
                    return Blocked::Whole;
                }
                let left = cap.cosine.acos() - dot.acos();
                if best.is_none_or(|(most, ..)| left > most) {
                    best = Some((left, blocker, cap));
                }
            }
            if let Some((_, blocker, cap)) = best {
                caps.truncate(MOST_CAPS);
                caps.push((which, blocker, cap));
            }
        }
        if middle || !self.is_free(voxel, cell.middle) { Blocked::Middle } else { Blocked::Not }
    }
}

/// How much of a cell is blocked.
enum Blocked {
    Whole,
    Middle,
    Not,
}

#[cfg(test)]
mod tests;
