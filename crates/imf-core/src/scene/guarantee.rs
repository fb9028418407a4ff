//! What "free" of the exact field guarantees for the mesh itself.
//!
//! Where every voxel that the surface touches is solid, every point of the part lies in a solid voxel, at most √3/2 pitch
//! from its centre. An element offset by that much that holds no solid centre therefore keeps off the mesh itself.

use std::fmt;

use super::SceneRecord;
use crate::grid::HALF_DIAGONAL;
use crate::tool::{Clearance, ElementKind, Tool};
use crate::unit::DisplayLength;

/// Which guarantee holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Guarantee {
    /// For voxel centres: a wall thinner than a voxel may be missing.
    Centres,
    /// For voxels of which every one is solid that the surface touches, and the tool at their centres; for the mesh it
    /// takes this clearance.
    Voxels {
        /// Half a voxel's diagonal, in the grid's unit.
        needed: f64,
    },
    /// For the mesh itself as far as holder and shank go; the cutter has too little clearance, or may touch the part.
    HolderAndShank,
    /// For the mesh itself and the whole tool.
    Mesh,
}

impl Guarantee {
    /// The guarantee of sections and counts of a tool that is offset by `clearance`; with `contact` the cutter may touch.
    #[must_use]
    pub fn new(conservative: bool, tool: &Tool, clearance: &Clearance, contact: bool, pitch: f64) -> Self {
        Self::with_needed(conservative, tool, clearance, contact, HALF_DIAGONAL * pitch)
    }

    /// How much nearer to shank and holder the surface may lie than the voxel centres that they avoided, for a pitch;
    /// `None` where it does not.
    #[must_use]
    pub fn surface_nearer_by(&self, pitch: f64) -> Option<f64> {
        match *self {
            Self::Centres => Some(pitch),
            Self::Voxels { needed } => Some(needed),
            Self::HolderAndShank | Self::Mesh => None,
        }
    }

    /// Which guarantee a clearance gives of which `needed` is enough.
    fn with_needed(
        conservative: bool,
        tool: &Tool,
        clearance: &Clearance,
        contact: bool,
        needed: f64,
    ) -> Self {
        let keeps_off = |cutter: bool| {
            let mut elements = tool.elements().iter().filter(|e| (e.kind == ElementKind::Cutter) == cutter);
            tool.mesh().is_none() && elements.all(|e| clearance.of(e.kind) >= needed)
        };
        let has_rest = tool.without_cutter().is_some();
        match (conservative, keeps_off(false), keeps_off(true) && !contact) {
            (false, ..) => Self::Centres,
            (true, true, true) => Self::Mesh,
            (true, true, false) if has_rest => Self::HolderAndShank,
            (true, ..) => Self::Voxels { needed },
        }
    }

    /// The order from the weakest to the strongest.
    #[must_use]
    pub fn strength(&self) -> u8 {
        match self {
            Self::Centres => 0,
            Self::Voxels { .. } => 1,
            Self::HolderAndShank => 2,
            Self::Mesh => 3,
        }
    }
}

/// Which guarantees hold on a path that is checked pose by pose.
///
/// No point of the tool is ever farther than half a step from where it is at the nearest of these poses. An element
/// offset by half a step more therefore keeps off the mesh at every time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathGuarantee {
    /// At the poses that are checked.
    pub at_poses: Guarantee,
    /// At every time.
    pub at_all_times: Guarantee,
    /// The clearance that the mesh itself takes at every time, in the grid's unit.
    pub needed: f64,
    /// How much nearer the tool may come between two checked poses, in the grid's unit.
    pub between: f64,
}

impl PathGuarantee {
    /// As [`Guarantee::new`], of a path on which no point of the tool moves farther than `step` between two poses that are
    /// checked.
    #[must_use]
    pub fn new(
        conservative: bool,
        tool: &Tool,
        clearance: &Clearance,
        contact: bool,
        pitch: f64,
        step: f64,
    ) -> Self {
        let needed = HALF_DIAGONAL * pitch + 0.5 * step;
        Self {
            at_poses: Guarantee::new(conservative, tool, clearance, contact, pitch),
            at_all_times: Guarantee::with_needed(conservative, tool, clearance, contact, needed),
            needed,
            between: 0.5 * step,
        }
    }
}

