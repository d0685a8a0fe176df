//! A recorded pipeline with its tape.

use std::fmt;

use smallvec::SmallVec;

use crate::error::TensorError;
use crate::record::OutputVars;
use crate::scalar::Scalar;
use crate::tape::Tape;
use crate::tensor::Tensor;
use crate::var::Var;

/// The variables that a recording remembers: what it starts from, and what it computes.
pub type Ends<'t, T> = [OutputVars<'t, T>; 2];

/// Gradients of a recording's inputs; up to four need no allocation.
pub type InputGradients<T> = SmallVec<[Option<Tensor<T>>; 4]>;

/// A recorded pipeline that owns its tape: its inputs and outputs are counted, so it has no lifetime. It can be stored,
/// and sent to another thread, until its gradients are asked for. So other languages get a forward pass and a
/// backward pass that meet at one object.
///
/// ```
/// use bokashi_core::{Recording, Tape, Tensor};
/// use smallvec::smallvec;
///
/// let recording = Recording::new(Tape::<f64>::new(), |tape| {
///     let x = tape.leaf_of([2], &[1.0, 3.0])?;
///     Ok::<_, bokashi_core::TensorError>([smallvec![x], smallvec![x * x]])
/// })?;
/// assert_eq!(recording.value(0).data(), [1.0, 9.0]);
/// let gradients = recording.pull_back(&[Some(&Tensor::full([2], 1.0))])?;
/// assert_eq!(gradients[0].as_ref().unwrap().data(), [2.0, 6.0]);
/// # Ok::<(), bokashi_core::TensorError>(())
/// ```
pub struct Recording<T: Scalar> {
    tape: Tape<T>,
    /// Of inputs and outputs.
    ends: [SmallVec<[u32; 4]>; 2],
}

impl<T: Scalar> Recording<T> {
    /// Records a pipeline on `tape`, whose step begins anew: `record` returns its inputs and its outputs.
    ///
    /// # Errors
    /// Those of `record`. The tape is lost then.
    ///
    /// # Panics
    /// Where `record` returns a variable of another tape.
    pub fn new<E>(
        mut tape: Tape<T>,
        record: impl for<'t> FnOnce(&'t Tape<T>) -> Result<Ends<'t, T>, E>,
    ) -> Result<Self, E> {
        tape.reset();
        let ends = record(&tape)?;
        let ends = ends.map(|of| {
            let index = |variable: Var<'_, T>| {
                let is_own = std::ptr::eq(variable.tape, &tape);
                assert!(is_own, "a recording needs variables of its own tape, got one of another");
                variable.index
            };
            of.into_iter().map(index).collect()
        });
        Ok(Self { tape, ends })
    }

    /// The number of inputs.
    pub fn input_count(&self) -> usize {
        self.ends[0].len()
    }

    /// The number of outputs.
    pub fn output_count(&self) -> usize {
        self.ends[1].len()
    }

    /// The value of the k-th output; shares the buffer on the tape.
    ///
    /// # Panics
    /// Where there is no such output.
    pub fn value(&self, k: usize) -> Tensor<T> {
        self.variable(self.ends[1][k]).value()
    }

    /// The gradient of `sum_k <upstream_k, output_k>` with respect to each input: the vector-Jacobian product. `None`
    /// stands for zeros, above and in what is returned. Inputs that are one variable share one gradient. It can be asked for
    /// as often as one likes.
    ///
    /// # Errors
    /// [`TensorError::Value`] unless there are as many upstream gradients as outputs; those of [`Tape::vjp`].
    pub fn pull_back(
        &self,
        upstream: &[Option<&Tensor<T>>],
    ) -> Result<InputGradients<T>, TensorError> {
        self.pull_back_to(upstream, |_| true)
    }

    /// [`Recording::pull_back`] to the inputs that `is_wanted` says; what leads to none of them is not computed, and the
    /// others get `None`.
    ///
    /// # Errors
    /// As [`Recording::pull_back`].
    pub fn pull_back_to(
        &self,
        upstream: &[Option<&Tensor<T>>],
        is_wanted: impl Fn(usize) -> bool,
    ) -> Result<InputGradients<T>, TensorError> {
        let [inputs, outputs] = &self.ends;
        if upstream.len() != outputs.len() {
            return Err(TensorError::Value {
                operation: "pull_back",
                rule: format!("as many upstream gradients as outputs, {}", outputs.len()).into(),
                value: upstream.len() as f64,
            });
        }
        let seeds: SmallVec<[_; 4]> = outputs
            .iter()
            .zip(upstream)
            .filter_map(|(&output, upstream)| Some((self.variable(output), (*upstream)?)))
            .collect();
        let wanted: SmallVec<[_; 4]> = (0..inputs.len()).filter(|&k| is_wanted(k)).collect();
        let variables: SmallVec<[_; 4]> =
            wanted.iter().map(|&k| self.variable(inputs[k])).collect();
        let mut gradients = self.tape.vjp_to(&seeds, &variables)?;
        let mut taken: InputGradients<T> = inputs.iter().map(|_| None).collect();
        for (&k, &variable) in wanted.iter().zip(&variables) {
            // A variable that is two inputs has one gradient.
            let before = wanted.iter().take_while(|&&before| before < k);
            let before = before.copied().find(|&before| inputs[before] == inputs[k]);
            taken[k] = match before {
                Some(before) => taken[before].clone(),
                None => gradients.take(variable),
            };
        }
        Ok(taken)
    }

    /// The tape, whose step ends: the next recording finds its memory again.
    pub fn into_tape(self) -> Tape<T> {
        let mut tape = self.tape;
        tape.reset();
        tape
    }

    fn variable(&self, index: u32) -> Var<'_, T> {
        Var { tape: &self.tape, index }
    }
}

impl<T: Scalar> fmt::Debug for Recording<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [inputs, outputs] = &self.ends;
        f.debug_struct("Recording")
            .field("inputs", inputs)
            .field("outputs", outputs)
            .field("tape", &self.tape)
            .finish()
    }
}
