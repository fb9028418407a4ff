//! A toolpath checked against what must not be hit, exactly, pose by pose and element by element.
//!
//! Between two lines of the toolpath poses are taken so close together that no point of the tool moves farther than
//! a step from one to the next, roll included. Each stretch is checked with its own tool. Holder and shank, offset by
//! their clearance, must hold no solid voxel's centre. The cutter must touch what it cuts: it may hold centres of the part's
//! voxels, but none deeper below its own surface than `contact`, a length that does not follow the pitch. What lies deep in the
//! cutter may be a thin wall, so that none is cut through unseen. Where meshes are given, no element may hold points of their
//! surfaces deeper than `contact` either; that much is what touches, of fixtures too.
//!
//! A collision's depth is measured from both sides: a solid centre that lies so deep in the element and so deep in the part has a
//! ball around it in either, so no translation shorter than the sum of both radii separates them. The depth of a pose is
//! the largest of these sums. The part's surface is taken to lie half-way between solid and empty centres.
//!
//! With stock ([`check_stock`]) the path is followed once more, the cutter taking away what it holds.
//!
//! With a machine the motions are its own, its head and table are bodies that move with its axes, and an axis that
//! leaves its range is reported.

mod deepest;
mod elements;
mod error;
mod machine;
mod motions;
mod poses;
mod report;
mod stick_out;
mod stock;

pub use error::{CheckError, LineFault};
pub use machine::{MachineBodies, MachineFault, MachineReach, machine_remarks};
pub use poses::PoseChecker;
pub use report::{CheckReport, Collision, HitBody, LineCollisions, TravelFault};
pub use stick_out::{PathStickOut, shortest_stick_outs};
pub use stock::{LineRemoval, StockLeft, StockReport, check_stock};

use std::sync::Arc;

use serde::Serialize;

use crate::control::Control;
use crate::mesh::Mesh;
use crate::occupancy::Occupancy;
use crate::parallel;
use crate::scene::{PathGuarantee, SceneRecord};
use crate::tool::{Clearance, Element, ElementKind, Tool, ToolShape};
use crate::toolpath::{Location, Toolpath};
use crate::unit::LengthUnit;
use elements::{Body, Elements};
use machine::MachinePairs;
use motions::{Motion, motions, rigid};
pub use motions::{cutters_not_compared, never_near};

/// Accepted contact, clearances, and how densely the path is sampled. Lengths in the unit of the part's grid.
///
/// # Example
/// Ten times as closely as by default, at a pitch of half a millimetre:
/// ```
/// use imf_core::check::CheckSettings;
/// use imf_core::unit::LengthUnit;
///
/// let usual = CheckSettings::of_pitch(0.5, LengthUnit::Mm);
/// let closer = CheckSettings { step: usual.step / 10.0, ..usual };
/// assert_eq!((closer.step, closer.contact), (0.0125, 0.05));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct CheckSettings {
    /// Room around each kind of element.
    pub clearance: Clearance,
    /// How deep the part may lie in the cutter, points of any surface in the other elements, clearances included, and any solid in
    /// shank and holder where they have none; 0 accepts nothing, and the cutter's clearance applies.
    pub contact: f64,
    /// How closely the path is followed: farthest that any point of the tool moves between two poses that are checked. What the cutter
    /// may cut is `contact`.
    pub step: f64,
}

/// Radius of the largest circle among points of a surface that holds none, as many times as they are apart.
const EMPTY_CIRCLE: f64 = 0.72;

/// Contact that is accepted by default, in mm: chord errors and tolerances of CAM programs are a few hundredths.
const CONTACT: f64 = 0.05;

impl CheckSettings {
    /// No clearance, contact of 0.05 mm, a step of a quarter of the pitch; lengths in `unit`.
    #[must_use]
    pub fn of_pitch(pitch: f64, unit: LengthUnit) -> Self {
        Self { clearance: Clearance::default(), contact: CONTACT / unit.in_mm(), step: pitch / 4.0 }
    }

    /// The defaults for a scene, with its clearance; `contact` and `step` where they are given.
    #[must_use]
    pub fn of_scene(record: &SceneRecord, contact: Option<f64>, step: Option<f64>) -> Self {
        let usual = Self::of_pitch(record.grid.pitch, record.unit);
        Self {
            clearance: record.clearance,
            contact: contact.unwrap_or(usual.contact),
            step: step.unwrap_or(usual.step),
        }
    }

