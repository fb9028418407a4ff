//! The stock along a toolpath: what each line takes of it, and what touches it that must not.
//!
//! At each pose of a check, in the order of the path, shank and holder are tested against the stock that is left;
//! then the cutter removes the voxels whose centres it holds, of the part those that lie deeper in it than the contact: what
//! it may touch stays. A cutter whose rim is thinner than a step along its axis removes what it holds between two poses too. On a rapid, and where the path begins (the approach is not in the file), the cutter must keep out as
//! well: it is tested against the stock from before the first of such motions in a row. The cutter of a drill, or of another tool that cuts along its axis alone, must keep out wherever it
//! moves otherwise, in the same way: in however many steps. A feed that moves nothing ends no row. Stock that belongs to the
//! part is left to the check of the part.
//!
//! The holder, what a machine's head carries, and everything with a clearance must hold no centre. A shank as wide as
//! its cutter rubs in what the cutter has just cut. So stock is accepted where, as seen from the tool's axis, the
//! cutter's flank passed: at most [`CheckSettings::accepted_in_stock`] below it, and at most the accepted contact
//! outside it. A centre found in the shank may be stock that the real cutter would have removed between two sampled
//! poses (up to half a step away), or that another pass left within the accepted contact. The voxels add no error of
//! their own: cutter and shank are tested on the same centres.

mod head;
mod non_cutting;
mod tool;
mod voxels;

use super::motions::{Motion, motions, rigid};
use super::{CheckBodies, CheckError, CheckSettings, Collision, LineCollisions, MachineBodies, report};
use crate::control::Control;
use crate::distance::DistanceField;
use crate::occupancy::Occupancy;
use crate::tool::Tool;
use crate::toolpath::{MoveKind, Toolpath};
use crate::unit::{DisplayLength, LengthUnit};
use head::Heads;
use tool::StockTool;
use voxels::{BitLines, StockVoxels};

impl CheckSettings {
    /// How deep below the cutter's surface stock is accepted in a shank as wide as the cutter, and in the cutter at
    /// rapid rate: the contact, and half of the tool's movement between two poses.
    #[must_use]
    pub fn accepted_in_stock(&self) -> f64 {
        self.contact + 0.5 * self.step
    }

    /// Depth below the cutter's surface from which on stock is certain to be detected at rapid rate: behind a corner of the stock the
    /// nearest solid centre lies up to a voxel's diagonal away, behind a face a pitch.
    #[must_use]
    pub fn sure_depth_of_rapids(&self, pitch: f64) -> f64 {
        self.accepted_in_stock() + 0.5 * self.step + 3f64.sqrt() * pitch
    }

    /// Diameter of the smallest ball of stock in the holder, or in anything that has a clearance or is wider than the
    /// cutter, that is certain to be detected. Where the cutter's flank passed it takes twice
    /// [`CheckSettings::accepted_in_stock`] more.
    #[must_use]
    pub fn sure_depth_in_stock(&self, pitch: f64) -> f64 {
        3f64.sqrt() * pitch + self.step
    }
}

/// What a line of the toolpath takes away.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineRemoval {
    /// Line of the toolpath's file.
    pub line: usize,
    /// Number of the tool, where the file names one.
    pub tool: Option<u32>,
    /// How the tool moves where it last takes some.
    pub kind: MoveKind,
    /// Voxels that go.
    pub voxels: u64,
    /// Those of them that are the part's.
    pub of_part: u64,
}

/// What becomes of the stock.
#[derive(Clone, Debug, PartialEq)]
pub struct StockReport {
    /// Lines on which something touches the stock that must not, in order; see [`CheckReport::add`](super::CheckReport::add).
    pub colliding: Vec<LineCollisions>,
    /// What every line takes, those that take nothing too, in order.
    pub removed: Vec<LineRemoval>,
    /// Voxels of the stock at first.
    pub voxels: u64,
    /// Fixtures that hold some of these voxels, and how many: no line takes those, and they remain.
    pub held: Vec<(String, u64)>,
    /// The stock that is left, the part in it included.
    pub remaining: Occupancy,
    /// For every voxel of that grid, the line of the file that took it; 0 of others.
    pub removed_by: Vec<u32>,
}

/// The stock that is still to be cut. Lengths in the grid's unit, places in world coordinates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StockLeft {
    /// Voxels of it.
    pub voxels: u64,
    /// How far from the part its farthest centre is from the nearest centre of the part; `None` where the part has no voxel, or
    /// nothing is left.
    pub farthest: Option<f64>,
    /// That centre; the first of equals.
    pub place: [f64; 3],
}

impl StockReport {
    /// A sentence about every fixture that overlaps the stock, whose grid has this unit.
    #[must_use]
    pub fn overlaps(&self, unit: LengthUnit) -> Vec<String> {
        let sentence = |(fixture, voxels): &(String, u64)| {
            format!(
                "the fixture {fixture} overlaps the stock by {} {unit}³: check where it stands, and its unit; no line cuts that, and it \
                 stays stock",
                DisplayLength(*voxels as f64 * self.remaining.grid.voxel_volume())
            )
        };
        self.held.iter().map(sentence).collect()
    }

