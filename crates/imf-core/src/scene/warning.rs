//! Warnings about a scene that can be used all the same.

use glam::DVec3;
use thiserror::Error;

use super::CoarseTool;
use crate::mesh::{FaceRepair, Mesh};
use crate::tool::{Assembly, Element, ElementKind, Tool};
use crate::unit::{DisplayLength, ImplausibleProportion, LengthUnit};

/// Rounding of coordinates that matters, in voxels.
const COARSE_ROUNDING: f64 = 0.02;

/// A warning about a scene. Implements `Error` so that callers may treat it as fatal.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum SceneWarning {
    /// Corners that all but coincide, and were joined.
    #[error(
        "{part}: {corners} corners lay within a hundred-thousandth of its size from others and were joined to them"
    )]
    Joined {
        /// The part or fixture.
        part: String,
        /// How many.
        corners: usize,
    },
    /// Triangles that were there more than once, and were left out.
    #[error("{part}: {} there more than once and left out", triangles_were(*.triangles))]
    Doubled {
        /// The part or fixture.
        part: String,
        /// How many.
        triangles: usize,
    },
    /// Triangles without area that were left out.
    #[error("{part}: {} without area and left out, which leaves fewer edges open", triangles_were(*.triangles))]
    Flat {
        /// The part or fixture.
        part: String,
        /// How many.
        triangles: usize,
    },
    /// Triangles that were cut where corners of others lie on their edges.
    #[error("{part}: {} cut where corners of others lie on their edges", triangles_were(*.triangles))]
    Cut {
        /// The part or fixture.
        part: String,
        /// How many.
        triangles: usize,
    },
    /// Closed bodies of a mesh that lie within another one and face as it does.
    #[error(
        "{part}: {}, and was taken as solid within solid; if a cavity is meant, its triangles must face inwards",
        nested(*.bodies)
    )]
    Nested {
        /// The part or fixture.
        part: String,
        /// How many.
        bodies: usize,
    },
    /// Triangles that faced the wrong way and were flipped.
    #[error("{part}: {flipped} of {triangles} triangles faced the wrong way and were flipped")]
    Flipped {
        /// The part or fixture.
        part: String,
        /// How many were flipped.
        flipped: usize,
        /// How many there are.
        triangles: usize,
    },
    /// A surface that has one side alone, and so no inside.
    #[error(
        "{part}: {triangles} triangles are of a surface with one side alone (as a Möbius strip), which has no inside"
    )]
    OneSided {
        /// The part or fixture.
        part: String,
        /// Its triangles.
        triangles: usize,
    },
    /// Coordinates of 32 bits, far from the origin.
    #[error(
        "{part}: its coordinates, up to {} {unit}, are no finer than numbers of 32 bits, which lie {} {unit} apart there: not small beside \
         voxels of {} {unit}; if they were rounded to that, as an STL file's are, export it nearer to the origin",
        DisplayLength(*.far), DisplayLength(*.rounding), DisplayLength(*.pitch)
    )]
    Rounded {
        /// The part or fixture.
        part: String,
        /// The largest coordinate.
        far: f64,
        /// Distance of neighbouring numbers of 32 bits there.
        rounding: f64,
        /// The grid's pitch.
        pitch: f64,
        /// Of all.
        unit: LengthUnit,
    },
    /// A mesh that is not closed.
    #[error(
        "{part} is open ({boundary_edges} boundary edges): it was taken as solid, its openings closed as by a skin over \
         their rims, which leaves {} of the voxel centres in it or near it in doubt; if it is a sheet, or faces are missing, \
         make it one closed solid and export it again",
        percent(*.fraction)
    )]
    Open {
        /// The part or fixture.
        part: String,
        /// Edges of its boundary.
        boundary_edges: usize,
        /// Fraction of the centres in or near it that it leaves undecided.
        fraction: f64,
    },
    /// A tool of which nothing holds the cutter.
    #[error("the tool {0} has no holder: what holds it is not seen")]
    NoHolder(String),
    /// A tool that passes between the voxels' centres, where that is allowed.
    #[error("{0}")]
    Coarse(CoarseTool),
    /// An element that is wider than the cutter, by less than a voxel.
    #[error(
        "the {element} of the tool '{tool}', with its clearance, is {} {unit} a side wider than the cutter, which voxels of {} {unit} see \
         at some walls and not at others: sections, space and stock, which know no points of surfaces, may be far off; choose a pitch of at \
         most {}, or conservative voxels",
        DisplayLength(*.step), DisplayLength(*.pitch), DisplayLength(*.step)
    )]
    Step {
        /// The tool.
        tool: String,
        /// The element.
        element: ElementKind,
        /// By how much a side, its clearance with it.
        step: f64,
        /// The grid's pitch.
        pitch: f64,
        /// Of both.
        unit: LengthUnit,
    },
    /// A tool that is not where its tip or another of its sharp points is.
    #[error(
        "the tip of the tool '{tool}', or another of its sharp points, is {} {unit} away from it: poses are those of the tip, and the \
         tool itself is elsewhere; check its frame (tip at the origin, holder towards +z) and its unit",
        DisplayLength(*.distance)
    )]
    TipOff {
        /// The tool.
        tool: String,
        /// How far that is from the tool.
        distance: f64,
        /// Unit of the distance.
        unit: LengthUnit,
    },
    /// A tool that reaches below its origin.
    #[error(
        "the tool '{tool}' reaches {} {unit} below its origin, which poses put where its tip should be; check its frame (tip at the \
         origin, holder towards +z)",
        DisplayLength(*.depth)
    )]
    BelowTip {
        /// The tool.
        tool: String,
        /// How far.
        depth: f64,
        /// Unit of the depth.
        unit: LengthUnit,
    },
    /// A tool whose tip is so slender that it passes between the voxels' centres for a while.
    #[error(
        "the tip of the tool '{tool}' is so slender that it passes between the centres of voxels of {} {unit}: what it hits is certain \
         to be seen where it is {} {unit} deep or more; choose a smaller pitch",
        DisplayLength(*.pitch), DisplayLength(*.depth)
    )]
    SlenderTip {
        /// The tool.
        tool: String,
        /// How deep it must be in a solid to be certain to be detected.
        depth: f64,
        /// The grid's pitch.
        pitch: f64,
        /// Of both.
        unit: LengthUnit,
    },
    /// A tool more of which lies below its tip than above.
    #[error(
        "more of the tool '{0}' lies below its tip than above: its holder should be towards +z of its own frame"
    )]
    UpsideDown(String),
    /// A part and a tool whose sizes hardly belong together.
    #[error("{0}; check the units of part and tool")]
    Proportion(ImplausibleProportion),
    /// A part of few voxels across.
    #[error(
        "{part} is {voxels} {} thick at most, at pitch {}: what is said of walls as thin as these is coarse; choose a \
         smaller pitch",
        if *.voxels == 1 { "voxel" } else { "voxels" }, DisplayLength(*.pitch)
    )]
    Thin {
        /// The part.
        part: String,
        /// Voxels across it where it is thickest.
        voxels: usize,
        /// The grid's pitch.
        pitch: f64,
    },
    /// Surface of walls, ribs and edges that lie between the voxels' centres.
    #[error(
        "{part}: {} {unit}² of its surface ({}), as at ({}), is of walls, ribs or edges so thin that they lie between the centres of \
         voxels of {} {unit}: a tool passes through them unseen; choose a smaller pitch, or conservative voxels",
        DisplayLength(*.area), percent(*.fraction),
        .at.to_array().map(|v| DisplayLength(v).to_string()).join(", "), DisplayLength(*.pitch)
    )]
    Lost {
        /// The part or fixture.
        part: String,
        /// Its area.
        area: f64,
        /// Fraction of the whole surface.
        fraction: f64,
        /// A point of it.
        at: DVec3,
        /// The grid's pitch.
        pitch: f64,
        /// Unit of them all.
        unit: LengthUnit,
    },
    /// A fixture that overlaps the part.
    #[error(
        "the fixture {fixture} overlaps the part by {} {unit}³: check where it stands, and its unit",
        DisplayLength(*.volume)
    )]
    Overlap {
        /// The fixture.
        fixture: String,
        /// The common volume.
        volume: f64,
        /// Unit of the volume's edges.
        unit: LengthUnit,
    },
}

