//! Checking a subject against every law, on inputs from a strategy.

use std::fmt;
use std::sync::Arc;

use proptest::strategy::{BoxedStrategy, Strategy, ValueTree};
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};

use crate::failure::{Broken, Failure, Law};
use crate::laws;
use crate::mutation::{Kills, kills};
use crate::run::caught;
use crate::shrink::{Counterexample, shrink};
use crate::subject::{AnySubject, Case, Input, Refusal, Subject};
use crate::trial::{Tally, Trial, Unfit};

/// The share of the points of a difference check that may be left out.
const MOST_LEFT_OUT: f64 = 0.1;
/// The other laws leave out a whole case where one of its entries is beside a kink.
const MOST_CASES_LEFT_OUT: f64 = 0.5;

/// A check in the making: a subject, a strategy for its inputs, and what else to try. See the
/// [crate] for an example.
#[derive(Debug, Clone)]
pub struct Check {
    name: String,
    strategy: BoxedStrategy<Case>,
    cases: u32,
    large: Option<(BoxedStrategy<Case>, u32)>,
    refused: Vec<Refused>,
    except: Vec<Law>,
}

impl Check {
    /// A check of one subject.
    pub fn new(
        name: impl Into<String>,
        subject: impl Subject,
        inputs: impl Strategy<Value = Vec<Input>> + 'static,
    ) -> Self {
        let subject: Arc<dyn AnySubject> = Arc::new(subject);
        let case = move |inputs| Case { subject: Arc::clone(&subject), inputs };
        Self::from_cases(name, inputs.prop_map(case))
    }

    /// A check of subjects that differ from case to case: other options, other meshes.
    pub fn from_cases(
        name: impl Into<String>,
        strategy: impl Strategy<Value = Case> + 'static,
    ) -> Self {
        Self {
            name: name.into(),
            strategy: strategy.boxed(),
            cases: 32,
            large: None,
            refused: Vec::new(),
            except: Vec::new(),
        }
    }

    /// How many cases are drawn; always the same cases. 32 unless told.
    #[must_use]
    pub fn cases(self, cases: u32) -> Self {
        Self { cases, ..self }
    }

    /// Adds cases that are large enough for work in pieces. Only threads and recycling are checked
    /// on them.
    #[must_use]
    pub fn large(self, cases: u32, strategy: impl Strategy<Value = Case> + 'static) -> Self {
        Self { large: Some((strategy.boxed(), cases)), ..self }
    }

    /// Wrong input, and the message of its error: the subject must refuse it, and leave the tape as
    /// it was.
    #[must_use]
    pub fn refuses(mut self, message: impl Into<String>, case: Case) -> Self {
        self.refused.push(Refused { message: message.into(), case, is_pipeline: false });
        self
    }

    /// [`Check::refuses`] for a pipeline: its first operations stay on the tape where a later
    /// operation refuses, but what was recorded before it must be as it was.
    #[must_use]
    pub fn refuses_midway(mut self, message: impl Into<String>, case: Case) -> Self {
        self.refused.push(Refused { message: message.into(), case, is_pipeline: true });
        self
    }

    /// A law that the subject is not meant to keep. The report says so.
    #[must_use]
    pub fn except(mut self, law: Law) -> Self {
        self.except.push(law);
        self
    }

    /// Checks every law on every case.
    ///
    /// # Errors
    /// The first law that is broken, on the smallest inputs found that break it.
    pub fn run(&self) -> Result<CheckReport, Box<Failure>> {
        let mut tallies: Vec<(Law, Tally)> = Vec::new();
        let mut right: Option<Trial> = None;
        let mut cases = points(&self.strategy);
        for _ in 0..self.cases {
            let trial = self.trial(&mut cases)?;
            for law in self.laws() {
                add(&mut tallies, law, self.check(law, &trial)?);
            }
            right.get_or_insert(trial);
        }
        if let Some((strategy, cases)) = &self.large {
            let mut points = points(strategy);
            for _ in 0..*cases {
                let trial = self.trial(&mut points)?;
                for law in [Law::Threads, Law::Recycling] {
                    add(&mut tallies, law, self.check(law, &trial)?);
                }
            }
        }
        for refused in &self.refused {
            let Some(right) = &right else { break };
            let Refused { message, case, is_pipeline } = refused;
            let tally = laws::refuses(case, message, *is_pipeline, right).map_err(|broken| {
                self.failure(Law::Refusals, broken, format!("{:?}", case.inputs))
            })?;
            add(&mut tallies, Law::Refusals, tally);
        }
        let report = CheckReport {
            name: self.name.clone(),
            cases: self.cases,
            tallies,
            except: self.except.clone(),
        };
        self.enough(&report)?;
        Ok(report)
    }

