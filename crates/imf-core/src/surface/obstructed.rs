//! Which elements and bodies obstruct how much of a surface.

use super::{SampleReach, SurfaceTool};
use crate::tool::ElementKind;

/// Areas that are not reached, by what obstructs them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ObstructedAreas {
    /// An element, the body that it hits (0 the part, then the fixtures in their order), and the area that this
    /// obstructs, in the mesh's unit squared; elements in their order along the tool. Several may obstruct one place.
    pub hits: Vec<(ElementKind, usize, f64)>,
    /// The area that a limit on poses alone obstructs ([`SurfaceTool::is_limited`]), in the mesh's unit squared.
    pub by_limit: f64,
}

impl ObstructedAreas {
    /// Of places: their tools, what these reach there, and their areas. Places that are not obstructed count for nothing.
    #[must_use]
    pub fn new<'a>(places: impl IntoIterator<Item = (&'a SurfaceTool, SampleReach, f64)>) -> Self {
        let mut found = Self::default();
        for (tool, reach, area) in places {
            let SampleReach::Obstructed { hits, .. } = reach else { continue };
            if tool.is_limited() && hits == 0 {
                found.by_limit += area;
            }
            for (kind, body) in tool.hits(hits) {
                match found.hits.iter_mut().find(|(k, b, _)| (*k, *b) == (kind, body)) {
                    Some((.., sum)) => *sum += area,
                    None => found.hits.push((kind, body, area)),
                }
            }
        }
        found.hits.sort_by_key(|(kind, body, _)| (kind.order(), *body));
        found
    }
}
