//! Orientations of the tool and sets of them.
//!
//! `R(θ, φ, ψ) = R_z(θ) R_y(φ) R_z(ψ)` turns the tool's frame (tip at the origin, axis +z from tip to holder) into
//! the world. The tool's axis points along `d = R ẑ = (sin φ cos θ, sin φ sin θ, cos φ)`; ψ rolls the tool about its
//! own axis and is 0 for tools that look the same at every roll. Angles are degrees, pairs are always (θ, φ).

mod limits;

pub use limits::Limits;

use std::f64::consts::{PI, SQRT_2, TAU};
use std::path::Path;

use glam::{DMat3, DQuat, DVec3};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde::{Deserialize, Serialize};
use thiserror::Error;

/// One orientation of the tool.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Orientation {
    /// Longitude of the tool's axis in degrees, [0, 360).
    pub theta: f64,
    /// Angle between the tool's axis and +z in degrees, [0, 180].
    pub phi: f64,
    /// Roll about the tool's own axis in degrees.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub roll: f64,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde's skip_serializing_if passes a reference")]
fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

impl Orientation {
    /// The orientation of an angle pair in degrees, without roll.
    #[must_use]
    pub fn new(theta: f64, phi: f64) -> Self {
        Self { theta, phi, roll: 0.0 }
    }

    /// The orientation whose axis points along `direction`, without roll; θ = 0 at the poles.
    ///
    /// `None` for a zero or non-finite vector.
    #[must_use]
    pub fn from_direction(direction: DVec3) -> Option<Self> {
        let d = direction.try_normalize()?;
        let flat = d.x.hypot(d.y);
        let theta = if flat < 1e-12 { 0.0 } else { wrap_degrees(d.y.atan2(d.x).to_degrees()) };
        Some(Self::new(theta, flat.atan2(d.z).to_degrees()))
    }

    /// The orientation of a rotation matrix.
    #[must_use]
    pub fn from_rotation(rotation: &DMat3) -> Self {
        let axis = rotation.z_axis;
        let flat = axis.x.hypot(axis.y);
        let theta = if flat < 1e-12 { 0.0 } else { axis.y.atan2(axis.x) };
        let phi = flat.atan2(axis.z);
        let rest = (DMat3::from_rotation_z(theta) * DMat3::from_rotation_y(phi)).transpose() * *rotation;
        let roll = rest.x_axis.y.atan2(rest.x_axis.x);
        Self {
            theta: wrap_degrees(theta.to_degrees()),
            phi: phi.to_degrees(),
            roll: wrap_degrees(roll.to_degrees()),
        }
    }

    /// The rotation matrix; components below 1e-12 are exact zeros, so that axes keep to the grid.
    #[must_use]
    pub fn rotation(&self) -> DMat3 {
        let rotation = DMat3::from_rotation_z(self.theta.to_radians())
            * DMat3::from_rotation_y(self.phi.to_radians())
            * DMat3::from_rotation_z(self.roll.to_radians());
        DMat3::from_cols_array(&rotation.to_cols_array().map(|v| if v.abs() < 1e-12 { 0.0 } else { v }))
    }

    /// Unit vector from the tool's tip along its axis; components below 1e-12 are 0.
    #[must_use]
    pub fn direction(&self) -> DVec3 {
        // The rotation's third column, term by term, so that both give the same bits.
        let (sin_theta, cos_theta) = self.theta.to_radians().sin_cos();
        let (sin_phi, cos_phi) = self.phi.to_radians().sin_cos();
        let axis = [cos_theta * sin_phi, sin_theta * sin_phi, cos_phi];
        DVec3::from_array(axis.map(|v: f64| if v.abs() < 1e-12 { 0.0 } else { v }))
    }

    /// (θ, φ) in degrees as the networks read them.
    #[must_use]
    pub fn angles(&self) -> [f32; 2] {
        [self.theta as f32, self.phi as f32]
    }
}

fn wrap_degrees(angle: f64) -> f64 {
    let wrapped = angle.rem_euclid(360.0);
    if wrapped >= 360.0 { 0.0 } else { wrapped }
}

