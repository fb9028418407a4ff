//! One tool among the stock: what its cutter removes, and its bodies that must not touch.

use super::super::deepest::DepthElement;
use super::super::elements::Track;
use super::super::motions::Motion;
use super::super::{CheckError, CheckSettings, Collision};
use super::head::Heads;
use super::non_cutting::{Approach, NonCuttingBody};
use super::voxels::{BitLines, StockRemover, StockVoxels};
use crate::field::solid::BodyLines;
use crate::pose::Pose;
use crate::tool::{Element, ElementKind, Tool};

/// Number of poses of a motion from which on their voxels are removed: poses farther apart share few lines.
const TOGETHER: usize = 16;
/// Sine of the angle to its axis within which a tool moves along it: files round their numbers.
const ALONG: f64 = 1e-3;
/// Width of the ring that a cone may leave around what it cuts with its upper end, in pitches.
pub(super) const RING: f64 = 0.1;
/// Lengths that are none.
const ROUNDING: f64 = 1e-9;

/// The cutter: what it holds goes, of the part what lies deeper in it than the contact.
struct Cutter {
    lines: BodyLines,
    deep: BodyLines,
    approach: Approach,
    /// How far it may move along its axis from one pose to the next, so that it leaves no ring around what it cuts.
    longest: f64,
    /// What a rapid must keep out of the stock: its points deeper than what is accepted.
    rapid: NonCuttingBody,
}

/// The bodies of one tool.
pub(super) struct StockTool<'a> {
    cutter: Option<Cutter>,
    non_cutting: Vec<NonCuttingBody>,
    heads: Option<Heads<'a>>,
    plunge_only: bool,
    /// Its cutter is wider than what stands on it, and does not cut there.
    has_back: bool,
}

impl<'a> StockTool<'a> {
    /// `heads` are what the spindle carries beside the tool.
    pub(super) fn new(
        tool: &Tool,
        heads: Option<Heads<'a>>,
        settings: &CheckSettings,
        pitch: f64,
    ) -> Result<Self, CheckError> {
        if tool.mesh().is_some() {
            return Err(CheckError::StockMesh(tool.name.clone()));
        }
        let intricate = || CheckError::Outline(tool.name.clone());
        let accepted = settings.accepted_in_stock();
        let whole = tool.cutter();
        let widest = whole.as_ref().map(|(cutter, _)| cutter.max_radius());
        let has_back = whole.as_ref().is_some_and(|(_, exposed)| *exposed) && !tool.back_cutting;
        let cutter = |(element, exposed): (Element, bool)| {
            let contact = settings.contact;
            let too_thin = || CheckError::Contact { tool: tool.name.clone(), contact };
            let deeper = |depth: f64| element.eroded(depth, exposed).ok_or_else(too_thin);
            let lines_of = |element: &Element| BodyLines::new(element, pitch).ok_or_else(intricate);
            let (lines, deep) = (lines_of(&element)?, lines_of(&deeper(contact)?)?);
            let not_at_rapid = deeper(accepted)?;
            let approach = Approach::new(&element, pitch);
            let longest = element.widest_length(RING * pitch);
            let measured = DepthElement::new(element, exposed, 0.0);
            let rapid = NonCuttingBody::new(measured, &not_at_rapid, None, pitch).ok_or_else(intricate)?;
            Ok::<_, CheckError>(Cutter { lines, deep, approach, longest, rapid })
        };
        let offset = tool.offset_elements(&settings.clearance)?;
        let stay_out = offset.into_iter().filter(|element| element.kind != ElementKind::Cutter);
        let one = |element: Element| {
            let clearance = settings.clearance.of(element.kind);
            let rubs = widest.filter(|_| element.kind == ElementKind::Shank && clearance == 0.0);
            let rubs = rubs.map(|widest| (widest - accepted, widest + settings.contact));
            let measured = DepthElement::new(element.clone(), true, clearance);
            NonCuttingBody::new(measured, &element, rubs, pitch).ok_or_else(intricate)
        };
        Ok(Self {
            cutter: whole.map(cutter).transpose()?,
            non_cutting: stay_out.map(one).collect::<Result<_, _>>()?,
            heads,
            plunge_only: tool.plunge_only,
            has_back,
        })
    }

