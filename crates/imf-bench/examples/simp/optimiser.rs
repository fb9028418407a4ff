//! The optimisation: as stiff as a share of the material can be (SIMP).
//!
//! Young's modulus of an element is `soft + (1 − soft)·ρ^p` of its filtered density ρ. Compliance is the sum over the loads of
//! weight times force times displacement; densities follow the optimality criteria (Bendsøe and Sigmund, Topology
//! Optimization, 2003), and a cone filter sets the least thickness of members.

use rayon::prelude::*;

use crate::element::{Matrix, largest_eigenvalue, stiffness};
use crate::lattice::Lattice;
use crate::solver::{Hierarchy, SolveError};
use crate::stiffness::Stiffness;

/// Young's modulus of empty space, as a share of the material's.
const SOFT: f64 = 1e-6;
/// The furthest that a density moves in a step.
const MOVE: f64 = 0.2;

/// What an element may become.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Material {
    /// Whatever the optimisation makes of it.
    Free,
    Solid,
    Void,
}

/// A load on the part, and what holds it then.
pub(crate) struct Load {
    pub(crate) weight: f64,
    /// By unknown of the lattice.
    pub(crate) held: Vec<bool>,
    /// By unknown of the lattice.
    pub(crate) force: Vec<f64>,
}

/// The problem.
pub(crate) struct Problem {
    pub(crate) lattice: Lattice,
    /// Sides of an element.
    pub(crate) sides: [f64; 3],
    /// Axes at whose far end the part goes on as its mirror image.
    pub(crate) mirrored: [bool; 3],
    /// By element.
    pub(crate) material: Vec<Material>,
    pub(crate) loads: Vec<Load>,
    /// Share of the elements that are not void.
    pub(crate) volume: f64,
    /// Radius of the filter, in the unit of the sides.
    pub(crate) radius: f64,
    /// Residual of the displacements, relative to the force.
    pub(crate) tolerance: f64,
}

/// After a step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Progress {
    pub(crate) step: usize,
    pub(crate) penalty: f64,
    /// Of the densities before the step.
    pub(crate) compliance: f64,
    /// Share of the elements that are not void, after the step.
    pub(crate) volume: f64,
    /// Iterations of conjugate gradients, all loads together.
    pub(crate) iterations: usize,
}

/// What came out.
pub(crate) struct Design {
    /// By element, before the filter: where a finer lattice may begin.
    pub(crate) design: Vec<f64>,
    /// Filtered density by element.
    pub(crate) density: Vec<f64>,
    /// Of the design, at the last penalty.
    pub(crate) compliance: f64,
    /// Where all is solid that may be.
    pub(crate) solid_compliance: f64,
}

/// Neighbours of elements and their weights.
struct Filter<'a> {
    problem: &'a Problem,
    /// Distance along each axis in elements, and weight.
    reach: Vec<([isize; 3], f64)>,
    /// Sum of the weights by element.
    whole: Vec<f64>,
}

impl<'a> Filter<'a> {
    fn new(problem: &'a Problem) -> Self {
        let most = problem.sides.map(|side| (problem.radius / side) as isize);
        let mut reach = Vec::new();
        for a in -most[0]..=most[0] {
            for (b, c) in (-most[1]..=most[1]).flat_map(|b| (-most[2]..=most[2]).map(move |c| (b, c))) {
                let square: f64 =
                    [a, b, c].iter().zip(problem.sides).map(|(d, side)| (*d as f64 * side).powi(2)).sum();
                let weight = problem.radius - square.sqrt();
                if weight > 0.0 {
                    reach.push(([a, b, c], weight));
                }
            }
        }
        let mut filter = Self { problem, reach, whole: vec![1.0; problem.material.len()] };
        filter.whole = filter.gathered(&vec![1.0; problem.material.len()]);
        filter
    }

    /// The element at a distance from another one; nothing outside and in the void.
    fn neighbour(&self, from: [usize; 3], distance: [isize; 3]) -> Option<usize> {
        let lattice = self.problem.lattice;
        let mut at = [0; 3];
        for axis in 0..3 {
            let n = lattice.n[axis];
            let i = from[axis].checked_add_signed(distance[axis])?;
            at[axis] = match i {
                i if i < n => i,
                i if self.problem.mirrored[axis] => 2 * n - 1 - i,
                _ => return None,
            };
        }
        let element = lattice.element(at);
        (self.problem.material[element] != Material::Void).then_some(element)
    }

