//! The tool assembly: cutter, shank and holder segments stacked along an axis, or a closed mesh.
//!
//! Tool frame: tip at the origin, axis +z from tip to holder. A point at height z and distance r from the axis is
//! inside where `0 ≤ z < length` and `r ≤ ρ(z)`. Elements do not overlap: each owns its own range of heights.

mod assembly;
mod check;
mod circle_depth;
mod depth;
mod erode;
mod extent;
#[cfg(feature = "formats")]
mod file;
#[cfg(feature = "formats")]
mod library;
mod offset;
mod profile;
mod sharp;
#[cfg(feature = "formats")]
mod stack;
mod stick_out;
mod surface;
mod thin;
mod tool_voxels;
mod voxel_count;

pub use assembly::Assembly;
pub use offset::{Clearance, ClearanceError};
pub use profile::{Element, ElementKind, Segment};
pub(crate) use voxel_count::snapped;
// For sections on a GPU.
pub use sharp::SharpPoints;
#[doc(hidden)]
pub use tool_voxels::ToolVoxels;
pub(crate) use tool_voxels::{ASIDE, SLACK, contains};

use glam::DVec3;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::mesh::Mesh;
use crate::unit::LengthUnit;

/// The longest tool that is accepted, in millimetres.
const LONGEST_MM: f64 = 20_000.0;

/// Maximum number of sharp points given as a number: 0.07 mm apart on a cutter of 10 mm that is 10 mm long.
const MOST_SHARP_POINTS: usize = 1 << 16;

/// A holder with its cutter, in its own unit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Tool {
    /// Display name.
    pub name: String,
    /// Unit of every length.
    pub unit: LengthUnit,
    /// What it is made of.
    pub shape: ToolShape,
    /// Where it can remove material.
    pub sharp_points: SharpPoints,
    /// Cutter and shank from end to end, what is in the holder included: how far the tool can stick out at most. `None` where it
    /// is not known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub overall_length: Option<f64>,
    /// Whether the cutter's upper end cuts too where it is wider than what stands on it, as that of a T-slot cutter does.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub back_cutting: bool,
    /// Whether it cuts along its axis alone, as a drill or a reamer does: of a surface it machines the walls and the bottoms of holes
    /// of its own outline.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub plunge_only: bool,
}

/// What a tool is made of.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ToolShape {
    /// Bodies of revolution stacked along the axis, from the tip upwards without gaps.
    Revolved(Vec<Element>),
    /// A mesh in the tool frame; it has no elements and no symmetry.
    Mesh(Mesh),
}

/// Why a tool is refused.
#[derive(Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum ToolError {
    /// No element, or one of zero or non-finite size.
    #[error("the tool '{name}' has no volume: {what}")]
    Empty {
        /// The tool.
        name: String,
        /// What is missing.
        what: String,
    },
    /// Pieces that do not stand on one another, or a radius that is none.
    #[error("the tool '{name}' is no body of revolution from its tip upwards: {what}")]
    Outline {
        /// The tool.
        name: String,
        /// What is wrong, and with which element.
        what: String,
    },
    /// A mesh that is not closed.
    #[error(
        "the mesh of the tool '{name}' is open ({boundary_edges} boundary edges), so that it does not say everywhere what is inside: \
         close its holes, make it one closed solid, and export it again"
    )]
    Open {
        /// The tool.
        name: String,
        /// Edges of its boundary.
        boundary_edges: usize,
    },
    /// Longer or wider than any machine.
    #[error(
        "the tool '{name}' reaches {length:e} {unit} from its tip, where no machine holds more than 20 m: check its lengths \
         (stick-out, cutter, holder) and its unit"
    )]
    TooLong {
        /// The tool.
        name: String,
        /// From its tip to its farthest point.
        length: f64,
        /// Its unit.
        unit: LengthUnit,
    },
    /// More sharp points than any cutter needs.
    #[error(
        "the tool '{name}' has {count} sharp points, and at most {MOST_SHARP_POINTS} are followed: choose fewer"
    )]
    SharpPoints {
        /// The tool.
        name: String,
        /// Its sharp points.
        count: usize,
    },
    /// So thin that no voxel centre lies in it.
    #[error(
        "the tool '{name}' holds no voxel centre at pitch {pitch}: it is too small for this grid; choose a smaller \
         pitch, or check the tool's unit"
    )]
    TooSmall {
        /// The tool.
        name: String,
        /// The grid's pitch.
        pitch: f64,
    },
    /// Its box would hold more voxels than can be indexed.
    #[error(
        "the tool '{name}' would span {dims:?} voxels at pitch {pitch}: choose a larger pitch, or check the tool's unit"
    )]
    TooLarge {
        /// The tool.
        name: String,
        /// Voxels along each axis.
        dims: [u64; 3],
        /// The grid's pitch.
        pitch: f64,
    },
}

