//! Poses held out of training: how well a network does where it has no samples, watched while it trains.
//!
//! A few random orientations, none of them one of the training set, and in each of their exact sections some voxels
//! drawn uniformly. Seed, numbers and scene decide all of it, so a run that goes on sees the same poses.

use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

use imf_core::control::Control;
use imf_core::field::EngineError;
use imf_core::orientation::{Orientation, OrientationSet};
use imf_core::scene::Scene;
use imf_core::section::{SectionError, SectionPlan, ToolPoints, stream_sections};
use imf_fields::metrics::{ErrorReport, Errors};
use imf_fields::recipe::HeldOutChoice;
use imf_fields::siren::{EvaluationEngine, INPUTS, features};

/// Separates the orientations from those that `random:N:SEED` gives for small seeds.
const SEED_MARK: u64 = 0x4845_4c44_5f4f_5554;
/// Directions closer than this cosine are one direction: a thousandth of a degree.
const SAME_DIRECTION: f64 = 1.0 - 1.5e-10;
/// Value above which the field calls a pose colliding; only the decisions of the report depend on it.
const THRESHOLD: f64 = 0.001;

/// The poses and their exact values.
pub struct HeldOut {
    /// `[poses][5]`, section after section.
    inputs: Vec<f32>,
    /// `[poses]`
    exact: Vec<f32>,
    /// The network's last values.
    answers: Vec<f32>,
}

impl HeldOut {
    /// Draws the poses and computes their exact values. One unit of progress is one orientation.
    ///
    /// # Errors
    /// A failed section, or cancellation.
    pub fn new(
        choice: HeldOutChoice,
        scene: &Scene,
        trained: &[Orientation],
        control: Control<'_>,
    ) -> Result<Self, SectionError> {
        let orientations = unseen(choice.orientations.clamp(1, choice.poses.max(1)), choice.seed, trained);
        let plan = SectionPlan::of_scene(scene, ToolPoints::Tip)?;
        let grid = scene.record.grid;
        let share = |index: usize| (index * choice.poses) / orientations.len();
        let drawn =
            stream_sections(&plan, &orientations, control, Vec::new, |list: &mut Vec<_>, index, cmf| {
                let mut generator = ChaCha8Rng::seed_from_u64(choice.seed ^ SEED_MARK);
                generator.set_stream(index as u64);
                let count = share(index + 1) - share(index);
                let mut poses = Vec::with_capacity(count);
                for _ in 0..count {
                    let voxel = ((u128::from(generator.next_u64()) * cmf.len() as u128) >> 64) as usize;
                    poses.push((voxel, cmf[voxel]));
                }
                list.push((index, poses));
            })?;
        let mut drawn: Vec<_> = drawn.into_iter().flatten().collect();
        drawn.sort_by_key(|&(index, _)| index);
        let mut inputs = Vec::with_capacity(choice.poses * INPUTS);
        let mut exact = Vec::with_capacity(choice.poses);
        for (index, poses) in drawn {
            let [theta, phi] = orientations[index].angles();
            for (voxel, value) in poses {
                let point = grid.unit(grid.centre(grid.voxel(voxel)));
                inputs.extend(features(point.as_vec3().to_array(), theta, phi));
                exact.push(value);
            }
        }
        Ok(Self { answers: vec![0.0; exact.len()], inputs, exact })
    }

    /// Errors of a network at the poses.
    ///
    /// # Errors
    /// A device that failed.
    pub fn errors(&mut self, engine: &mut dyn EvaluationEngine) -> Result<ErrorReport, EngineError> {
        engine.evaluate(&self.inputs, &mut self.answers)?;
        let mut errors = Errors::default();
        errors.add(&self.exact, &self.answers, THRESHOLD);
        Ok(errors.report(THRESHOLD))
    }
}

/// `count` random orientations of which none has a direction of `trained`.
fn unseen(count: usize, seed: u64, trained: &[Orientation]) -> Vec<Orientation> {
    let directions: Vec<_> = trained.iter().map(Orientation::direction).collect();
    let is_new = |orientation: &Orientation| {
        let direction = orientation.direction();
        directions.iter().all(|other| direction.dot(*other) < SAME_DIRECTION)
    };
    let mut found = Vec::with_capacity(count);
    // One round nearly always: a random direction is one of a million given ones once in ten thousand draws.
    for round in 0..16 {
        let spec = format!("random:{count}:{}", (seed ^ SEED_MARK).wrapping_add(round));
        let drawn = OrientationSet::parse(&spec).map(|set| set.orientations).unwrap_or_default();
        found.extend(drawn.into_iter().filter(is_new).take(count - found.len()));
        if found.len() == count {
            break;
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixtures::scene;
    use imf_core::section::direct_count;
    use imf_core::tool::ToolVoxels;

    const CHOICE: HeldOutChoice = HeldOutChoice { poses: 101, orientations: 7, seed: 3 };

    #[test]
    fn poses_are_the_exact_field_at_voxels_of_unseen_directions() {
        let scene = scene();
        let held = HeldOut::new(CHOICE, &scene, &[], Control::quiet()).unwrap();
        let HeldOut { inputs, exact, .. } = &held;
        assert_eq!((inputs.len(), exact.len()), (101 * INPUTS, 101));
        let orientations = unseen(7, 3, &[]);
        for (pose, value) in inputs.chunks(INPUTS).zip(exact) {
            let orientation = orientations
                .iter()
                .find(|o| features([0.0; 3], o.angles()[0], o.angles()[1])[3..] == pose[3..])
                .expect("an orientation of the set");
            let tool = ToolVoxels::new(&scene.record.tool, orientation, 8.0).unwrap();
            let voxel: Vec<i64> = (0..3)
                .map(|a| ((f64::from(pose[a]) + 1.0) / 2.0 * scene.record.grid.dims[a] as f64).floor() as i64)
                .collect();
            let count = direct_count(&scene.obstacle, &tool, [voxel[0], voxel[1], voxel[2]]);
            assert_eq!(*value, (f64::from(count) * (1.0 / f64::from(tool.count))) as f32);
        }
    }

    #[test]
    fn seed_decides_and_training_directions_are_left_out() {
        let scene = scene();
        let make = |choice, trained: &[Orientation]| {
            HeldOut::new(choice, &scene, trained, Control::quiet()).unwrap().inputs
        };
        assert_eq!(make(CHOICE, &[]), make(CHOICE, &[]));
        assert_ne!(make(CHOICE, &[]), make(HeldOutChoice { seed: 4, ..CHOICE }, &[]));
        // The very set that would be drawn is trained on: others are drawn.
        let first = unseen(7, 3, &[]);
        let others = unseen(7, 3, &first);
        assert_eq!(others.len(), 7);
        assert!(others.iter().all(|o| first.iter().all(|f| f.direction().dot(o.direction()) < 1.0 - 1e-9)));
        assert_ne!(make(CHOICE, &[]), make(CHOICE, &first));
    }
}
