//! In how few set-ups a surface is machined: each is one way to put the part on the machine, and gives the tool one
//! direction (three axes) or all within the ranges of the rotary axes.

use glam::{DQuat, DVec3};

use super::{SurfaceAccess, SurfaceSample};
use crate::control::Control;
use crate::cover::{CoverProblem, CoverSettings};
use crate::mesh::Mesh;
use crate::orientation::{Limits, Orientation};

/// One way to put the part on the machine.
#[derive(Clone, Debug, PartialEq)]
pub struct PartSetup {
    /// Unit vector in the part's frame that points along the machine's +z.
    pub up: DVec3,
    /// Indices of the directions that the machine gives the tool there.
    pub directions: Vec<usize>,
    /// True where the part stands on its lowest face by itself.
    pub rests: bool,
}

impl PartSetup {
    /// The set-up with this direction up: of `directions` those that the machine's limits reach, seen from there. The part is
    /// turned by the shortest way; where the turning axis has a range of less than 360° another turn about +z may reach others.
    #[must_use]
    pub fn new(part: &Mesh, up: DVec3, directions: &[Orientation], limits: &Limits) -> Self {
        let to_machine = DQuat::from_rotation_arc(up, DVec3::Z);
        let reached = |o: &Orientation| limits.reach((to_machine * o.direction()).normalize());
        let directions = directions.iter().enumerate().filter(|(_, o)| reached(o)).map(|(index, _)| index);
        Self { up, directions: directions.collect(), rests: part.rests_on(-up) }
    }
}

/// One of the set-ups that were chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChosenSetup {
    /// Its index in the candidates.
    pub candidate: usize,
    /// The area that it reaches.
    pub area: f64,
    /// The area that no other chosen one reaches.
    pub alone: f64,
}

/// The fewest set-ups, and what they reach.
#[derive(Clone, Debug, PartialEq)]
pub struct SetupPlan {
    /// The set-ups; each adds the most to those before it.
    pub setups: Vec<ChosenSetup>,
    /// No fewer of the candidates reach as much.
    pub at_least: usize,
    /// The area that the chosen set-ups reach together.
    pub area: f64,
    /// The area that all candidates together reach.
    pub reachable: f64,
}

impl SetupPlan {
    /// True where no plan with fewer set-ups of the candidates exists.
    #[must_use]
    pub fn is_proven(&self) -> bool {
        self.at_least == self.setups.len()
    }
}

