//! The reference parts: shapes that the project makes itself, so that every figure can be made again from
//! nothing.
//!
//! Every part is in millimetres, and its grid of [`ReferencePart::dims`] has a pitch of 1 mm: the tool of the
//! paper (29×29×83 voxels) is then the built-in one. Only the teapot is the paper's own part; the others are
//! ours in its style, and every table says so.

/// Sizes that the optimisation in `imf-bench`, which made the bracket, starts from.
#[doc(hidden)]
pub mod bracket;
mod screw_gear;
/// Surfaces from faces and walls, of which `imf-bench` makes parts too.
#[doc(hidden)]
pub mod shell;
mod teapot;
mod teapot_patches;

use std::fmt;
use std::str::FromStr;

use thiserror::Error;

use crate::mesh::Mesh;

/// A part that the project makes itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ReferencePart {
    /// Newell's teapot, lying with its height along x, its depth along y and its length along z.
    Teapot,
    /// A topology-optimised bracket: what is left of [`ReferencePart::BracketRaw`].
    Bracket,
    /// The bracket's design domain, a box with the same holes for bolts and pin.
    BracketRaw,
    /// A helical gear on a threaded bore, its axis along z.
    ScrewGear,
}

/// A name that no reference part has.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("there is no reference part '{0}'; the parts are teapot, bracket, bracket-raw and screw-gear")]
pub struct UnknownPart(pub String);

impl ReferencePart {
    /// All parts, in the order in which they are listed.
    pub const ALL: [Self; 4] = [Self::Teapot, Self::Bracket, Self::BracketRaw, Self::ScrewGear];

    /// The part's name on the command line and in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Teapot => "teapot",
            Self::Bracket => "bracket",
            Self::BracketRaw => "bracket-raw",
            Self::ScrewGear => "screw-gear",
        }
    }

    /// What the part is, in one line.
    #[must_use]
    pub fn description(self) -> &'static str {
        match self {
            Self::Teapot => "Newell's teapot of 32 Bézier patches, solid where the winding number says so",
            Self::Bracket => {
                "a topology-optimised bracket between four bolts and a pin: 15 % of its design domain"
            }
            Self::BracketRaw => "the bracket's design domain: a box with the same holes for bolts and pin",
            Self::ScrewGear => "a helical gear of 14 teeth with recessed web and hub on a threaded bore",
        }
    }

    /// True for a part that the paper itself uses; false for one of ours in its style.
    #[must_use]
    pub fn is_papers_own(self) -> bool {
        matches!(self, Self::Teapot)
    }

    /// The paper's grid for the part, whose pitch is 1 mm.
    #[must_use]
    pub fn dims(self) -> [usize; 3] {
        match self {
            Self::Teapot => [58, 76, 121],
            Self::Bracket | Self::BracketRaw => [49, 147, 87],
            Self::ScrewGear => [99, 98, 63],
        }
    }

    /// The part's surface in millimetres, facing outwards; the same on every call.
    #[must_use]
    pub fn mesh(self) -> Mesh {
        match self {
            Self::Teapot => teapot::mesh(),
            Self::Bracket => bracket::mesh(),
            Self::BracketRaw => bracket::design_domain(),
            Self::ScrewGear => screw_gear::mesh(),
        }
    }
}

impl fmt::Display for ReferencePart {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for ReferencePart {
    type Err = UnknownPart;

    fn from_str(name: &str) -> Result<Self, Self::Err> {
        Self::ALL.into_iter().find(|part| part.name() == name).ok_or_else(|| UnknownPart(name.to_owned()))
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use std::collections::HashMap;

    use super::*;
    use crate::grid::Grid;

    /// How many edges are not used exactly once in each direction.
    pub(crate) fn open_edges(mesh: &Mesh) -> usize {
        let mut uses: HashMap<(u32, u32), [usize; 2]> = HashMap::new();
        for &[a, b, c] in &mesh.triangles {
            for (from, to) in [(a, b), (b, c), (c, a)] {
                uses.entry((from.min(to), from.max(to))).or_default()[usize::from(from > to)] += 1;
            }
        }
        uses.values().filter(|&&directions| directions != [1, 1]).count()
    }

    #[test]
    fn the_papers_grids_have_a_pitch_of_one_millimetre() {
        for part in ReferencePart::ALL {
            let (lower, upper) = part.mesh().bounds().unwrap();
            let grid = Grid::with_dims(lower, upper, part.dims(), 0).unwrap();
            assert!((grid.pitch - 1.0).abs() < 1e-9, "{part}: pitch {}", grid.pitch);
        }
    }

    #[test]
    fn our_own_parts_are_closed_and_fill_their_grids_on_every_axis() {
        for part in ReferencePart::ALL.into_iter().filter(|part| !part.is_papers_own()) {
            let mesh = part.mesh();
            assert_eq!(open_edges(&mesh), 0, "{part}");
            let (lower, upper) = mesh.bounds().unwrap();
            let grid = Grid::with_pitch(lower, upper, 1.0, 0).unwrap();
            assert_eq!(grid.dims, part.dims(), "{part}: from {lower} to {upper}");
        }
    }

    #[test]
    fn meshes_are_whole_face_outwards_and_come_out_the_same_every_time() {
        for part in ReferencePart::ALL {
            let mesh = part.mesh();
            assert!(mesh.signed_volume() > 0.0, "{part}");
            assert!(mesh.vertices.iter().all(|p| p.is_finite()), "{part}");
            assert!(mesh.triangles.iter().all(|[a, b, c]| a != b && b != c && c != a), "{part}");
            let mut used = vec![false; mesh.vertices.len()];
            mesh.triangles.iter().flatten().for_each(|&v| used[v as usize] = true);
            assert!(used.iter().all(|&u| u), "{part}: a vertex that no triangle uses");
            assert_eq!(mesh, part.mesh(), "{part}");
        }
    }

    #[test]
    fn names_are_read_back_and_others_are_refused_with_the_list() {
        for part in ReferencePart::ALL {
            assert_eq!(part.to_string().parse(), Ok(part));
        }
        let refusal = "kettle".parse::<ReferencePart>().unwrap_err().to_string();
        assert!(refusal.contains("kettle"));
        assert!(ReferencePart::ALL.iter().all(|part| refusal.contains(part.name())), "{refusal}");
    }
}