/// A tip is called slender if it must be at least this many pitches deep in a solid to be certain to be detected; 1.7
/// for a flat end, 2.6 for a point of 60 degrees.
const SLENDER: f64 = 5.0;

impl SceneWarning {
    /// Warnings about where a tool is in its own frame, among voxels of a pitch.
    #[must_use]
    pub fn of_frame(tool: &Tool, pitch: f64) -> Vec<Self> {
        let name = || tool.name.clone();
        let distance = tool.sharp_points_off();
        let off = (distance > 2.0 * pitch).then(|| Self::TipOff { tool: name(), distance, unit: tool.unit });
        let of_mesh = tool.mesh().and_then(Mesh::bounds).map(|(lower, _)| lower.z);
        let lowest = of_mesh.or_else(|| tool.segments().next().map(|first| first.range().0));
        let turned = lowest.filter(|&lowest| -lowest > tool.length().max(0.0));
        let below = lowest.filter(|&lowest| turned.is_none() && off.is_none() && -lowest > pitch);
        let below = below.map(|lowest| Self::BelowTip { tool: name(), depth: -lowest, unit: tool.unit });
        // As a ball that surely holds a centre; a cutter that is hardly thick enough holds none, and needs none.
        let ball = (0.75_f64.sqrt() * pitch).min(0.5 * tool.thinnest().1);
        let depth = tool.tip_depth(ball).filter(|depth| *depth > SLENDER * pitch);
        let slender = depth.map(|depth| Self::SlenderTip { tool: name(), depth, pitch, unit: tool.unit });
        off.into_iter().chain(below).chain(slender).chain(turned.map(|_| Self::UpsideDown(name()))).collect()
    }