/// Why a set of orientations cannot be made.
#[derive(Debug, Error)]
pub enum OrientationSetError {
    /// The text is none of the known forms.
    #[error(
        "'{0}' is no orientation set: use grid:N, fibonacci:N, random:N:SEED, cone:X,Y,Z:HALF_ANGLE:N, \
         ac:A_MIN:A_MAX:C_MIN:C_MAX:NA:NC, bc:…, so3:N, within:LIMITS@SET, a list of angle pairs such as 0,0;12,6, or a CSV file"
    )]
    Form(String),
    /// A number in the text is missing, malformed or out of range.
    #[error("orientation set '{spec}': {what}")]
    Value {
        /// The text given.
        spec: String,
        /// What is wrong with it.
        what: String,
    },
    /// The text of machine limits is none of the known forms.
    #[error(
        "'{0}' are no machine limits: use ac:A_MIN:A_MAX:C_MIN:C_MAX, bc:B_MIN:B_MAX:C_MIN:C_MAX or \
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

/// More orientations than this are refused as a slip of the keyboard.
const MOST: usize = 10_000_000;

impl OrientationSet {
    /// Reads a set from its text:
    ///
    /// | text | set |
    /// | --- | --- |
    /// | `grid:N` | N × N angle pairs, θ = 360°·i/N, φ = 180°·j/N, θ outermost (the paper's; repeats the pole N times) |
    /// | `fibonacci:N` | N directions spread evenly over the sphere |
    /// | `random:N:SEED` | N directions uniform on the sphere |
    /// | `cone:X,Y,Z:HALF_ANGLE:N` | N directions spread evenly within an angle (degrees) of an axis |
    /// | `ac:A0:A1:C0:C1:NA:NC` | NA × NC directions of two rotary axes within their ranges, see [`Limits`] |
    /// | `bc:B0:B1:C0:C1:NB:NC` | the same for B and C |
    /// | `within:LIMITS@SET` | those directions of SET that a machine's [`Limits`] reach |
    /// | `so3:N` | N rotations spread evenly over SO(3), for tools that are not axisymmetric |
    /// | `θ,φ;θ,φ;…` | the pairs given, degrees |
    /// | a path ending in `.csv` | columns `theta,phi[,roll]` in degrees or `i,j,k`, with that header line |
    ///
    /// # Errors
    /// Names the part of the text that is wrong.
    pub fn parse(spec: &str) -> Result<Self, OrientationSetError> {
        let fail = |what: &str| OrientationSetError::Value { spec: spec.to_owned(), what: what.to_owned() };
        let count = |text: &str| match text.parse::<usize>() {
            Ok(n) if (1..=MOST).contains(&n) => Ok(n),
            _ => Err(fail(&format!("'{text}' is no number of orientations from 1 to {MOST}"))),
        };
        if let Some((limits, set)) = spec.strip_prefix("within:").and_then(|rest| rest.split_once('@')) {
            return Self::parse(set)?.within(&Limits::parse(limits)?);
        }
        let parts: Vec<&str> = spec.split(':').collect();
        let orientations = match parts.as_slice() {
            ["grid", n] => {
                let n = count(n)?;
                if n.saturating_mul(n) > MOST {
                    return Err(fail(&format!("{n} × {n} is more than {MOST} orientations")));
                }
                grid(n)
            }
            ["fibonacci", n] => fibonacci(count(n)?, -1.0).map(direction_orientation).collect(),
            ["random", n, seed] => {
                let seed =
                    seed.parse().map_err(|_| fail(&format!("'{seed}' is no seed (a whole number)")))?;
                random(count(n)?, seed)
            }
            ["cone", axis, half_angle, n] => {
                let axis = numbers(axis)
                    .filter(|v| v.len() == 3)
                    .and_then(|v| DVec3::from_slice(&v).try_normalize());
                let axis =
                    axis.ok_or_else(|| fail("the axis must be three numbers, not all zero, such as 0,0,1"))?;
                let half_angle: f64 = half_angle.parse().unwrap_or(f64::NAN);
                if !(0.0..=180.0).contains(&half_angle) {
                    return Err(fail("the half angle must be from 0 to 180 degrees"));
                }
                let turn = DQuat::from_rotation_arc(DVec3::Z, axis);
                let lowest = half_angle.to_radians().cos();
                fibonacci(count(n)?, lowest).map(|d| direction_orientation(turn * d)).collect()
            }
            ["ac" | "bc", _, _, _, _, n_tilt, n_turn] => {
                let (n_tilt, n_turn) = (count(n_tilt)?, count(n_turn)?);
                if n_tilt.saturating_mul(n_turn) > MOST {
                    return Err(fail(&format!("{n_tilt} × {n_turn} is more than {MOST} orientations")));
                }
                Limits::parse(&parts[..5].join(":"))?.directions(n_tilt, n_turn)
            }
            ["so3", n] => super_fibonacci(count(n)?),
            [path] if path.to_ascii_lowercase().ends_with(".csv") => return Self::read_csv(Path::new(path)),
            [list] if list.contains(',') => list
                .split(';')
                .map(|pair| match numbers(pair).as_deref() {
                    Some(&[theta, phi]) => angle_pair(theta, phi, 0.0).map_err(|what| fail(&what)),
                    _ => Err(fail(&format!("'{pair}' is no pair θ,φ"))),
                })
                .collect::<Result<_, _>>()?,
            _ => return Err(OrientationSetError::Form(spec.to_owned())),
        };
        Ok(Self { spec: spec.to_owned(), orientations })
    }