impl Tool {
    /// The paper's tool in mm: a ball-end cutter of radius 5 and length 35 in a holder of radius 14.5 up to 83.
    #[must_use]
    pub fn paper() -> Self {
        let cutter = vec![Segment::ball_end(5.0), Segment::cylinder(5.0, 35.0, 5.0)];
        let holder = vec![Segment::cylinder(35.0, 83.0, 14.5)];
        Self::revolved("paper", [(ElementKind::Cutter, cutter), (ElementKind::Holder(0), holder)])
    }

    /// Elements by kind and outline from the tip upwards, without gaps; in mm, sharp at the tip alone.
    #[must_use]
    pub fn revolved(
        name: impl Into<String>,
        elements: impl IntoIterator<Item = (ElementKind, Vec<Segment>)>,
    ) -> Self {
        let elements = elements.into_iter().map(|(kind, profile)| Element { kind, profile });
        Self {
            name: name.into(),
            unit: LengthUnit::Mm,
            shape: ToolShape::Revolved(elements.collect()),
            sharp_points: SharpPoints::Tip,
            overall_length: None,
            back_cutting: false,
            plunge_only: false,
        }
    }

    /// The tool with every length in `unit`.
    #[must_use]
    pub fn in_unit(&self, unit: LengthUnit) -> Self {
        let factor = self.unit.in_mm() / unit.in_mm();
        if factor == 1.0 {
            return Self { unit, ..self.clone() };
        }
        let shape = match &self.shape {
            ToolShape::Revolved(elements) => {
                ToolShape::Revolved(elements.iter().map(|e| e.scaled(factor)).collect())
            }
            ToolShape::Mesh(mesh) => {
                ToolShape::Mesh(mesh.transformed(&glam::DMat4::from_scale(DVec3::splat(factor))))
            }
        };
        Self {
            name: self.name.clone(),
            unit,
            shape,
            sharp_points: self.sharp_points.scaled(factor),
            overall_length: self.overall_length.map(|length| length * factor),
            back_cutting: self.back_cutting,
            plunge_only: self.plunge_only,
        }
    }

    /// The tool with its tip as the only sharp point: its collision measure is the overlap at the tip.
    #[must_use]
    pub fn with_tip_only(&self) -> Self {
        Self { sharp_points: SharpPoints::Tip, ..self.clone() }
    }

    /// Shank and holder alone, sharp where the whole tool is; `None` where the tool is all cutter, or a
    /// mesh, which has no elements.
    #[must_use]
    pub fn without_cutter(&self) -> Option<Self> {
        let rest = self.elements().iter().filter(|e| e.kind != ElementKind::Cutter);
        let rest: Vec<Element> = rest.cloned().collect();
        let sharp_points = self.inherited_sharp_points();
        (!rest.is_empty()).then(|| Self { shape: ToolShape::Revolved(rest), sharp_points, ..self.clone() })
    }

    /// The mesh of a tool that is one.
    pub(crate) fn mesh(&self) -> Option<&Mesh> {
        match &self.shape {
            ToolShape::Mesh(mesh) => Some(mesh),
            ToolShape::Revolved(_) => None,
        }
    }

    /// Its elements from the tip upwards; none of a mesh.
    pub(crate) fn elements(&self) -> &[Element] {
        match &self.shape {
            ToolShape::Revolved(elements) => elements,
            ToolShape::Mesh(_) => &[],
        }
    }

    /// The pieces of its outline from the tip upwards; none of a mesh.
    pub(crate) fn segments(&self) -> impl Iterator<Item = &Segment> {
        self.elements().iter().flat_map(|element| &element.profile)
    }

