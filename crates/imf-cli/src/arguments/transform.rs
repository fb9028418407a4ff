//! The part's set-up as text: steps that are applied one after the other.

use anyhow::{Context, Result, bail, ensure};
use glam::{DMat4, DQuat, DVec3, DVec4};
use imf_core::scene::TransformFault;

/// Reads steps separated by `;`, the first applied first:
/// `rotate:X,Y,Z:ANGLE` (axis, degrees), `translate:X,Y,Z`, or `matrix:` and 12 or 16 numbers (three or four rows of four) that
/// turn, move, and scale alike in all directions.
pub(crate) fn parse_transform(text: &str) -> Result<DMat4, String> {
    let mut steps = text.split(';').map(str::trim).filter(|step| !step.is_empty());
    steps.try_fold(DMat4::IDENTITY, |done, step| match parse_step(step) {
        Ok(transform) => Ok(transform * done),
        Err(error) => Err(format!("transform step '{step}': {error:#}")),
    })
}

fn parse_step(step: &str) -> Result<DMat4> {
    match step.split(':').collect::<Vec<_>>().as_slice() {
        ["rotate", axis, angle] => {
            let axis = vector(axis)?.try_normalize().context("the axis must not be zero")?;
            let angle: f64 = angle.parse().context("the angle must be a number of degrees")?;
            ensure!(angle.is_finite(), "the angle must be a finite number");
            // Exact zeros and ones for quarter turns.
            let clean = |v: f64| if v.abs() < 1e-12 { 0.0 } else { v };
            let turn = DMat4::from_quat(DQuat::from_axis_angle(axis, angle.to_radians()));
            Ok(DMat4::from_cols_array(&turn.to_cols_array().map(clean)))
        }
        ["translate", offset] => Ok(DMat4::from_translation(vector(offset)?)),
        ["matrix", rows] => {
            let v = numbers(rows)?;
            ensure!(
                v.len() == 12 || v.len() == 16,
                "a matrix needs 12 numbers, three rows of four, or 16 with the row 0,0,0,1, not {}",
                v.len()
            );
            ensure!(
                v.len() == 12 || v[12..] == [0.0, 0.0, 0.0, 1.0],
                "the last row of a matrix must be 0,0,0,1: write it row by row, the translation at the end of the first three rows"
            );
            let column = |c: usize, w: f64| DVec4::new(v[c], v[4 + c], v[8 + c], w);
            let matrix = DMat4::from_cols(column(0, 0.0), column(1, 0.0), column(2, 0.0), column(3, 1.0));
            TransformFault::check(&matrix)?;
            Ok(matrix)
        }
        _ => bail!("use rotate:X,Y,Z:ANGLE, translate:X,Y,Z or matrix: with 12 or 16 numbers"),
    }
}

fn vector(text: &str) -> Result<DVec3> {
    let v = numbers(text)?;
    ensure!(v.len() == 3, "'{text}' must be three numbers");
    Ok(DVec3::from_slice(&v))
}

fn numbers(text: &str) -> Result<Vec<f64>> {
    text.split(',')
        .map(|t| {
            let value: f64 = t.trim().parse().with_context(|| format!("'{t}' is not a number"))?;
            ensure!(value.is_finite(), "'{t}' is not a finite number");
            Ok(value)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_applied_in_order() {
        let m = parse_transform("translate:1,0,0; rotate:0,0,1:90").unwrap();
        assert!((m.transform_point3(DVec3::ZERO) - DVec3::Y).length() < 1e-12);
        let m = parse_transform("matrix:0,-1,0,5,1,0,0,6,0,0,1,7").unwrap();
        assert_eq!(m.transform_point3(DVec3::X), DVec3::new(5.0, 7.0, 7.0));
        // One scale for all axes, and a last row that says nothing.
        let scaled = "matrix:0,-25.4,0,5,25.4,0,0,6,0,0,25.4,7,0,0,0,1";
        assert_eq!(parse_transform(scaled).unwrap().transform_point3(DVec3::X), DVec3::new(5.0, 31.4, 7.0));
    }

    #[test]
    fn what_changes_the_parts_shape_is_refused_by_name() {
        for text in
            ["scale:2", "rotate:0,0,0:5", "matrix:1,2", "matrix:2,0,0,0,0,1,0,0,0,0,1,0", "translate:1,x,0"]
        {
            assert!(parse_transform(text).is_err(), "{text}");
        }
        for (text, name) in [
            ("matrix:-1,0,0,0,0,1,0,0,0,0,1,0", "mirrors"),
            ("matrix:2,0,0,0,0,1,0,0,0,0,1,0", "scales by 2, 1 and 1"),
            ("matrix:1,0,0,0,0,0,0,0,0,0,1,0", "scales by 1, 0 and 1"),
            ("matrix:1,0.6,0,0,0,0.8,0,0,0,0,1,0", "shears"),
            ("matrix:1,0,0,0,0,1,0,0,0,0,1,0,5,6,7,1", "row by row"),
        ] {
            let refusal = parse_transform(text).unwrap_err();
            assert!(refusal.contains(name), "{refusal}");
        }
    }
}