impl fmt::Display for PathGuarantee {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { at_poses, at_all_times, .. } = self;
        let [needed, between] = [self.needed, self.between].map(enough);
        if at_poses.strength() < Guarantee::HolderAndShank.strength() {
            return write!(
                f,
                "{at_poses}; between the checked poses a guarantee takes a clearance of at least {needed} in the part's unit"
            );
        }
        if at_all_times == at_poses {
            return write!(
                f,
                "{at_poses}; that holds at every time, not only at the checked poses, for the clearance is at least {needed}"
            );
        }
        write!(
            f,
            "{at_poses}; that holds at the checked poses, between which the tool may come nearer by {between}: at every time \
             it takes a clearance of at least {needed}"
        )
    }
}

/// A length that is asked for: to four significant digits, never less.
fn enough(length: f64) -> DisplayLength {
    let digit = 10_f64.powf((length.log10() - 3.0).floor());
    DisplayLength(((length / digit - 1e-9).ceil() * digit).max(0.0))
}

impl SceneRecord {
    /// Which guarantee holds for this scene's field.
    #[must_use]
    pub fn guarantee(&self) -> Guarantee {
        let contact = self.contact.is_some();
        Guarantee::new(self.conservative, self.bare_tool(), &self.clearance, contact, self.grid.pitch)
    }
}

impl fmt::Display for Guarantee {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Centres => f.write_str(
                "exact for voxel centres; no guarantee about the mesh itself (which needs conservative voxels, and a \
                 clearance of at least √3/2 pitch)",
            ),
            Self::Voxels { needed } => write!(
                f,
                "exact for the tool at voxel centres against every voxel that the surface touches; a guarantee about the \
                 mesh itself also needs a clearance of at least √3/2 pitch ({})",
                enough(*needed)
            ),
            Self::HolderAndShank => f.write_str(
                "where it is free, holder and shank keep off the mesh itself (every voxel that the surface touches is \
                 solid, and their clearance is at least √3/2 pitch); for the cutter exact for voxel centres",
            ),
            Self::Mesh => f.write_str(
                "where it is free, the whole tool keeps off the mesh itself (every voxel that the surface touches is \
                 solid, and its clearance is at least √3/2 pitch)",
            ),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_takes_half_of_its_step_more() {
        let tool = Tool::paper();
        let at_pitch = |room: f64, step: f64, pitch: f64| {
            let clearance = Clearance { holder: room, shank: room, cutter: room };
            PathGuarantee::new(true, &tool, &clearance, false, pitch, step)
        };
        let guarantee = |room: f64, step: f64| at_pitch(room, step, 1.0);
        let near = guarantee(0.87, 0.25);
        assert_eq!(near.at_poses, Guarantee::Mesh);
        assert!(matches!(near.at_all_times, Guarantee::Voxels { .. }));
        assert!((near.needed - 0.991_025).abs() < 1e-6);
        assert!(
            near.to_string().contains("nearer by 0.125:") && near.to_string().contains("at least 0.9911")
        );
        let far = guarantee(1.0, 0.25);
        assert_eq!(far.at_all_times, Guarantee::Mesh);
        assert!(
            far.to_string().contains("at every time, not only at the checked poses, for the clearance"),
            "{far}"
        );
        assert!(guarantee(1.0, 1.0).to_string().contains("at least 1.367"));
        // In metres.
        assert!(at_pitch(7e-4, 1.875e-4, 7.5e-4).to_string().contains("at least 0.0007433"));
    }

    #[test]
    fn the_mesh_itself_needs_conservative_voxels_and_half_a_diagonal() {
        let tool = Tool::paper();
        let guarantee = |conservative, holder, cutter, contact| {
            let clearance = Clearance { holder, shank: 0.0, cutter };
            Guarantee::new(conservative, &tool, &clearance, contact, 2.0)
        };
        assert_eq!(guarantee(false, 9.0, 9.0, false), Guarantee::Centres);
        assert_eq!(guarantee(true, 1.7, 9.0, false), Guarantee::Voxels { needed: HALF_DIAGONAL * 2.0 });
        assert_eq!(guarantee(true, 1.74, 1.7, false), Guarantee::HolderAndShank);
        // The tool has no shank, so that a shank's clearance of 0 does not matter.
        assert_eq!(guarantee(true, 1.74, 1.74, false), Guarantee::Mesh);
        assert_eq!(guarantee(true, 1.74, 1.74, true), Guarantee::HolderAndShank);
    }
}
