//! The surface for display: its layers, and the places that are not reached with what obstructs them.

use std::fmt::Write as _;

use glam::DVec3;
use imf_core::surface::SurfacePatch;
use imf_core::unit::LengthUnit;
use serde::Serialize;

use super::blame::remedy;
use super::cavities::Cavities;
use super::freed::{LongerStickOut, slimmer};
use super::row::{body_name, with_article};
use super::{AccessRun, Surface, Verdict, rgb};
use crate::output::{length, show_measure};
use crate::view::{Colours, Layer, NONE, Place, Table, TableRow, View, distinct};

/// What helps at the wall of a cavity.
const CLOSED_OFF: &str = "nothing: the voxels of part and fixtures close it off on all sides";

/// Places that are not reached, at most: the largest.
const PLACES: usize = 30;

/// A connected patch of the surface that no tool reaches, for one reason.
#[derive(Debug, Serialize)]
pub(crate) struct UnreachedPatch {
    area: f64,
    /// A point in its middle.
    middle: [f64; 3],
    /// Outward, there.
    normal: [f64; 3],
    /// Lowest and highest coordinates.
    bounds: [[f64; 3]; 2],
    /// `something is in the way`, `the cutter does not fit` or `no direction faces it`.
    why: &'static str,
    /// The tool that comes nearest, and from where (from tip to holder).
    #[serde(skip_serializing_if = "Option::is_none")]
    tool: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    direction: Option<[f64; 3]>,
    /// The point of the patch that it comes nearest to reaching: of minimum overlap.
    #[serde(skip_serializing_if = "Option::is_none")]
    nearest: Option<[f64; 3]>,
    /// Which of its elements stands in what there, the largest volume first.
    hits: Vec<Hit>,
    /// What else keeps it from there.
    #[serde(skip_serializing_if = "Option::is_none")]
    fault: Option<String>,
    /// A longer stick-out of that tool that frees some of it.
    #[serde(skip_serializing_if = "Option::is_none")]
    stick_out: Option<LongerStickOut>,
    would_help: String,
}

/// An element in a body.
#[derive(Debug, Serialize)]
struct Hit {
    element: String,
    /// `part`, or a fixture's name.
    body: String,
    /// How deep its deepest centre or point lies in the element.
    depth: f64,
    /// Of the voxels in it, in the unit cubed; 0 where it holds points of the surface alone.
    volume: f64,
}

impl Hit {
    fn text(&self, unit: LengthUnit) -> String {
        // What holds no centre holds points of the surface.
        let volume = (self.volume > 0.0).then(|| format!(", {} {unit}³", show_measure(self.volume)));
        let (element, depth, body) = (&self.element, show_measure(self.depth), with_article(&self.body));
        format!("{element} {depth} {unit} deep in {body}{}", volume.unwrap_or_default())
    }
}

/// Patches that the summary lists for people.
const LISTED: usize = 5;

impl UnreachedPatch {
    /// Why, and what collides where the tool comes nearest.
    fn reason(&self, unit: LengthUnit, several: bool) -> String {
        let hits = self.hits.iter().map(|hit| hit.text(unit)).chain(self.fault.clone());
        let hits: Vec<String> = hits.collect();
        let of_tool = match &self.tool {
            Some(tool) if several => format!(" by {tool}"),
            _ => String::new(),
        };
        match self.nearest {
            Some(place) if !hits.is_empty() => {
                format!(
                    "{}; least{of_tool} at ({}): {}",
                    self.why,
                    length::place(place, unit),
                    hits.join("; ")
                )
            }
            _ => self.why.to_owned(),
        }
    }

    /// Lines for people about the largest, one of every reason among them.
    pub(crate) fn lines(all: &[Self], unit: LengthUnit, several: bool) -> String {
        let mut text = String::new();
        let is_first = |&at: &usize| all[..at].iter().all(|before| before.why != all[at].why);
        let (first, others): (Vec<usize>, Vec<usize>) = (0..all.len()).partition(is_first);
        let mut shown: Vec<usize> = first.into_iter().chain(others).take(LISTED).collect();
        shown.sort_unstable();
        for patch in shown.into_iter().map(|at| &all[at]) {
            let _ = writeln!(
                text,
                "  not reached: {} {unit}² around ({}): {}",
                show_measure(patch.area),
                length::place(patch.middle, unit),
                patch.reason(unit, several)
            );
            let _ = writeln!(text, "    would help: {}", patch.would_help);
        }
        if all.len() > LISTED {
            let _ = writeln!(text, "  and smaller patches, listed in summary.json and on the page");
        }
        text
    }
}

