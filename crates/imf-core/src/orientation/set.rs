//! Sets of orientations, and their text form.

use std::collections::HashMap;
use std::path::Path;

use glam::DVec3;
use serde::{Deserialize, Serialize};
use thiserror::Error;

#[cfg(feature = "random")]
use super::spread::random;
use super::spread::{direction_orientation, fibonacci, grid, super_fibonacci};
use super::table::read_csv;
use super::{Limits, Orientation, wrap_degrees};
use crate::mesh::SAME;

/// Why a set of orientations cannot be made.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum OrientationSetError {
    /// The text has none of the known forms.
    #[error("'{0}' is not an orientation set. {forms}", forms = OrientationSet::FORMS)]
    Form(String),
    /// The text names the part's own directions, and no part is known.
    #[error(
        "'normals' are directions that the surface of a part suggests, and no surface is known here: name them, or take \
         axes+fibonacci:N"
    )]
    NoPart,
    /// A number in the text is missing, malformed or out of range.
    #[error("orientation set '{spec}': {what}")]
    Value {
        /// The text given.
        spec: String,
        /// What is wrong with it.
        what: String,
    },
    /// The text of machine limits has none of the known forms.
    #[error(
        "'{0}' are not machine limits: use ac:A_MIN:A_MAX:C_MIN:C_MAX, bc:B_MIN:B_MAX:C_MIN:C_MAX or \
             cone:X,Y,Z:HALF_ANGLE, in degrees"
    )]
    Limits(String),
    /// The CSV file cannot be read.
    #[error("cannot read orientations from {path}: {source}")]
    Read {
        /// The file.
        path: String,
        /// The system's reason.
        source: std::io::Error,
    },
}

/// An ordered list of orientations and the text it was made from.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OrientationSet {
    /// The text that [`OrientationSet::parse`] read, or a name.
    pub spec: String,
    /// The orientations in order: indices in results count these.
    pub orientations: Vec<Orientation>,
}

/// Gives the directions of the part.
type Part<'a> = &'a mut dyn FnMut() -> Result<Vec<DVec3>, OrientationSetError>;

/// From above first, as most parts are set up.
pub(crate) const AXES: [DVec3; 6] = [DVec3::Z, DVec3::NEG_Z, DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y];

/// More orientations than this are refused as a slip of the keyboard.
const MAX_ORIENTATIONS: usize = 10_000_000;

