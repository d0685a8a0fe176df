//! Shares of problems solved, and performance profiles.
//!
//! # Forward
//! With `c(p, s)` what solver `s` spends until it solves problem `p` to a level, infinite where it
//! never does, and `r(p, s) = c(p, s) / min_s c(p, s)`: the profile `rho_s(tau)` is the share of
//! all problems with `r(p, s) <= tau`. `rho_s(1)` is the share where `s` is the cheapest;
//! `rho_s(infinity)` the share that it solves at all. A problem that nobody solves stays in the
//! denominator.
//!
//! # Source
//! Dolan and More, *Benchmarking optimization software with performance profiles*, Mathematical
//! Programming 91, 2002.

use std::collections::BTreeMap;

use super::ledger::{LEVELS, Moment};
use super::optimizers::Run;

/// What a run spends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cost {
    /// Wall-clock seconds.
    Seconds,
    /// Gradient evaluations.
    Gradients,
}

impl Cost {
    fn value_of(self, moment: Moment) -> f64 {
        match self {
            Self::Seconds => moment.seconds,
            Self::Gradients => moment.gradient_evaluations,
        }
    }
}

/// A solver: an optimizer, with the best of its rates on each problem apart.
#[derive(Debug, Clone, PartialEq)]
pub struct Solver<'a> {
    /// The optimizer.
    pub optimizer: &'static str,
    /// Its run on each problem; of several rates, the one that comes farthest, then soonest.
    pub runs: Vec<&'a Run>,
}

/// Each optimizer with its best run per problem, in the order in which they first appear. All
/// have their runs in the same order of problems.
pub fn solvers<'a>(runs: impl IntoIterator<Item = &'a Run>) -> Vec<Solver<'a>> {
    let mut names: Vec<&'static str> = Vec::new();
    let mut problems: Vec<(&str, u64)> = Vec::new();
    let mut best: BTreeMap<(usize, usize), &Run> = BTreeMap::new();
    for run in runs {
        let solver = index_in(&mut names, run.optimizer);
        let problem = index_in(&mut problems, (run.problem.as_str(), run.seed));
        let held = best.entry((solver, problem)).or_insert(run);
        if better(run, held) {
            *held = run;
        }
    }
    let all = names.iter().enumerate().map(|(solver, &optimizer)| Solver {
        optimizer,
        runs: (0..problems.len()).filter_map(|p| best.get(&(solver, p)).copied()).collect(),
    });
    all.collect()
}

/// The index of `one`, which is added where it is new.
fn index_in<T: PartialEq>(all: &mut Vec<T>, one: T) -> usize {
    all.iter().position(|known| *known == one).unwrap_or_else(|| {
        all.push(one);
        all.len() - 1
    })
}

/// Whether `run` comes farther than `other`, or as far and with less.
fn better(run: &Run, other: &Run) -> bool {
    let to = |run: &Run| run.solved_to.checked_sub(1).and_then(|level| run.reached[level]);
    let spent = |run: &Run| to(run).map_or(f64::INFINITY, |m| m.gradient_evaluations);
    (run.solved_to, -spent(run), -run.error) > (other.solved_to, -spent(other), -other.error)
}

/// The share of `runs` that are solved to each of 1e-1 ... 1e-8.
pub fn shares(runs: &[&Run]) -> [f64; LEVELS] {
    let count = |level: usize| runs.iter().filter(|run| run.solved_to > level).count();
    std::array::from_fn(|level| count(level) as f64 / runs.len().max(1) as f64)
}

/// `(tau, rho(tau))` at each step of the profile of every solver for level `10^-level`, `level`
/// from 1 to 8.
///
/// # Panics
/// Where `level` is out of its range.
pub fn profiles(solvers: &[Solver<'_>], level: usize, cost: Cost) -> Vec<Vec<[f64; 2]>> {
    let problems = solvers.iter().map(|solver| solver.runs.len()).max().unwrap_or(0);
    let spent = |solver: &Solver<'_>, problem: usize| -> f64 {
        let reached = solver.runs.get(problem).and_then(|run| run.reached[level - 1]);
        reached.map_or(f64::INFINITY, |moment| cost.value_of(moment))
    };
    let least: Vec<f64> = (0..problems)
        .map(|p| solvers.iter().map(|solver| spent(solver, p)).fold(f64::INFINITY, f64::min))
        .collect();
    let profile = |solver: &Solver<'_>| {
        let mut ratios: Vec<f64> = (0..problems)
            .map(|p| spent(solver, p) / least[p])
            .filter(|ratio| ratio.is_finite())
            .collect();
        ratios.sort_by(f64::total_cmp);
        let share = |count: usize| count as f64 / problems as f64;
        let steps = ratios.iter().enumerate().map(|(k, &ratio)| [ratio, share(k + 1)]);
        steps.collect::<Vec<_>>()
    };
    solvers.iter().map(profile).collect()
}

