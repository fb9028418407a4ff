//! Obstacles of which voxels become solid or empty.

use super::{Checker, ObstacleId, World, WorldError};
use crate::obstacle::Obstacle;

impl World {
    /// An obstacle's voxels, in its own frame.
    ///
    /// # Errors
    /// An obstacle that is not there.
    pub fn obstacle(&self, id: ObstacleId) -> Result<&Obstacle, WorldError> {
        let standing = self.obstacles.iter().find(|standing| standing.id == id);
        standing.map(|standing| standing.prepared.obstacle()).ok_or(WorldError::Unknown(id))
    }

    /// Makes voxels of an obstacle solid, and others empty, by their indices in its grid
    /// ([`Grid::index`](crate::grid::Grid::index)); those that are so already are skipped. A solid one is
    /// forbidden to the whole tool. All results are those of an obstacle made anew of these voxels, in a small part
    /// of the time.
    ///
    /// `checkers` are those of this world that are to see the change, as by [`Checker::follow`]. All others, and
    /// their clones, keep the old voxels, which are then copied first.
    ///
    /// # Errors
    /// An obstacle that is not there, a voxel that its grid has not or that should be both; a checker that cannot follow this world.
    /// Nothing is changed then.
    pub fn change(
        &mut self,
        id: ObstacleId,
        solid: &[usize],
        empty: &[usize],
        checkers: &mut [Checker],
    ) -> Result<(), WorldError> {
        checkers.iter().try_for_each(|checker| checker.check_world(self))?;
        let standing = self.standing_mut(id)?;
        let grid = *standing.prepared.obstacle().grid();
        let refused =
            |voxel: usize, why| WorldError::Voxel { obstacle: standing.name.to_string(), voxel, why };
        if let Some(&voxel) = solid.iter().chain(empty).find(|&&voxel| voxel >= grid.len()) {
            return Err(refused(voxel, "it is not in its grid"));
        }
        let mut both = solid.to_vec();
        both.sort_unstable();
        if let Some(&voxel) = empty.iter().find(|voxel| both.binary_search(voxel).is_ok()) {
            return Err(refused(voxel, "it cannot become both solid and empty"));
        }
        for checker in checkers.iter_mut() {
            checker.forget(id);
        }
        standing.prepared.change(solid, empty);
        standing.conservative &= empty.is_empty();
        let centres = solid.iter().map(|&voxel| grid.centre(grid.voxel(voxel)));
        standing.ball = centres.fold(standing.ball, |ball, centre| match ball {
            None => Some((centre, 0.0)),
            Some((middle, radius)) => Some((middle, radius.max(middle.distance(centre)))),
        });
        checkers.iter_mut().try_for_each(|checker| checker.follow(self))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::DVec3;
    use rand::SeedableRng as _;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::field::Decision;
    use crate::occupancy::Occupancy;
    use crate::pose::Pose;
    use crate::section::test_shapes::number;
    use crate::tool::{Clearance, Tool};
    use crate::world::tests::bracket_scene;
    use crate::world::{HERE, MotionOptions};

    fn poses(random: &mut ChaCha8Rng, world: &World, id: ObstacleId, count: usize) -> Vec<Pose> {
        let grid = *world.obstacle(id).unwrap().grid();
        let mut vector = || DVec3::from_array([0; 3].map(|_| number(random)));
        let (low, size) = (grid.origin - 10.0, grid.size() + 20.0);
        let mut pose = || Pose::along(low + size * vector(), vector() * 2.0 - 1.0);
        (0..count).map(|_| pose()).collect()
    }

    #[test]
    fn after_any_changes_all_answers_are_those_of_an_obstacle_made_anew() {
        let scene = bracket_scene([14, 41, 25]);
        let mut random = ChaCha8Rng::seed_from_u64(7);
        // Of a part of which the cutter may enter a layer, and of one that is forbidden as a whole.
        for layer in [true, false] {
            let mut world = World::builder().allow_coarse(true).build().unwrap();
            let obstacle = Obstacle::from(&scene);
            let obstacle = if layer {
                let mut own = Occupancy::clone(&obstacle.forbidden);
                own.solid
                    .iter_mut()
                    .enumerate()
                    .for_each(|(index, solid)| *solid &= u8::from(index.is_multiple_of(3)));
                Obstacle::with_cuttable(&obstacle.whole(), own)
            } else {
                obstacle
            };
            let at = Pose::along(DVec3::new(3.0, -4.0, 5.0), DVec3::new(0.1, 0.2, 1.0));
            let id = world.add_voxels("part", obstacle, at).unwrap();
            let far = Pose::along(DVec3::splat(500.0), DVec3::Z);
            world.add_voxels("far", &scene, far).unwrap();
            let tool = Tool::paper();
            let mut checkers = [0.0, 1.0].map(|clearance| {
                world.checker(&tool, &Clearance::around_holder_and_shank(clearance)).unwrap()
            });
            let mut differ = 0;
            for step in 0..12 {
                // Whoever does not follow keeps what it saw, and is what others are copied for.
                let kept = (step % 3 == 0).then(|| checkers.clone());
                let poses = poses(&mut random, &world, id, 200);
                let classify = |checker: &Checker| {
                    let mut decisions = vec![Decision::Undecided; poses.len()];
                    checker.classify(&poses, &mut decisions).unwrap();
                    decisions
                };
                let before = checkers.each_ref().map(classify);
                let grid = *world.obstacle(id).unwrap().grid();
                // A ball of voxels, and voxels here and there.
                let mut any = || (number(&mut random) * (grid.len() - 1) as f64) as usize;
                let centre = |index: usize| grid.centre(grid.voxel(index));
                let (middle, radius) = (centre(any()), 8.0 * grid.pitch);
                let ball = (0..grid.len()).filter(|&index| centre(index).distance(middle) < radius);
                let more = (0..20).map(|_| any());
                let voxels: Vec<usize> = ball.chain(more).collect();
                let (solid, empty): (&[usize], &[usize]) =
                    if step % 2 == 0 { (&voxels, &[]) } else { (&[], &voxels) };
                world.change(id, solid, empty, &mut checkers).unwrap();

                let mut anew = World::builder().allow_coarse(true).build().unwrap();
                let own = world.obstacle(id).unwrap();
                let copy = Obstacle {
                    forbidden: Arc::new((*own.forbidden).clone()),
                    cuttable: own.cuttable.as_ref().map(|layer| Arc::new((**layer).clone())),
                };
                for &voxel in &voxels {
                    assert_eq!(copy.forbidden.solid[voxel], u8::from(step % 2 == 0));
                    assert!(copy.cuttable.as_ref().is_none_or(|layer| layer.solid[voxel] == 0));
                }
                let own = anew.add_voxels("part", copy, at).unwrap();
                anew.add_voxels("far", &scene, far).unwrap();
                for (checker, clearance) in checkers.iter().zip([0.0, 1.0]) {
                    let expected =
                        anew.checker(&tool, &Clearance::around_holder_and_shank(clearance)).unwrap();
                    assert_eq!(classify(checker), classify(&expected));
                    for pair in poses.chunks_exact(2).take(20) {
                        let contact = |checker: &Checker, id: ObstacleId| {
                            let found = checker.contact(&pair[0]).unwrap();
                            assert!(found.is_none_or(|found| found.obstacle == id));
                            let found = found.map(|found| (found.element, found.point, found.depth));
                            (found, checker.is_free(&pair[0]))
                        };
                        assert_eq!(contact(checker, id), contact(&expected, own));
                        let motion = |checker: &Checker| {
                            checker.check_motion(&pair[0], &pair[1], &MotionOptions::default()).unwrap()
                        };
                        assert_eq!(motion(checker).is_free(), motion(&expected).is_free());
                    }
                }
                let after = checkers.each_ref().map(classify);
                differ += before.iter().flatten().zip(after.iter().flatten()).filter(|(a, b)| a != b).count();
                if let Some(kept) = kept {
                    assert_eq!(kept.each_ref().map(classify), before);
                }
            }
            assert!(differ > 20, "{differ}");
        }
    }

    #[test]
    fn what_cannot_be_changed_is_refused_and_nothing_is() {
        let mut world = World::builder().allow_coarse(true).build().unwrap();
        let scene = bracket_scene([7, 20, 12]);
        let id = world.add_voxels("part", &scene, HERE).unwrap();
        let before = world.obstacle(id).unwrap().clone();
        let of = |error: Result<(), WorldError>| error.unwrap_err().to_string();
        assert_eq!(
            of(world.change(id, &[5, 1680], &[], &mut [])),
            "voxel 1680 of the obstacle 'part' cannot be changed: it is not in its grid"
        );
        assert_eq!(
            of(world.change(id, &[5, 7], &[9, 5], &mut [])),
            "voxel 5 of the obstacle 'part' cannot be changed: it cannot become both solid and empty"
        );
        assert_eq!(of(world.change(ObstacleId(8), &[5], &[], &mut [])), "the world has no obstacle 8");
        assert_eq!(*world.obstacle(id).unwrap(), before);
    }
}