impl OrientationSet {
    /// The text of the set that users want where they name none: with the part's own directions where it is `of_part`, else the axes
    /// and all around; whole rotations unless the tool is `round`.
    #[must_use]
    pub fn usual(round: bool, of_part: bool) -> &'static str {
        match (round, of_part) {
            (true, true) => "axes+normals+fibonacci:225",
            (true, false) => "axes+fibonacci:225",
            (false, true) => "axes+normals+so3:500",
            (false, false) => "axes+so3:500",
        }
    }

    /// The grammar of sets, for help and messages.
    pub const FORMS: &str = "Sets of directions, joined by + (a direction that comes again is left out): axes (±x, ±y, ±z), \
        normals (of the part's large flat faces, and both ways along its cylinders' axes), fibonacci:N (spread evenly), \
        cone:X,Y,Z:HALF_ANGLE:N (an axis first, the others around it), ac:A0:A1:C0:C1:NA:NC and bc:… (of two rotary axes, \
        evenly), within:LIMITS@SET (those that a machine reaches), pairs θ,φ such as 0,0;30,40, a CSV file \
        (theta,phi[,roll] or i,j,k), so3:N (whole rotations, for tools that are not round), random:N:SEED, grid:N (the paper's). \
        Angles are in degrees; a direction points from the tip to the holder.";

    /// Reads a set from its text, where no part is known: as [`OrientationSet::parse_for`] without `normals`.
    ///
    /// # Errors
    /// Names the part of the text that is wrong.
    pub fn parse(spec: &str) -> Result<Self, OrientationSetError> {
        Self::read(spec, &mut || Err(OrientationSetError::NoPart))
    }

    /// Reads a set from its text:
    ///
    /// | text | set |
    /// | --- | --- |
    /// | `axes` | ±z, ±x, ±y |
    /// | `normals` | the directions that the part suggests, as `part` gives them ([`Mesh::machining_directions`](crate::mesh::Mesh::machining_directions)), in the frame of the set-up |
    /// | `fibonacci:N` | N directions spread evenly over the sphere |
    /// | `cone:X,Y,Z:HALF_ANGLE:N` | N directions within an angle (degrees) of an axis: the axis, then others spread evenly |
    /// | `ac:A0:A1:C0:C1:NA:NC` | NA × NC directions of two rotary axes within their ranges, see [`Limits`] |
    /// | `bc:B0:B1:C0:C1:NB:NC` | the same for B and C |
    /// | `random:N:SEED` | N directions uniform on the sphere |
    /// | `grid:N` | N × N angle pairs, θ = 360°·i/N, φ = 180°·j/N, θ outermost (the paper's; repeats the pole N times) |
    /// | `so3:N` | N rotations spread evenly over SO(3), for tools that are not axisymmetric |
    /// | `θ,φ;θ,φ;…` | the pairs given, degrees |
    /// | a path ending in `.csv` | columns `theta,phi[,roll]` in degrees or `i,j,k`, with that header line; a first column `index` is passed over |
    /// | `A+B` | A, then of B what has not come before: rotations at less than 0.03° are one |
    /// | `within:LIMITS@SET` | of all that follows what a machine reaches, see [`OrientationSet::within`] |
    ///
    /// `part` is called where the text names `normals`, and not otherwise.
    ///
    /// # Errors
    /// Names the part of the text that is wrong.
    pub fn parse_for(spec: &str, mut part: impl FnMut() -> Vec<DVec3>) -> Result<Self, OrientationSetError> {
        Self::read(spec, &mut || Ok(part()))
    }

    fn read(spec: &str, part: Part<'_>) -> Result<Self, OrientationSetError> {
        if let Some((limits, set)) = spec.strip_prefix("within:").and_then(|rest| rest.split_once('@')) {
            return Self::read(set, part)?.within(&Limits::parse(limits)?);
        }
        // A file's name may hold a plus.
        let is_file = is_csv(spec) && Path::new(spec).is_file();
        let orientations = match spec.split_once('+').filter(|_| !is_file) {
            None => Self::term(spec, part)?,
            Some((first, rest)) => {
                let first = Self::term(first, part)?;
                joined(&[&first, &Self::read(rest, part)?.orientations])
            }
        };
        Ok(Self { spec: spec.to_owned(), orientations })
    }

    /// One set of those that are joined.
    fn term(spec: &str, part: Part<'_>) -> Result<Vec<Orientation>, OrientationSetError> {
        let fail = |what: &str| OrientationSetError::Value { spec: spec.to_owned(), what: what.to_owned() };
        let count = |text: &str| match text.parse::<usize>() {
            Ok(n) if (1..=MAX_ORIENTATIONS).contains(&n) => Ok(n),
            _ => Err(fail(&format!("'{text}' is not a number of orientations from 1 to {MAX_ORIENTATIONS}"))),
        };
        let table = |a: usize, b: usize| match a.saturating_mul(b) {
            0..=MAX_ORIENTATIONS => Ok(()),
            _ => Err(fail(&format!("{a} × {b} is more than {MAX_ORIENTATIONS} orientations"))),
        };
        let parts: Vec<&str> = spec.split(':').collect();
        Ok(match parts.as_slice() {
            ["axes"] => AXES.map(direction_orientation).to_vec(),
            ["normals"] => part()?.into_iter().map(direction_orientation).collect(),
            ["grid", n] => {
                let n = count(n)?;
                table(n, n)?;
                grid(n)
            }
            ["fibonacci", n] => fibonacci(count(n)?, -1.0).map(direction_orientation).collect(),
            #[cfg(not(feature = "random"))]
            ["random", ..] => return Err(fail("random sets need the feature `random` of imf-core")),
            #[cfg(feature = "random")]
            ["random", n, seed] => {
                let seed =
                    seed.parse().map_err(|_| fail(&format!("'{seed}' is not a seed (a whole number)")))?;
                random(count(n)?, seed)
            }
            ["cone", _, _, n] => Limits::parse(&parts[..3].join(":"))?.cone(count(n)?),
            ["ac" | "bc", _, _, _, _, n_tilt, n_turn] => {
                let (n_tilt, n_turn) = (count(n_tilt)?, count(n_turn)?);
                table(n_tilt, n_turn)?;
                Limits::parse(&parts[..5].join(":"))?.directions(n_tilt, n_turn)
            }
            ["so3", n] => super_fibonacci(count(n)?),
            _ if is_csv(spec) => read_csv(Path::new(spec))?,
            [list] if list.contains(',') => list
                .split(';')
                .map(|pair| match numbers(pair).as_deref() {
                    Some(&[theta, phi]) => angle_pair(theta, phi, 0.0).map_err(|what| fail(&what)),
                    _ => Err(fail(&format!("'{pair}' is not a pair θ,φ"))),
                })
                .collect::<Result<_, _>>()?,
            // A folder, say, or a link that leads nowhere.
            _ if Path::new(spec).symlink_metadata().is_ok() => {
                return Err(fail("orientations are read from files that end in .csv"));
            }
            _ => return Err(OrientationSetError::Form(spec.to_owned())),
        })
    }

    /// Where an axis is fixed, what it leaves, which no set meets by chance (the axis of a cone of half angle 0; every few degrees of the
    /// circle that a fixed rotary axis leaves), then the orientations whose directions lie within the limits, in the same order. To pairs
    /// of angles and to files, which name the directions that are asked, nothing is added.
    ///
    /// # Errors
    /// No orientation is left.
    pub fn within(&self, limits: &Limits) -> Result<Self, OrientationSetError> {
        let spec = format!("within:{limits}@{}", self.spec);
        let reachable = self.orientations.iter().copied().filter(|o| limits.reach(o.direction()));
        let reachable: Vec<_> = reachable.collect();
        let is_named = |set: &str| is_csv(set) || set.contains(',') && !set.contains(':');
        let is_file = is_csv(&self.spec) && Path::new(&self.spec).is_file();
        let are_named = is_file || self.spec.split('+').all(is_named);
        let own = if are_named { Vec::new() } else { limits.own_directions() };
        let orientations = if own.is_empty() { reachable } else { joined(&[&own, &reachable]) };
        if orientations.is_empty() {
            let what = format!("none of its {} orientations is within {limits}", self.len());
            return Err(OrientationSetError::Value { spec: self.spec.clone(), what });
        }
        Ok(Self { spec, orientations })
    }

    /// Number of orientations.
    #[must_use]
    pub fn len(&self) -> usize {
        self.orientations.len()
    }

    /// True without orientations.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.orientations.is_empty()
    }
}