/// The share of problems solved to `10^-level` within `budget` gradient evaluations.
///
/// # Panics
/// Where `level` is not from 1 to 8.
pub fn share_within(runs: &[&Run], level: usize, budget: f64) -> f64 {
    let within = |run: &&&Run| {
        run.reached[level - 1].is_some_and(|moment| moment.gradient_evaluations <= budget)
    };
    runs.iter().filter(within).count() as f64 / runs.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stiff::ledger::Counts;
    use crate::stiff::optimizers::Outcome;
    use crate::stiff::problem::Family;

    /// A run that needs `costs[k]` gradients for level `k + 1`.
    fn made_up(problem: &str, optimizer: &'static str, costs: &[f64]) -> Run {
        let mut reached = [None; LEVELS];
        for (k, &cost) in costs.iter().enumerate() {
            let error = f64::powi(10.0, -(k as i32) - 1);
            reached[k] = Some(Moment { seconds: 2.0 * cost, gradient_evaluations: cost, error });
        }
        Run {
            problem: problem.to_owned(),
            family: Family::Literature,
            seed: 0,
            optimizer,
            rate: None,
            solved_to: costs.len(),
            error: f64::powi(10.0, -(costs.len() as i32)),
            minimiser_error: None,
            seconds: 1.0,
            gradient_evaluations: 1.0,
            counts: Counts::default(),
            outcome: Outcome::Budget,
            message: String::new(),
            reached,
            history: Vec::new(),
        }
    }

    fn runs() -> Vec<Run> {
        vec![
            made_up("a", "slow", &[10.0, 40.0]),
            made_up("a", "fast", &[5.0, 10.0]),
            made_up("b", "slow", &[2.0]),
            // Two rates: the one that comes farther counts, though it starts later.
            made_up("b", "fast", &[8.0, 16.0]),
            made_up("b", "fast", &[1.0]),
            made_up("c", "slow", &[]),
            made_up("c", "fast", &[]),
        ]
    }

    #[test]
    fn profiles_are_those_worked_out_by_hand() {
        let runs = runs();
        let solvers = solvers(&runs);
        let names: Vec<_> = solvers.iter().map(|solver| solver.optimizer).collect();
        assert_eq!(names, ["slow", "fast"]);
        let third = 1.0 / 3.0;
        for cost in [Cost::Gradients, Cost::Seconds] {
            let [slow, fast] = &profiles(&solvers, 1, cost)[..] else { panic!("two") };
            // a: 10 against 5, b: 2 against 8, c: nobody.
            assert_eq!(slow[..], [[1.0, third], [2.0, 2.0 * third]]);
            assert_eq!(fast[..], [[1.0, third], [4.0, 2.0 * third]]);
        }
        let [slow, fast] = &profiles(&solvers, 2, Cost::Gradients)[..] else { panic!("two") };
        assert_eq!(slow[..], [[4.0, third]]);
        assert_eq!(fast[..], [[1.0, third], [1.0, 2.0 * third]]);
        assert!(profiles(&solvers, 8, Cost::Gradients).iter().all(Vec::is_empty));
    }

    #[test]
    fn shares_fall_with_the_level_and_count_what_is_not_solved() {
        let runs = runs();
        let solvers = solvers(&runs);
        let third = 1.0 / 3.0;
        assert_eq!(shares(&solvers[0].runs)[..3], [2.0 * third, third, 0.0]);
        assert_eq!(shares(&solvers[1].runs)[..3], [2.0 * third, 2.0 * third, 0.0]);
        assert_eq!(share_within(&solvers[1].runs, 2, 10.0), third);
        assert_eq!(share_within(&solvers[1].runs, 2, 9.0), 0.0);
    }
}