    /// The orientations whose directions lie within the limits, in the same order.
    ///
    /// # Errors
    /// No orientation is left.
    pub fn within(&self, limits: &Limits) -> Result<Self, OrientationSetError> {
        let spec = format!("within:{limits}@{}", self.spec);
        let reachable = self.orientations.iter().copied().filter(|o| limits.reach(o.direction()));
        let orientations: Vec<_> = reachable.collect();
        if orientations.is_empty() {
            let what = format!("none of its {} orientations is within {limits}", self.len());
            return Err(OrientationSetError::Value { spec: self.spec.clone(), what });
        }
        Ok(Self { spec, orientations })
    }

    fn read_csv(path: &Path) -> Result<Self, OrientationSetError> {
        let spec = path.display().to_string();
        let text = std::fs::read_to_string(path)
            .map_err(|source| OrientationSetError::Read { path: spec.clone(), source })?;
        let fail = |what: String| OrientationSetError::Value { spec: spec.clone(), what };
        let mut lines = text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty());
        let header = lines.next().map(|(_, line)| line.replace(' ', "").to_ascii_lowercase());
        let directions = match header.as_deref() {
            Some("theta,phi" | "theta,phi,roll") => false,
            Some("i,j,k") => true,
            _ => return Err(fail("the first line must be theta,phi or theta,phi,roll or i,j,k".into())),
        };
        let columns = header.map_or(0, |h| h.split(',').count());
        let mut orientations = Vec::new();
        for (number, line) in lines {
            let wrong = |what: &str| fail(format!("line {}: {what}", number + 1));
            let values = numbers(line).filter(|v| v.len() == columns);
            let values = values.ok_or_else(|| wrong(&format!("'{line}' is not {columns} numbers")))?;
            orientations.push(if directions {
                Orientation::from_direction(DVec3::from_slice(&values))
                    .ok_or_else(|| wrong("a direction must not be zero"))?
            } else {
                angle_pair(values[0], values[1], values.get(2).copied().unwrap_or(0.0))
                    .map_err(|e| wrong(&e))?
            });
        }
        if orientations.is_empty() {
            return Err(fail("holds no orientation".into()));
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

fn numbers(text: &str) -> Option<Vec<f64>> {
    text.split(',').map(|t| t.trim().parse::<f64>().ok().filter(|v| v.is_finite())).collect()
}

fn angle_pair(theta: f64, phi: f64, roll: f64) -> Result<Orientation, String> {
    if (0.0..=180.0).contains(&phi) {
        Ok(Orientation { theta: wrap_degrees(theta), phi, roll: wrap_degrees(roll) })
    } else {
        Err(format!("φ must be from 0 to 180 degrees, not {phi}"))
    }
}

fn direction_orientation(direction: DVec3) -> Orientation {
    Orientation::from_direction(direction).unwrap_or_default()
}

fn grid(n: usize) -> Vec<Orientation> {
    let step = |i: usize, whole: f64| whole * i as f64 / n as f64;
    (0..n * n).map(|k| Orientation::new(step(k / n, 360.0), step(k % n, 180.0))).collect()
}

/// `n` directions on a golden spiral over the part of the unit sphere with z ≥ `lowest`: equal areas.
fn fibonacci(n: usize, lowest: f64) -> impl Iterator<Item = DVec3> {
    let golden_angle = PI * (3.0 - 5.0f64.sqrt());
    (0..n).map(move |i| {
        let z = 1.0 - (1.0 - lowest) * (i as f64 + 0.5) / n as f64;
        let flat = (1.0 - z * z).max(0.0).sqrt();
        let (sine, cosine) = (golden_angle * i as f64).sin_cos();
        DVec3::new(flat * cosine, flat * sine, z)
    })
}

fn random(n: usize, seed: u64) -> Vec<Orientation> {
    let mut generator = ChaCha8Rng::seed_from_u64(seed);
    let mut unit = || (generator.next_u64() >> 11) as f64 / (1u64 << 53) as f64;
    (0..n)
        .map(|_| {
            let z = 2.0 * unit() - 1.0;
            Orientation::new(360.0 * unit(), z.acos().to_degrees())
        })
        .collect()
}

/// Super-Fibonacci spirals (Alexa 2022): low-discrepancy rotations.
fn super_fibonacci(n: usize) -> Vec<Orientation> {
    // The positive root of ψ⁴ = ψ + 4.
    const PSI: f64 = 1.533_751_168_755_204_3;
    (0..n)
        .map(|i| {
            let s = i as f64 + 0.5;
            let (inner, outer) = ((s / n as f64).sqrt(), (1.0 - s / n as f64).sqrt());
            let (alpha, beta) = (TAU * s / SQRT_2, TAU * s / PSI);
            let turn = DQuat::from_xyzw(
                inner * alpha.sin(),
                inner * alpha.cos(),
                outer * beta.sin(),
                outer * beta.cos(),
            );
            Orientation::from_rotation(&DMat3::from_quat(turn.normalize()))
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(spec: &str) -> Vec<Orientation> {
        OrientationSet::parse(spec).unwrap().orientations
    }

    #[test]
    fn directions_follow_the_convention() {
        let d = Orientation::new(30.0, 60.0).direction();
        let (t, p) = (30f64.to_radians(), 60f64.to_radians());
        assert!((d - DVec3::new(p.sin() * t.cos(), p.sin() * t.sin(), p.cos())).length() < 1e-15);
        assert_eq!(Orientation::new(90.0, 90.0).direction(), DVec3::Y);
        assert_eq!(Orientation::new(0.0, 180.0).direction(), DVec3::NEG_Z);
    }

    #[test]
    fn directions_and_rotations_return_to_their_angles() {
        for o in set("random:200:5") {
            let back = Orientation::from_direction(o.direction()).unwrap();
            assert!((back.direction() - o.direction()).length() < 1e-12);
        }
        for o in set("so3:200") {
            let back = Orientation::from_rotation(&o.rotation());
            assert!((back.rotation() - o.rotation()).to_cols_array().iter().all(|v| v.abs() < 1e-10));
        }
        assert!(Orientation::from_direction(DVec3::ZERO).is_none());
    }

    #[test]
    fn the_papers_grid_holds_its_out_of_sample_pair_at_30_only() {
        let holds = |n: usize| set(&format!("grid:{n}")).iter().any(|o| o.theta == 12.0 && o.phi == 6.0);
        assert_eq!(set("grid:15").len(), 225);
        assert!(!holds(15) && holds(30));
    }

    #[test]
    fn spirals_and_random_sets_are_balanced() {
        for spec in ["fibonacci:1000", "random:100000:1"] {
            let mean: DVec3 =
                set(spec).iter().map(Orientation::direction).sum::<DVec3>() / set(spec).len() as f64;
            assert!(mean.length() < 0.01, "{spec}: {mean}");
        }
        assert_eq!(set("random:9:4"), set("random:9:4"));
        assert_ne!(set("random:9:4"), set("random:9:5"));
        // The mean of uniform rotations is the zero matrix.
        let mean = set("so3:4000").iter().fold(DMat3::ZERO, |sum, o| sum + o.rotation()) * (1.0 / 4000.0);
        assert!(mean.to_cols_array().iter().all(|v| v.abs() < 0.01), "{mean:?}");
    }

    #[test]
    fn a_cone_stays_within_its_angle() {
        let axis = DVec3::new(1.0, -2.0, 0.5).normalize();
        for o in set("cone:1,-2,0.5:25:300") {
            assert!(o.direction().dot(axis) >= 25f64.to_radians().cos() - 1e-12);
        }
    }

    #[test]
    fn lists_and_files_are_read_and_their_errors_name_the_line() {
        assert_eq!(set("0,0;12,6")[1], Orientation::new(12.0, 6.0));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("axes.csv");
        std::fs::write(&path, "i,j,k\n0,0,2\n1,0,0\n").unwrap();
        let read = OrientationSet::parse(path.to_str().unwrap()).unwrap();
        assert_eq!(read.orientations[1].direction(), DVec3::X);
        std::fs::write(&path, "theta,phi\n0,10\n0,190\n").unwrap();
        let error = OrientationSet::parse(path.to_str().unwrap()).unwrap_err().to_string();
        assert!(error.contains("line 3") && error.contains("190"), "{error}");
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
        ] {
            assert!(OrientationSet::parse(spec).is_err(), "{spec}");
        }
    }
}
