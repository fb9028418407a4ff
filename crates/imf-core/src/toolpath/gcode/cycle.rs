//! Drilling cycles: above a hole by a rapid, to R, down to Z by the feed, and back to R (G99) or to where the cycle began (G98).
//!
//! Pecks stay within that way. Cycles that move aside (G76, G87) or stop for the operator (G88) are refused. Sources: the
//! manuals of LinuxCNC, Fanuc and Haas, where they agree; where they do not, the block is refused.

use super::block::Block;
use super::{Motion, Program};

/// Cycles that peck: beside them K may be a length.
const PECKING: [u32; 2] = [73, 83];
/// Heights closer than this, in the path's unit, are one: sums of offsets round.
const SAME: f64 = 1e-6;

/// A cycle in force. Heights are the program's, in the path's unit.
#[derive(Clone, Copy)]
pub(super) struct Cycle {
    /// Its G word.
    word: u32,
    /// Where the first hole began.
    start: Option<f64>,
    /// R and Z.
    level: Option<f64>,
    depth: Option<f64>,
}

impl Program<'_> {
    /// The motion or cycle that is in force from a block on.
    pub(super) fn take_motion(&mut self, block: &Block) {
        self.returns = block.returns.or(self.returns);
        self.motion = block.motion.or(self.motion);
        if let Some(word) = block.cycle {
            self.motion = None;
            let before = self.cycle.filter(|before| before.word == word);
            let start = self.cycle.and_then(|before| before.start);
            self.cycle = before.or(Some(Cycle { word, start, level: None, depth: None }));
        } else if block.motion.is_some()
            || block.ends_cycle
            || block.changes_tool
            || block.home.is_some()
            || block.in_machine_coordinates
        {
            self.cycle = None;
        }
    }

    /// The holes of a block.
    pub(super) fn drill(&mut self, line: usize, block: &Block) -> Result<(), String> {
        let (cycle, top) = self.levels(block)?;
        let word = cycle.word;
        let (Some(start), Some(level), Some(depth)) = (cycle.start, cycle.level, cycle.depth) else {
            return Err(format!("G{word} needs Z and R"));
        };
        self.cycle = Some(cycle);
        if level > top + SAME {
            return Err(format!(
                "R lies above the tool, and controls differ in how they get there: begin G{word} above"
            ));
        }
        if depth > level {
            return Err(format!("Z of G{word} lies above its R"));
        }
        if self.returns.is_none() {
            let text = "a cycle without G98 or G99 is taken to end where it began (G98)";
            self.remark(line, "returns", text);
        }
        let mut above = block.clone();
        above.linear[2] = None;
        let moves_above = above.linear.iter().chain(&above.rotary).any(Option::is_some);
        let count = self.holes(word, block, moves_above)?;
        self.check_length(line, true)?;
        self.z_by_spindle = false;
        let end = if self.returns == Some(false) { level } else { start };
        for _ in 0..count {
            if moves_above {
                self.remark_on_rapid(line, &above);
            }
            let (to, rotary) = self.target(&above)?;
            // Out of the hole whichever way: what the feed has passed, a rapid passes too.
            let ways = [
                (to.z, Motion::Rapid, moves_above),
                (level, Motion::Rapid, level < to.z - SAME),
                (depth, Motion::Feed, true),
                (level, Motion::Feed, true),
                (end, Motion::Rapid, end > level + SAME),
            ];
            for (z, motion, _) in ways.into_iter().filter(|&(.., is_made)| is_made) {
                self.reach(line, to.with_z(z), rotary, motion)?;
            }
        }
        Ok(())
    }

    /// The cycle with what a block says of it, and the tool's height.
    fn levels(&self, block: &Block) -> Result<(Cycle, f64), String> {
        let mut cycle = self.cycle.ok_or("no cycle is in force")?;
        let word = cycle.word;
        if self.centre_point {
            return Err(format!("G{word} while the tool's centre point is kept: end that with G49 before"));
        }
        if self.plane != [0, 1, 2] {
            return Err(format!("G{word} is followed along Z alone: write G17 before"));
        }
        let top = self.position()?.z;
        if top.is_nan() {
            return Err(format!("G{word} begins where Z is not known"));
        }
        let start = *cycle.start.get_or_insert(top);
        let [level, depth] = [block.radius, block.linear[2]].map(|given| Some(self.value(given?)));
        if self.absolute {
            (cycle.level, cycle.depth) = (level.or(cycle.level), depth.or(cycle.depth));
        } else if top < start - SAME || level.is_some() != depth.is_some() {
            return Err("controls differ in what R and Z are steps from here (G91): write them by G90, or both, and G98".into());
        } else if let (Some(level), Some(depth)) = (level, depth) {
            (cycle.level, cycle.depth) = (Some(start + level), Some(start + level + depth));
        }
        Ok((cycle, top))
    }

    /// How many holes a block makes: by steps (G91) as many as it says, else one in its place.
    fn holes(&mut self, word: u32, block: &Block, moves_above: bool) -> Result<usize, String> {
        let Some((letter, count)) = block.repeats else { return Ok(1) };
        let may_be_a_length = letter == 'K' && PECKING.contains(&word);
        if may_be_a_length && self.absolute && count != 0.0 {
            return Ok(1);
        }
        let is_count = count >= 0.0 && count.fract() == 0.0 && count <= self.chords_left as f64;
        if may_be_a_length || !is_count || count == 0.0 && moves_above {
            return Err(format!(
                "how many holes {letter}{count} makes differs from control to control: write each hole"
            ));
        }
        if count == 0.0 {
            return Ok(0);
        }
        let holes = if self.absolute { 1 } else { count as usize };
        self.chords_left -= holes;
        Ok(holes)
    }
}
