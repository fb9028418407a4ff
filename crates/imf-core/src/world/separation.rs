//! How far a tool is from the obstacles, or how deep it is in them.
//!
//! A free tool's distance is exact for voxel centres: branch and bound over the tool's bounding spheres. Of a colliding tool the distance is
//! below 0: minus the length of the shortest translation that frees it of that obstacle, between a bound by spheres
//! inscribed in the tool and a translation that was found.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use super::ObstacleId;
use super::checker::{Checker, PlacedField, QueryError};
use crate::field::ExactField;
use crate::field::solid::Separation;
use crate::pose::Pose;
use crate::tool::ElementKind;

/// A distance with its bounds, in the world's unit: above 0 between the tool, offset by its clearance, and the nearest solid voxel's centre;
/// below 0 minus the shortest translation that frees the tool from the obstacle.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Distance {
    /// The distance is at least this.
    pub lower: f64,
    /// It is at most this; equal to `lower` where the tool is free.
    pub upper: f64,
    /// The nearest obstacle, or the one in which the tool is deepest, as far as that is proven.
    pub obstacle: ObstacleId,
    /// The element that is nearest to it; where the tool collides, the one whose stretch of the tool, with all clearances, holds the
    /// deepest voxel.
    pub element: ElementKind,
    /// The point of the element's surface that is nearest to `obstacle_point`.
    pub tool_point: DVec3,
    /// The nearest voxel's centre; where the tool collides, the one deepest in its element.
    pub obstacle_point: DVec3,
}

/// Halvings of a translation that frees the tool.
const HALVINGS: usize = 14;

impl Checker {
    /// How far the tool is from the nearest obstacle, or how deep it is in one. `None` where no obstacle has a solid voxel.
    ///
    /// # Errors
    /// An invalid pose, or one too far away to have a distance; a mesh tool, or one whose outline has an arc around a centre beyond its axis, or too many pieces.
    pub fn distance(&self, pose: &Pose) -> Result<Option<Distance>, QueryError> {
        let middle = self.tool_middle(pose).ok_or(QueryError::InvalidPose)?;
        let mut nearest: Option<Distance> = None;
        for one in self.placed.iter() {
            let least = nearest.map_or(f64::INFINITY, |nearest| nearest.lower);
            if self.gap(one, middle) > least {
                continue;
            }
            let local = one.local(pose);
            one.around.field.clearance_bound(&local).ok_or_else(|| self.not_measured())?;
            if let Some(found) = distance(one, &local) {
                nearest = nearest.filter(|nearest| nearest.lower <= found.lower).or(Some(found));
            }
        }
        match nearest {
            Some(nearest) if nearest.lower.is_finite() => Ok(Some(nearest)),
            None if self.placed.is_empty() => Ok(None),
            _ => Err(QueryError::TooFar),
        }
    }

    fn not_measured(&self) -> QueryError {
        if self.tool.assembly.tool().mesh().is_some() { QueryError::Mesh } else { QueryError::Outline }
    }
}

/// From one obstacle, at a pose in its frame, but with points in the world.
fn distance(one: &PlacedField, pose: &Pose) -> Option<Distance> {
    let field = &one.around.field;
    let Some(deepest) = deepest(field, pose) else {
        let both = field.solids_with_tools().filter_map(|(solid, tool)| solid.separation(tool, pose));
        let nearest = both.min_by(|a, b| a.distance.total_cmp(&b.distance))?;
        return Some(of(one, &nearest, nearest.distance, nearest.distance));
    };
    let least = field.penetration_bound(pose)?;
    // At contact 0, not −0.
    Some(of(one, &deepest, 0.0 - exit(field, pose, &deepest, least), 0.0 - least))
}

fn of(one: &PlacedField, pair: &Separation, lower: f64, upper: f64) -> Distance {
    let [tool_point, obstacle_point] = [pair.foot, pair.centre].map(|point| one.at.of_point(point));
    Distance { lower, upper, obstacle: one.id, element: pair.element, tool_point, obstacle_point }
}

/// The centre deepest in its element; `None` where the tool is free, and of a mesh.
fn deepest(field: &ExactField, pose: &Pose) -> Option<Separation> {
    let axis = pose.axis().filter(|_| field.collides(pose))?;
    let both = field.solids_with_tools().filter_map(|(solid, tool)| solid.deepest(tool, pose));
    let deepest = both.max_by(|a, b| a.depth.total_cmp(&b.depth))?;
    Some(Separation::of(deepest.element?, pose.position, axis, deepest.centre))
}

/// The length of a translation that frees the tool, the shortest of those that were tried; at least `least`.
fn exit(field: &ExactField, pose: &Pose, deepest: &Separation, least: f64) -> f64 {
    let grid = field.obstacle().grid();
    let (middle, radius) = (grid.origin + 0.5 * grid.size(), 0.5 * grid.size().length() + field.reach());
    let away = pose.position - middle;
    // So far that the tool's reach no longer meets the grid's box.
    let out = |way: DVec3| {
        let along = away.dot(way);
        (radius * radius - away.length_squared() + along * along).max(0.0).sqrt() - along
    };
    let cells = (-1..=1).flat_map(|x| (-1..=1).flat_map(move |y| (-1..=1).map(move |z| [x, y, z])));
    let ways = cells.map(|cell| DVec3::from_array(cell.map(f64::from)));
    let more = [pose.axis().unwrap_or(DVec3::Z), deepest.centre - deepest.foot];
    let mut shortest = f64::INFINITY;
    for way in more.into_iter().chain(ways).filter_map(DVec3::try_normalize) {
        let is_free =
            |length: f64| !field.collides(&Pose { position: pose.position + way * length, ..*pose });
        let (mut low, mut high) = (least, out(way).min(shortest));
        if !is_free(high) {
            continue;
        }
        for _ in 0..HALVINGS {
            let middle = 0.5 * (low + high);
            if is_free(middle) { high = middle } else { low = middle }
        }
        shortest = high;
    }
    shortest.max(least)
}
