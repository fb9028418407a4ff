//! What voxels resolve of a surface's walls, in words.

use imf_core::unit::LengthUnit;

use crate::output::short;

/// States that walls are known to within a voxel, whether or not shank and holder avoid all voxels that the surface
/// touches: the cutter meets voxel centres in either case.
pub(super) fn resolved(pitch: f64, conservative: bool, unit: LengthUnit) -> String {
    let pitch = short(pitch);
    let rest = match conservative {
        false => " (of shank and holder too, unless --conservative)".to_owned(),
        true => {
            format!("; for shank and holder none does, and one up to {pitch} {unit} wider may be blocked")
        }
    };
    format!(
        "walls are known to within voxels of {pitch} {unit}: a cutter may cut so much deeper than said, and a gap up to {pitch} {unit} too \
         narrow for it passes for one that fits{rest}"
    )
}
