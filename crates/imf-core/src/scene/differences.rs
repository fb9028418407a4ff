//! Whether two scenes are the same to a field.

use super::Scene;

impl Scene {
    /// In what two scenes differ that a field depends on, each as a clause; nothing where a field of the one is a field of the other.
    /// The part's name and what its voxels were made of do not count.
    #[must_use]
    pub fn differences(&self, other: &Self) -> Vec<&'static str> {
        let (own, there) = (&self.record, &other.record);
        let same_grid = own.grid == there.grid;
        let same_voxels = same_grid && self.obstacle == other.obstacle;
        let fixed = !(own.fixtures.is_empty() && there.fixtures.is_empty());
        let voxels = if fixed { "the voxels of part or fixtures differ" } else { "the part's voxels differ" };
        let all = [
            (own.unit != there.unit, "the unit differs"),
            (!same_grid, "the grid differs"),
            // Voxels of different grids cannot be compared.
            (same_grid && !same_voxels, voxels),
            (own.bare_tool() != there.bare_tool(), "the tool differs"),
            (own.clearance != there.clearance, "the clearance differs"),
            // What belongs to a fixture may not be touched at any depth.
            (
                own.contact != there.contact || (same_voxels && self.layer != other.layer),
                "the contact differs",
            ),
        ];
        all.into_iter().filter_map(|(differs, what)| differs.then_some(what)).collect()
    }
}