    /// For each wrong input the message that its error has to have, and the error; `None` where there is
    /// none.
    pub fn refusals(&self) -> impl Iterator<Item = (&str, Option<Refusal>)> {
        self.refused.iter().map(|refused| (&*refused.message, refused.case.error::<f64>()))
    }

    /// [`Check::refusals`] in `f32`, of inputs whose numbers it holds, though rounded. Their messages may
    /// end in other digits.
    pub fn refusals_in_single(&self) -> impl Iterator<Item = (&str, Option<Refusal>)> {
        let refused = self.refused.iter().filter(|refused| refused.case.is_held_by_single());
        refused.map(|refused| (&*refused.message, refused.case.error::<f32>()))
    }

    /// [`Check::run`], with a line about what was compared on standard output.
    ///
    /// # Panics
    /// Where a law is broken, with the failure as the message.
    #[allow(clippy::must_use_candidate, reason = "most tests want the panic alone")]
    pub fn assert(&self) -> CheckReport {
        match self.run() {
            Ok(report) => {
                println!("{report}");
                report
            }
            Err(failure) => panic!("{failure}"),
        }
    }

    /// Mutation controls: wrong adjoints, made from the right one, and how many of them break a
    /// law.
    ///
    /// # Errors
    /// As [`Check::run`]: where a law is broken without a mistake, nothing can be said.
    pub fn kills(&self) -> Result<Kills, Box<Failure>> {
        self.run()?;
        let mut cases = points(&self.strategy);
        let trials: Result<Vec<_>, _> = (0..self.cases).map(|_| self.trial(&mut cases)).collect();
        let breaks_a_law = |case: Case| {
            let breaks = |trial: Trial| self.laws().any(|law| laws::check(law, &trial).is_err());
            // A mutant that panics or refuses is not one that a law caught.
            caught(|| Trial::new(case, None).is_ok_and(breaks)).unwrap_or(false)
        };
        Ok(kills(&self.name, &trials?, breaks_a_law))
    }

    fn laws(&self) -> impl Iterator<Item = Law> {
        Law::ALL.into_iter().filter(|law| !self.except.contains(law))
    }

    /// The next case, run once.
    fn trial(&self, points: &mut Points) -> Result<Trial, Box<Failure>> {
        let law = Law::Defined;
        let case = points.next().map_err(|reason| {
            self.failure(law, Broken::from_message(format!("no inputs: {reason}")), String::new())
        })?;
        let broken = match caught(|| Trial::new(case.clone(), None)) {
            Ok(Ok(trial)) => return Ok(trial),
            Ok(Err(Unfit::Broken(broken))) => broken,
            Ok(Err(Unfit::Refused(why))) => {
                Broken::from_message(format!("it refuses inputs of its strategy: {why}"))
            }
            Err(panic) => Broken::from_message(format!("it panicked: {panic}")),
        };
        Err(self.smallest(law, Counterexample { case, upstream: Vec::new(), broken }))
    }

    /// Checks one law on one case.
    fn check(&self, law: Law, trial: &Trial) -> Result<Tally, Box<Failure>> {
        let broken = match caught(|| laws::check(law, trial)) {
            Ok(Ok(tally)) => return Ok(tally),
            Ok(Err(broken)) => broken,
            Err(panic) => Broken::from_message(format!("it panicked: {panic}")),
        };
        let (case, upstream) = (trial.case.clone(), trial.upstream.clone());
        Err(self.smallest(law, Counterexample { case, upstream, broken }))
    }

    /// A failure made as small as can be.
    fn smallest(&self, law: Law, counterexample: Counterexample) -> Box<Failure> {
        let counterexample = shrink(law, counterexample);
        self.failure(law, counterexample.broken.clone(), described(&counterexample))
    }

    fn failure(&self, law: Law, broken: Broken, inputs: String) -> Box<Failure> {
        Box::new(Failure { name: self.name.clone(), law, broken, inputs })
    }

    /// Whether each law was checked on enough points.
    fn enough(&self, report: &CheckReport) -> Result<(), Box<Failure>> {
        // Wrong input is given by hand or not at all.
        for law in self.laws().filter(|&law| law != Law::Refusals) {
            let tally = report.tally(law);
            let Tally { compared, left_out, .. } = tally;
            let (share, most) = match law {
                Law::Differences | Law::Curvature => (tally.share_left_out(), MOST_LEFT_OUT),
                _ => (left_out as f64 / f64::from(self.cases), MOST_CASES_LEFT_OUT),
            };
            if share > most || compared == 0 {
                let what = format!(
                    "{left_out} points left out and {compared} compared; at most {} % may be left \
                     out",
                    100.0 * most
                );
                return Err(self.failure(law, Broken::from_message(what), String::new()));
            }
        }
        Ok(())
    }
}

