//! A tape-based reverse-mode automatic differentiation engine.
//!
//! Values live on a [`Tape`]; a [`Var`] is a handle to one of them, with operators, so that a
//! computation reads as mathematics. [`Var::backward`] gives the gradient of a scalar with
//! respect to every leaf:
//!
//! ```
//! use bokashi_core::{Tape, Tensor};
//!
//! let tape = Tape::<f64>::new();
//! let x = tape.leaf(&Tensor::new([2], vec![1.0, 2.0])?);
//! let loss = (x * x).sum();
//! let gradients = loss.backward()?;
//! assert_eq!(gradients.get(x).unwrap().data(), [2.0, 4.0]);
//! # Ok::<(), bokashi_core::TensorError>(())
//! ```
//!
//! # What there is
//!
//! | topic | what |
//! |---|---|
//! | a step | [`Tape`], [`Var`], [`Tensor`], [`Shape`]; [`leaf`](Tape::leaf), [`constant`](Tape::constant), [`leaf_scalar`](Tape::leaf_scalar), [`constant_scalar`](Tape::constant_scalar), [`reset`](Tape::reset) |
//! | gradients | [`backward`](Var::backward), [`backward_to`](Var::backward_to), [`Tape::vjp`], [`detach`](Var::detach), [`Gradients`]; [`jvp`] and [`hvp`], products with a Jacobian and a Hessian, over [`Dual`] numbers, or [`ForwardDual`] ones where no backward pass runs |
//! | pairs of entries, with broadcasting | `+`, `-`, `*`, `/`; [`try_add`](Var::try_add), [`try_sub`](Var::try_sub), [`try_mul`](Var::try_mul), [`try_div`](Var::try_div), [`pow`](Var::pow), [`minimum`](Var::minimum), [`maximum`](Var::maximum) |
//! | each entry | [`exp`](Var::exp), [`ln`](Var::ln), [`sqrt`](Var::sqrt), [`square`](Var::square), [`powi`](Var::powi), [`powf`](Var::powf), [`sin`](Var::sin), [`cos`](Var::cos), [`tanh`](Var::tanh), [`sigmoid`](Var::sigmoid), [`softplus`](Var::softplus), [`relu`](Var::relu), [`abs`](Var::abs), [`clamp`](Var::clamp), [`affine`](Var::affine) |
//! | truth values | [`is_less`](Var::is_less), [`is_at_most`](Var::is_at_most), [`is_greater`](Var::is_greater), [`is_at_least`](Var::is_at_least), [`is_finite`](Var::is_finite); [`Mask`], [`Mask::select`] |
//! | sums and means | [`sum`](Var::sum), [`sum_axis`](Var::sum_axis), [`mean`](Var::mean), [`mean_axis`](Var::mean_axis); [`squared_error`], [`mean_squared_error`] |
//! | vectors along the last axis | [`dot`](Var::dot), [`cross`](Var::cross), [`norm`](Var::norm), [`normalize`](Var::normalize) |
//! | matrices | [`matmul`](Var::matmul), [`transpose`](Var::transpose); [`SparseMatrix`], [`SparseMatrix::product`] |
//! | shapes | [`reshape`](Var::reshape), [`keepdim`](Var::keepdim), [`permute`](Var::permute), [`slice`](Var::slice), [`pad`](Var::pad), [`concat`](Var::concat), [`stack`](Var::stack) |
//! | rows by index | [`gather_rows`](Var::gather_rows), [`scatter_add_rows`](Var::scatter_add_rows) |
//! | without lifetimes | [`Recording`]: a pipeline with its tape, its values and its pull-back, for other languages; [`leaf_of`](Tape::leaf_of), [`constant_of`](Tape::constant_of), [`Tensor::from_owner`], [`Gradients::take`]: arrays of others come and go without a copy more |
//! | many parts | [`Tape::sum_over`]: a sum whose terms have tapes of their own, on many threads |
//! | what happened | [`Tape::take_report`], [`TapeReport`]: calls, times, bytes, and what was left out; [`value_errors`] and [`gradient_errors`], one precision against another; [`Dependence`] |
//!
//! # What returns a `Result`, and what panics
//!
//! A method that can be refused, for a shape, an axis, a bound or a variable of another tape, returns
//! a `Result`. Its error says the rule and then the value, and the tape is as it was. A method that
//! cannot be refused (`exp`, `sum`, `abs`) returns its value.
//!
//! Operators and reading panic, at the caller's line. `x + y` panics where `x.try_add(y)` returns the
//! error, and so for `-`, `*` and `/`. `t[[i, j]]` panics outside the shape, and `item()` for anything
//! but a single entry. A constructor from a shape alone (`zeros`, `full`, `from_fn`) panics where the
//! shape has more entries than fit into memory. So does a gradient that is asked of another tape.
//!
//! An output that can be far larger than the inputs, such as that of a broadcast, is refused before its
//! memory is taken: where the allocator has none, and from 2^40 entries on.
//!
//! # An operation of your own
//!
//! It implements [`Op`], as the built-in operations do. A mistake of its author panics, and nothing is
//! recorded: an input that it reads and did not keep, say.
//!
//! # Determinism and memory
//!
//! Results are bitwise the same for any number of threads, and a step that repeats the last one
//! allocates nothing on one thread.

mod axis;
mod backward;
mod broadcast;
mod comparison;
mod conversion;
mod copies;
mod dependence;
mod dual;
mod elementwise;
mod entries;
mod error;
mod gradient;
mod grouping;
mod inequality;
mod joining;
mod length;
mod listed_rows;
mod logistic;
mod mask;
#[doc(hidden)]
pub mod mixing;
mod node;
mod op;
mod pool;
mod power;
// Unit tests compile what they call.
#[cfg(all(feature = "precompiled", not(test)))]
#[doc(hidden)]
pub mod precompiled;
mod preference;
mod products;
mod record;
mod recording;
mod reduction;
mod report;
mod scalar;
mod shape;
mod sparse;
mod sum_over;
mod summation;
mod tape;
mod tensor;
mod value;
mod var;
mod vectors;
mod walk;

pub mod ops;
pub mod parallel;

pub use backward::Gradients;
pub use comparison::{gradient_errors, value_errors};
pub use dependence::Dependence;
pub use dual::{Dual, ForwardDual};
pub use error::TensorError;
pub use gradient::{Accumulator, Accumulators};
pub use mask::Mask;
pub use op::{Inputs, Keep, Kept, Op, Outputs};
pub use ops::{Padding, mean_squared_error, squared_error};
pub use products::{hvp, jvp};
pub use record::OutputVars;
pub use recording::{Ends, InputGradients, Recording};
pub use report::{LeftOut, OperationReport, TapeReport, ValueError};
pub use scalar::Scalar;
pub use shape::Shape;
pub use sparse::SparseMatrix;
pub use sum_over::{PartialSum, covered, halves};
pub use summation::sum;
pub use tape::Tape;
pub use tensor::Tensor;
pub use var::Var;
