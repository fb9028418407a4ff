//! What becomes of one sample of a surface: with its numbers, and in a word.

/// The verdict on one sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SampleReach {
    /// Reached from at least one direction.
    Reached {
        /// Their number; those in which the tool stands alike are one.
        directions: u32,
    },
    /// The cutter fits among the part, but something of the tool collides from every such direction.
    Obstructed {
        /// The direction nearest to the normal from which the cutter fits; of several as near the one where least is in the way.
        direction: u32,
        /// What collides there with what, as [`SurfaceTool::hits`](super::SurfaceTool::hits) reads it; none of a mesh tool.
        hits: u64,
    },
    /// The cutter itself does not fit: it would cut deeper into the part than the tolerance, or it would have to hang by the upper part
    /// of its flank where the part stands on its axis.
    Gouged,
    /// The cutter has no point that could touch the surface from any of the directions: none faces it, or the tool cuts along its axis
    /// alone and stands in no hole of its own there.
    NotFaced,
}

impl SampleReach {
    /// In a word.
    #[must_use]
    pub fn verdict(&self) -> Verdict {
        match self {
            Self::Reached { .. } => Verdict::Reached,
            Self::Obstructed { .. } => Verdict::Obstructed,
            Self::Gouged => Verdict::Gouged,
            Self::NotFaced => Verdict::NotFaced,
        }
    }
}

/// What becomes of one sample in a word, the better ones first.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Verdict {
    /// Reached from some direction.
    Reached,
    /// The cutter fits, but something of the tool collides.
    Obstructed,
    /// The cutter does not fit.
    Gouged,
    /// No direction faces it.
    NotFaced,
}
