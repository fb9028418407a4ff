//! Displacements under forces: conjugate gradients, preconditioned by a multigrid V-cycle.
//!
//! Every coarser lattice takes the stiffness that interpolation makes of the finer one's (Galerkin), so that thin members
//! beside empty space are still felt there; a displacement is held on it where it is held at the same point of the finest.
//! Smoothing is damped Jacobi, the coarsest system is factorised. (Amir, Aage, Lazarov, On multigrid-CG for efficient topology
//! optimization, 2014.)

use thiserror::Error;

use crate::lattice::Lattice;
use crate::stiffness::Stiffness;

/// Sweeps of Jacobi before and after the coarser lattice's correction.
const SWEEPS: usize = 2;
/// Iterations after which a system counts as not solvable; well-posed ones take some tens.
const MOST_ITERATIONS: usize = 1000;
/// Pivots below this, as a fraction of their diagonal, are rounding: nothing holds the displacement.
const MINIMUM_PIVOT: f64 = 1e-10;

/// Why there are no displacements.
#[derive(Debug, Error)]
pub(crate) enum SolveError {
    /// A part that nothing holds, or a lattice without stiffness.
    #[error("the coarsest stiffness is not positive definite: is every piece held in all directions?")]
    NotHeld,
    #[error("conjugate gradients did not converge in {MOST_ITERATIONS} iterations")]
    Iteration,
}

/// All lattices' stiffness, finest first; the same for every load.
#[derive(Debug)]
pub(crate) struct Hierarchy {
    levels: Vec<Stiffness>,
    diagonals: Vec<Vec<f64>>,
    /// Of damped Jacobi.
    damping: f64,
}

impl Hierarchy {
    /// `largest` bounds the eigenvalues of `D⁻¹K` on the finest lattice.
    pub(crate) fn new(finest: Stiffness, largest: f64) -> Self {
        let mut levels = vec![finest];
        while let Some(coarser) = levels[levels.len() - 1].halved() {
            levels.push(coarser);
        }
        let diagonals = levels.iter().map(Stiffness::diagonal).collect();
        // Up to 2 / largest converges; the upper half of the spectrum falls fastest near 4/3.
        Self { levels, diagonals, damping: 1.33 / largest }
    }

    /// A solver for what is held: `held` marks displacements of the finest lattice that stay zero.
    pub(crate) fn solver(&self, held: &[bool]) -> Result<Solver<'_>, SolveError> {
        let mut free: Vec<Vec<f64>> = vec![held.iter().map(|&held| f64::from(u8::from(!held))).collect()];
        for pair in self.levels.windows(2) {
            let (fine, coarse) = (pair[0].lattice, pair[1].lattice);
            let above = &free[free.len() - 1];
            free.push(injected(fine, coarse, above));
        }
        let inverses = free.iter().zip(&self.diagonals).map(|(free, diagonal)| {
            free.iter().zip(diagonal).map(|(free, d)| if *d > 0.0 { free / d } else { 0.0 }).collect()
        });
        let inverses = inverses.collect();
        let last = &self.levels[self.levels.len() - 1];
        let kept = &free[free.len() - 1];
        let n = last.lattice.unknowns();
        let mut rows: Vec<Vec<f64>> = (0..n).map(|row| vec![0.0; row + 1]).collect();
        last.entries_of_all(|row, column, value| {
            if column <= row {
                rows[row][column] += value * kept[row] * kept[column];
            }
        });
        for row in (0..n).filter(|&row| kept[row] == 0.0) {
            rows[row][row] = 1.0;
        }
        let coarsest = Cholesky::new(rows).ok_or(SolveError::NotHeld)?;
        Ok(Solver { hierarchy: self, free, inverses, coarsest })
    }
}

/// Values of the nodes that both lattices have.
fn injected(fine: Lattice, coarse: Lattice, values: &[f64]) -> Vec<f64> {
    let mut injected = vec![0.0; coarse.unknowns()];
    for (node, d) in coarse.nodes().flat_map(|node| (0..3).map(move |d| (node, d))) {
        injected[coarse.unknown(node, d)] = values[fine.unknown(node.map(|i| 2 * i), d)];
    }
    injected
}

/// A symmetric positive definite matrix as L·Lᵀ: of every row of L what stands from its first number that is not zero to the
/// diagonal.
#[derive(Debug)]
struct Cholesky {
    first: Vec<usize>,
    rows: Vec<Vec<f64>>,
}