/// The fewest of these set-ups in which any of the tools reaches the fraction of [`CoverSettings`] of the area that all of
/// them reach; `None` where the control asks to stop. One unit of progress is one set-up looked at. Every element of `tools` is of these samples and of the directions
/// that the set-ups count.
///
/// # Panics
/// If the numbers of samples or directions differ.
#[must_use]
pub fn fewest_setups(
    tools: &[&SurfaceAccess],
    samples: &[SurfaceSample],
    setups: &[PartSetup],
    settings: &CoverSettings,
    control: Control<'_>,
) -> Option<SetupPlan> {
    let mut problem = CoverProblem::new(samples.iter().map(|sample| sample.area).collect());
    for setup in setups {
        let reaches =
            |sample: &usize| tools.iter().any(|tool| tool.is_free_from_any(*sample, &setup.directions));
        problem.add((0..samples.len()).filter(reaches));
        (control.progress)(1);
        if control.is_cancelled() {
            return None;
        }
    }
    let cover = problem.fewest(settings, control)?;
    let alone = problem.covered_alone(&cover.sets);
    let chosen = cover.sets.iter().zip(alone).map(|(&candidate, alone)| ChosenSetup {
        candidate,
        area: problem.covered(&[candidate]),
        alone,
    });
    Some(SetupPlan {
        setups: chosen.collect(),
        at_least: cover.at_least,
        area: problem.covered(&cover.sets),
        reachable: problem.covered(&(0..setups.len()).collect::<Vec<_>>()),
    })
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DMat4;

    use super::*;
    use crate::grid::Grid;
    use crate::mesh::tests::unit_cube;
    use crate::orientation::OrientationSet;
    use crate::surface::{SurfaceSamples, SurfaceTool, Surroundings, default_tolerance, surface_access};
    use crate::tool::{Element, ElementKind, Segment, SharpPoints, Tool, ToolShape};
    use crate::unit::LengthUnit;
    use crate::voxelize::voxelize;

    const UPS: [DVec3; 6] = [DVec3::Z, DVec3::NEG_Z, DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y];

    /// The fewest set-ups for a plain block with a flat end mill whose flutes are longer than the block is high.
    fn plan(limits: &str, fraction: f64) -> (SetupPlan, Vec<PartSetup>, f64) {
        let cylinder = |kind, from, to, radius| Element {
            kind,
            profile: vec![Segment::Line { from, to, radius_from: radius, radius_to: radius }],
        };
        let elements = vec![
            cylinder(ElementKind::Cutter, 0.0, 45.0, 5.0),
            cylinder(ElementKind::Holder(0), 45.0, 75.0, 12.0),
        ];
        let (name, unit, sharp_points) = ("flat".into(), LengthUnit::Mm, SharpPoints::Tip);
        let tool =
            Tool { name, unit, shape: ToolShape::Revolved(elements), sharp_points, overall_length: None };
        let block = unit_cube().transformed(&DMat4::from_scale(DVec3::new(40.0, 30.0, 15.0)));
        let grid = Grid::with_pitch(DVec3::splat(-0.4), DVec3::new(40.3, 30.3, 15.3), 1.0, 1).unwrap();
        let solid = Arc::new(voxelize(&block, &grid, false));
        let samples = SurfaceSamples::new(&block, &solid, 600).samples;
        let surroundings = Surroundings::new(&solid.into(), &[]);
        let directions = OrientationSet::parse("0,0;0,180;0,90;180,90;90,90;270,90").unwrap().orientations;
        let tool =
            SurfaceTool::new(&surroundings, &tool.into(), default_tolerance(1.0, LengthUnit::Mm)).unwrap();
        let access = surface_access(&tool, &samples, &directions, Control::quiet()).unwrap();
        let limits = Limits::parse(limits).unwrap();
        let setups: Vec<PartSetup> =
            UPS.iter().map(|&up| PartSetup::new(&block, up, &directions, &limits)).collect();
        let settings = CoverSettings { fraction, ..CoverSettings::default() };
        let plan = fewest_setups(&[&access], &samples, &setups, &settings, Control::quiet()).unwrap();
        (plan, setups, samples.iter().map(|sample| sample.area).sum())
    }

    #[test]
    fn a_block_takes_two_set_ups_on_three_axes_and_one_where_the_tool_tilts_to_the_side() {
        let (three_axes, setups, area) = plan("cone:0,0,1:0", 1.0);
        assert!(setups.iter().all(|setup| setup.directions.len() == 1 && setup.rests));
        assert_eq!((three_axes.setups.len(), three_axes.at_least), (2, 2));
        assert!(
            (three_axes.area - area).abs() < 1e-6 * area && (three_axes.reachable - area).abs() < 1e-6 * area
        );
        // Each leaves the face that it stands on to the other.
        let faces = three_axes.setups.iter().map(|chosen| area - chosen.area);
        let [first, second] = faces.collect::<Vec<_>>()[..] else { panic!() };
        assert!((first - three_axes.setups[1].alone).abs() < 1e-6 * area);
        assert!((second - three_axes.setups[0].alone).abs() < 1e-6 * area);
        let (tilting, setups, _) = plan("cone:0,0,1:90", 1.0);
        assert!(setups.iter().all(|setup| setup.directions.len() == 5));
        assert_eq!(tilting.setups.len(), 1);
    }

    #[test]
    fn a_face_that_may_stay_saves_a_set_up() {
        // The smallest face is 450 of 4,500 mm².
        let (plan, ..) = plan("cone:0,0,1:0", 0.85);
        assert_eq!((plan.setups.len(), plan.is_proven()), (1, true));
    }
}