/// Wrong input.
#[derive(Debug, Clone)]
struct Refused {
    /// What its error says.
    message: String,
    case: Case,
    /// Whether operations before the one that refuses stay on the tape.
    is_pipeline: bool,
}

fn add(tallies: &mut Vec<(Law, Tally)>, law: Law, tally: Tally) {
    match tallies.iter_mut().find(|(known, _)| *known == law) {
        Some((_, sum)) => sum.add(tally),
        None => tallies.push((law, tally)),
    }
}

/// The inputs of a failure, as text.
fn described(counterexample: &Counterexample) -> String {
    let mut text = format!("with {:?}", counterexample.case.subject);
    for (i, input) in counterexample.case.inputs.iter().enumerate() {
        let constant = if input.differentiable { "" } else { ", a constant" };
        text.push_str(&format!("\n     in{i} = {:?}{constant}", input.tensor));
    }
    for (j, upstream) in counterexample.upstream.iter().enumerate() {
        text.push_str(&format!("\n     u{j} = {upstream:?}"));
    }
    text
}

/// The cases of a strategy, always the same.
pub(crate) struct Points {
    strategy: BoxedStrategy<Case>,
    runner: TestRunner,
}

pub(crate) fn points(strategy: &BoxedStrategy<Case>) -> Points {
    let config = Config { failure_persistence: None, ..Config::default() };
    let rng = TestRng::deterministic_rng(RngAlgorithm::ChaCha);
    let runner = TestRunner::new_with_rng(config, rng);
    Points { strategy: strategy.clone(), runner }
}

impl Points {
    pub(crate) fn next(&mut self) -> Result<Case, String> {
        let tree = self.strategy.new_tree(&mut self.runner);
        tree.map(|tree| tree.current()).map_err(|reason| reason.to_string())
    }
}

/// What a check looked at. `Display` gives a line.
#[derive(Debug, Clone, PartialEq)]
pub struct CheckReport {
    /// The subject's name.
    pub name: String,
    /// How many cases were drawn.
    pub cases: u32,
    /// What each law compared and left out.
    pub tallies: Vec<(Law, Tally)>,
    /// Laws that the subject is not meant to keep.
    pub except: Vec<Law>,
}

impl CheckReport {
    /// What one law compared and left out.
    pub fn tally(&self, law: Law) -> Tally {
        let tally = self.tallies.iter().find(|(known, _)| *known == law);
        tally.map(|&(_, tally)| tally).unwrap_or_default()
    }
}

impl Tally {
    /// Left out, of all points.
    pub fn share_left_out(&self) -> f64 {
        let all = self.compared + self.left_out;
        if all == 0 { 0.0 } else { self.left_out as f64 / all as f64 }
    }
}

impl fmt::Display for CheckReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let differences = self.tally(Law::Differences);
        let all = differences.compared + differences.left_out;
        let compared: u64 = self.tallies.iter().map(|(_, tally)| tally.compared).sum();
        let worst = self.tallies.iter().max_by(|(_, a), (_, b)| a.worst.total_cmp(&b.worst));
        write!(
            f,
            "{}: {} cases, {compared} comparisons; {} of {all} difference quotients left out \
             ({:.1} %)",
            self.name,
            self.cases,
            differences.left_out,
            100.0 * differences.share_left_out(),
        )?;
        if let Some((law, tally)) = worst.filter(|(_, tally)| tally.worst > 0.0) {
            write!(f, "; largest error {:.2} of its bound ({law})", tally.worst)?;
        }
        for (law, Tally { left_out, .. }) in &self.tallies {
            match law {
                Law::Differences => {}
                Law::Curvature if *left_out > 0 => {
                    write!(f, "; {law}: {left_out} points left out")?;
                }
                _ if *left_out > 0 => write!(f, "; {law}: {left_out} cases left out")?,
                _ => {}
            }
        }
        if self.tally(Law::Refusals).compared == 0 {
            write!(f, "; no wrong input was given")?;
        }
        if !self.except.is_empty() {
            let laws: Vec<_> = self.except.iter().map(Law::to_string).collect();
            write!(f, "; not checked: {}", laws.join(", "))?;
        }
        Ok(())
    }
}