impl Cholesky {
    /// `rows` are the lower triangle's. Nothing where the matrix is not positive definite.
    fn new(mut rows: Vec<Vec<f64>>) -> Option<Self> {
        let filled = |row: &Vec<f64>| row.iter().position(|&v| v != 0.0).unwrap_or(row.len() - 1);
        let first: Vec<usize> = rows.iter().map(filled).collect();
        for (row, &first) in rows.iter_mut().zip(&first) {
            row.drain(..first);
        }
        for i in 0..rows.len() {
            let (above, rest) = rows.split_at_mut(i);
            let row = &mut rest[0];
            let diagonal = row[i - first[i]];
            for j in first[i]..i {
                let from = first[i].max(first[j]);
                let known =
                    dot(&row[from - first[i]..j - first[i]], &above[j][from - first[j]..j - first[j]]);
                row[j - first[i]] = (row[j - first[i]] - known) / above[j][j - first[j]];
            }
            let (pivot, before) = row.split_last_mut()?;
            *pivot -= dot(before, before);
            if *pivot <= MINIMUM_PIVOT * diagonal {
                return None;
            }
            *pivot = pivot.sqrt();
        }
        Some(Self { first, rows })
    }

    fn solve(&self, x: &mut [f64]) {
        let rows = self.rows.iter().zip(&self.first).enumerate();
        for (i, (row, &first)) in rows.clone() {
            let last = i - first;
            x[i] = (x[i] - dot(&row[..last], &x[first..i])) / row[last];
        }
        for (i, (row, &first)) in rows.rev() {
            let last = i - first;
            x[i] /= row[last];
            let solved = x[i];
            x[first..i].iter_mut().zip(row).for_each(|(x, l)| *x -= l * solved);
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Solves for one set of held displacements.
#[derive(Debug)]
pub(crate) struct Solver<'a> {
    hierarchy: &'a Hierarchy,
    /// 1 where a displacement is free, 0 where it is held; by level.
    free: Vec<Vec<f64>>,
    /// The diagonal's inverse, 0 where held; by level.
    inverses: Vec<Vec<f64>>,
    coarsest: Cholesky,
}

impl Solver<'_> {
    /// Displacements under `force`, beginning from those in `u`, until the residual is `tolerance` of the force. Answers
    /// with the number of iterations.
    pub(crate) fn solve(&self, force: &[f64], u: &mut [f64], tolerance: f64) -> Result<usize, SolveError> {
        let mask = |values: &mut [f64]| values.iter_mut().zip(&self.free[0]).for_each(|(v, free)| *v *= free);
        let mut force = force.to_vec();
        mask(&mut force);
        mask(u);
        let target = tolerance * dot(&force, &force).sqrt();
        let mut image = vec![0.0; force.len()];
        self.apply(0, u, &mut image);
        let mut residual: Vec<f64> = force.iter().zip(&image).map(|(f, image)| f - image).collect();
        let mut preconditioned = vec![0.0; force.len()];
        let mut direction = vec![0.0; force.len()];
        let mut before = f64::INFINITY;
        for iteration in 0..MOST_ITERATIONS {
            if dot(&residual, &residual).sqrt() <= target {
                return Ok(iteration);
            }
            self.cycle(0, &residual, &mut preconditioned);
            let square = dot(&residual, &preconditioned);
            let ratio = square / before;
            direction.iter_mut().zip(&preconditioned).for_each(|(d, z)| *d = z + ratio * *d);
            before = square;
            self.apply(0, &direction, &mut image);
            let step = square / dot(&direction, &image);
            u.iter_mut().zip(&direction).for_each(|(u, d)| *u += step * d);
            residual.iter_mut().zip(&image).for_each(|(r, image)| *r -= step * image);
        }
        Err(SolveError::Iteration)
    }

    /// `out = M K u` with M the free displacements; `u` is zero where it is held.
    fn apply(&self, level: usize, u: &[f64], out: &mut [f64]) {
        self.hierarchy.levels[level].apply(u, out);
        out.iter_mut().zip(&self.free[level]).for_each(|(v, free)| *v *= free);
    }

    /// Approximately `K⁻¹ r`, symmetric in `r`.
    fn cycle(&self, level: usize, r: &[f64], x: &mut [f64]) {
        let levels = &self.hierarchy.levels;
        if level + 1 == levels.len() {
            x.iter_mut().zip(r).zip(&self.free[level]).for_each(|((x, r), free)| *x = r * free);
            self.coarsest.solve(x);
            return;
        }
        let damping = self.hierarchy.damping;
        let inverse = &self.inverses[level];
        let mut image = vec![0.0; r.len()];
        for i in 0..r.len() {
            x[i] = damping * inverse[i] * r[i];
        }
        let sweep = |x: &mut [f64], image: &mut [f64]| {
            self.apply(level, x, image);
            for i in 0..r.len() {
                x[i] += damping * inverse[i] * (r[i] - image[i]);
            }
        };
        for _ in 1..SWEEPS {
            sweep(x, &mut image);
        }
        self.apply(level, x, &mut image);
        for i in 0..r.len() {
            image[i] = self.free[level][i] * (r[i] - image[i]);
        }
        let (lattice, free) = (levels[level].lattice, &self.free[level + 1]);
        let mut below = vec![0.0; free.len()];
        lattice.restricted(&image, &mut below);
        below.iter_mut().zip(free).for_each(|(v, free)| *v *= free);
        let mut correction = vec![0.0; free.len()];
        self.cycle(level + 1, &below, &mut correction);
        image.fill(0.0);
        lattice.add_interpolated(&correction, &mut image);
        for i in 0..r.len() {
            x[i] += self.free[level][i] * image[i];
        }
        for _ in 0..SWEEPS {
            sweep(x, &mut image);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::element::{largest_eigenvalue, stiffness};
    use nalgebra::{DMatrix, DVector};

    /// A cantilever held at x = 0, with a soft core.
    fn cantilever() -> (Hierarchy, Vec<bool>, Vec<f64>) {
        let lattice = Lattice { n: [8, 4, 4] };
        let matrix = stiffness([1.0; 3]);
        let soft = |e: usize| if e % 16 == 5 || e % 16 == 10 { 1e-4 } else { 1.0 };
        let largest = largest_eigenvalue(&matrix);
        let factors = (0..lattice.elements()).map(soft).collect();
        let hierarchy = Hierarchy::new(Stiffness::scaled(lattice, matrix, factors), largest);
        let mut held = vec![false; lattice.unknowns()];
        let mut force = vec![0.0; held.len()];
        for node in lattice.nodes() {
            (0..3).for_each(|d| held[lattice.unknown(node, d)] = node[0] == 0);
            force[lattice.unknown(node, 2)] = if node[0] == 8 { -0.01 } else { 0.0 };
        }
        (hierarchy, held, force)
    }

    #[test]
    fn displacements_are_those_of_the_factorised_system() {
        let (hierarchy, held, force) = cantilever();
        assert_eq!(hierarchy.levels.len(), 3);
        let mut u = vec![0.0; force.len()];
        let solver = hierarchy.solver(&held).unwrap();
        let iterations = solver.solve(&force, &mut u, 1e-11).unwrap();
        assert!(iterations < 40, "{iterations}");
        let n = force.len();
        let mut matrix = DMatrix::<f64>::zeros(n, n);
        hierarchy.levels[0].entries_of_all(|row, column, value| {
            if !held[row] && !held[column] {
                matrix[(row, column)] += value;
            }
        });
        (0..n).filter(|&row| held[row]).for_each(|row| matrix[(row, row)] = 1.0);
        let right = DVector::from_fn(n, |i, _| if held[i] { 0.0 } else { force[i] });
        let expected = matrix.cholesky().unwrap().solve(&right);
        let scale = expected.amax();
        for i in 0..n {
            // The residual's tolerance times a slender beam's condition.
            assert!((u[i] - expected[i]).abs() < 1e-7 * scale, "{i}: {} against {}", u[i], expected[i]);
        }
        // From the answer itself there is nothing to do.
        assert_eq!(solver.solve(&force, &mut u, 1e-9).unwrap(), 0);
    }

    #[test]
    fn the_cycle_is_symmetric_and_what_nothing_holds_is_refused() {
        let (hierarchy, held, force) = cantilever();
        let solver = hierarchy.solver(&held).unwrap();
        let free = |seed: usize| -> Vec<f64> {
            let value = |i: usize| ((i * seed + 3) % 97) as f64 / 48.0 - 1.0;
            (0..force.len()).map(|i| if held[i] { 0.0 } else { value(i) }).collect()
        };
        let (a, b) = (free(31), free(57));
        let (mut x, mut y) = (vec![0.0; a.len()], vec![0.0; a.len()]);
        solver.cycle(0, &a, &mut x);
        solver.cycle(0, &b, &mut y);
        let (one, other) = (dot(&b, &x), dot(&a, &y));
        assert!((one - other).abs() < 1e-9 * dot(&a, &x).abs(), "{one} against {other}");
        assert!(dot(&a, &x) > 0.0);
        assert!(matches!(hierarchy.solver(&vec![false; held.len()]), Err(SolveError::NotHeld)));
    }
}