    /// Compares what is left with the part.
    ///
    /// # Panics
    /// If the part's voxels are not those that the stock was followed with.
    #[must_use]
    pub fn left_beside(&self, part: &Occupancy) -> StockLeft {
        let grid = &self.remaining.grid;
        let part = part.on(grid).expect("the part lies on the voxels of the stock");
        let distances = DistanceField::new(&part);
        let beside = self.remaining.solids().filter(|&voxel| part.solid[voxel] == 0);
        let mut left = StockLeft { voxels: 0, farthest: None, place: [f64::NAN; 3] };
        let mut most = None;
        for voxel in beside {
            left.voxels += 1;
            let squared = distances.squared(voxel);
            if squared > most {
                most = squared;
                left.place = grid.centre(grid.voxel(voxel)).to_array();
            }
        }
        left.farthest = most.map(|squared| (squared as f64).sqrt() * grid.pitch);
        left
    }
}

/// Follows a toolpath through a stock: all that is solid on a grid whose voxels are those of the part's grid, with all that a
/// machine's head carries; its table bears the stock. What is in a fixture as well is the fixture's while the path is followed, and
/// remains. One unit of progress is one location.
///
/// # Errors
/// As [`check_toolpath`](super::check_toolpath); a tool that is a mesh, of which is not known what cuts; a stock on other voxels than the part.
///
/// # Example
/// A ball of 10 mm along the top of a block, as deep as its radius:
/// ```
/// use imf_core::check::{CheckBodies, CheckSettings, check_stock};
/// use imf_core::control::Control;
/// use imf_core::glam::DVec3;
/// use imf_core::grid::Grid;
/// use imf_core::occupancy::Occupancy;
/// use imf_core::tool::Tool;
/// use imf_core::toolpath::Toolpath;
/// use imf_core::unit::LengthUnit;
///
/// let grid = Grid { origin: DVec3::splat(-20.0), pitch: 1.0, dims: [40, 40, 20] };
/// let stock = Occupancy { grid, solid: vec![1; grid.len()] };
/// let part = Occupancy { grid, solid: vec![0; grid.len()] };
/// let bodies = CheckBodies::of_part(&part);
/// let path = Toolpath::parse("x,y,z\n-30,0,-5\n30,0,-5\n", LengthUnit::Mm, "path.csv")?;
/// let settings = CheckSettings::of_pitch(1.0, LengthUnit::Mm);
/// let report = check_stock(bodies, &stock, &[(None, &Tool::paper())], &path, &settings, Control::quiet())?;
/// assert!(report.colliding.is_empty());
/// // Half a disc over the length of the block, in voxels of 1 mm³.
/// let expected = 0.5 * std::f64::consts::PI * 25.0 * 40.0;
/// assert!((report.removed[1].voxels as f64 / expected - 1.0).abs() < 0.05);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn check_stock(
    bodies: CheckBodies<'_>,
    stock: &Occupancy,
    tools: &[(Option<u32>, &Tool)],
    toolpath: &Toolpath,
    settings: &CheckSettings,
    control: Control<'_>,
) -> Result<StockReport, CheckError> {
    settings.check()?;
    bodies.check()?;
    if !stock.is_sound() {
        return Err(CheckError::Voxels("the stock".into()));
    }
    tools.iter().try_for_each(|(_, tool)| tool.check())?;
    let motions = motions(toolpath, tools, settings, bodies.machine.map(MachineBodies::machine))?;
    let grid = stock.grid;
    let world = rigid(&toolpath.set_up);
    let used = |index: &usize| motions.iter().any(|motion| motion.tool == *index);
    let stock_tools = tools.iter().enumerate().map(|(index, (_, tool))| {
        let made = || {
            let heads = bodies.machine.map(|machine| Heads::new(machine, settings, &world, grid.pitch));
            StockTool::new(tool, heads.transpose()?, settings, grid.pitch)
        };
        used(&index).then(made).transpose()
    });
    let stock_tools = stock_tools.collect::<Result<Vec<_>, _>>()?;
    let on_grid = |body: &Occupancy| body.on(&grid).ok_or(CheckError::StockGrid);
    let part = on_grid(bodies.part)?;
    let mut free = stock.clone();
    let mut held = Vec::new();
    for (name, fixture) in bodies.fixtures {
        let own = on_grid(fixture)?;
        free.solid.iter_mut().zip(&own.solid).for_each(|(free, own)| *free &= 1 - own);
        let voxels = stock.solid.iter().zip(&own.solid).filter(|(stock, own)| **stock & **own == 1).count();
        if voxels > 0 {
            held.push((name.clone(), voxels as u64));
        }
    }
    let mut following = PathFollower {
        toolpath,
        motions: &motions,
        tools: stock_tools,
        stock: StockVoxels::new(&free),
        part: BitLines::of(&part),
        removed_by: vec![0; grid.len()],
        removed: Vec::new(),
        found: Vec::new(),
        waiting: Vec::new(),
        control,
    };
    drop(part);
    following.follow()?;
    let mut report = following.report(settings, stock.count() as u64, held);
    let in_fixtures = stock.solid.iter().zip(&free.solid).map(|(stock, free)| stock & (1 - free));
    report.remaining.solid.iter_mut().zip(in_fixtures).for_each(|(left, held)| *left |= held);
    Ok(report)
}

