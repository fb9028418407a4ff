//! What should be known of a scene, though nothing keeps it from being used.

use std::fmt;

use super::CoarseTool;
use crate::mesh::FaceRepair;
use crate::mesh::topology::MeshReport;
use crate::tool::Tool;
use crate::unit::{ImplausibleProportion, Length, LengthUnit};

/// What should be known of a scene.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum SceneWarning {
    /// Triangles that faced the wrong way and were turned.
    Turned {
        /// The part or fixture.
        part: String,
        /// How many were turned.
        turned: usize,
        /// How many there are.
        triangles: usize,
    },
    /// A surface that has one side alone, and so no inside.
    OneSided {
        /// The part or fixture.
        part: String,
        /// Its triangles.
        triangles: usize,
    },
    /// A mesh that is not closed.
    Open {
        /// The part.
        part: String,
        /// Edges of its boundary.
        boundary_edges: usize,
    },
    /// A mesh whose triangles face inwards.
    InsideOut {
        /// The part.
        part: String,
    },
    /// A tool of which nothing holds the cutter.
    NoHolder {
        /// The tool.
        tool: String,
    },
    /// A tool that passes between the voxels' centres, where that is allowed.
    Coarse(CoarseTool),
    /// A part that is smaller than the tool is thick.
    Proportion(ImplausibleProportion),
    /// A part of few voxels across.
    Thin {
        /// The part.
        part: String,
        /// Voxels across it where it is thickest.
        voxels: usize,
        /// The grid's pitch.
        pitch: f64,
    },
    /// A mesh that does not say at many voxel centres whether they are solid.
    Undecided {
        /// The part.
        part: String,
        /// Their share of the centres in the part or near it.
        share: f64,
    },
    /// A fixture that shares room with the part.
    Overlap {
        /// The fixture.
        fixture: String,
        /// The volume that they share.
        volume: f64,
        /// Unit of the volume's edges.
        unit: LengthUnit,
    },
}

impl SceneWarning {
    /// Those of a part's mesh.
    #[must_use]
    pub fn of_mesh(part: &str, report: &MeshReport) -> Vec<Self> {
        let open = (!report.closed)
            .then(|| Self::Open { part: part.to_owned(), boundary_edges: report.boundary_edges });
        let turned = (report.signed_volume < 0.0).then(|| Self::InsideOut { part: part.to_owned() });
        open.into_iter().chain(turned).collect()
    }

    /// Those of what was done to a mesh's triangles, of which there are so many.
    #[must_use]
    pub fn of_repair(part: &str, repair: &FaceRepair, triangles: usize) -> Vec<Self> {
        let FaceRepair { turned, one_sided } = *repair;
        let turned = (turned > 0).then(|| Self::Turned { part: part.to_owned(), turned, triangles });
        let one_sided =
            (one_sided > 0).then(|| Self::OneSided { part: part.to_owned(), triangles: one_sided });
        turned.into_iter().chain(one_sided).collect()
    }

    /// Those of a tool.
    #[must_use]
    pub fn of_tool(tool: &Tool) -> Option<Self> {
        (!tool.has_holder()).then(|| Self::NoHolder { tool: tool.name.clone() })
    }
}

impl fmt::Display for SceneWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Open { part, boundary_edges } => write!(
                f,
                "{part} is open ({boundary_edges} boundary edges): inside is where the winding number exceeds one half"
            ),
            Self::InsideOut { part } => {
                write!(f, "{part} is inside out (negative volume); it is taken as solid all the same")
            }
            Self::Turned { part, turned, triangles } => {
                write!(f, "{part}: {turned} of {triangles} triangles faced the wrong way and were turned")
            }
            Self::OneSided { part, triangles } => write!(
                f,
                "{part}: {triangles} triangles are of a surface with one side alone (as a Möbius strip), which has no inside"
            ),
            Self::Coarse(coarse) => coarse.fmt(f),
            Self::Proportion(proportion) => proportion.fmt(f),
            Self::Thin { part, voxels, pitch } => write!(
                f,
                "{part} is {voxels} {} thick at most, at pitch {}: what is said of walls as thin as these is coarse; choose a \
                 smaller pitch",
                if *voxels == 1 { "voxel" } else { "voxels" },
                Length(*pitch)
            ),
            Self::Overlap { fixture, volume, unit } => write!(
                f,
                "the fixture {fixture} overlaps the part by {} {unit}³: check where it stands, and its unit",
                Length(*volume)
            ),
            Self::Undecided { part, share } => write!(
                f,
                "{part} does not say at {:.0} % of the voxel centres in it or near it whether they are solid (its winding number lies \
                 between 0.2 and 0.8): an answer there may be wrong, and \"free\" too; repair the mesh or export it again",
                100.0 * share
            ),
            Self::NoHolder { tool } => write!(f, "the tool {tool} has no holder: what holds it is not seen"),
        }
    }
}
