//! More poses, where too few of them collide.

use super::CalibrationSettings;

/// Most random poses that are drawn to choose thresholds by.
const MOST: usize = 4_000_000;

impl CalibrationSettings {
    /// As many poses as resolve the required rate where `colliding` of these collide, or as many as are drawn at most; nothing where
    /// that is not more.
    #[must_use]
    pub fn with_more_poses(&self, colliding: usize) -> Option<Self> {
        if self.uniform >= MOST || colliding == 0 {
            return None;
        }
        // Of zero errors the bound is below the goal from 4.6 over it on; a tenth more for chance.
        let more = 1.1 * 4.61 / self.goals.false_free / colliding as f64;
        let uniform = ((self.uniform as f64 * more.max(1.1)) as usize).min(MOST);
        Some(Self { uniform, ..*self })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_are_drawn_as_long_as_there_may_be() {
        let usual = CalibrationSettings::default();
        let more = usual.with_more_poses(2_000).unwrap();
        assert!(more.uniform > usual.uniform && more.uniform <= MOST);
        // Enough of them collide then, and a tenth more.
        let colliding = 2_000.0 * more.uniform as f64 / usual.uniform as f64;
        assert!(more.uniform == MOST || colliding * usual.goals.false_free > 4.6);
        assert_eq!(usual.with_more_poses(0), None);
        assert_eq!(CalibrationSettings { uniform: MOST, ..usual }.with_more_poses(10), None);
    }
}
