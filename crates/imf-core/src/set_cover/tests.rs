use super::local::Numbers;
use super::*;
use crate::orientation::Orientation;
use crate::section::test_shapes::orientations;

fn problem<const N: usize>(elements: usize, sets: [&[usize]; N]) -> CoverProblem {
    let mut problem = CoverProblem::new(vec![1.0; elements]);
    sets.into_iter().for_each(|set| problem.add(set.iter().copied()));
    problem
}

fn fewest(problem: &CoverProblem) -> Cover {
    problem.fewest(&CoverSettings::default(), Control::quiet()).unwrap()
}

fn random(numbers: &mut Numbers, elements: usize, sets: usize, one_in: usize) -> CoverProblem {
    let mut problem = CoverProblem::new((0..elements).map(|_| numbers.below(10) as f64).collect());
    for _ in 0..sets {
        let held: Vec<usize> = (0..elements).filter(|_| numbers.below(one_in) == 0).collect();
        problem.add(held);
    }
    problem
}

/// The size of the smallest cover, by trying all.
fn by_trying_all(problem: &CoverProblem, fraction: f64) -> usize {
    let all: Vec<usize> = (0..problem.sets()).collect();
    let needed = fraction * problem.coverable();
    let size = |choice: u32| choice.count_ones() as usize;
    let enough = |choice: &u32| {
        let sets: Vec<usize> = all.iter().copied().filter(|set| choice >> set & 1 == 1).collect();
        problem.covered(&sets) >= needed - 1e-9
    };
    (0..1u32 << problem.sets()).filter(enough).map(size).min().unwrap()
}

#[test]
fn nothing_covers_zero_and_not_minus_zero() {
    assert!(problem(2, [&[], &[0]]).covered(&[0]).is_sign_positive());
}

#[test]
fn covers_are_the_smallest_that_trying_all_finds() {
    let mut numbers = Numbers(7);
    for round in 0..400 {
        let mut problem = random(&mut numbers, 6 + round % 27, 3 + round % 10, 2 + round % 5);
        if round % 3 == 0 {
            let first = problem.sets[0].clone();
            problem.sets.insert(problem.sets.len() / 2, first);
        }
        for fraction in [1.0, 0.97, 0.9, 0.7, 0.4] {
            let settings = CoverSettings { fraction, ..CoverSettings::default() };
            let cover = problem.fewest(&settings, Control::quiet()).unwrap();
            assert!(cover.is_proven());
            assert_eq!(cover.sets.len(), by_trying_all(&problem, fraction), "{round} {fraction} {problem:?}");
            assert!(problem.covered(&cover.sets) >= fraction * problem.coverable() - 1e-9);
        }
    }
}

/// Of all covers of that size the last set is the first possible.
#[test]
fn covers_are_of_the_first_sets_that_trying_all_finds() {
    let mut numbers = Numbers(5);
    let mut earlier = 0;
    for round in 0..200 {
        let problem = random(&mut numbers, 6 + round % 27, 3 + round % 8, 2 + round % 5);
        for fraction in [1.0, 0.9, 0.6] {
            let settings = CoverSettings { fraction, ..CoverSettings::default() };
            let any = problem.fewest(&settings, Control::quiet()).unwrap();
            let size = any.sets.len();
            let cover = problem.among_first(any.clone(), &settings, Control::quiet()).unwrap();
            let needed = fraction * problem.coverable() - 1e-9;
            assert!(cover.sets.len() == size && problem.covered(&cover.sets) >= needed);
            let sets = |choice: u32| (0..problem.sets()).filter(move |set| choice >> set & 1 == 1);
            let covers = (0..1u32 << problem.sets()).filter(|choice| {
                choice.count_ones() as usize == size
                    && problem.covered(&sets(*choice).collect::<Vec<_>>()) >= needed
            });
            let first = covers.filter_map(|choice| sets(choice).max()).min();
            assert_eq!(cover.sets.iter().copied().max(), first, "{round} {fraction} {problem:?}");
            earlier += usize::from(first < any.sets.iter().copied().max());
        }
    }
    assert!(earlier > 50, "{earlier}");
}

/// The search alone, without covers that exchanges find: every number of sets is refused or found rightly.
#[test]
fn the_search_refuses_fewer_sets_than_there_must_be_and_finds_as_many() {
    let mut numbers = Numbers(3);
    let mut sizes = [0; 8];
    for round in 0..60 {
        let problem = random(&mut numbers, 60, 14, 4 + round % 5);
        for fraction in [1.0, 0.9] {
            let (least, reduced) =
                (by_trying_all(&problem, fraction), problem.reduced(problem.sets(), fraction).unwrap());
            sizes[least.min(7)] += 1;
            for count in 1..=least + 1 {
                let found = branches::cover_of(&reduced, count, &mut u64::MAX.clone(), Control::quiet());
                let Ok(found) = found else { panic!("{round} {fraction} {count} stopped") };
                assert_eq!(found.is_some(), count >= least, "{round} {fraction} {count} of {least}");
                if let Some(sets) = found {
                    let sets: Vec<usize> = sets.into_iter().map(|set| set as usize).collect();
                    assert!(sets.len() <= count);
                    assert!(problem.covered(&sets) >= fraction * problem.coverable() - 1e-9);
                }
            }
        }
    }
    // Deep enough for prices and for branches of branches.
    assert!(sizes[5..].iter().sum::<i32>() > 10, "{sizes:?}");
}

