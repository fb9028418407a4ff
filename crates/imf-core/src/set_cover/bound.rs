//! Prices of rows that prove that a number of sets is too few.
//!
//! With a price of each row, at most its weight where rows may stay uncovered, no cover of k sets exists unless the k sets of
//! the highest prices are together worth all rows less the slack (Lagrange's bound, k sets of a linear program). Prices are
//! improved by subgradients in floating point; what is concluded from them is computed in whole numbers.

use super::bits::ones;
use super::reduced::ReducedProblem;

/// What prices say of the sets, for covers of a number of sets.
pub(super) enum Verdict {
    /// There is no cover.
    None,
    /// One of these sets is in every cover; those that most is to be hoped of first. And sets that are in no cover.
    OneOf { sets: Vec<usize>, useless: Vec<usize> },
}

/// The sum of prices that rows are scaled to where no weight limits them.
const WHOLE: f64 = (1u64 << 40) as f64;
/// Rounds without a better bound after which the steps are halved.
const PATIENCE: usize = 4;
/// Rounds where no price is known, and where the problem is part of one whose prices are.
const ROUNDS: [usize; 2] = [300, 60];
/// Steps this much shorter than at first lead nowhere any more.
const SHORTEST: f64 = 1.0 / 256.0;

/// The verdict of the best prices, which stay in the problem, and the steps that it took.
pub(super) fn by_prices(problem: &mut ReducedProblem, count: usize) -> (Verdict, u64) {
    let (rows, sets) = (problem.rows(), problem.sets());
    let limited = problem.slack > 0;
    let unit: u64 = problem.weights.iter().sum();
    let limit: Vec<f64> = problem.weights.iter().map(|&w| w as f64 / unit as f64).collect();
    let slack = problem.slack as f64 / unit as f64;
    let known = problem.prices.iter().sum::<f64>() > 0.0;
    let total = if limited { unit as f64 } else { problem.prices.iter().sum::<f64>().max(f64::MIN_POSITIVE) };
    let mut prices: Vec<f64> = match (known, limited) {
        (true, _) => problem.prices.iter().map(|price| price / total).collect(),
        (false, true) => limit.clone(),
        (false, false) => vec![1.0 / rows as f64; rows],
    };
    let held: Vec<Vec<u32>> =
        (0..sets).map(|set| ones(problem.rows_of.row(set)).map(|row| row as u32).collect()).collect();
    let mut best: Option<(f64, Vec<f64>)> = None;
    let (mut factor, mut waited) = (1.0, 0);
    let mut worth = vec![0.0; sets];
    let mut done = 0;
    for _ in 0..ROUNDS[usize::from(known)] {
        done += 1;
        for (worth, rows) in worth.iter_mut().zip(&held) {
            *worth = rows.iter().map(|&row| prices[row as usize]).sum();
        }
        let top = highest(&worth, count);
        let all: f64 = prices.iter().sum();
        let excess =
            (top.iter().map(|&set| worth[set]).sum::<f64>() - all + slack) / all.max(f64::MIN_POSITIVE);
        if best.as_ref().is_none_or(|(least, _)| excess < *least) {
            best = Some((excess, prices.clone()));
            waited = 0;
        } else {
            waited += 1;
            if waited == PATIENCE {
                (factor, waited) = (0.5 * factor, 0);
                if factor < SHORTEST {
                    break;
                }
                prices.clone_from(&best.as_ref().expect("a first round is the best so far").1);
                continue;
            }
        }
        if excess < -1e-9 {
            break;
        }
        // Rows that none of the best sets holds become expensive, those that several hold cheap.
        let mut slope = vec![-1.0; rows];
        top.iter().for_each(|&set| held[set].iter().for_each(|&row| slope[row as usize] += 1.0));
        let steepness: f64 = slope.iter().map(|s| s * s).sum();
        let step = factor * all * (excess + 0.05) / steepness.max(1.0);
        for ((price, slope), limit) in prices.iter_mut().zip(slope).zip(&limit) {
            let most = if limited { *limit } else { f64::INFINITY };
            *price = (*price - step * slope).clamp(0.0, most);
        }
    }
    let prices = best.map_or(prices, |(_, prices)| prices);
    let sum: f64 = prices.iter().sum();
    let scale = if limited { unit as f64 } else { WHOLE / sum.max(f64::MIN_POSITIVE) };
    let whole = prices.iter().zip(&problem.weights).map(|(price, &weight)| {
        let whole = (price * scale) as u64;
        if limited { whole.min(weight) } else { whole }
    });
    let whole: Vec<u64> = whole.collect();
    problem.prices = prices.iter().map(|price| price * scale).collect();
    let steps = held.iter().map(|rows| rows.len() as u64).sum::<u64>() * done;
    (conclude(problem, &whole, count), steps)
}

/// What follows from whole prices.
fn conclude(problem: &ReducedProblem, prices: &[u64], count: usize) -> Verdict {
    let needed = prices.iter().sum::<u64>().saturating_sub(problem.slack);
    let worth = |set: usize| ones(problem.rows_of.row(set)).map(|row| prices[row]).sum::<u64>();
    let mut order: Vec<(u64, usize)> = (0..problem.sets()).map(|set| (worth(set), set)).collect();
    order.sort_by(|a, b| b.0.cmp(&a.0).then(a.1.cmp(&b.1)));
    let sum = |range: &[(u64, usize)]| range.iter().map(|(worth, _)| worth).sum::<u64>();
    let end = |from: usize| (from + count).min(order.len());
    if sum(&order[..end(0)]) < needed {
        return Verdict::None;
    }
    let others = sum(&order[..(count - 1).min(order.len())]);
    let useful = order.partition_point(|(worth, _)| worth + others >= needed);
    let useless = order[useful..].iter().map(|(_, set)| *set).collect();
    let enough = (0..useful).find(|&from| sum(&order[from..end(from)]) < needed).unwrap_or(useful);
    Verdict::OneOf { sets: order[..enough].iter().map(|(_, set)| *set).collect(), useless }
}

/// Indices of the highest values.
fn highest(values: &[f64], count: usize) -> Vec<usize> {
    let mut top: Vec<usize> = Vec::with_capacity(count + 1);
    for index in 0..values.len() {
        if top.len() < count || values[index] > values[top[top.len() - 1]] {
            let at = top.partition_point(|&other| values[other] >= values[index]);
            top.insert(at, index);
            top.truncate(count);
        }
    }
    top
}
