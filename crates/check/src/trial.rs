//! One case with its upstream gradients, run once: what every law looks at.

use bokashi_core::Tensor;

use crate::failure::Broken;
use crate::run::{Point, Run, forward, noise, point, run};
use crate::subject::Case;

/// Bounds on rounding, as multiples of the unit roundoff: a few dozen roundings between inputs
/// and outputs.
pub(crate) const ROUNDINGS: f64 = 64.0;

/// A gradient counts as zero where a step in `x` changes `<u, out>` by less than this of
/// `sum |u out|`: the rounding of `f32`.
pub(crate) const NEGLIGIBLE: f64 = 1e-6;

/// A case under test.
#[derive(Debug, Clone)]
pub(crate) struct Trial {
    pub(crate) case: Case,
    /// Per output.
    pub(crate) upstream: Vec<Tensor<f64>>,
    pub(crate) point: Point<f64>,
    /// What the case gives in `f64`.
    pub(crate) nominal: Run<f64>,
}

/// Why a case can't be tried.
#[derive(Debug)]
pub(crate) enum Unfit {
    /// The subject refuses the inputs.
    Refused(String),
    /// It is not defined on inputs that it takes.
    Broken(Broken),
}

impl Trial {
    /// Runs `case` with the given upstream gradients, or with some of all sizes.
    pub(crate) fn new(case: Case, upstream: Option<Vec<Tensor<f64>>>) -> Result<Self, Unfit> {
        let point = point(&case.inputs);
        let refused = |error: crate::Refusal| Unfit::Refused(error.to_string());
        let (outputs, _) = forward(&*case.subject, &point).map_err(refused)?;
        let upstream =
            upstream.unwrap_or_else(|| outputs.iter().zip(1..).map(|(y, j)| noise(y, j)).collect());
        let shapes = |tensors: &[Tensor<f64>]| -> Vec<_> {
            tensors.iter().map(|tensor| tensor.shape().clone()).collect()
        };
        if shapes(&upstream) != shapes(&outputs) {
            return Err(Unfit::Refused("other outputs than upstream gradients".to_owned()));
        }
        let nominal = run(&*case.subject, &point, &upstream).map_err(refused)?;
        let broken = |what: &str, k: usize| {
            let what = format!("{what}{k} is not finite");
            Err(Unfit::Broken(Broken::from_message(what)))
        };
        if let Some(j) = nominal.outputs.iter().position(|y| !y.is_finite()) {
            return broken("out", j);
        }
        for (i, (gradient, input)) in nominal.gradients.iter().zip(&case.inputs).enumerate() {
            match gradient {
                Some(gradient) if !gradient.is_finite() => {
                    return broken("the gradient of in", i);
                }
                Some(_) if !input.differentiable => {
                    let what = format!("in{i} is a constant and got a gradient");
                    return Err(Unfit::Broken(Broken::from_message(what)));
                }
                _ => {}
            }
        }
        Ok(Self { case, upstream, point, nominal })
    }

    /// `sum |u out|`, against which the rounding of `<u, out>` is measured.
    pub(crate) fn size(&self) -> f64 {
        crate::run::dot(&self.nominal.outputs, &self.upstream).1
    }

    /// The differentiable inputs: index and gradient.
    pub(crate) fn gradients(&self) -> impl Iterator<Item = (usize, &Tensor<f64>)> {
        let gradients = self.nominal.gradients.iter().enumerate();
        gradients.filter_map(|(i, gradient)| Some((i, gradient.as_ref()?)))
    }
}

/// What a law looked at.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Tally {
    /// Numbers that were compared.
    pub compared: u64,
    /// Points that told nothing: the discrete state changes within the stencil, or the error bar
    /// is too wide.
    pub left_out: u64,
    /// The largest error in units of its bound.
    pub worst: f64,
}

impl Tally {
    /// Counts a comparison with a bound; breaks where the error is larger, or is NaN.
    pub(crate) fn compare(
        &mut self,
        (got, expected): (f64, f64),
        bound: f64,
        what: impl FnOnce() -> String,
    ) -> Result<(), Broken> {
        self.compared += 1;
        let error = (got - expected).abs();
        if !approx::abs_diff_eq!(got, expected, epsilon = bound) {
            return Err(Broken::numbers(what(), got, expected, bound));
        }
        if error > 0.0 {
            self.worst = self.worst.max(error / bound);
        }
        Ok(())
    }

    /// Counts the numbers of `x` and `y`, which have the same bits; breaks where they have not.
    pub(crate) fn same_bits<T: bokashi_core::Scalar>(
        &mut self,
        got: &Tensor<T>,
        expected: &Tensor<T>,
        what: impl Fn() -> String,
    ) -> Result<(), Broken> {
        if got.shape() != expected.shape() {
            let (got, expected) = (got.shape(), expected.shape());
            return Err(Broken::from_message(format!(
                "{}: shape {got} instead of {expected}",
                what()
            )));
        }
        self.compared += got.size() as u64;
        match crate::run::first_difference(got, expected) {
            None => Ok(()),
            Some(k) => {
                let entry_name = crate::failure::entry("", got.shape(), k);
                let (got, expected) = (got.data()[k].to_f64(), expected.data()[k].to_f64());
                Err(Broken::numbers(format!("{}{entry_name}", what()), got, expected, 0.0))
            }
        }
    }

    /// Adds what another case gave.
    pub(crate) fn add(&mut self, other: Self) {
        self.compared += other.compared;
        self.left_out += other.left_out;
        self.worst = self.worst.max(other.worst);
    }
}