/// State of the path that is being followed.
struct PathFollower<'a> {
    toolpath: &'a Toolpath,
    motions: &'a [Motion<'a>],
    /// In the order of the tools that are given; none of one that the path does not use.
    tools: Vec<Option<StockTool<'a>>>,
    stock: StockVoxels,
    part: BitLines,
    removed_by: Vec<u32>,
    removed: Vec<LineRemoval>,
    found: Vec<report::MotionFindings>,
    /// Motions that must not cut, which were checked and have removed nothing yet, each with its collision.
    waiting: Vec<(usize, Option<Collision>)>,
    control: Control<'a>,
}

impl PathFollower<'_> {
    fn follow(&mut self) -> Result<(), CheckError> {
        for (index, motion) in self.motions.iter().enumerate() {
            let kind = self.toolpath.locations[index].kind;
            let is_still = kind == MoveKind::Feed && motion.poses().all(|(_, pose)| pose == motion.at(0.0));
            if is_still && !self.waiting.is_empty() {
                self.waiting.push((index, None));
                continue;
            }
            let tool = self.tools[motion.tool].as_ref();
            let may_cut = kind == MoveKind::Feed && tool.is_none_or(|tool| !tool.must_not_cut(motion));
            if may_cut || kind == MoveKind::Start {
                self.cut_waiting()?;
            }
            if may_cut {
                self.cut(index, None)?;
                continue;
            }
            let begins = self.waiting.is_empty();
            let tool = self.tools[motion.tool].as_mut();
            let hit = tool.and_then(|tool| tool.rapid(motion, &self.stock, &self.part, begins));
            let is_hit = hit.is_some();
            self.waiting.push((index, hit));
            // What it goes through is gone for the next ones.
            if is_hit {
                self.cut_waiting()?;
            }
        }
        self.cut_waiting()
    }

    fn cut_waiting(&mut self) -> Result<(), CheckError> {
        std::mem::take(&mut self.waiting).into_iter().try_for_each(|(index, hit)| self.cut(index, hit))
    }

    /// `cutter` is in the stock where it must not be.
    fn cut(&mut self, index: usize, cutter: Option<Collision>) -> Result<(), CheckError> {
        self.control.check()?;
        let (motion, location) = (&self.motions[index], &self.toolpath.locations[index]);
        let (line, tool, kind) = (location.line, location.tool, location.kind);
        let mut removal = LineRemoval { line, tool, kind, voxels: 0, of_part: 0 };
        let mut collisions: Vec<_> = cutter.into_iter().collect();
        if let Some(own) = &mut self.tools[motion.tool] {
            if kind == MoveKind::Start {
                own.begin();
            }
            let Self { stock, part, removed_by, .. } = self;
            let number = u32::try_from(line).unwrap_or(u32::MAX);
            collisions.extend(own.cut(motion, stock, part, &mut |first, bits| {
                removal.voxels += u64::from(bits.count_ones());
                let mut rest = bits;
                while rest != 0 {
                    removed_by[first + rest.trailing_zeros() as usize] = number;
                    rest &= rest - 1;
                }
                removal.of_part += u64::from((bits & part.from(first)).count_ones());
            }));
        }
        motion.with_joints(&mut collisions);
        match self.removed.last_mut() {
            Some(last) if last.line == line && kind != MoveKind::Start => {
                last.voxels += removal.voxels;
                last.of_part += removal.of_part;
                if removal.voxels > 0 {
                    last.kind = kind;
                }
            }
            _ => self.removed.push(removal),
        }
        self.found.push((
            index,
            LineCollisions { line, tool, kind, poses: motion.count, collisions },
            Vec::new(),
        ));
        (self.control.progress)(1);
        Ok(())
    }

    fn report(mut self, settings: &CheckSettings, voxels: u64, held: Vec<(String, u64)>) -> StockReport {
        let pitch = self.stock.fine().grid.pitch;
        StockReport {
            colliding: report::gather(&mut self.found, self.toolpath, settings, pitch).colliding,
            removed: self.removed,
            voxels,
            held,
            remaining: self.stock.fine().occupancy(),
            removed_by: self.removed_by,
        }
    }
}

#[cfg(test)]
mod slots;
#[cfg(test)]
mod stock_oracle;
