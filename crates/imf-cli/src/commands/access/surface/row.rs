//! The surface in the summary, for files and for people.

use std::fmt::Write as _;

use imf_core::surface::{ObstructedAreas, Verdict};
use imf_core::unit::LengthUnit;
use serde::Serialize;

use super::super::on_machine::IN_THE_WAY;
use super::words;
use crate::output::{length, short, show_measure};

/// One direction, and the fraction of the surface that it reaches.
#[derive(Debug, Serialize)]
pub(crate) struct DirectionRow {
    pub(super) direction: [f64; 3],
    pub(super) fraction: f64,
}

/// An element of a tool, a body that it hits, and the fraction of the surface that this obstructs.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct ObstructedRow {
    tool: String,
    element: String,
    /// `part`, or a fixture's name.
    body: String,
    fraction: f64,
}

/// A body that is hit: 0 the part, then the fixtures in their order.
pub(super) fn body_name(body: usize, fixtures: &[String]) -> String {
    match body {
        0 => PART.into(),
        fixture => fixtures.get(fixture - 1).cloned().unwrap_or_default(),
    }
}

/// Its name in a sentence.
pub(super) fn with_article(body: &str) -> &str {
    if body == PART { "the part" } else { body }
}

const PART: &str = "part";

impl ObstructedRow {
    /// The rows of areas that a tool is obstructed at by part and fixtures, as fractions of the surface.
    pub(crate) fn all(tool: &str, found: &ObstructedAreas, fixtures: &[String], area: f64) -> Vec<Self> {
        let hits = found.hits.iter().map(|&(kind, body, own)| {
            let body = body_name(body, fixtures);
            Self { tool: tool.to_owned(), element: kind.to_string(), body, fraction: own / area }
        });
        let [element, body] = IN_THE_WAY.map(str::to_owned);
        let machine = Self { tool: tool.to_owned(), element, body, fraction: found.by_limit / area };
        hits.chain((found.by_limit > 0.0).then_some(machine)).collect()
    }

    /// All of them in a line, of `several` tools with their names.
    pub(crate) fn text(rows: &[Self], several: bool) -> String {
        let each = |Self { element, body, fraction, .. }: &Self| {
            format!("{element} at {} {:.1} %", with_article(body), 100.0 * fraction)
        };
        let of_tool = |rows: &[Self]| {
            let name = if several { format!("{}: ", rows[0].tool) } else { String::new() };
            name + &rows.iter().map(each).collect::<Vec<_>>().join(", ")
        };
        let tools: Vec<String> = rows.chunk_by(|a, b| a.tool == b.tool).map(of_tool).collect();
        if tools.is_empty() { String::new() } else { format!("nearest to the normal: {}", tools.join("; ")) }
    }
}

/// Radius of the largest circle among points of a surface, as many times as they are apart.
const CORNER: f64 = 0.72;

/// How deep an edge of a tool may stand in a surface between points of it that are so far apart: no deeper than the hole among them is wide.
pub(crate) fn edge_between_points(points_apart: f64) -> f64 {
    CORNER * points_apart
}

/// States how well walls are known, by points of surfaces that are so far apart.
pub(crate) fn resolved(pitch: f64, points_apart: f64, conservative: bool, unit: LengthUnit) -> String {
    let (corner, pitch) = (short(edge_between_points(points_apart)), short(pitch));
    match conservative {
        false => format!(
            "walls are known by points of the surfaces: an edge of cutter, shank or holder may stand up to {corner} {unit} deeper in them \
             than said, a round less"
        ),
        true => format!(
            "walls are known to shank and holder as voxels that they touch, and a gap up to {pitch} {unit} wider than these may be blocked; \
             the edge of a cutter may cut up to {corner} {unit} deeper than said, a round less"
        ),
    }
}

/// How sure it is that nothing fewer does, in words.
pub(crate) fn proof(proven: bool, at_least: usize) -> String {
    match proven {
        true => "proven: no fewer do".into(),
        false => format!("at least {at_least} are needed: the search for fewer was given up"),
    }
}

/// The line of what is left, by why it is; nothing where nothing is left.
pub(super) fn left(shares: &[(&str, f64)]) -> String {
    let some = shares.iter().filter(|(_, share)| *share > 0.0);
    let some: Vec<String> = some.map(|(why, share)| format!("{why} {:.1} %", 100.0 * share)).collect();
    if some.is_empty() { String::new() } else { format!("  left: {}\n", some.join(", ")) }
}

/// The surface in the summary; shares are of its area.
#[derive(Debug, Serialize)]
pub(crate) struct SurfaceRow {
    pub(super) area: f64,
    pub(super) samples: usize,
    /// Inside other bodies of the part's mesh or flush with them, and left out of all shares.
    pub(super) hidden_area: f64,
    pub(super) tolerance: f64,
    pub(super) reached: f64,
    /// Of the triangles on both sides of its border, each of which counts as its middle does.
    pub(super) border: f64,
    pub(super) reached_at_twice_the_pitch: f64,
    pub(super) difference: f64,
    /// The cutter fits, and something else of the tool collides.
    pub(super) obstructed: f64,
    /// What collides of a place's best tool, of the directions from which its cutter fits in the one nearest to the normal; several may
    /// at once.
    pub(super) obstructed_by: Vec<ObstructedRow>,
    /// The cutter does not fit.
    pub(super) gouged: f64,
    pub(super) not_faced: f64,
    pub(super) best_directions: Vec<DirectionRow>,
    /// That are not among these.
    #[serde(skip)]
    pub(super) other_directions: usize,
}

impl SurfaceRow {
    /// For people; of `several` tools those are named that something obstructs.
    pub(crate) fn lines(&self, unit: LengthUnit, several: bool) -> String {
        let mut text = format!(
            "surface, {} {unit}² (the cutter may cut {} {unit} below it)\n",
            show_measure(self.area),
            length::finer(self.tolerance, unit, 2)
        );
        let mut row = |name: &str, share: f64, rest: &str| {
            let _ = writeln!(text, "  {name:34}{:>8.1} %   {rest}", 100.0 * share);
        };
        let [coarse, border] = [self.reached_at_twice_the_pitch, self.border].map(|share| 100.0 * share);
        let coarse =
            format!("({coarse:.1} % at twice the pitch; triangles on its border hold {border:.1} %)");
        row(words(Verdict::Reached), self.reached, &coarse);
        let hits = ObstructedRow::text(&self.obstructed_by, several);
        row(words(Verdict::Obstructed), self.obstructed, &hits);
        row(words(Verdict::Gouged), self.gouged, "");
        row(words(Verdict::NotFaced), self.not_faced, "");
        for DirectionRow { direction: [i, j, k], fraction } in &self.best_directions {
            row(&format!("from ({i:.3}, {j:.3}, {k:.3})"), *fraction, "");
        }
        if self.other_directions > 0 {
            let _ = writeln!(text, "  and {} more", self.other_directions);
        }
        if self.hidden_area > 0.0 {
            let _ = writeln!(
                text,
                "  left out: {} {unit}² where bodies of the part cross or lie flush",
                show_measure(self.hidden_area)
            );
        }
        text
    }
}
