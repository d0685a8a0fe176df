//! What is checked: an operation or a whole pipeline, written once for every kind of number.

use std::error::Error;
use std::fmt::Debug;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::Arc;

use bokashi_core::{Dual, Scalar, Tape, Tensor, Var};

/// Why a subject refused its inputs: whatever error its operations return.
pub type Refusal = Box<dyn Error + Send + Sync>;

/// What recording a subject gives.
pub type Applied<'t, T> = Result<Outcome<'t, T>, Refusal>;

/// An operation or a whole pipeline under test.
///
/// It is written for any [`Scalar`], because the checker runs it in `f32`, in `f64`, and over
/// [dual numbers](crate::Dual). [`subject!`](crate::subject) makes one from an expression.
pub trait Subject: Debug + Send + Sync + 'static {
    /// Records the subject on `tape` and returns its outputs, with its discrete state where it has
    /// one.
    ///
    /// # Errors
    /// Inputs for which the subject is not defined.
    fn apply<'t, T: Scalar>(&self, tape: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T>;
}

/// What a subject computed.
#[derive(Debug, Clone)]
pub struct Outcome<'t, T: Scalar> {
    pub(crate) outputs: Vec<Var<'t, T>>,
    pub(crate) state: u64,
}

impl<T: Scalar> Outcome<'_, T> {
    /// Declares discrete state: anything that tells on which smooth piece the inputs lie, such as
    /// triangle ids, edge choices, which side of a clamp. Points are left out of the difference
    /// checks where it changes between the ends of a stencil. Several declarations add up.
    #[must_use]
    pub fn with_state(mut self, state: impl Hash) -> Self {
        let mut hasher = DefaultHasher::new();
        (self.state, state).hash(&mut hasher);
        self.state = hasher.finish();
        self
    }
}

impl<'t, T: Scalar> From<Vec<Var<'t, T>>> for Outcome<'t, T> {
    fn from(outputs: Vec<Var<'t, T>>) -> Self {
        Self { outputs, state: 0 }
    }
}

impl<'t, T: Scalar> From<Var<'t, T>> for Outcome<'t, T> {
    fn from(output: Var<'t, T>) -> Self {
        vec![output].into()
    }
}

impl<'t, T: Scalar, const N: usize> From<[Var<'t, T>; N]> for Outcome<'t, T> {
    fn from(outputs: [Var<'t, T>; N]) -> Self {
        outputs.to_vec().into()
    }
}

/// On which side of each of `kinks` every entry of `x` lies: the discrete state of an operation
/// with kinks at these values.
pub fn sides<T: Scalar>(x: Var<'_, T>, kinks: &[f64]) -> Vec<i8> {
    let sign = |x: f64| i8::from(x > 0.0) - i8::from(x < 0.0);
    let x = x.value();
    x.data().iter().flat_map(|x| kinks.iter().map(move |kink| sign(x.to_f64() - kink))).collect()
}

/// Makes a [`Subject`](crate::Subject) of a name and an expression in its inputs, which may use
/// `?` and yields a variable, several of them, or an [`Outcome`](crate::Outcome). The kind of number
/// is `T`:
///
/// ```
/// use bokashi_check::{Outcome, Scalar, sides, subject};
///
/// subject!(Product: |x| x[0].try_mul(x[1])?);
/// subject!(Double: |x| x[0] * T::from_f64(2.0));
/// subject!(Size: |x| Outcome::from(x[0].abs()).with_state(sides(x[0], &[0.0])));
/// ```
#[macro_export]
macro_rules! subject {
    ($name:ident: |$inputs:ident| $outputs:expr) => {
        #[derive(Debug, Clone, Copy)]
        struct $name;

        impl $crate::Subject for $name {
            fn apply<'t, T: $crate::Scalar>(
                &self,
                _tape: &'t $crate::Tape<T>,
                $inputs: &[$crate::Var<'t, T>],
            ) -> Result<$crate::Outcome<'t, T>, $crate::Refusal> {
                Ok($outputs.into())
            }
        }
    };
}

/// One input of a subject.
#[derive(Debug, Clone, PartialEq)]
pub struct Input {
    /// The value.
    pub tensor: Tensor<f64>,
    /// Whether it has a gradient.
    pub differentiable: bool,
}

impl Input {
    /// An input with a gradient.
    pub fn leaf(tensor: Tensor<f64>) -> Self {
        Self { tensor, differentiable: true }
    }

