//! Surface that no solid voxel stands for: of walls, ribs and edges thinner than a voxel.

use glam::DVec3;

use crate::grid::Grid;
use crate::mesh::Mesh;
use crate::occupancy::Occupancy;
use crate::parallel;

/// Surface of a mesh with no solid centre near it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct LostSurface {
    /// Its area.
    pub(crate) area: f64,
    /// Fraction of the whole surface.
    pub(crate) fraction: f64,
    /// A point of it.
    pub(crate) at: DVec3,
}

/// Squared distance in voxels within which every point of a thick body's surface has a solid centre: a ball of radius √3/2 holds a
/// centre wherever it lies, also where it touches the surface from within.
const NEAR: f64 = 3.0;
/// Maximum edge of the sampled pieces, in voxels.
const PIECE: f64 = 1.5;
/// Less than this, in faces of a voxel, is the tip of an edge and not a rib.
const FEW: f64 = 9.0;

impl LostSurface {
    /// Of a body in its place, by its voxels, which need not fill the grid; `None` where it is too little to matter.
    /// What lies outside the grid is ignored.
    pub(crate) fn of(mesh: &Mesh, solid: &Occupancy, grid: &Grid) -> Option<Self> {
        let pitch = grid.pitch;
        let found = parallel::map(mesh.triangles.len(), |triangle| {
            let mut found = TriangleLoss::default();
            found.look(mesh.corners(triangle), (PIECE * pitch).powi(2), solid, grid);
            found
        });
        let area: f64 = found.iter().map(|found| found.lost).sum();
        let all: f64 = found.iter().map(|found| found.area).sum();
        let most = found.iter().max_by(|a, b| a.lost.total_cmp(&b.lost))?;
        (area >= FEW * pitch * pitch).then(|| Self { area, fraction: area / all, at: most.at })
    }
}

/// What was found of one triangle.
#[derive(Default)]
struct TriangleLoss {
    area: f64,
    lost: f64,
    at: DVec3,
}

impl TriangleLoss {
    /// Halves the longest edge until no squared edge exceeds `longest`, and looks up the middles of the pieces.
    fn look(&mut self, [a, b, c]: [DVec3; 3], longest: f64, solid: &Occupancy, grid: &Grid) {
        let edges = [a.distance_squared(b), b.distance_squared(c), c.distance_squared(a)];
        let [p, q, r] = match edges {
            [ab, bc, ca] if ab >= bc && ab >= ca => [a, b, c],
            [_, bc, ca] if bc >= ca => [b, c, a],
            _ => [c, a, b],
        };
        let middle = (p + q) * 0.5;
        // Far from the origin the middle may be an end.
        if p.distance_squared(q) > longest && middle != p && middle != q {
            self.look([p, middle, r], longest, solid, grid);
            self.look([middle, q, r], longest, solid, grid);
            return;
        }
        let (area, middle) = (0.5 * (q - p).cross(r - p).length(), (p + q + r) / 3.0);
        self.area += area;
        if is_in(middle, grid) && !has_solid_near(middle, solid) {
            self.lost += area;
            self.at = middle;
        }
    }
}

/// Whether a point lies in one of a grid's voxels, or on their faces.
fn is_in(point: DVec3, grid: &Grid) -> bool {
    let at = grid.continuous(point);
    (0..3).all(|axis| (-0.500_001..grid.dims[axis] as f64 - 0.499_999).contains(&at[axis]))
}

/// Whether a solid centre lies within [`NEAR`] of a point.
fn has_solid_near(point: DVec3, solid: &Occupancy) -> bool {
    let at = solid.grid.continuous(point);
    let low = at.floor();
    // Those around the point nearly always hold one; the others are checked where they do not.
    (0..8).any(|corner| is_solid(low + offset(corner, 2), solid))
        || (0..64).any(|index| {
            let centre = low + offset(index, 4) - DVec3::ONE;
            centre.distance_squared(at) <= NEAR && is_solid(centre, solid)
        })
}

/// The voxel of a number among `edge³`.
fn offset(index: u32, edge: u32) -> DVec3 {
    DVec3::from([index / edge / edge, index / edge % edge, index % edge].map(f64::from))
}

/// Whether a voxel lies in the grid and is solid.
fn is_solid(voxel: DVec3, solid: &Occupancy) -> bool {
    solid.grid.index_at(voxel).is_some_and(|index| solid.solid[index] != 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::voxelize::voxelize;

    /// A block of 20 × 20 × 10, and on it a rib of a thickness, 12 long and 8 high, its middle at `x`.
    fn ribbed(x: f64, thickness: f64) -> Mesh {
        let mut mesh = Mesh::cuboid(DVec3::ZERO, DVec3::new(20.0, 20.0, 10.0));
        let half = 0.5 * thickness;
        mesh.append(&Mesh::cuboid(DVec3::new(x - half, 4.0, 10.0), DVec3::new(x + half, 16.0, 18.0)));
        mesh
    }

    fn lost(mesh: &Mesh, conservative: bool) -> Option<LostSurface> {
        let grid = Grid { origin: DVec3::splat(-2.0), pitch: 1.0, dims: [24, 24, 22] };
        LostSurface::of(mesh, &voxelize(mesh, &grid, conservative).cropped(), &grid)
    }

    #[test]
    fn a_rib_between_the_centres_is_lost_and_a_thick_one_is_not() {
        // Centres lie at halves. The rib's top, its ends and both sides, but for what the block's centres below it are near.
        let rib = lost(&ribbed(10.0, 0.5), false).unwrap();
        let area = 2.0 * (12.0 + 0.5) * 8.0 + 12.0 * 0.5;
        assert!(rib.area < area && rib.area > 0.75 * area, "{rib:?} of {area}");
        assert!((rib.at.x - 10.0).abs() <= 0.25 && rib.at.z > 10.0, "{rib:?}");
        // One that holds a centre, one of a voxel, and voxels that the rib touches.
        assert_eq!(lost(&ribbed(10.5, 0.5), false), None);
        assert_eq!(lost(&ribbed(10.0, 1.01), false), None);
        assert_eq!(lost(&ribbed(10.0, 0.5), true), None);
    }

    #[test]
    fn thick_bodies_lose_nothing_however_they_stand() {
        let block = Mesh::cuboid(DVec3::ZERO, DVec3::new(9.0, 7.0, 5.0));
        for turn in 0..40 {
            let angle = 0.1 * f64::from(turn);
            let rotation = glam::DQuat::from_euler(glam::EulerRot::XYZ, angle, 1.7 * angle, 0.3 * angle);
            let placed =
                block.transformed(&glam::DMat4::from_rotation_translation(rotation, DVec3::splat(10.0)));
            let (lower, upper) = placed.bounds().unwrap();
            let grid = Grid::with_pitch(lower, upper, 1.0, 1).unwrap();
            assert_eq!(LostSurface::of(&placed, &voxelize(&placed, &grid, false), &grid), None, "{turn}");
        }
    }
}