    /// Sums over the neighbours of each element that is not void.
    fn gathered(&self, values: &[f64]) -> Vec<f64> {
        let [_, ny, nz] = self.problem.lattice.n;
        let sum = |element: usize| {
            let from = [element / (ny * nz), element / nz % ny, element % nz];
            let neighbours =
                self.reach.iter().filter_map(|&(d, w)| Some(w * values[self.neighbour(from, d)?]));
            if self.problem.material[element] == Material::Void { 0.0 } else { neighbours.sum() }
        };
        (0..values.len()).into_par_iter().map(sum).collect()
    }

    /// Filtered densities: those that are given stay.
    fn density(&self, design: &[f64]) -> Vec<f64> {
        let mut density = self.gathered(design);
        for (element, density) in density.iter_mut().enumerate() {
            *density = match self.problem.material[element] {
                Material::Free => *density / self.whole[element],
                Material::Solid => 1.0,
                Material::Void => 0.0,
            };
        }
        density
    }

    /// Derivatives by the design, of those by filtered densities. Mirror images keep distances, so weights are symmetric.
    fn derivative(&self, by_density: &[f64]) -> Vec<f64> {
        let free = |e: usize| self.problem.material[e] == Material::Free;
        let share = |e: usize| if free(e) { by_density[e] / self.whole[e] } else { 0.0 };
        self.gathered(&(0..by_density.len()).map(share).collect::<Vec<_>>())
    }
}

/// The sum of the loads' compliances and its derivative by each element's modulus; `u` holds each load's displacements,
/// from which the next ones begin.
fn compliance(
    problem: &Problem,
    matrix: &Matrix,
    modulus: Vec<f64>,
    u: &mut [Vec<f64>],
) -> Result<(f64, Vec<f64>, usize), SolveError> {
    let largest = largest_eigenvalue(matrix);
    let hierarchy = Hierarchy::new(Stiffness::scaled(problem.lattice, *matrix, modulus), largest);
    let (mut whole, mut by_modulus, mut iterations) = (0.0, vec![0.0; problem.material.len()], 0);
    for (load, u) in problem.loads.iter().zip(u) {
        iterations += hierarchy.solver(&load.held)?.solve(&load.force, u, problem.tolerance)?;
        whole += load.weight * load.force.iter().zip(&*u).map(|(f, u)| f * u).sum::<f64>();
        let energies = Stiffness::unit_energies(problem.lattice, matrix, u);
        by_modulus.iter_mut().zip(energies).for_each(|(sum, energy)| *sum -= load.weight * energy);
    }
    Ok((whole, by_modulus, iterations))
}

fn modulus(density: &[f64], penalty: f64) -> Vec<f64> {
    density.iter().map(|rho| SOFT + (1.0 - SOFT) * rho.powf(penalty)).collect()
}

