//! Newell's teapot as he drew it: 32 bicubic Bézier patches, which six silhouettes and four tubes generate.
//!
//! The data are Martin Newell's (*The Utilization of Procedure Models in Digital Image Synthesis*, PhD thesis,
//! University of Utah, 1975) with the height that Blinn gave it and the bottom that F. C. Crow published with it
//! (*The Origins of the Teapot*, IEEE CG&A 7(1), 1987). The frame is theirs: z up from the table, x from the
//! handle to the spout, y across, and a height of 3.15.
//!
//! The body is symmetric about x = 0 and y = 0, handle and spout about y = 0. Only the generating patches are listed;
//! the others are their mirror images with exactly the same numbers.

use glam::DVec3;

/// Height of the teapot in Newell's unit.
pub(super) const HEIGHT: f64 = 3.15;

/// One row of a quarter of a round patch: the control points (r, 0), (r, k), (k, r) and (0, r) at height z, as
/// `[r, k, z]`.
pub(super) type Ring = [f64; 3];

/// One row of half a tube: two points `(x, z)` on the plane y = 0 and the control polygon's half width between
/// them, as `[x₀, z₀, x₁, z₁, y]`. The points are (x₀, 0, z₀), (x₀, −y, z₀), (x₁, −y, z₁) and (x₁, 0, z₁).
pub(super) type Rung = [f64; 5];

/// The round patches, from the inside outwards and from the top downwards: a rim, two of the body, two of the
/// lid, the bottom.
pub(super) const ROUND: [[Ring; 4]; 6] = [
    // Rim.
    [[1.4, 0.784, 2.4], [1.3375, 0.749, 2.53125], [1.4375, 0.805, 2.53125], [1.5, 0.84, 2.4]],
    // Body.
    [[1.5, 0.84, 2.4], [1.75, 0.98, 1.875], [2.0, 1.12, 1.35], [2.0, 1.12, 0.9]],
    [[2.0, 1.12, 0.9], [2.0, 1.12, 0.45], [1.5, 0.84, 0.225], [1.5, 0.84, 0.15]],
    // Lid: the knob, then the shade. Newell's 0.45 in the knob is not a slip of ours.
    [[0.0, 0.0, 3.15], [0.8, 0.45, 3.15], [0.0, 0.0, 2.85], [0.2, 0.112, 2.7]],
    [[0.2, 0.112, 2.7], [0.4, 0.224, 2.55], [1.3, 0.728, 2.55], [1.3, 0.728, 2.4]],
    // Bottom.
    [[1.5, 0.84, 0.15], [1.5, 0.84, 0.075], [1.425, 0.798, 0.0], [0.0, 0.0, 0.0]],
];

/// The tubes: two patches of the handle from the rim downwards, two of the spout from the body outwards.
pub(super) const TUBES: [[Rung; 4]; 4] = [
    // Handle.
    [
        [-1.6, 2.025, -1.5, 2.25, 0.3],
        [-2.3, 2.025, -2.5, 2.25, 0.3],
        [-2.7, 2.025, -3.0, 2.25, 0.3],
        [-2.7, 1.8, -3.0, 1.8, 0.3],
    ],
    [
        [-2.7, 1.8, -3.0, 1.8, 0.3],
        [-2.7, 1.575, -3.0, 1.35, 0.3],
        [-2.5, 1.125, -2.65, 0.9375, 0.3],
        [-2.0, 0.9, -1.9, 0.6, 0.3],
    ],
    // Spout.
    [
        [1.7, 1.425, 1.7, 0.6, 0.66],
        [2.6, 1.425, 3.1, 0.825, 0.66],
        [2.3, 2.1, 2.4, 2.025, 0.25],
        [2.7, 2.4, 3.3, 2.4, 0.25],
    ],
    [
        [2.7, 2.4, 3.3, 2.4, 0.25],
        [2.8, 2.475, 3.525, 2.49375, 0.25],
        [2.9, 2.475, 3.45, 2.5125, 0.15],
        [2.8, 2.4, 3.2, 2.4, 0.15],
    ],
];

/// A bicubic Bézier patch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Patch {
    /// Control points: the row runs along the silhouette or the tube, the column around it.
    pub(super) points: [[DVec3; 4]; 4],
    /// True if ∂/∂column × ∂/∂row points outwards, false if it points inwards.
    pub(super) outward: bool,
}

/// The 32 patches: rim, body, lid and bottom (24), then handle and spout (8).
pub(super) fn patches() -> Vec<Patch> {
    let mut patches = Vec::with_capacity(32);
    for rings in ROUND {
        let quarter =
            rings.map(|[r, k, z]| [(r, 0.0), (r, k), (k, r), (0.0, r)].map(|(x, y)| DVec3::new(x, y, z)));
        for mirror in [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]] {
            patches.push(mirrored(quarter, mirror, false));
        }
    }
    for rungs in TUBES {
        let half = rungs.map(|[x0, z0, x1, z1, y]| {
            [(x0, 0.0, z0), (x0, -y, z0), (x1, -y, z1), (x1, 0.0, z1)].map(|(x, y, z)| DVec3::new(x, y, z))
        });
        for mirror in [[1.0, 1.0], [1.0, -1.0]] {
            patches.push(mirrored(half, mirror, true));
        }
    }
    patches
}

/// A generating patch, `outward` or not, with the signs of x and y multiplied by those of `mirror`; one mirror
/// turns it inside out, two do not.
fn mirrored(points: [[DVec3; 4]; 4], mirror: [f64; 2], outward: bool) -> Patch {
    let signs = DVec3::new(mirror[0], mirror[1], 1.0);
    Patch { points: points.map(|row| row.map(|p| p * signs)), outward: outward == (mirror[0] == mirror[1]) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_patches_have_newells_number_and_height() {
        let patches = patches();
        assert_eq!(patches.len(), 32);
        let heights = patches.iter().flat_map(|p| p.points).flatten().map(|p| p.z);
        assert_eq!(heights.clone().fold(f64::INFINITY, f64::min), 0.0);
        assert_eq!(heights.fold(0.0, f64::max), HEIGHT);
    }

    #[test]
    fn patches_of_one_surface_join() {
        for surface in [&ROUND[..3], &ROUND[3..5]] {
            assert!(surface.windows(2).all(|pair| pair[0][3] == pair[1][0]));
        }
        assert_eq!(ROUND[2][3], ROUND[5][0]);
        assert!([0, 2].iter().all(|&i| TUBES[i][3] == TUBES[i + 1][0]));
    }
}