/// The finite numbers of a comma-separated list; `None` where one is not a finite number.
pub(super) fn numbers(text: &str) -> Option<Vec<f64>> {
    text.split(',').map(|t| t.trim().parse::<f64>().ok().filter(|v| v.is_finite())).collect()
}

fn is_csv(text: &str) -> bool {
    text.to_ascii_lowercase().ends_with(".csv")
}

/// Sets behind one another without what has come before.
pub(crate) fn joined(sets: &[&[Orientation]]) -> Vec<Orientation> {
    let mut orientations: Vec<Orientation> = Vec::new();
    // By the cell of the direction, so that only neighbours are compared.
    let mut cells: HashMap<[i64; 3], Vec<usize>> = HashMap::new();
    for orientation in sets.iter().copied().flatten() {
        let (direction, turn) = (orientation.direction(), orientation.quaternion());
        let cell = (direction / SAME).floor().to_array().map(|place| place as i64);
        let known = (0..27usize).any(|n| {
            let near = [
                cell[0] + (n / 9) as i64 - 1,
                cell[1] + (n / 3 % 3) as i64 - 1,
                cell[2] + (n % 3) as i64 - 1,
            ];
            let there = cells.get(&near).into_iter().flatten();
            there.copied().any(|index| orientations[index].quaternion().angle_between(turn) < SAME)
        });
        if !known {
            cells.entry(cell).or_default().push(orientations.len());
            orientations.push(*orientation);
        }
    }
    orientations
}