    /// True where one of its elements is a cutter.
    #[must_use]
    pub fn has_cutter(&self) -> bool {
        self.elements().iter().any(|e| e.kind == ElementKind::Cutter)
    }

    /// True where one of its elements is a holder; true of a mesh, which is all that there is.
    #[must_use]
    pub fn has_holder(&self) -> bool {
        self.mesh().is_some() || self.elements().iter().any(|e| matches!(e.kind, ElementKind::Holder(_)))
    }

    /// True where turning the tool about its axis changes nothing, sharp points included (rings count as whole).
    #[must_use]
    pub fn is_axisymmetric(&self) -> bool {
        matches!(self.shape, ToolShape::Revolved(_))
            && match &self.sharp_points {
                SharpPoints::Points(points) => points.iter().all(|p| p.x == 0.0 && p.y == 0.0),
                SharpPoints::Tip | SharpPoints::Cutter(_) | SharpPoints::Boundary(_) => true,
            }
    }

    /// Largest distance from the tool's origin to any of its points (an upper bound, tight for cylinders).
    #[must_use]
    pub fn reach(&self) -> f64 {
        let of_segments = self.segments().map(|s| s.max_radius().hypot(s.range().1));
        let of_mesh = self.mesh().into_iter().flat_map(|mesh| &mesh.vertices).map(|v| v.length());
        of_segments.chain(of_mesh).fold(0.0, f64::max)
    }

    /// Diameter of a ball that holds the tool.
    pub(crate) fn span(&self) -> f64 {
        if let Some((lower, upper)) = self.mesh().and_then(Mesh::bounds) {
            return lower.distance(upper);
        }
        let middle = self.length() / 2.0;
        let radius = |s: &Segment| {
            let (from, to) = s.range();
            s.max_radius().hypot((from - middle).abs().max((to - middle).abs()))
        };
        2.0 * self.segments().map(radius).fold(0.0, f64::max)
    }

    /// Volume in cubic units: analytic for bodies of revolution, by the divergence theorem for a mesh.
    #[must_use]
    pub fn volume(&self) -> f64 {
        match &self.shape {
            ToolShape::Revolved(_) => self.segments().map(Segment::volume).sum(),
            ToolShape::Mesh(mesh) => mesh.signed_volume().abs(),
        }
    }

    /// Height of the tool along its axis, 0 for a mesh below its tip.
    #[must_use]
    pub fn length(&self) -> f64 {
        match &self.shape {
            ToolShape::Revolved(_) => self.segments().last().map_or(0.0, |s| s.range().1),
            ToolShape::Mesh(mesh) => mesh.bounds().map_or(0.0, |(_, upper)| upper.z),
        }
    }

    /// Name and largest diameter of the thinnest element; of a mesh, the shortest side of its box.
    #[must_use]
    pub fn thinnest(&self) -> (String, f64) {
        if let Some(mesh) = self.mesh() {
            let side = mesh.bounds().map_or(0.0, |(lower, upper)| (upper - lower).min_element());
            return ("body".into(), side);
        }
        let widths = self.elements().iter().map(|e| (e.kind.to_string(), 2.0 * e.max_radius()));
        widths.min_by(|(_, a), (_, b)| a.total_cmp(b)).unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_papers_tool_has_the_papers_reach_and_volume() {
        let tool = Tool::paper();
        assert!((tool.reach() - 84.3).abs() < 0.05, "{}", tool.reach());
        let ball = 2.0 / 3.0 * std::f64::consts::PI * 125.0;
        let rest = std::f64::consts::PI * (25.0 * 30.0 + 14.5 * 14.5 * 48.0);
        assert!((tool.volume() - ball - rest).abs() < 1e-9);
    }

    #[test]
    fn units_scale_every_length() {
        let tool = Tool { sharp_points: SharpPoints::Points(vec![DVec3::X]), ..Tool::paper() };
        let inches = tool.in_unit(LengthUnit::Inch);
        assert!((inches.reach() * 25.4 - tool.reach()).abs() < 1e-9);
        assert!((inches.volume() * 25.4f64.powi(3) - tool.volume()).abs() < 1e-6);
        assert!((inches.sharp_point_positions(1.0)[0].x * 25.4 - 1.0).abs() < 1e-12);
        assert!(!inches.is_axisymmetric() && Tool::paper().is_axisymmetric());
    }
}
