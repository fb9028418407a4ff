//! The element: a brick with eight nodes, of isotropic material with Young's modulus 1.
//!
//! Its node `(a, b, c)`, each 0 or 1 along x, y, z, is number `4a + 2b + c`, and the displacement `d` of a node is row
//! `3·node + d`.

/// Rows of an element: three displacements at each of eight nodes.
pub(crate) const ROWS: usize = 24;

/// A matrix of an element, row by row.
pub(crate) type Matrix = [[f64; ROWS]; ROWS];

/// Poisson's ratio of common metals.
pub(crate) const POISSON: f64 = 0.3;

/// Number of a node by its place.
pub(crate) const fn node([a, b, c]: [usize; 3]) -> usize {
    4 * a + 2 * b + c
}

/// The eight places of nodes, by number.
pub(crate) fn corners() -> impl Iterator<Item = [usize; 3]> {
    (0..8).map(|n| [n >> 2, n >> 1 & 1, n & 1])
}

/// The stiffness of a brick with these sides: `∫ Bᵀ C B` by two Gauss points an axis, which is exact for a brick.
pub(crate) fn stiffness(sides: [f64; 3]) -> Matrix {
    let lambda = POISSON / ((1.0 + POISSON) * (1.0 - 2.0 * POISSON));
    let mu = 0.5 / (1.0 + POISSON);
    let at = 0.5 / 3f64.sqrt();
    let weight = sides.iter().product::<f64>() / 8.0;
    let mut matrix = [[0.0; ROWS]; ROWS];
    for [a, b, c] in corners() {
        let gauss = [a, b, c].map(|side| if side == 0 { 0.5 - at } else { 0.5 + at });
        let mut slope = [[0.0; 3]; 8];
        for place in corners() {
            let shape = |axis: usize| if place[axis] == 0 { 1.0 - gauss[axis] } else { gauss[axis] };
            for axis in 0..3 {
                let sign = if place[axis] == 0 { -1.0 } else { 1.0 };
                slope[node(place)][axis] = sign / sides[axis] * shape((axis + 1) % 3) * shape((axis + 2) % 3);
            }
        }
        // σ : ε of two nodal displacements e_i at p and e_j at q.
        for (p, q) in (0..8).flat_map(|p| (0..8).map(move |q| (p, q))) {
            let [g, h] = [slope[p], slope[q]];
            let dot = (0..3).map(|axis| g[axis] * h[axis]).sum::<f64>();
            for (i, j) in (0..3).flat_map(|i| (0..3).map(move |j| (i, j))) {
                let same = if i == j { dot } else { 0.0 };
                matrix[3 * p + i][3 * q + j] += weight * (lambda * g[i] * h[j] + mu * (g[j] * h[i] + same));
            }
        }
    }
    matrix
}

/// What the largest eigenvalue of `D⁻¹K` cannot exceed, D the diagonal: of a sum of elements, each times any factor, it
/// cannot either, since both Rayleigh quotients are sums with the same factors.
pub(crate) fn largest_eigenvalue(matrix: &Matrix) -> f64 {
    let mut vector: [f64; ROWS] = std::array::from_fn(|row| 1.0 + (row * row % 7) as f64);
    let mut value = 0.0;
    for _ in 0..200 {
        let image: [f64; ROWS] = std::array::from_fn(|row| {
            (0..ROWS).map(|column| matrix[row][column] * vector[column]).sum::<f64>() / matrix[row][row]
        });
        value = image.iter().fold(0.0, |most: f64, v| most.max(v.abs()));
        vector = image.map(|v| v / value);
    }
    value
}

#[cfg(test)]
mod tests {
    use nalgebra::SMatrix;

    use super::*;

    #[test]
    fn a_brick_is_stiff_but_for_the_six_motions_of_a_rigid_body() {
        let sides = [1.0, 1.3, 0.7];
        let matrix = stiffness(sides);
        for (row, column) in (0..ROWS).flat_map(|r| (0..ROWS).map(move |c| (r, c))) {
            assert!((matrix[row][column] - matrix[column][row]).abs() < 1e-15);
        }
        let values =
            SMatrix::<f64, ROWS, ROWS>::from_fn(|row, column| matrix[row][column]).symmetric_eigenvalues();
        // Rounding leaves 1e-16 of the largest; the softest real mode has a hundredth of it.
        let zero = values.iter().filter(|v| v.abs() < 1e-12).count();
        assert_eq!(zero, 6, "{values:?}");
        assert!(values.iter().all(|&v| v > -1e-12));
        // Those six: three translations, three rotations.
        for mode in 0..6 {
            let mut motion = [0.0; ROWS];
            for place in corners() {
                let at: [f64; 3] = std::array::from_fn(|axis| place[axis] as f64 * sides[axis]);
                let moved = match mode {
                    axis @ 0..3 => std::array::from_fn(|d| f64::from(u8::from(d == axis))),
                    3 => [0.0, -at[2], at[1]],
                    4 => [at[2], 0.0, -at[0]],
                    _ => [-at[1], at[0], 0.0],
                };
                motion[3 * node(place)..][..3].copy_from_slice(&moved);
            }
            for row in matrix {
                assert!(row.iter().zip(motion).map(|(k, u)| k * u).sum::<f64>().abs() < 1e-12, "mode {mode}");
            }
        }
    }

    #[test]
    fn a_pulled_brick_answers_with_hookes_law() {
        // Uniform strain along x with free sides: the energy is ½·E·ε²·V, so uᵀKu = E ε² V.
        let sides = [2.0, 0.5, 1.5];
        let (matrix, strain) = (stiffness(sides), 0.01);
        let mut u = [0.0; ROWS];
        for place in corners() {
            for axis in 0..3 {
                let ratio = if axis == 0 { 1.0 } else { -POISSON };
                u[3 * node(place) + axis] = strain * ratio * place[axis] as f64 * sides[axis];
            }
        }
        let energy: f64 = (0..ROWS).map(|r| u[r] * (0..ROWS).map(|c| matrix[r][c] * u[c]).sum::<f64>()).sum();
        let expected = strain * strain * sides.iter().product::<f64>();
        assert!((energy - expected).abs() < 1e-12 * expected, "{energy:e} against {expected:e}");
    }

    #[test]
    fn no_vector_is_stretched_more_than_the_largest_eigenvalue_says() {
        let matrix = stiffness([1.0, 1.0, 1.0]);
        let scaled = |r: usize, c: usize| matrix[r][c] / (matrix[r][r] * matrix[c][c]).sqrt();
        let most = SMatrix::<f64, ROWS, ROWS>::from_fn(scaled).symmetric_eigenvalues().max();
        assert!((largest_eigenvalue(&matrix) - most).abs() < 1e-6 * most);
    }
}