    /// The weakest guarantee of some tools on a path in a scene; `None` without tools.
    #[must_use]
    pub fn guarantee<'a>(
        &self,
        tools: impl IntoIterator<Item = &'a Tool>,
        record: &SceneRecord,
    ) -> Option<PathGuarantee> {
        let Self { clearance, contact, step } = self;
        let of = |tool| {
            let (conservative, pitch) = (record.conservative, record.grid.pitch);
            PathGuarantee::new(conservative, tool, clearance, *contact > 0.0, pitch, *step)
        };
        tools.into_iter().map(of).min_by_key(|g| (g.at_all_times.strength(), g.at_poses.strength()))
    }

    /// Diameter of the smallest ball whose overlap is certain to be detected at any time of a motion: at the nearest checked
    /// pose, and below the accepted contact, the rest of such an overlap still contains a voxel centre.
    #[must_use]
    pub fn sure_depth(&self, pitch: f64) -> f64 {
        3f64.sqrt() * pitch + 2.0 * self.contact + self.step
    }

    fn check(&self) -> Result<(), CheckError> {
        let Self { contact, step, .. } = *self;
        if !(contact.is_finite() && contact >= 0.0) {
            let wanted = "a finite length of at least 0";
            return Err(CheckError::Setting { name: "contact", wanted, value: contact });
        }
        if !(step.is_finite() && step > 0.0) {
            let wanted = "a finite length above 0";
            return Err(CheckError::Setting { name: "step", wanted, value: step });
        }
        Ok(())
    }
}

/// What must not be hit: voxels on grids of one pitch, in world coordinates.
#[derive(Clone, Copy, Debug)]
pub struct CheckBodies<'a> {
    /// The part.
    pub part: &'a Occupancy,
    /// The part by the rule of voxel centres, where `part` is conservative: what the cutter touches and must not cut into.
    pub by_centres: Option<&'a Occupancy>,
    /// What holds it, by name.
    pub fixtures: &'a [(String, Occupancy)],
    /// The meshes of the part and of the fixtures, in that order and in world coordinates: unless the contact is 0, tools are held
    /// against their surfaces between the voxels' centres too. Without them the centres decide.
    pub surfaces: &'a [&'a Mesh],
    /// The machine that follows the path; the path is read for it.
    pub machine: Option<&'a MachineBodies>,
}

impl<'a> CheckBodies<'a> {
    /// A part by its voxels alone: a cutter may be as deep in it as no centre of them shows.
    #[must_use]
    pub fn of_part(part: &'a Occupancy) -> Self {
        Self { part, by_centres: None, fixtures: &[], surfaces: &[], machine: None }
    }

    fn check(&self) -> Result<(), CheckError> {
        let pitch = self.part.grid.pitch;
        let own = [Some(self.part), self.by_centres].into_iter().flatten().map(|voxels| ("the part", voxels));
        let mut all = own.chain(self.fixtures.iter().map(|(name, voxels)| (&**name, voxels)));
        let is_sound =
            |voxels: &Occupancy| voxels.is_sound() && (voxels.grid.pitch / pitch - 1.0).abs() < 1e-9;
        let unsound = all.find(|(_, voxels)| !is_sound(voxels));
        unsound.map_or(Ok(()), |(name, _)| Err(CheckError::Voxels(name.to_owned())))
    }
}

/// Checks every motion of a toolpath on all threads of the current pool. One unit of progress is one location.
///
/// `tools` are one tool without a number, for a path of one tool, or tools by number, each of which checks its own stretches;
/// their lengths, and those of bodies and settings, are in the path's unit.
///
/// # Errors
/// Settings, voxels or tools that make no sense, a tool of another unit than the path's, a location without a tool or, where its tool
/// is not round, without a roll, a motion whose turn is not defined or that is absurdly long, cancellation.
pub fn check_toolpath(
    bodies: CheckBodies<'_>,
    tools: &[(Option<u32>, &Tool)],
    toolpath: &Toolpath,
    settings: &CheckSettings,
    control: Control<'_>,
) -> Result<CheckReport, CheckError> {
    settings.check()?;
    bodies.check()?;
    tools.iter().try_for_each(|(_, tool)| tool.check())?;
    // Every motion is validated before any pose is checked.
    let machine = bodies.machine.map(MachineBodies::machine);
    let motions = motions(toolpath, tools, settings, machine)?;
    let Hit { bodies: hit, cut, points_apart } = Hit::new(bodies, settings);
    let (mut used, mut surfaces_known) = (Vec::new(), true);
    bodies.machine.map_or(Ok(()), |machine| machine.check(bodies.part.grid.pitch))?;
    let world = rigid(&toolpath.set_up);
    let mut lines: Vec<report::MotionFindings> = Vec::with_capacity(motions.len());
    for (index, (_, tool)) in tools.iter().enumerate() {
        let own: Vec<usize> = (0..motions.len()).filter(|&m| motions[m].tool == index).collect();
        if own.is_empty() {
            continue;
        }
        let elements = Elements::new(&hit, &cut, tool, settings)?;
        surfaces_known &= elements.know_the_surfaces();
        used.push(*tool);
        let pairs = bodies.machine.map(|machine| MachinePairs::new(machine, &hit, tool, settings, &world));
        let pairs = pairs.transpose()?;
        lines.extend(parallel::try_map(own.len(), |place| {
            control.check()?;
            let motion = &motions[own[place]];
            let location = &toolpath.locations[own[place]];
            let (line, tool, kind) = (location.line, location.tool, location.kind);
            let mut collisions = elements.collisions(motion);
            let mut beyond = Vec::new();
            if let Some(pairs) = &pairs {
                collisions.extend(pairs.follow(motion).map_err(|fault| fault.on_line(line))?);
                beyond = pairs.beyond(motion, line).map_err(|fault| fault.on_line(line))?;
            }
            motion.with_joints(&mut collisions);
            (control.progress)(1);
            let found = LineCollisions { line, tool, kind, poses: motion.count, collisions };
            Ok::<_, CheckError>((own[place], found, beyond))
        })?);
    }
    lines.sort_by_key(|(index, ..)| *index);
    let mut report = report::gather(&mut lines, toolpath, settings, bodies.part.grid.pitch);
    let ball = report.sure_depth;
    // A slender tip or a thin cutter is wide enough only farther up; a tool that never is, is never certain to be seen.
    let of_tip = |&(_, tool): &(Option<u32>, &Tool)| match &tool.shape {
        ToolShape::Revolved(_) => tool.tip_depth(0.5 * ball).unwrap_or_else(|| tool.length()),
        ToolShape::Mesh(_) => ball,
    };
    report.sure_depth = tools.iter().map(of_tip).fold(ball, f64::max);
    if surfaces_known {
        let by_centres = report.sure_depth;
        [report.sure_gouge, report.sure_overlap] = sure_depths(&used, settings, &points_apart, by_centres)?;
    }
    Ok(report)
}

