//! What a checker's answers are worth: warnings about its tool, and what "free" says about the meshes that the voxels were made of.

use super::Checker;
use crate::scene::{CoarseTool, Guarantee, SceneWarning};

impl Checker {
    /// Warnings about the tool among these obstacles: its tip is not at the origin of its frame, or it passes between
    /// the centres of their largest voxels for a while.
    #[must_use]
    pub fn warnings(&self) -> Vec<SceneWarning> {
        let (tool, unit) = (self.tool.assembly.tool(), self.tool.unit);
        self.pitches().reduce(f64::max).map_or_else(Vec::new, |pitch| {
            let coarse = CoarseTool::of(tool, pitch, unit).map(SceneWarning::Coarse);
            SceneWarning::of_frame(tool, pitch).into_iter().chain(coarse).collect()
        })
    }

    /// What "free" guarantees for the meshes of all obstacles; `None` without one. Obstacles of voxels, and those that were changed
    /// voxel by voxel, have no mesh: for them it is exact for voxel centres. Of a motion it holds as far as that is proven.
    #[must_use]
    pub fn guarantee(&self) -> Option<Guarantee> {
        let assembly = &self.tool.assembly;
        let of_each = self.placed.iter().map(|placed| {
            let contact = placed.around.field.obstacle().cuttable.is_some();
            let (tool, clearance) = (assembly.tool(), assembly.clearance());
            (Guarantee::new(placed.conservative, tool, clearance, contact, placed.pitch()), placed.pitch())
        });
        // Of equal ones that of the largest voxels, which takes the largest clearance.
        let least = of_each
            .min_by(|(a, fine), (b, coarse)| a.strength().cmp(&b.strength()).then(coarse.total_cmp(fine)));
        least.map(|(guarantee, _)| guarantee)
    }
}

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

    use crate::mesh::Mesh;
    use crate::pose::Pose;
    use crate::scene::Guarantee;
    use crate::tool::{Clearance, Tool};
    use crate::world::{ObstacleMesh, World};

    #[test]
    fn it_is_that_of_the_obstacle_for_which_least_holds() {
        let tool = Tool::paper();
        let all = |room: f64| Clearance { holder: room, shank: room, cutter: room };
        let block = |pitch: f64| ObstacleMesh {
            pitch: Some(pitch),
            ..ObstacleMesh::new("block", Mesh::cuboid(DVec3::splat(0.3), DVec3::splat(20.6)))
        };
        let mut world = World::builder().pitch(1.0).conservative(true).build().unwrap();
        let of = |world: &World, room: f64| world.checker(&tool, &all(room)).unwrap().guarantee();
        assert_eq!(of(&world, 0.0), None);
        let fine = world.add(block(1.0)).unwrap();
        assert!(
            matches!(of(&world, 0.0), Some(Guarantee::Voxels { needed }) if (needed - 0.866).abs() < 1e-3)
        );
        // A block that is said to be free of the tool is free of it: 0.45 above its face, of which the voxels reach 0.4 higher.
        let checker = world.checker(&tool, &Clearance::default()).unwrap();
        let within = Pose::new(DVec3::new(10.0, 10.0, 20.55), DQuat::IDENTITY);
        assert!(checker.is_free(&within), "in the block, and free of its centres");
        let checker = world.checker(&tool, &all(0.867)).unwrap();
        assert!(checker.guarantee() == Some(Guarantee::Mesh) && !checker.is_free(&within));

        let coarse = world.add(block(2.0)).unwrap();
        assert!(
            matches!(of(&world, 0.867), Some(Guarantee::Voxels { needed }) if (needed - 1.732).abs() < 1e-3)
        );
        world.remove(coarse).unwrap();
        let touched = world.add(ObstacleMesh { contact: 1.0, ..block(1.0) }).unwrap();
        assert_eq!(of(&world, 0.867), Some(Guarantee::HolderAndShank));
        world.remove(touched).unwrap();
        let voxels = world.obstacle(fine).unwrap().forbidden.clone();
        let own = world.add_voxels("voxels", voxels, Pose::new(DVec3::ZERO, DQuat::IDENTITY)).unwrap();
        assert_eq!(of(&world, 0.867), Some(Guarantee::Centres));
        world.remove(own).unwrap();
        assert_eq!(of(&world, 0.867), Some(Guarantee::Mesh));
        for (solid, empty, expected) in
            [(vec![0], vec![], Guarantee::Mesh), (vec![], vec![0], Guarantee::Centres)]
        {
            world.change(fine, &solid, &empty, &mut []).unwrap();
            assert_eq!(of(&world, 0.867), Some(expected));
        }
    }
}