/// Optimises: for each pair of `schedule` as many steps with that penalty, from the design `start` or an even one.
pub(crate) fn optimise(
    problem: &Problem,
    schedule: &[(usize, f64)],
    start: Option<&[f64]>,
    mut report: impl FnMut(Progress),
) -> Result<Design, SolveError> {
    let matrix = stiffness(problem.sides);
    let filter = Filter::new(problem);
    let all = problem.material.len();
    let given = |material| problem.material.iter().filter(|&&m| m == material).count() as f64;
    let (solid, void) = (given(Material::Solid), given(Material::Void));
    let most = all as f64 - void;
    let free = problem.volume * most - solid;
    let even = (free / (most - solid)).clamp(0.0, 1.0);
    let begin = |(element, material): (usize, &Material)| match material {
        Material::Free => start.map_or(even, |start| start[element]),
        Material::Solid => 1.0,
        Material::Void => 0.0,
    };
    let mut design: Vec<f64> = problem.material.iter().enumerate().map(begin).collect();
    let is_free = |e: usize| problem.material[e] == Material::Free;
    let by_design = filter.derivative(&vec![1.0; all]);
    let mut u = vec![vec![0.0; problem.lattice.unknowns()]; problem.loads.len()];
    let mut density = filter.density(&design);
    let volume = |density: &[f64]| density.iter().sum::<f64>() / most;
    let penalties = schedule.iter().flat_map(|&(steps, penalty)| std::iter::repeat_n(penalty, steps));
    for (step, penalty) in penalties.enumerate() {
        let (value, by_modulus, iterations) =
            compliance(problem, &matrix, modulus(&density, penalty), &mut u)?;
        let slope = |e: usize| by_modulus[e] * penalty * (1.0 - SOFT) * density[e].powf(penalty - 1.0);
        let by_density: Vec<f64> = (0..all).map(slope).collect();
        let gain = filter.derivative(&by_density);
        let moved = |price: f64| -> Vec<f64> {
            let one = |e: usize| {
                if !is_free(e) {
                    return design[e];
                }
                let factor = (-gain[e]).max(0.0) / (price * by_design[e]);
                let to = design[e] * factor.sqrt();
                to.clamp(design[e] - MOVE, design[e] + MOVE).clamp(0.0, 1.0)
            };
            (0..all).into_par_iter().map(one).collect()
        };
        // The volume falls with the price; filtered and not, through the derivative.
        let taken =
            |design: &[f64]| (0..all).filter(|&e| is_free(e)).map(|e| design[e] * by_design[e]).sum::<f64>();
        let beside: f64 =
            (0..all).filter(|&e| problem.material[e] == Material::Solid).map(|e| by_design[e]).sum();
        let (mut low, mut high) = (1e-12 * value, 1e6 * value);
        while high / low > 1.0 + 1e-9 {
            let price = (low * high).sqrt();
            if taken(&moved(price)) + beside > free { low = price } else { high = price }
        }
        design = moved(high);
        density = filter.density(&design);
        report(Progress { step, penalty, compliance: value, volume: volume(&density), iterations });
    }
    let penalty = schedule.last().map_or(1.0, |last| last.1);
    let (value, ..) = compliance(problem, &matrix, modulus(&density, penalty), &mut u)?;
    let solid: Vec<f64> =
        problem.material.iter().map(|&m| f64::from(u8::from(m != Material::Void))).collect();
    u.iter_mut().for_each(|u| u.fill(0.0));
    let (solid_compliance, ..) = compliance(problem, &matrix, modulus(&solid, 1.0), &mut u)?;
    Ok(Design { design, density, compliance: value, solid_compliance })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A cantilever held at x = 0, pulled down in the middle of its far end, with a hole and a solid tip.
    fn cantilever() -> Problem {
        let lattice = Lattice { n: [16, 4, 8] };
        let mut held = vec![false; lattice.unknowns()];
        let mut force = vec![0.0; held.len()];
        for node in lattice.nodes() {
            (0..3).for_each(|d| held[lattice.unknown(node, d)] = node[0] == 0);
            if node[0] == 16 && node[2] == 4 {
                force[lattice.unknown(node, 2)] = if node[1] == 0 || node[1] == 4 { -0.5 } else { -1.0 };
            }
        }
        let kind = |e: usize| match [e / 32, e / 8 % 4, e % 8] {
            [15, _, 3 | 4] => Material::Solid,
            [5 | 6, _, 3 | 4] => Material::Void,
            _ => Material::Free,
        };
        let material = (0..lattice.elements()).map(kind).collect();
        let loads = vec![Load { weight: 1.0, held, force }];
        let (sides, mirrored) = ([1.0; 3], [false; 3]);
        Problem { lattice, sides, mirrored, material, loads, volume: 0.4, radius: 1.6, tolerance: 1e-9 }
    }

    #[test]
    fn a_cantilever_becomes_stiffer_keeps_its_volume_and_is_symmetric() {
        let problem = cantilever();
        let mut steps = Vec::new();
        let design = optimise(&problem, &[(24, 3.0)], None, |step| steps.push(step)).unwrap();
        let mean = |steps: &[Progress]| steps.iter().map(|s| s.compliance).sum::<f64>() / steps.len() as f64;
        let means: Vec<f64> = steps.chunks(6).map(mean).collect();
        assert!(means.windows(2).all(|pair| pair[1] < pair[0]), "{means:?}");
        assert!(
            design.compliance < 0.5 * steps[0].compliance,
            "{} from {}",
            design.compliance,
            steps[0].compliance
        );
        assert!(design.compliance > design.solid_compliance);
        // As near as the price is found.
        assert!(steps.iter().all(|step| (step.volume - problem.volume).abs() < 1e-6), "{steps:?}");
        for (element, &density) in design.density.iter().enumerate() {
            let [i, j, k] = [element / 32, element / 8 % 4, element % 8];
            match problem.material[element] {
                Material::Solid => assert_eq!(density, 1.0),
                Material::Void => assert_eq!(density, 0.0),
                Material::Free => assert!((0.0..=1.0).contains(&density)),
            }
            for mirror in [[i, 3 - j, k], [i, j, 7 - k]] {
                let other = design.density[problem.lattice.element(mirror)];
                // The tolerance of the displacements, through the steps.
                assert!((density - other).abs() < 1e-5, "{element}: {density} and {other}");
            }
        }
        let again = optimise(&problem, &[(24, 3.0)], None, |_| {}).unwrap();
        assert_eq!(again.density, design.density);
    }

    #[test]
    fn half_a_symmetric_part_becomes_what_the_whole_does() {
        let whole = cantilever();
        let mut half = cantilever();
        let lattice = Lattice { n: [16, 2, 8] };
        let of_half = |node: [usize; 3], d: usize| whole.lattice.unknown(node, d);
        let mut load =
            Load { weight: 1.0, held: vec![false; lattice.unknowns()], force: vec![0.0; lattice.unknowns()] };
        for (node, d) in lattice.nodes().flat_map(|node| (0..3).map(move |d| (node, d))) {
            let unknown = lattice.unknown(node, d);
            let plane = node[1] == 2;
            load.held[unknown] = whole.loads[0].held[of_half(node, d)] || plane && d == 1;
            load.force[unknown] = whole.loads[0].force[of_half(node, d)] * if plane { 0.5 } else { 1.0 };
        }
        half.material = (0..lattice.elements())
            .map(|e| whole.material[whole.lattice.element([e / 16, e / 8 % 2, e % 8])])
            .collect();
        (half.lattice, half.loads, half.mirrored) = (lattice, vec![load], [false, true, false]);
        let [whole_design, half_design] =
            [&whole, &half].map(|problem| optimise(problem, &[(8, 2.0)], None, |_| {}).unwrap());
        assert!((2.0 * half_design.compliance / whole_design.compliance - 1.0).abs() < 1e-6);
        for (e, density) in half_design.density.iter().enumerate() {
            let same = whole_design.density[whole.lattice.element([e / 16, e / 8 % 2, e % 8])];
            assert!((density - same).abs() < 1e-5, "{e}: {density} and {same}");
        }
    }

    #[test]
    fn derivatives_are_those_of_differences() {
        let problem = cantilever();
        let filter = Filter::new(&problem);
        let matrix = stiffness(problem.sides);
        let mut design: Vec<f64> = (0..problem.material.len()).map(|e| 0.3 + (e % 7) as f64 / 15.0).collect();
        let mut u = vec![vec![0.0; problem.lattice.unknowns()]];
        let mut value = |design: &[f64]| {
            compliance(&problem, &matrix, modulus(&filter.density(design), 3.0), &mut u).unwrap()
        };
        let (_, by_modulus, _) = value(&design);
        let density = filter.density(&design);
        let by_density: Vec<f64> =
            (0..density.len()).map(|e| by_modulus[e] * 3.0 * (1.0 - SOFT) * density[e].powi(2)).collect();
        let gain = filter.derivative(&by_density);
        for element in [3, 77, 200, 355, 501] {
            let kept = design[element];
            let [up, down] = [1e-4, -1e-4].map(|step| {
                design[element] = kept + step;
                value(&design).0
            });
            design[element] = kept;
            let expected = (up - down) / 2e-4;
            // Central differences of a residual of 1e-9: six figures are left.
            assert!(
                (gain[element] - expected).abs() < 1e-4 * expected.abs() + 1e-6,
                "{element}: {} against {expected}",
                gain[element]
            );
        }
    }
}