    /// An input without a gradient.
    pub fn constant(tensor: Tensor<f64>) -> Self {
        Self { tensor, differentiable: false }
    }
}

/// A subject and the inputs it is run on.
#[derive(Debug, Clone)]
pub struct Case {
    pub(crate) subject: Arc<dyn AnySubject>,
    pub(crate) inputs: Vec<Input>,
}

impl Case {
    /// A case of `subject` on `inputs`.
    pub fn new(subject: impl Subject, inputs: impl Into<Vec<Input>>) -> Self {
        Self { subject: Arc::new(subject), inputs: inputs.into() }
    }

    /// What the subject is run on.
    pub fn inputs(&self) -> &[Input] {
        &self.inputs
    }

    /// Records the subject on `tape`, on variables of its inputs or of others, and returns the first of its
    /// outputs.
    ///
    /// # Errors
    /// Inputs for which the subject is not defined.
    pub fn record<'t, T: Number>(
        &self,
        tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Var<'t, T>, Refusal> {
        let outcome = T::apply(&*self.subject, tape, inputs)?;
        outcome.outputs.first().copied().ok_or_else(|| "a subject needs an output, got none".into())
    }

    /// The error with which the subject refuses the inputs; `None` where it takes them.
    pub(crate) fn error<T: Number>(&self) -> Option<Refusal> {
        let tape = Tape::<T>::new();
        let leaf = |input: &Input| tape.leaf(&input.tensor.cast());
        let inputs: Vec<_> = self.inputs.iter().map(leaf).collect();
        T::apply(&*self.subject, &tape, &inputs).err()
    }

    /// Whether `f32` has all numbers of the inputs, though rounded: no number becomes 0 or infinite.
    pub(crate) fn is_held_by_single(&self) -> bool {
        let entries = self.inputs.iter().flat_map(|input| input.tensor.data());
        let is_held = |x: f64, single: f32| {
            (x == 0.0) == (single == 0.0) && x.is_infinite() == single.is_infinite()
        };
        entries.copied().all(|x| is_held(x, x as f32))
    }
}

/// A [`Subject`] whose type is forgotten, so that the laws are compiled once and not for every
/// subject. They need it for three kinds of numbers alone.
pub trait AnySubject: Debug + Send + Sync {
    fn apply_f32<'t>(&self, tape: &'t Tape<f32>, inputs: &[Var<'t, f32>]) -> Applied<'t, f32>;
    fn apply_f64<'t>(&self, tape: &'t Tape<f64>, inputs: &[Var<'t, f64>]) -> Applied<'t, f64>;
    fn apply_dual<'t>(
        &self,
        tape: &'t Tape<Dual<f64>>,
        inputs: &[Var<'t, Dual<f64>>],
    ) -> Applied<'t, Dual<f64>>;
}

impl<S: Subject> AnySubject for S {
    fn apply_f32<'t>(&self, tape: &'t Tape<f32>, inputs: &[Var<'t, f32>]) -> Applied<'t, f32> {
        self.apply(tape, inputs)
    }
    fn apply_f64<'t>(&self, tape: &'t Tape<f64>, inputs: &[Var<'t, f64>]) -> Applied<'t, f64> {
        self.apply(tape, inputs)
    }
    fn apply_dual<'t>(
        &self,
        tape: &'t Tape<Dual<f64>>,
        inputs: &[Var<'t, Dual<f64>>],
    ) -> Applied<'t, Dual<f64>> {
        self.apply(tape, inputs)
    }
}

/// The kinds of numbers that subjects are run in: `f32`, `f64`, and [dual numbers](crate::Dual) of `f64`.
pub trait Number: Scalar {
    #[doc(hidden)]
    fn apply<'t>(
        subject: &dyn AnySubject,
        tape: &'t Tape<Self>,
        inputs: &[Var<'t, Self>],
    ) -> Applied<'t, Self>;
}

macro_rules! number {
    ($t:ty, $apply:ident) => {
        impl Number for $t {
            fn apply<'t>(
                subject: &dyn AnySubject,
                tape: &'t Tape<Self>,
                inputs: &[Var<'t, Self>],
            ) -> Applied<'t, Self> {
                subject.$apply(tape, inputs)
            }
        }
    };
}

number!(f32, apply_f32);
number!(f64, apply_f64);
number!(Dual<f64>, apply_dual);