const ALL: [Verdict; 4] = [Verdict::Reached, Verdict::Obstructed, Verdict::Gouged, Verdict::NotFaced];

pub(super) fn words(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Reached => "reached",
        Verdict::Obstructed => "something is in the way",
        Verdict::Gouged => "the cutter does not fit",
        Verdict::NotFaced => "no direction faces it",
    }
}

impl Surface {
    /// The largest patches that are not reached.
    pub(crate) fn unreached(&self, run: &AccessRun) -> Vec<UnreachedPatch> {
        let class = |sample: usize| match self.best[sample].0 {
            Verdict::Reached => None,
            why => Some(why as u32),
        };
        let patches = self.samples.patches(class);
        if patches.is_empty() {
            return Vec::new();
        }
        let cavities = Cavities::of(&run.solid);
        let shown = patches.iter().take(PLACES);
        shown.map(|patch| self.patch(patch, cavities.closes_off(patch.middle, patch.normal), run)).collect()
    }

    fn patch(&self, patch: &SurfacePatch, closed_off: bool, run: &AccessRun) -> UnreachedPatch {
        let verdict = patch.samples.first().map_or(Verdict::NotFaced, |&sample| self.best[sample].0);
        // The sample that comes nearest to being reached.
        let poses = patch.samples.iter().filter_map(|&sample| Some((sample, self.blame.nearest[sample]?)));
        let nearest = poses.min_by_key(|(_, at)| at.key());
        let place = nearest.map(|(sample, _)| (self.samples.samples[sample].point + 0.0).to_array());
        let nearest = nearest.map(|(sample, at)| {
            let tool = self.best[sample].1;
            let direction = run.orientations.orientations[at.direction as usize].direction();
            (direction, self.tools[tool].1.collisions(&at), tool, at)
        });
        let on_machine = run.machine.as_ref();
        let fault =
            nearest.as_ref().and_then(|(.., tool, at)| on_machine?.fault(*tool, at, &run.orientations));
        let hits = nearest.as_ref().map_or(&[][..], |(_, hits, ..)| hits);
        let unit = run.unit;
        let shown = hits.iter().map(|hit| Hit {
            element: hit.kind.to_string(),
            body: body_name(hit.body, &run.fixtures),
            // Centres that lie on its surface but for rounding.
            depth: if hit.depth < 1e-6 * run.query.pitch { 0.0 } else { hit.depth },
            volume: f64::from(hit.voxels) * run.query.voxel_volume(),
        });
        let mut quantified = Vec::new();
        let of_tool = |sample: &&usize| nearest.as_ref().is_some_and(|near| near.2 == self.best[**sample].1);
        let lengths = patch.samples.iter().filter(of_tool).filter_map(|&sample| self.freed[sample]);
        // An edge may stand so deep between points of a surface.
        let longer = LongerStickOut::new(lengths, self.surface_nearer_by(run).unwrap_or(0.0), unit);
        if let Some((_, _, tool, _)) = &nearest {
            let assembly = &run.tools[*tool];
            quantified
                .extend(longer.as_ref().and_then(|longer| longer.text(assembly, unit, on_machine.is_some())));
            let frees = |diameter: f64| {
                format!("a holder slimmer by {} {unit} frees that place", length::at_least(diameter, unit))
            };
            quantified.extend(slimmer(hits, assembly).map(frees));
        }
        UnreachedPatch {
            area: patch.area,
            middle: patch.middle.to_array(),
            normal: (patch.normal + 0.0).to_array(),
            bounds: patch.bounds.map(|corner| corner.to_array()),
            why: words(verdict),
            tool: nearest.as_ref().map(|(_, _, tool, _)| self.tools[*tool].1.name().to_owned()),
            direction: nearest.as_ref().map(|(direction, ..)| (*direction + 0.0).to_array()),
            nearest: place,
            hits: shown.collect(),
            fault: fault.as_ref().map(ToString::to_string),
            stick_out: longer.filter(|_| !closed_off),
            would_help: match (fault, on_machine) {
                _ if closed_off => CLOSED_OFF.to_owned(),
                (Some(fault), Some(machine)) => machine.remedy(&fault).to_owned(),
                _ => remedy(verdict, hits, &quantified, &run.tools),
            },
        }
    }

