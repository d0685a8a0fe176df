//! An operation beside its inputs, and how it is run.

use std::hint::black_box;
use std::time::Instant;

use bokashi_core::{Gradients, Scalar, Tape, Tensor, Var};
use bokashi_fit::FitError;

use crate::bench::difference::relative_error;

/// Records an operation on variables of its inputs, given what else it needs.
pub(crate) type Record<T, S> = for<'t> fn(&S, &[Var<'t, T>]) -> Result<Var<'t, T>, FitError>;

/// An operation and what it is run on.
pub(crate) struct Case<T: Scalar, S> {
    /// The name it has on the tape, and after a comma what it works on.
    pub(crate) label: &'static str,
    pub(crate) inputs: Vec<Tensor<f64>>,
    pub(crate) record: Record<T, S>,
}

impl<T: Scalar, S> Case<T, S> {
    pub(crate) fn name(&self) -> &'static str {
        self.label.split(',').next().unwrap_or(self.label)
    }

    /// The operations that it stands for: its name is one, or several between "and".
    fn has(&self, operation: &str) -> bool {
        self.name().split(" and ").any(|name| name == operation)
    }
}

/// A case in one precision, with its memory.
pub(crate) struct Runner<T: Scalar, S> {
    case: Case<T, S>,
    inputs: Vec<Tensor<T>>,
    /// Of the output, once its shape is known.
    upstream: Option<Tensor<T>>,
    tape: Tape<T>,
}

/// The errors of an output and of the worst gradient, as shares of their largest entries.
pub(crate) fn errors<T: Scalar>(found: &[Tensor<T>], exact: &[Tensor<f64>]) -> [f64; 2] {
    let mut errors = [0.0_f64; 2];
    for (index, (found, exact)) in found.iter().zip(exact).enumerate() {
        let error = &mut errors[index.min(1)];
        *error = error.max(relative_error(found, exact));
    }
    errors
}

/// What a case took: by the tape's own clock, and all that a step does by the clock on the wall.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Seconds {
    pub(crate) forward: f64,
    pub(crate) backward: f64,
    pub(crate) step: f64,
}

impl Seconds {
    /// Both passes.
    pub(crate) fn both(self) -> f64 {
        self.forward + self.backward
    }
}

impl<T: Scalar, S> Runner<T, S> {
    pub(crate) fn new(case: Case<T, S>) -> Self {
        let inputs = case.inputs.iter().map(Tensor::cast).collect();
        let tape = Tape::new();
        tape.set_timed(true);
        Self { case, inputs, upstream: None, tape }
    }

    /// Records and walks back once.
    pub(crate) fn step(&mut self, surroundings: &S) -> Result<Seconds, FitError> {
        Ok(self.look(surroundings, |_, _, gradients| drop(black_box(gradients)))?.1)
    }

    /// Records and walks back once: the output, and the gradients.
    pub(crate) fn results(&mut self, surroundings: &S) -> Result<Vec<Tensor<T>>, FitError> {
        let results = self.look(surroundings, |output, inputs, gradients| {
            let all = inputs.iter().map(|&input| gradients.get_or_zeros(input));
            std::iter::once(output.value()).chain(all).collect()
        });
        Ok(results?.0)
    }

    /// Records and walks back once, with a look at the output, the inputs and the gradients.
    fn look<R>(
        &mut self,
        surroundings: &S,
        look: impl for<'t> FnOnce(Var<'t, T>, &[Var<'t, T>], Gradients<'t, T>) -> R,
    ) -> Result<(R, Seconds), FitError> {
        let start = Instant::now();
        let results = {
            let inputs: Vec<Var<'_, T>> =
                self.inputs.iter().map(|input| self.tape.leaf(input)).collect();
            let output = (self.case.record)(surroundings, &inputs)?;
            // Between 1/2 and 3/2, and exact in f32.
            let entry = |k: usize| T::from_f64(0.5 + (k % 257) as f64 / 256.0);
            let upstream =
                self.upstream.get_or_insert_with(|| Tensor::from_flat_fn(output.shape(), entry));
            look(output, &inputs, self.tape.vjp(&[(output, upstream)])?)
        };
        self.tape.reset();
        let step = start.elapsed().as_secs_f64();
        let report = self.tape.take_report();
        // Of a composition no operation has the name: then all of them count.
        let is_composed = !report.operations.iter().any(|entry| self.case.has(entry.name));
        let counted = report.operations.iter();
        let counted = || counted.clone().filter(|entry| is_composed || self.case.has(entry.name));
        let forward = counted().map(|entry| entry.forward.as_secs_f64()).sum();
        let backward = counted().map(|entry| entry.backward.as_secs_f64()).sum();
        Ok((results, Seconds { forward, backward, step }))
    }
}
