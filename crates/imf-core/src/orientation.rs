//! Orientations of the tool and sets of them.
//!
//! `R(θ, φ, ψ) = R_z(θ) R_y(φ) R_z(ψ)` turns the tool's frame (tip at the origin, axis +z from tip to holder) into
//! the world. The tool's axis points along `d = R ẑ = (sin φ cos θ, sin φ sin θ, cos φ)`; ψ rolls the tool about its
//! own axis and is 0 for tools that look the same at every roll. Angles are degrees, pairs are always (θ, φ).

mod limits;
mod set;
mod spread;
mod table;

pub use limits::{Limits, TiltingAxis};
pub(crate) use set::AXES;
pub(crate) use set::joined;
pub use set::{OrientationSet, OrientationSetError};

use std::collections::HashSet;

use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};

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

    /// The rotation as a quaternion of length 1.
    #[must_use]
    pub fn quaternion(&self) -> DQuat {
        DQuat::from_rotation_z(self.theta.to_radians())
            * DQuat::from_rotation_y(self.phi.to_radians())
            * DQuat::from_rotation_z(self.roll.to_radians())
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

/// Of each orientation, whether a tool stands in it as in one before: a `round` tool wherever the direction is the same.
#[doc(hidden)]
#[must_use]
pub fn repeats(orientations: &[Orientation], round: bool) -> Vec<bool> {
    let mut known = HashSet::new();
    let stands = |orientation: &Orientation| {
        let rolled = if round { DVec3::ZERO } else { orientation.rotation().x_axis };
        // Adding zero turns minus zero into zero.
        [orientation.direction(), rolled].map(|axis| (axis + 0.0).to_array().map(f64::to_bits))
    };
    orientations.iter().map(|orientation| !known.insert(stands(orientation))).collect()
}

fn wrap_degrees(angle: f64) -> f64 {
    let wrapped = angle.rem_euclid(360.0);
    if wrapped >= 360.0 { 0.0 } else { wrapped }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::section::test_shapes::orientations;

    #[test]
    fn directions_follow_the_convention() {
        let d = Orientation::new(30.0, 60.0).direction();
        let (t, p) = (30f64.to_radians(), 60f64.to_radians());
        assert!((d - DVec3::new(p.sin() * t.cos(), p.sin() * t.sin(), p.cos())).length() < 1e-15);
        assert_eq!(Orientation::new(90.0, 90.0).direction(), DVec3::Y);
        assert_eq!(Orientation::new(0.0, 180.0).direction(), DVec3::NEG_Z);
    }

    #[test]
    fn a_round_tool_cannot_tell_turns_about_its_axis_apart() {
        let rolled = Orientation { roll: 90.0, ..Orientation::default() };
        let set = [&orientations("0,0;90,0;0,0;30,60;390,60")[..], &[rolled]].concat();
        assert_eq!(repeats(&set, true), [false, true, true, false, true, true]);
        // To another one a turn about the pole is a roll.
        assert_eq!(repeats(&set, false), [false, false, true, false, true, true]);
    }

    #[test]
    fn directions_and_rotations_return_to_their_angles() {
        for o in orientations("random:200:5") {
            let back = Orientation::from_direction(o.direction()).unwrap();
            assert!((back.direction() - o.direction()).length() < 1e-12);
        }
        for o in orientations("so3:200") {
            let back = Orientation::from_rotation(&o.rotation());
            let same =
                |rotation: DMat3| (rotation - o.rotation()).to_cols_array().iter().all(|v| v.abs() < 1e-10);
            assert!(same(back.rotation()) && same(DMat3::from_quat(o.quaternion())));
        }
        assert!(Orientation::from_direction(DVec3::ZERO).is_none());
    }
}
