//! Tools and their lengths: when one is in force, and how long it is.

use glam::DVec3;

use super::Program;
use super::block::Block;
use crate::toolpath::error::Fault;

impl Program<'_> {
    pub(super) fn change_tool(&mut self) -> Result<(), String> {
        let (_, number) =
            self.called.ok_or("M6 changes the tool, and no T says to which: write T and its number")?;
        if self.centre_point {
            return Err("the tool changes while its centre point is kept: end that with G49 before".into());
        }
        if self.tool.is_none() && self.path.locations.len() == self.homed {
            // Before its first tool a program only goes home, with nothing that could be checked.
            self.path.locations.clear();
            self.z_without_length = None;
            self.forget_ways_home();
        }
        self.tool = Some(number);
        if self.has_used_length {
            self.ended_by = Some("M6");
        }
        self.length = false;
        (self.length_number, self.edge_of_motion) = (None, None);
        self.give_up_waiting(false);
        self.unchecked.said = [false; 5];
        // The way to where tools are changed is the machine's own.
        self.joints.linear = DVec3::NAN;
        self.broken = true;
        Ok(())
    }

    pub(super) fn take_length(&mut self, line: usize, block: &Block) -> Result<(), Fault> {
        self.take_edge(block);
        let Some(length) = block.length else { return Ok(()) };
        if let (Some(number), Some(tool)) = (block.length_number, self.tool)
            && length.is_some()
            && number != tool
        {
            return Err(format!("H{number} is the length of another tool than T{tool}").into());
        }
        if let (Some(number), Some(before)) = (block.length_number, self.length_number)
            && number != before
        {
            return Err(format!(
                "H{number} is the length of another tool than H{before}, and nothing changes to it: write T{number} M6 before"
            )
            .into());
        }
        self.length_number = block.length_number.or(self.length_number);
        if length.is_some() && self.length_number.is_none() {
            self.remark(
                line,
                "no H",
                "no H names the tool's length: it is taken to be that of the tool in the spindle",
            );
        }
        let keeps = length == Some(true);
        if keeps && self.machine.is_none_or(|machine| machine.rotary.is_empty()) {
            let said = "it keeps the tool's centre point while rotary axes turn";
            return Err(match self.machine {
                Some(machine) => format!("{said}, and the machine '{}' has none", machine.name).into(),
                None => Fault::needs_machine(format!("{said}, and no machine is given that has some")),
            });
        }
        if let (Some(_), Some(line), None) = (length, self.z_without_length, self.machine) {
            return Err(format!(
                "the program uses tool lengths, and in line {line} Z moved while none was in force: that is the spindle's place and not the \
                 tip's, and how far the tip was below is not known (write G43 H and the tool's number before)"
            )
            .into());
        }
        if length.is_some() {
            (self.has_used_length, self.ended_by) = (true, None);
        } else if self.length {
            self.ended_by = Some("G49");
        }
        if keeps != self.centre_point {
            self.kept = DVec3::NAN;
        }
        (self.length, self.centre_point) = (length.is_some(), keeps);
        Ok(())
    }

    /// Where no G43 takes up a length, D may be a tool's edge (Siemens): in force from the tool change on, up to D0.
    fn take_edge(&mut self, block: &Block) {
        let Some(edge) = block.edge else { return };
        let is_none = edge == 0.0;
        if is_none && !self.has_used_length && (self.tool.is_some() || self.has_used_edge) {
            self.ended_by = Some("D0");
        }
        if !is_none {
            self.edge = Some(edge);
            self.has_used_edge = true;
            self.ended_by = self.ended_by.filter(|&word| word != "D0");
        }
    }

    /// A tool's other edge may be longer, or lie elsewhere.
    pub(super) fn note_edge(&mut self, line: usize) {
        if let (Some(before), Some(edge)) = (self.edge_of_motion, self.edge)
            && before != edge
        {
            self.edge_change.get_or_insert((line, before, edge));
        }
        self.edge_of_motion = self.edge;
    }

    /// Beside G43 D is a radius's place; of a program without it, an edge.
    pub(super) fn remark_on_edges(&mut self) {
        if let (Some((line, before, edge)), false) = (self.edge_change, self.has_used_length) {
            let text = format!(
                "the tool moves by its edge D{edge}, and before by D{before}: both are taken to be its tip, and where they are not, the edges have to be checked one by one"
            );
            self.remark(line, "edges", &text);
        }
    }

    /// What Z means must be known: the place of the tip.
    pub(super) fn check_length(&mut self, line: usize, moves_z: bool) -> Result<(), String> {
        if !moves_z {
            return Ok(());
        }
        if !self.length {
            self.z_without_length.get_or_insert(line);
        }
        match (self.machine, self.ended_by) {
            (Some(machine), _) if !self.length => {
                let more = if machine.rotary.is_empty() { "" } else { ", or G43.4" };
                Err(format!(
                    "Z moves while no tool length is in force: whether it is the tip's or the spindle's is not said (write G43 H{more} before)"
                ))
            }
            (None, Some(word)) => {
                // With a machine too, Z needs G43.
                let remedy = if word == "D0" {
                    "write D and the edge's number before, or take the motion out"
                } else {
                    "write G43 H and the tool's number before, take the motion out, or give the machine"
                };
                Err(format!(
                    "Z moves after {word} has ended the tool length: it is the spindle's place and not the tip's, and how far the tip is \
                     below is not known ({remedy})"
                ))
            }
            _ => Ok(()),
        }
    }

    /// In a program that takes up no length at all Z may be the tip's or the spindle's: says which is taken.
    pub(super) fn remark_on_length(&mut self) {
        if let (Some(line), None, false) =
            (self.z_without_length, self.machine, self.has_used_length || self.has_used_edge)
        {
            self.remark(
                line,
                "length",
                "Z moves, and nowhere is a tool length taken up (by G43, or D): Z is taken to be the tip's",
            );
        }
    }

    /// From the spindle's face to the tip of the tool in use; 0 without a machine, where both are one.
    pub(super) fn tool_length(&self) -> Result<f64, String> {
        if self.machine.is_none() {
            return Ok(0.0);
        }
        self.reading.length_of(self.tool).ok_or_else(|| match self.tool {
            Some(number) => format!("tool {number} is not given, and its length moves the machine"),
            None => "no tool is called before this motion, and the tools that are given have numbers".into(),
        })
    }
}