pub(super) fn angle_pair(theta: f64, phi: f64, roll: f64) -> Result<Orientation, String> {
    if (0.0..=180.0).contains(&phi) {
        Ok(Orientation { theta: wrap_degrees(theta), phi, roll: wrap_degrees(roll) })
    } else {
        Err(format!("φ must be from 0 to 180 degrees, not {phi}"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::section::test_shapes::orientations;

    #[test]
    fn the_papers_grid_holds_its_out_of_sample_pair_at_30_only() {
        let contains =
            |n: usize| orientations(&format!("grid:{n}")).iter().any(|o| o.theta == 12.0 && o.phi == 6.0);
        assert_eq!(orientations("grid:15").len(), 225);
        assert!(!contains(15) && contains(30));
    }

    #[test]
    fn lists_and_files_are_read_and_their_errors_name_the_line() {
        assert_eq!(orientations("0,0;12,6")[1], Orientation::new(12.0, 6.0));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("axes.csv");
        let read = |text: &str| {
            std::fs::write(&path, text).unwrap();
            OrientationSet::parse(path.to_str().unwrap()).map(|read| read.orientations)
        };
        assert_eq!(read("i,j,k\n0,0,2\n1,0,0\n").unwrap()[1].direction(), DVec3::X);
        let rolled = read("index,theta,phi,roll\n0,30,40,50\n1,0,90,0\n").unwrap();
        assert_eq!(rolled[0], Orientation { theta: 30.0, phi: 40.0, roll: 50.0 });
        let error = read("theta,phi\n0,10\n0,190\n").unwrap_err().to_string();
        assert!(error.contains("line 3") && error.contains("190"), "{error}");
        let other = OrientationSet::parse(folder.path().to_str().unwrap()).unwrap_err().to_string();
        assert!(other.contains("files that end in .csv") && !other.contains("fibonacci"), "{other}");
    }

    #[test]
    fn joined_sets_keep_their_order_and_drop_what_has_come_before() {
        let lone = orientations("fibonacci:50");
        let both = orientations("axes+0,0;90,90;10,20+fibonacci:50");
        assert_eq!(both[0].direction(), DVec3::Z);
        assert_eq!(both[6], Orientation::new(10.0, 20.0));
        assert_eq!(both[7..], lone);
        // Rolled about an axis that came before: another rotation.
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a+b.csv");
        std::fs::write(&path, "theta,phi,roll\n0,0,90\n0,0.01,0\n0,0,359.99\n").unwrap();
        let path = path.to_str().unwrap();
        assert_eq!(orientations(path).len(), 3);
        std::fs::rename(path, folder.path().join("ab.csv")).unwrap();
        let rolled = orientations(&format!("axes+{}", folder.path().join("ab.csv").display()));
        assert_eq!((rolled.len(), rolled[6].roll), (7, 90.0));
        assert_eq!(orientations("so3:40+axes").len(), 46);
    }

    #[test]
    fn directions_of_the_part_are_requested_where_the_text_names_them() {
        let mut asked = 0;
        let mut part = || {
            asked += 1;
            vec![DVec3::NEG_Z, DVec3::new(3.0, 0.0, 4.0)]
        };
        let found = OrientationSet::parse_for("axes+normals+fibonacci:9", &mut part).unwrap();
        assert_eq!(found.len(), 16);
        assert!(found.orientations[6].direction().distance(DVec3::new(0.6, 0.0, 0.8)) < 1e-12);
        let within = OrientationSet::parse_for("within:cone:0,0,1:40@normals+axes", &mut part).unwrap();
        assert_eq!(within.len(), 2);
        OrientationSet::parse_for("axes", &mut part).unwrap();
        assert_eq!(asked, 2);
        let refusal = OrientationSet::parse("axes+normals").unwrap_err();
        assert!(matches!(refusal, OrientationSetError::NoPart), "{refusal}");
    }

    #[test]
    fn wrong_texts_are_refused() {
        for spec in [
            "",
            "grid",
            "grid:0",
            "grid:x",
            "random:5",
            "cone:0,0,0:10:5",
            "cone:0,0,1:200:5",
            "1,2,3",
            "grid:99999",
            "axes+",
            "+axes",
            "axes:3",
            "axes+spiral:3",
        ] {
            assert!(OrientationSet::parse(spec).is_err(), "{spec}");
        }
    }
}
