//! Nonlinear least-squares problems as pipelines on the tape.
//!
//! # Forward
//! `f(x) = sum_i r_i(x)^2`, without a factor of 1/2, as in the literature's tables of minima.
//!
//! # The error of a point
//! `(f(x) - f_min) / (f(x_start) - f_min)`: 1 at the start, 0 at the known minimum, whatever the
//! scale of the problem. A point solves a problem to `10^-k` where its error is at most that.
//!
//! # Source
//! More and Wild, *Benchmarking derivative-free optimization algorithms*, SIAM Journal on
//! Optimization 20(1), 2009, eq. (2.2): their convergence test, with the known minimum for `f_L`.

use std::fmt;
use std::ops::Range;

use bokashi_core::{Dual, Scalar, Tape, Tensor, Var};
use bokashi_fit::FitError;

/// The residuals of a problem, for numbers of any kind.
pub trait Residuals: Send + Sync + 'static {
    /// Records the residuals, of any shape, at `x: [n]`.
    ///
    /// # Errors
    /// What the operations refuse.
    fn residuals<'t, T: Scalar>(&self, x: Var<'t, T>) -> Result<Var<'t, T>, FitError>;
}

/// Constants on the tape of `x`, of shape `[m]`.
pub(super) fn constants<'t, T: Scalar>(x: Var<'t, T>, values: &[f64]) -> Var<'t, T> {
    x.tape().constant(&Tensor::from_flat_fn([values.len()], |k| T::from_f64(values[k])))
}

/// [`Residuals`] behind a pointer: in each kind of number that the evaluations need.
trait AnyResiduals: Send + Sync {
    fn plain<'t>(&self, x: Var<'t, f64>) -> Result<Var<'t, f64>, FitError>;
    fn dual<'t>(&self, x: Var<'t, Dual<f64>>) -> Result<Var<'t, Dual<f64>>, FitError>;
}

impl<R: Residuals> AnyResiduals for R {
    fn plain<'t>(&self, x: Var<'t, f64>) -> Result<Var<'t, f64>, FitError> {
        self.residuals(x)
    }

    fn dual<'t>(&self, x: Var<'t, Dual<f64>>) -> Result<Var<'t, Dual<f64>>, FitError> {
        self.residuals(x)
    }
}

/// Where a problem comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Family {
    /// The set of More, Garbow and Hillstrom, and the rotated quadratic.
    Literature,
    /// Our own scenes.
    Scene,
}

/// A least-squares problem with a start and a known minimum.
pub struct Problem {
    name: String,
    family: Family,
    start: Vec<f64>,
    least: f64,
    minimiser: Option<Vec<f64>>,
    blocks: Vec<(&'static str, Range<usize>)>,
    residuals: Box<dyn AnyResiduals>,
}

impl Problem {
    /// A problem whose objective is `least` at its global minimum.
    pub fn new(
        name: impl Into<String>,
        start: Vec<f64>,
        least: f64,
        residuals: impl Residuals,
    ) -> Self {
        let residuals = Box::new(residuals);
        Self {
            name: name.into(),
            family: Family::Literature,
            start,
            least,
            minimiser: None,
            blocks: Vec::new(),
            residuals,
        }
    }

    /// The problem with its minimiser; where there are several, one of them.
    #[must_use]
    pub fn minimiser_at(self, minimiser: impl Into<Vec<f64>>) -> Self {
        Self { minimiser: Some(minimiser.into()), ..self }
    }

    /// The problem as one of our scenes, with its blocks of parameters.
    #[must_use]
    pub fn scene(self, blocks: Vec<(&'static str, Range<usize>)>) -> Self {
        Self { family: Family::Scene, blocks, ..self }
    }

    /// The name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Where it comes from.
    pub fn family(&self) -> Family {
        self.family
    }

    /// Where every optimizer starts.
    pub fn start(&self) -> &[f64] {
        &self.start
    }

    /// The number of parameters.
    pub fn size(&self) -> usize {
        self.start.len()
    }

    /// The objective at the global minimum.
    pub fn least(&self) -> f64 {
        self.least
    }

    /// A minimiser, where one is known to enough digits.
    pub fn minimiser(&self) -> Option<&[f64]> {
        self.minimiser.as_deref()
    }

    /// Named ranges of parameters of one kind; none where all are alike.
    pub fn blocks(&self) -> &[(&'static str, Range<usize>)] {
        &self.blocks
    }

    /// Records the residuals at `x: [n]`.
    ///
    /// # Errors
    /// What the operations refuse.
    pub fn record<'t>(&self, x: Var<'t, f64>) -> Result<Var<'t, f64>, FitError> {
        self.residuals.plain(x)
    }

    /// Records the residuals at `x: [n]` in dual numbers.
    ///
    /// # Errors
    /// What the operations refuse.
    pub fn record_dual<'t>(&self, x: Var<'t, Dual<f64>>) -> Result<Var<'t, Dual<f64>>, FitError> {
        self.residuals.dual(x)
    }

    /// The objective at `x`.
    ///
    /// # Errors
    /// What the operations refuse.
    pub fn objective(&self, x: &[f64]) -> Result<f64, FitError> {
        let tape = Tape::new();
        let x = tape.constant(&Tensor::from_flat_fn([x.len()], |k| x[k]));
        Ok(self.record(x)?.square().sum().item())
    }
}

impl fmt::Debug for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Problem").field("name", &self.name).field("start", &self.start).finish()
    }
}