#[test]
fn where_the_steps_end_the_gap_is_told_and_holds() {
    let problem = caps(300, 80, 50.0);
    let settings = CoverSettings::default();
    let proven = problem.fewest(&settings, Control::quiet()).unwrap();
    assert!(proven.is_proven());
    let mut gaps = 0;
    for steps in [0, 100_000, 1_000_000, 10_000_000, 40_000_000] {
        let cover = problem.fewest(&CoverSettings { steps, ..settings }, Control::quiet()).unwrap();
        assert!(
            cover.at_least <= proven.sets.len() && cover.sets.len() >= proven.sets.len(),
            "{steps} {cover:?}"
        );
        gaps += usize::from(!cover.is_proven());
    }
    assert!(gaps > 0, "the search was never needed");
}

#[test]
#[cfg(feature = "parallel")]
fn any_number_of_threads_finds_the_same() {
    let problem = caps(300, 80, 50.0);
    for (fraction, steps) in [(1.0, 5_000_000), (1.0, 100_000_000), (0.95, 5_000_000), (0.95, 100_000_000)] {
        let settings = CoverSettings { fraction, steps };
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(|| problem.fewest(&settings, Control::quiet()).unwrap())
        };
        let one = on(1);
        assert!([2, 3, 7].into_iter().all(|threads| on(threads) == one), "{fraction} {steps}");
    }
}

#[test]
fn of_sets_that_do_as_well_the_first_is_taken() {
    let problem = problem(6, [&[0, 1, 2], &[0, 1, 2, 3], &[3, 4, 5], &[2, 3, 4, 5]]);
    assert_eq!(fewest(&problem).sets, [0, 2]);
}

#[test]
fn where_greedy_takes_a_third_set_two_are_found_and_proven() {
    let halves: [&[usize]; 2] = [&[0, 1, 2, 3, 4, 5, 6], &[7, 8, 9, 10, 11, 12, 13]];
    let problem = problem(14, [&[0, 1, 2, 3, 7, 8, 9, 10], &[4, 5, 11, 12], &[6, 13], halves[0], halves[1]]);
    let cover = fewest(&problem);
    assert_eq!((cover.sets.as_slice(), cover.at_least), (&[3, 4][..], 2));
    assert_eq!(problem.covered_alone(&cover.sets), [7.0, 7.0]);
}

#[test]
fn what_no_set_contains_need_not_be_covered() {
    let mut problem = CoverProblem::new(vec![1.0, 5.0, 2.0]);
    problem.add([]);
    problem.add([0]);
    problem.add([2, 0]);
    assert_eq!(fewest(&problem).sets, [2]);
    let empty = fewest(&CoverProblem::new(vec![1.0]));
    assert!(empty.sets.is_empty() && empty.is_proven());
}

/// Directions all around that each see a cap of a ball, but for some places: as a tool sees a part's surface.
fn caps(elements: usize, sets: usize, half_angle: f64) -> CoverProblem {
    let directions = |n: usize| {
        orientations(&format!("fibonacci:{n}")).iter().map(Orientation::direction).collect::<Vec<_>>()
    };
    let (normals, mut numbers) = (directions(elements), Numbers(11));
    let mut problem = CoverProblem::new(vec![1.0; elements]);
    for direction in directions(sets) {
        let seen = |&index: &usize| {
            numbers.below(50) > 0 && normals[index].dot(direction) >= half_angle.to_radians().cos()
        };
        let seen: Vec<usize> = (0..elements).filter(seen).collect();
        problem.add(seen);
    }
    problem
}

#[test]
fn caps_of_a_ball_are_covered_by_a_proven_few() {
    // Four corners of a tetrahedron see all of a ball, three caps of 80° do not.
    let cover = fewest(&caps(500, 100, 80.0));
    assert_eq!((cover.sets.len(), cover.at_least), (4, 4));
}

#[test]
fn two_universes_weigh_the_same_side_by_side() {
    let mut one = CoverProblem::new(vec![3.0, 1.0, 5.0]);
    let mut other = CoverProblem::new(vec![10.0, 30.0]);
    for (sets, more) in [(vec![0], vec![0]), (vec![1], vec![1]), (vec![0, 1], vec![])] {
        one.add(sets);
        other.add(more);
    }
    let both = one.beside(&other);
    // The last element of the first is in no set.
    assert_eq!(both.covered(&[0]), 0.75 + 0.25);
    assert_eq!(both.covered(&[1]), 0.25 + 0.75);
    assert_eq!(both.covered(&[2]), 1.0);
    assert_eq!(both.covered(&[0, 1]), 2.0);
    let cover = fewest(&both);
    assert_eq!((cover.sets.len(), cover.is_proven()), (2, true));
    // What no set covers chooses nothing.
    let mut none = CoverProblem::new(vec![7.0]);
    (0..3).for_each(|_| none.add(vec![]));
    let both = one.beside(&none);
    assert_eq!((both.covered(&[0]), both.covered(&[2])), (0.75, 1.0));
    assert_eq!(fewest(&both).sets, [2]);
}

#[test]
fn a_fraction_that_is_no_number_asks_for_all() {
    let problem = problem(4, [&[0, 1], &[2], &[3]]);
    let settings = CoverSettings { fraction: f64::NAN, ..CoverSettings::default() };
    assert_eq!(problem.fewest(&settings, Control::quiet()), Some(fewest(&problem)));
}

#[test]
#[should_panic(expected = "weights must be finite and at least 0")]
fn a_weight_that_is_none_is_refused() {
    let _ = CoverProblem::new(vec![1.0, f64::NAN]);
}
