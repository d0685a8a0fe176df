//! Mutation controls: is a check able to fail?
//!
//! An identity whose backward pass is wrong on purpose stands in front of one input, and makes a
//! wrong adjoint of a right one. A check that passes with it would also pass with an operation that
//! has this mistake.

use std::fmt;
use std::sync::Arc;

use bokashi_core::{
    Accumulators, Dual, Inputs, Kept, Op, Outputs, Scalar, Tape, Tensor, TensorError, Var,
};

use crate::subject::{AnySubject, Applied, Case};
use crate::trial::Trial;

/// A mistake in a backward pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Mutation {
    /// The gradient with the wrong sign.
    Sign,
    /// The gradient off by a percent.
    Factor,
    /// No gradient.
    Dropped,
    /// The gradient written over what is there, instead of added.
    Overwrites,
    /// The gradient's last two axes exchanged, or its entries in reverse where there are none.
    Transposed,
}

impl Mutation {
    /// Every mutation.
    pub const ALL: [Self; 5] =
        [Self::Sign, Self::Factor, Self::Dropped, Self::Overwrites, Self::Transposed];

    /// The wrong gradient, or `None` for none.
    fn apply<T: Scalar>(self, gradient: &[T], shape: &[usize]) -> Option<Vec<T>> {
        let percent = T::from_f64(1.01);
        match self {
            Self::Sign => Some(gradient.iter().map(|&entry| -entry).collect()),
            Self::Factor => Some(gradient.iter().map(|&entry| entry * percent).collect()),
            Self::Dropped => None,
            Self::Overwrites => Some(gradient.to_vec()),
            Self::Transposed => Some(match *shape {
                [.., rows, columns] if rows > 1 && columns > 1 => {
                    let from = |k: usize| {
                        let (matrix, entry) = (k / (rows * columns), k % (rows * columns));
                        matrix * rows * columns + entry % rows * columns + entry / rows
                    };
                    (0..gradient.len()).map(|k| gradient[from(k)]).collect()
                }
                _ => gradient.iter().rev().copied().collect(),
            }),
        }
    }
}

/// The identity, with a mutation of its backward pass.
#[derive(Debug)]
struct WrongIdentity(Mutation);

impl<T: Scalar> Op<T> for WrongIdentity {
    type Saved = ();
    type Error = TensorError;

    fn name(&self) -> &'static str {
        "wrong identity"
    }

    fn forward(
        &self,
        inputs: &Inputs<'_, T>,
        outputs: &mut Outputs<'_, T>,
        (): &mut (),
    ) -> Result<(), TensorError> {
        outputs.push_renamed(inputs.shape(0), 0);
        Ok(())
    }

    fn backward(&self, kept: &Kept<'_, T>, (): &mut (), gradients: &mut Accumulators<'_, T>) {
        let Some(gradient) = gradients.get(0) else { return };
        let wrong = self.0.apply(kept.only_upstream(), kept.input_shape(0));
        match (self.0, wrong) {
            (_, None) => {}
            (Mutation::Overwrites, Some(wrong)) => gradient.entries().copy_from_slice(&wrong),
            (_, Some(wrong)) => gradient.add(&wrong),
        }
    }
}

/// A subject whose adjoint is wrong for one input.
#[derive(Debug)]
struct Mutant {
    subject: Arc<dyn AnySubject>,
    mutation: Mutation,
    input: usize,
}

impl Mutant {
    /// The inputs, one of them behind a wrong identity.
    fn mutated<'t, T: Scalar>(
        &self,
        tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Vec<Var<'t, T>>, TensorError> {
        let mut inputs = inputs.to_vec();
        if let Some(input) = inputs.get_mut(self.input) {
            *input = tape.apply(WrongIdentity(self.mutation), &[*input])?;
        }
        Ok(inputs)
    }
}

impl AnySubject for Mutant {
    fn apply_f32<'t>(&self, tape: &'t Tape<f32>, inputs: &[Var<'t, f32>]) -> Applied<'t, f32> {
        self.subject.apply_f32(tape, &self.mutated(tape, inputs)?)
    }
    fn apply_f64<'t>(&self, tape: &'t Tape<f64>, inputs: &[Var<'t, f64>]) -> Applied<'t, f64> {
        self.subject.apply_f64(tape, &self.mutated(tape, inputs)?)
    }
    fn apply_dual<'t>(
        &self,
        tape: &'t Tape<Dual<f64>>,
        inputs: &[Var<'t, Dual<f64>>],
    ) -> Applied<'t, Dual<f64>> {
        self.subject.apply_dual(tape, &self.mutated(tape, inputs)?)
    }
}

/// How many wrong adjoints a check caught. `Display` gives a line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Kills {
    /// The subject's name.
    pub name: String,
    /// Wrong adjoints that were tried: those that differ from the right one in some case.
    pub tried: usize,
    /// Those that passed every law.
    pub survivors: Vec<(Mutation, usize)>,
}

impl Kills {
    /// The share of wrong adjoints that were caught; `None` where there was none to catch.
    pub fn rate(&self) -> Option<f64> {
        let caught = (self.tried - self.survivors.len()) as f64;
        (self.tried > 0).then(|| caught / self.tried as f64)
    }
}

impl fmt::Display for Kills {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let caught = self.tried - self.survivors.len();
        write!(f, "{}: {caught} of {} wrong adjoints caught", self.name, self.tried)?;
        if let Some(rate) = self.rate() {
            write!(f, " ({:.0} %)", 100.0 * rate)?;
        }
        for (mutation, input) in &self.survivors {
            write!(f, "; not caught: {mutation:?} for in{input}")?;
        }
        Ok(())
    }
}

/// Tries every mutation for every input of `trials`, whose adjoints are right.
pub(crate) fn kills(name: &str, trials: &[Trial], breaks_a_law: impl Fn(Case) -> bool) -> Kills {
    let inputs = trials.iter().map(|trial| trial.case.inputs.len()).max().unwrap_or(0);
    let mut kills = Kills { name: name.to_owned(), tried: 0, survivors: Vec::new() };
    for mutation in Mutation::ALL {
        for input in 0..inputs {
            let differs = |trial: &&Trial| {
                let gradient = trial.nominal.gradients.get(input).and_then(Option::as_ref);
                gradient.is_some_and(|gradient| is_wrong(mutation, gradient))
            };
            let mutants = trials.iter().filter(differs).map(|trial| {
                let Case { subject, inputs } = trial.case.clone();
                Case { subject: Arc::new(Mutant { subject, mutation, input }), inputs }
            });
            let mut mutants = mutants.peekable();
            if mutants.peek().is_none() {
                continue;
            }
            kills.tried += 1;
            if !mutants.any(&breaks_a_law) {
                kills.survivors.push((mutation, input));
            }
        }
    }
    kills
}

/// Whether the mutation changes what a gradient of `gradient` becomes.
fn is_wrong(mutation: Mutation, gradient: &Tensor<f64>) -> bool {
    // What it overwrites need not be 0.
    mutation == Mutation::Overwrites && gradient.size() > 0
        || match mutation.apply(gradient.data(), gradient.shape()) {
            None => gradient.data().iter().any(|&entry| entry != 0.0),
            Some(wrong) => wrong != gradient.data(),
        }
}
