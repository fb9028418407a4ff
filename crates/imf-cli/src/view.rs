//! A surface coloured by results, for all outputs: a page in 3D ([`View::write_page`]) and pictures from six sides
//! ([`View::draw_sides`]).

mod page;
mod sides;

use glam::DVec3;
use imf_core::mesh::Mesh;
use imf_core::unit::LengthUnit;

/// Grey, for what has no value.
pub(crate) const NONE: [u8; 3] = [150, 150, 155];

pub(crate) struct View<'a> {
    pub(crate) title: String,
    /// Of all lengths.
    pub(crate) unit: LengthUnit,
    pub(crate) mesh: &'a Mesh,
    /// The box that is shown, where it is not that of the whole mesh.
    pub(crate) focus: Option<(DVec3, DVec3)>,
    /// The first is shown first; at least one.
    pub(crate) layers: Vec<Layer>,
    /// Unit vectors from tip to holder.
    pub(crate) directions: Vec<DVec3>,
    /// What the marked places are.
    pub(crate) place_name: &'static str,
    pub(crate) places: Vec<Place>,
    pub(crate) paths: Vec<PathLines>,
    /// What the command prints.
    pub(crate) summary: String,
    pub(crate) tables: Vec<Table>,
}

/// One value for each triangle, and its colours.
pub(crate) struct Layer {
    /// As in the files, whose tools are counted from 0.
    pub(crate) name: &'static str,
    /// For people, such as `by tool`.
    pub(crate) title: &'static str,
    pub(crate) colours: Colours,
    pub(crate) values: Vec<f32>,
}

pub(crate) enum Colours {
    /// Values are the numbers of these.
    Classes(Vec<(String, [u8; 3])>),
    /// Values are the numbers of these bodies, each of which can be taken away; true where it is at first.
    Bodies(Vec<(String, [u8; 3], bool)>),
    /// Viridis from the smallest to the largest value.
    Scale {
        label: String,
        /// What NaN stands for.
        none: &'static str,
    },
}

pub(crate) struct Place {
    pub(crate) at: DVec3,
    /// The direction from which it is viewed.
    pub(crate) normal: DVec3,
}

pub(crate) struct PathLines {
    pub(crate) name: &'static str,
    pub(crate) colour: [u8; 3],
    pub(crate) pieces: Vec<[DVec3; 2]>,
}

/// A table beside the view.
pub(crate) struct Table {
    pub(crate) title: String,
    /// True where a column holds numbers.
    pub(crate) columns: Vec<(&'static str, bool)>,
    pub(crate) rows: Vec<TableRow>,
}

pub(crate) struct TableRow {
    /// The place that it is about.
    pub(crate) place: Option<usize>,
    pub(crate) cells: Vec<String>,
}

/// Distinct colours, starting again after the last.
pub(crate) fn distinct(class: usize) -> [u8; 3] {
    let colour = colorous::TABLEAU10[class % colorous::TABLEAU10.len()];
    [colour.r, colour.g, colour.b]
}

/// Viridis, `place` from 0 to 1.
fn ramp(place: f64) -> [u8; 3] {
    let colour = colorous::VIRIDIS.eval_continuous(place.clamp(0.0, 1.0));
    [colour.r, colour.g, colour.b]
}

impl Layer {
    /// Smallest and largest finite value; 0 and 1 without any.
    fn range(&self) -> [f32; 2] {
        let finite = || self.values.iter().copied().filter(|value| value.is_finite());
        let (low, high) =
            (finite().fold(f32::INFINITY, f32::min), finite().fold(f32::NEG_INFINITY, f32::max));
        if low <= high { [low, high] } else { [0.0, 1.0] }
    }

    fn colour(&self, value: f32, [low, high]: [f32; 2]) -> [u8; 3] {
        match &self.colours {
            Colours::Classes(classes) => classes.get(value as usize).map_or(NONE, |(_, colour)| *colour),
            Colours::Bodies(bodies) => bodies.get(value as usize).map_or(NONE, |(_, colour, _)| *colour),
            Colours::Scale { .. } if !value.is_finite() => NONE,
            Colours::Scale { .. } if high <= low => ramp(0.0),
            Colours::Scale { .. } => ramp(f64::from((value - low) / (high - low))),
        }
    }
}