    /// The path begins anew: the tool's previous place is unknown.
    pub(super) fn begin(&mut self) {
        self.cutter.iter_mut().for_each(|cutter| cutter.approach.forget());
        self.non_cutting.iter_mut().for_each(|body| body.approach.forget());
        self.heads.iter_mut().for_each(Heads::forget);
    }

    /// Whether a tool that cuts along its axis alone moves otherwise, or one that does not cut with its back goes back along its axis.
    pub(super) fn must_not_cut(&self, motion: &Motion<'_>) -> bool {
        if !self.plunge_only && !self.has_back {
            return false;
        }
        let mut before = motion.at(0.0);
        let Some(axis) = before.axis() else { return true };
        let mut must_not = |pose: Pose| {
            let way = pose.position - before.position;
            let turned = pose.axis().is_none_or(|own| own.cross(axis).length() > ALONG);
            before = pose;
            let aside = turned || way.cross(axis).length() > ALONG * way.length() + ROUNDING;
            aside && self.plunge_only || !aside && self.has_back && way.dot(axis) > ROUNDING
        };
        motion.poses().any(|(_, pose)| must_not(pose))
    }

    /// What the cutter holds of the stock beside the part at a motion that must not cut, nothing being taken. `begins` where the
    /// motion before was none of these.
    pub(super) fn rapid(
        &mut self,
        motion: &Motion<'_>,
        stock: &StockVoxels,
        part: &BitLines,
        begins: bool,
    ) -> Option<Collision> {
        let rapid = &mut self.cutter.as_mut()?.rapid;
        if begins {
            rapid.approach.forget();
        }
        let mut track = Track::default();
        for (step, pose) in motion.poses() {
            rapid.look(stock, part, &step, &pose, &mut track);
        }
        track.finish()
    }

    /// Checks at every pose of a motion what must not touch, and removes what the cutter holds there.
    pub(super) fn cut(
        &mut self,
        motion: &Motion<'_>,
        stock: &mut StockVoxels,
        part: &BitLines,
        taken: &mut impl FnMut(usize, u64),
    ) -> Vec<Collision> {
        let mut tracks: Vec<Track> = self.non_cutting.iter().map(|_| Track::default()).collect();
        let mut on_head = self.heads.as_ref().map_or_else(Vec::new, |heads| heads.begin(motion));
        let (lines, mut approach) = match &mut self.cutter {
            Some(Cutter { lines, deep, approach, longest, .. }) => {
                (Some((&*lines, &*deep)), Some((approach, *longest)))
            }
            None => (None, None),
        };
        // Poses whose voxels are removed together, before anything is checked.
        let mut waiting = Vec::with_capacity(TOGETHER);
        let mut take = |stock: &mut StockVoxels, waiting: &mut Vec<Pose>| {
            if let (Some((lines, deep)), false) = (lines, waiting.is_empty()) {
                let grid = stock.fine().grid;
                let taken = &mut *taken;
                let mut beside = StockRemover { stock, spared: Some(part), spares: false, taken };
                lines.visit_all(&grid, waiting, &mut beside);
                if beside.spares {
                    let StockRemover { stock, taken, .. } = beside;
                    deep.visit_all(
                        &grid,
                        waiting,
                        &mut StockRemover { stock, spared: None, spares: false, taken },
                    );
                }
            }
            waiting.clear();
        };
        for (step, pose) in motion.poses() {
            let near = approach.as_mut().and_then(|(approach, longest)| {
                (!approach.is_away(stock, &pose, motion.step)).then_some(*longest)
            });
            if let Some(longest) = near {
                waiting.extend(motion.poses_between(&step, longest));
            }
            for (one, track) in self.non_cutting.iter_mut().zip(&mut tracks) {
                // Stock that is still to be removed may make it seem nearer than it is.
                if !one.approach.is_away(stock, &pose, step.length) {
                    take(stock, &mut waiting);
                    one.look_closely(stock, part, &step, &pose, track);
                }
            }
            if let Some(heads) = &mut self.heads {
                take(stock, &mut waiting);
                heads.look(stock, part, motion, step.index, &mut on_head);
            }
            if near.is_some() {
                waiting.push(pose);
            }
            if waiting.len() >= TOGETHER || step.is_last {
                take(stock, &mut waiting);
            }
        }
        let mut found: Vec<_> = tracks.into_iter().filter_map(Track::finish).collect();
        let on_head = on_head.into_iter().filter_map(|samples| samples.track.finish());
        found.extend(on_head.map(|hit| motion.with_tool(hit)));
        found
    }
}
