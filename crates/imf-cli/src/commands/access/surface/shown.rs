//! The surface for those who look: its layers, and the places that are not reached with what keeps them so.

use std::collections::BTreeMap;

use glam::DVec3;
use imf_core::surface::{Reach, SurfacePatch};
use serde::Serialize;

use super::{Setup, Surface, Verdict};
use crate::output::show_measure;
use crate::view::{Colours, Layer, NONE, Place, Table, TableRow, View, distinct};

/// Places that are not reached, at most: the largest.
const PLACES: usize = 30;

/// A connected patch of the surface that no tool reaches, for one reason.
#[derive(Debug, Serialize)]
pub(in crate::commands::access) struct UnreachedPatch {
    area: f64,
    /// A point in its middle.
    middle: [f64; 3],
    /// Outward, there.
    normal: [f64; 3],
    /// Lowest and highest coordinates.
    bounds: [[f64; 3]; 2],
    /// `something is in the way`, `the cutter does not fit` or `no direction faces it`.
    why: &'static str,
    /// Which element hits which body, the commonest first.
    hits: Vec<String>,
}

impl Verdict {
    const ALL: [Self; 4] = [Self::Reached, Self::Obstructed, Self::Gouged, Self::NotFaced];

    pub(super) fn words(self) -> &'static str {
        match self {
            Self::Reached => "reached",
            Self::Obstructed => "something is in the way",
            Self::Gouged => "the cutter does not fit",
            Self::NotFaced => "no direction faces it",
        }
    }
}

impl Surface {
    /// The largest patches that are not reached.
    pub(in crate::commands::access) fn unreached(&self, fixtures: &[String]) -> Vec<UnreachedPatch> {
        let class = |sample: usize| match self.best[sample].0 {
            Verdict::Reached => None,
            why => Some(why as u32),
        };
        let patches = self.samples.patches(class);
        patches.iter().take(PLACES).map(|patch| self.patch(patch, fixtures)).collect()
    }

    fn patch(&self, patch: &SurfacePatch, fixtures: &[String]) -> UnreachedPatch {
        let mut hits: BTreeMap<String, f64> = BTreeMap::new();
        for &sample in &patch.samples {
            let (verdict, tool) = self.best[sample];
            let (access, surface_tool) = &self.tools[tool];
            if let (Verdict::Obstructed, Reach::Obstructed { hits: found, .. }) =
                (verdict, access.reach[sample])
            {
                for (kind, body) in surface_tool.hits(found) {
                    let body = match body {
                        0 => "the part",
                        fixture => fixtures.get(fixture - 1).map_or("a fixture", String::as_str),
                    };
                    *hits.entry(format!("{kind} hits {body}")).or_default() +=
                        self.samples.samples[sample].area;
                }
            }
        }
        let mut hits: Vec<(String, f64)> = hits.into_iter().collect();
        hits.sort_by(|a, b| b.1.total_cmp(&a.1));
        UnreachedPatch {
            area: patch.area,
            middle: patch.middle.to_array(),
            normal: (patch.normal + 0.0).to_array(),
            bounds: patch.bounds.map(|corner| corner.to_array()),
            why: patch.samples.first().map_or("", |&sample| self.best[sample].0.words()),
            hits: hits.into_iter().map(|(what, _)| what).collect(),
        }
    }

    /// The surface with the values of every sample, coloured.
    pub(in crate::commands::access) fn view<'a>(
        &'a self,
        setup: &Setup,
        unreached: &[UnreachedPatch],
        summary: String,
    ) -> View<'a> {
        let classes = |names: &mut dyn Iterator<Item = (String, [u8; 3])>| Colours::Classes(names.collect());
        let each = |value: &dyn Fn(usize) -> f32| -> Vec<f32> { (0..self.best.len()).map(value).collect() };
        let reached = |sample: usize| self.best[sample].0 == Verdict::Reached;
        let mut layers = vec![Layer {
            name: "verdict",
            title: "by reach",
            colours: classes(&mut Verdict::ALL.iter().map(|v| (v.words().to_owned(), v.rgb()))),
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
                values: each(&|sample| if reached(sample) { self.best[sample].1 as f32 + 1.0 } else { 0.0 }),
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
            values: each(&|sample| match self.tools[self.best[sample].1].0.reach[sample] {
                Reach::Reached { directions } => directions as f32,
                _ => f32::NAN,
            }),
        });
        let unit = setup.unit;
        let show = |at: [f64; 3]| at.map(|value| format!("{value:.1}")).join(", ");
        let rows = unreached.iter().enumerate().map(|(place, patch)| {
            let [low, high] = patch.bounds.map(DVec3::from_array);
            let why = [&[patch.why.to_owned()][..], &patch.hits[..]].concat().join(": ");
            let size = (high - low).to_array().map(|side| format!("{side:.0}")).join(" × ");
            TableRow {
                place: Some(place),
                cells: vec![show_measure(patch.area), show(patch.middle), size, why],
            }
        });
        let table = Table {
            title: format!("Not reached, in {unit}² and {unit}: the largest patches"),
            columns: vec![("area", true), ("around", false), ("extent", false), ("why", false)],
            rows: rows.collect(),
        };
        let places = unreached.iter().map(|patch| Place {
            at: DVec3::from_array(patch.middle),
            normal: DVec3::from_array(patch.normal),
        });
        let tools: Vec<&str> = self.tools.iter().map(|(_, tool)| tool.name()).collect();
        View {
            title: format!("{}, tools: {}", setup.part, tools.join(", ")),
            unit,
            mesh: &self.samples.mesh,
            layers,
            directions: self.shown_directions(setup),
            place_name: "places that are not reached",
            places: places.collect(),
            paths: Vec::new(),
            summary,
            tables: if unreached.is_empty() { Vec::new() } else { vec![table] },
        }
    }

    /// Those of the set-ups, or else those that reach most.
    fn shown_directions(&self, setup: &Setup) -> Vec<DVec3> {
        match &self.setups {
            Some(setups) => setups.ways_up().collect(),
            None => {
                self.best_directions().map(|at| setup.orientations.orientations[at].direction()).collect()
            }
        }
    }
}