    /// Warnings about the repairs of a mesh of `triangles` triangles.
    #[must_use]
    pub fn of_repair(part: &str, repair: &FaceRepair, triangles: usize) -> Vec<Self> {
        let FaceRepair { joined, doubled, flat, cut, flipped, one_sided, nested } = *repair;
        let name = || part.to_owned();
        let all = [
            (joined > 0).then(|| Self::Joined { part: name(), corners: joined }),
            (doubled > 0).then(|| Self::Doubled { part: name(), triangles: doubled }),
            (flat > 0).then(|| Self::Flat { part: name(), triangles: flat }),
            (cut > 0).then(|| Self::Cut { part: name(), triangles: cut }),
            (flipped > 0).then(|| Self::Flipped { part: name(), flipped, triangles }),
            (one_sided > 0).then(|| Self::OneSided { part: name(), triangles: one_sided }),
            (nested > 0).then(|| Self::Nested { part: name(), bodies: nested }),
        ];
        all.into_iter().flatten().collect()
    }

    /// Of a mesh as its file has it, whose coordinates are no finer than numbers of 32 bits; `scale` is that of its place.
    pub(crate) fn of_rounding(
        part: &str,
        mesh: &Mesh,
        scale: f64,
        pitch: f64,
        unit: LengthUnit,
    ) -> Option<Self> {
        let far = mesh.vertices.iter().map(|vertex| vertex.abs().max_element()).fold(0.0, f64::max);
        let rounding = scale * f64::from((far as f32).next_up() - far as f32);
        let is_short = |&value: &f64| f64::from(value as f32) == value;
        let is_rounded = rounding > COARSE_ROUNDING * pitch
            && mesh.vertices.iter().all(|vertex| vertex.to_array().iter().all(is_short));
        is_rounded.then(|| Self::Rounded { part: part.to_owned(), far, rounding, pitch, unit })
    }

    /// Warnings about a tool.
    #[must_use]
    pub fn of_tool(tool: &Tool) -> Option<Self> {
        (!tool.has_holder()).then(|| Self::NoHolder(tool.name.clone()))
    }

    /// Of a tool whose shank or holder, with its clearance, is wider than its cutter by less than a voxel: along a wall that the cutter
    /// touches no centre need lie so near. The assembly is in the grid's unit.
    #[must_use]
    pub fn of_step(assembly: &Assembly, pitch: f64) -> Option<Self> {
        let cutting = assembly.tool().elements().iter().filter(|element| element.kind == ElementKind::Cutter);
        let cutter = cutting.map(Element::max_radius).reduce(f64::max)?;
        let above = assembly.noncutting()?.elements();
        let wider = above.iter().map(|element| (element.kind, element.max_radius() - cutter));
        let unseen = wider.filter(|(_, step)| (1e-6 * pitch..(1.0 - 1e-6) * pitch).contains(step));
        let (element, step) = unseen.min_by(|a, b| a.1.total_cmp(&b.1))?;
        let (tool, unit) = (assembly.tool().name.clone(), assembly.tool().unit);
        Some(Self::Step { tool, element, step, pitch, unit })
    }
}

/// Describes `bodies` closed bodies that lie in others.
fn nested(bodies: usize) -> String {
    match bodies {
        1 => "a closed body lies within another and faces outwards as that does".to_owned(),
        _ => format!("each of {bodies} closed bodies lies within another and faces outwards as that does"),
    }
}

/// So many triangles, as the beginning of a sentence.
fn triangles_were(count: usize) -> String {
    if count == 1 { "1 triangle was".to_owned() } else { format!("{count} triangles were") }
}

/// A fraction in words.
fn percent(fraction: f64) -> String {
    if fraction < 0.01 { "less than 1 %".to_owned() } else { format!("{:.0} %", 100.0 * fraction) }
}