    /// The surface with the values of every sample, coloured.
    pub(crate) fn view<'a>(
        &'a self,
        run: &AccessRun,
        unreached: &[UnreachedPatch],
        summary: String,
    ) -> View<'a> {
        let classes = |names: &mut dyn Iterator<Item = (String, [u8; 3])>| Colours::Classes(names.collect());
        let each = |value: &dyn Fn(usize) -> f32| -> Vec<f32> { (0..self.best.len()).map(value).collect() };
        let mut layers = vec![Layer {
            name: "verdict",
            title: "by reach",
            colours: classes(&mut ALL.map(|verdict| (words(verdict).to_owned(), rgb(verdict))).into_iter()),
            values: each(&|sample| f32::from(self.best[sample].0 as u8)),
        }];
        let none = |name: &str| std::iter::once((name.to_owned(), NONE));
        if self.tools.len() > 1 {
            let names = self.tools.iter().enumerate();
            let names = names.map(|(at, (_, tool))| (tool.name().to_owned(), distinct(at)));
            layers.push(Layer {
                name: "tool",
                title: "by tool",
                colours: classes(&mut none("no tool").chain(names)),
                values: each(&|sample| {
                    if self.is_reached(sample) { self.best[sample].1 as f32 + 1.0 } else { 0.0 }
                }),
            });
        }
        if let Some(setups) = &self.setups {
            let most = setups.by_sample.iter().copied().max().unwrap_or(0) as usize;
            let names = (1..=most).map(|at| (format!("set-up {at}"), distinct(at - 1)));
            layers.push(Layer {
                name: "setup",
                title: "by set-up",
                colours: classes(&mut none("in no set-up").chain(names)),
                values: each(&|sample| setups.by_sample[sample] as f32),
            });
        }
        layers.push(Layer {
            name: "directions",
            title: "by directions",
            colours: Colours::Scale { label: "directions that reach it".into(), none: "not reached" },
            values: each(&|sample| self.reached_from(sample).unwrap_or(f32::NAN)),
        });
        // Of several tools the one with the shortest stick-out.
        if !self.stick_outs.is_empty() {
            let least = |sample: usize| {
                let lengths = self.stick_outs.iter().map(|tool| tool.found[sample].length());
                let least = lengths.fold(f64::INFINITY, f64::min);
                if least.is_finite() { least as f32 } else { f32::NAN }
            };
            layers.push(Layer {
                name: "stick_out",
                title: "by stick-out",
                colours: Colours::Scale {
                    label: format!("shortest stick-out in {}", run.unit),
                    none: "no length helps",
                },
                values: each(&least),
            });
        }
        if self.blame.voxels.is_some() {
            layers.push(Layer {
                name: "blame",
                title: "by blame",
                colours: Colours::Scale {
                    label: format!("area in {}² that it keeps from being reached", run.unit),
                    none: "in the way of nothing",
                },
                values: self.samples.samples.iter().map(|sample| self.blame.at(sample)).collect(),
            });
        }
        let unit = run.unit;
        let show = |at: [f64; 3]| length::place(at, unit);
        let rows = unreached.iter().enumerate().map(|(place, patch)| {
            let [low, high] = patch.bounds.map(DVec3::from_array);
            let size = (high - low).to_array().map(|side| length::nearest(side, unit)).join(" × ");
            TableRow {
                place: Some(place),
                cells: vec![
                    show_measure(patch.area),
                    show(patch.middle),
                    size,
                    patch.reason(unit, self.tools.len() > 1),
                    patch.would_help.clone(),
                ],
            }
        });
        let table = Table {
            title: format!("Not reached, in {unit}² and {unit}: the largest patches"),
            columns: vec![
                ("area", true),
                ("around", false),
                ("extent", false),
                ("why", false),
                ("would help", false),
            ],
            rows: rows.collect(),
        };
        let places = unreached.iter().map(|patch| Place {
            at: DVec3::from_array(patch.middle),
            normal: DVec3::from_array(patch.normal),
        });
        let tools: Vec<&str> = self.tools.iter().map(|(_, tool)| tool.name()).collect();
        View {
            title: format!("{}, tools: {}", run.part, tools.join(", ")),
            unit,
            mesh: &self.samples.mesh,
            focus: None,
            layers,
            directions: self.shown_directions(run),
            place_name: "places that are not reached",
            places: places.collect(),
            paths: Vec::new(),
            summary,
            tables: if unreached.is_empty() { Vec::new() } else { vec![table] },
        }
    }

    /// Those of the set-ups, or else those that reach most.
    fn shown_directions(&self, run: &AccessRun) -> Vec<DVec3> {
        match &self.setups {
            Some(setups) => setups.ways_up().collect(),
            None => self.best_directions().map(|at| run.orientations.orientations[at].direction()).collect(),
        }
    }
}