/// Bytes that a path of so many locations takes while it is checked, those of a collision left out: how many there are is known at the end
/// alone. Lists that grow have room for twice as many.
#[doc(hidden)]
#[must_use]
pub fn path_memory_estimate(locations: usize) -> u64 {
    let each = size_of::<Location>() + size_of::<Motion<'_>>() + size_of::<report::MotionFindings>();
    2 * (locations * each) as u64
}

/// Part and fixtures as tools meet them.
struct Hit {
    bodies: Vec<Arc<Body>>,
    /// The part as the cutter meets it.
    cut: Arc<Body>,
    /// Distance of points of each surface that is known.
    points_apart: Vec<f64>,
}

impl Hit {
    fn new(given: CheckBodies<'_>, settings: &CheckSettings) -> Self {
        let (mut bodies, mut points_apart) = (Body::all(given.part, given.fixtures), Vec::new());
        if settings.contact > 0.0 {
            for (body, mesh) in bodies.iter_mut().zip(given.surfaces) {
                let (with_points, apart) = body.with_surface_of(mesh);
                *body = with_points;
                points_apart.push(apart);
            }
        }
        let cut =
            given.by_centres.map_or_else(|| bodies[0].clone(), |part| bodies[0].of_voxels(part.clone()));
        Self { bodies, cut, points_apart }
    }
}

/// How deep a cutter must enter the part's surface, and anything else a surface, to hold a point of it, or of the latter a centre, for
/// which `by_centres` is enough; `None` where there are no such elements, or a cutter is too thin. `apart` is the distance of points, of
/// the part and of each fixture.
fn sure_depths(
    tools: &[&Tool],
    settings: &CheckSettings,
    apart: &[f64],
    by_centres: f64,
) -> Result<[Option<f64>; 2], CheckError> {
    let Some(&of_part) = apart.first() else { return Ok([None, None]) };
    let farthest = apart.iter().copied().fold(of_part, f64::max);
    let sure = |element: &Element, exposed: bool, apart: f64| {
        element.depth_of_circle(settings.contact, EMPTY_CIRCLE * apart, exposed) + 0.5 * settings.step
    };
    let (mut gouges, mut overlaps) = (Vec::new(), Vec::new());
    for tool in tools {
        gouges.extend(tool.cutter().map(|(cutter, exposed)| sure(&cutter, exposed, of_part)));
        let mut elements = tool.offset_elements(&settings.clearance)?;
        elements.retain(|element| element.kind != ElementKind::Cutter || apart.len() > 1);
        overlaps.extend(elements.iter().map(|element| sure(element, true, farthest).min(by_centres)));
    }
    let worst = |depths: Vec<f64>| depths.into_iter().reduce(f64::max).filter(|depth| depth.is_finite());
    Ok([gouges, overlaps].map(worst))
}

#[cfg(test)]
mod between_centres;
#[cfg(test)]
mod machine_oracle;
#[cfg(test)]
mod oracle;
#[cfg(test)]
mod tests;
