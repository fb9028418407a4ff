//! What a reader is told of a program that is followed: what is taken for granted, and where a control may do otherwise.

use super::Program;
use super::block::Block;

impl Program<'_> {
    /// On words that are taken to move nothing.
    pub(super) fn remark_on_idle(&mut self, line: usize, block: &Block) {
        for &number in &block.unknown_m {
            if !self.unknown_m.contains(&number) {
                self.unknown_m.push(number);
                self.path.remarks.push(format!(
                    "line {line}: what M{number} does differs from machine to machine: it is taken to move neither tool nor part"
                ));
            }
        }
        if let Some(letter) = block.idle_axis {
            let text = format!("{letter}0 is taken to leave an axis that is not given where it stands");
            self.remark(line, "idle axis", &text);
        }
    }

    /// That the tool has moved since a T to which no M6 has changed. Programs call their first tool at their end, for the next run.
    pub(super) fn remark_on_call(&mut self) {
        let waiting = self.waiting.take().filter(|&(_, number, _)| Some(number) != self.first_tool);
        if let (Some((line, number, true)), Some(tool)) = (waiting, self.tool) {
            self.path.remarks.push(format!(
                "line {line}: T{number} is called, and no M6 changes to it: what follows is checked with tool {tool}"
            ));
        }
    }

    /// The path is followed as it is written.
    pub(super) fn round_corners(&mut self, line: usize, block: &Block) {
        let [p, q] = block.lengths.map(Option::unwrap_or_default);
        if p + q > self.rounded {
            self.rounded = p + q;
            self.path.remarks.push(format!(
                "line {line}: with G64 the control leaves the path by up to {}: it is followed as written, so ask for as much more clearance",
                self.rounded
            ));
        }
    }

    pub(super) fn remark(&mut self, line: usize, about: &'static str, text: &str) {
        if !self.remarked.contains(&about) {
            self.remarked.push(about);
            self.path.remarks.push(format!("line {line}: {text}"));
        }
    }

    /// On a rapid of several axes.
    pub(super) fn remark_on_rapid(&mut self, line: usize, block: &Block) {
        let axes = block.linear.iter().chain(&block.rotary).flatten().count();
        if !self.broken && axes > 1 {
            self.remark(
                line,
                "rapids",
                "G0 is followed straight: a machine that moves each axis at its own full speed takes another way",
            );
        }
    }
}
