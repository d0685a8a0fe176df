//! A parameter: a named array with its rate and its moments.

use bokashi_core::{Scalar, Tensor, Var};

use super::mapping::Mapping;
use crate::error::FitError;
use crate::preconditioner::Preconditioner;

/// A named array that an optimizer changes, with its rate, its mapping and its moments.
#[derive(Debug, Clone)]
pub struct Parameter<T> {
    pub(super) name: String,
    /// The values until the parameter is added to a list, and then the raw numbers.
    pub(crate) raw: Tensor<T>,
    pub(crate) rate: f64,
    pub(crate) mapping: Mapping,
    pub(crate) preconditioner: Option<Preconditioner>,
    /// Whether Adam divides all entries by one number.
    pub(crate) is_uniform: bool,
    pub(crate) frozen: bool,
    /// Whether a loss may do without it.
    pub(crate) is_optional: bool,
    /// Adam's moving average of the gradient; empty until the first update.
    pub(crate) first: Vec<T>,
    /// Adam's moving average of the squared gradient.
    pub(crate) second: Vec<T>,
    /// AMSGrad's largest average square; empty unless it is used.
    pub(crate) greatest: Vec<T>,
    /// The number of updates of the moving averages.
    pub(crate) updates: u64,
    /// The number of entries whose last update vanished.
    pub(crate) vanished: usize,
}

/// What a list checks of a preconditioned parameter.
const SHAPE: &str = "a preconditioned parameter has a row for each vertex";

/// The default rate, as usual for Adam.
const DEFAULT_RATE: f64 = 1e-3;

impl<T: Scalar> Parameter<T> {
    /// A parameter that starts at `value`, with a rate of 1e-3 and no mapping.
    pub fn new(name: impl Into<String>, value: Tensor<T>) -> Self {
        Self {
            name: name.into(),
            raw: value,
            rate: DEFAULT_RATE,
            mapping: Mapping::Identity,
            preconditioner: None,
            is_uniform: false,
            frozen: false,
            is_optional: false,
            first: Vec::new(),
            second: Vec::new(),
            greatest: Vec::new(),
            updates: 0,
            vanished: 0,
        }
    }

    /// The parameter with another learning rate. A rate of 0 freezes it.
    #[must_use]
    pub fn rate(self, rate: f64) -> Self {
        Self { rate, ..self }
    }

    /// The parameter with its values restricted by `mapping`; it starts at the same value.
    #[must_use]
    pub fn mapping(self, mapping: Mapping) -> Self {
        Self { mapping, ..self }
    }

    /// The parameter, of numbers at the vertices of a mesh (`[V]` or `[V, C]`), learnt as
    /// `raw = (I + lambda L) value`; it starts at the same value. Steps in raw are smooth steps in value,
    /// so rates can be large and vertices do not tangle. Also makes the parameter
    /// [uniform](Parameter::uniform), as in the paper. It goes with no mapping.
    ///
    /// A fit that is saved has the raw numbers; to be resumed it needs the preconditioner again.
    #[must_use]
    pub fn preconditioned(self, preconditioner: &Preconditioner) -> Self {
        let preconditioner = Some(preconditioner.clone());
        Self { preconditioner, is_uniform: true, ..self }
    }

    /// The parameter as a uniform one: Adam and AMSGrad divide all entries by the root of their largest average square.
    /// Steps then have the direction of the average gradient, and entries with small gradients make small steps.
    #[must_use]
    pub fn uniform(self) -> Self {
        Self { is_uniform: true, ..self }
    }

    /// The preconditioner, if there is one.
    pub fn preconditioner(&self) -> Option<&Preconditioner> {
        self.preconditioner.as_ref()
    }

    /// The mapping from the raw numbers to the value.
    pub fn mapped_by(&self) -> Mapping {
        self.mapping
    }

    /// Whether two parameters have the same name, shape, learning rate, mapping and preconditioner. Also both or
    /// neither must be uniform, and frozen.
    pub fn is_like(&self, other: &Self) -> bool {
        (self.name(), self.raw.shape()) == (other.name(), other.raw.shape())
            && (self.rate, self.mapping, self.frozen) == (other.rate, other.mapping, other.frozen)
            && (self.is_uniform, &self.preconditioner) == (other.is_uniform, &other.preconditioner)
    }

    /// The parameter frozen at its value. It is recorded as a constant and costs no gradient.
    #[must_use]
    pub fn frozen(self) -> Self {
        Self { frozen: true, ..self }
    }

    /// The parameter as an optional one: the loss of the first step need not depend on it. Otherwise a fit refuses a
    /// parameter without influence ([`FitError::NoInfluence`](crate::FitError::NoInfluence)).
    #[must_use]
    pub fn optional(self) -> Self {
        Self { is_optional: true, ..self }
    }

    /// The name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Whether updates leave the parameter alone.
    pub fn is_frozen(&self) -> bool {
        self.frozen || self.rate == 0.0
    }

    /// The number of entries whose last update was not zero and yet changed nothing: it was below half a unit in the
    /// last place. If there are many, the precision is too low, the rate has become too small, or a gradient was far
    /// too large.
    pub fn vanished(&self) -> usize {
        self.vanished
    }

    /// The raw numbers, which the optimizer moves.
    pub fn raw(&self) -> &Tensor<T> {
        &self.raw
    }

    /// The value: the mapping, or the preconditioner, applied to the raw numbers.
    pub fn value(&self) -> Tensor<T> {
        if let Some(preconditioner) = &self.preconditioner {
            return preconditioner.value(&self.raw).expect(SHAPE);
        }
        match self.mapping {
            Mapping::Identity => self.raw.clone(),
            mapping => self.raw.map(|raw| mapping.value(raw)),
        }
    }

    /// The value of a parameter of one entry. Allocates nothing.
    ///
    /// # Panics
    /// Where the parameter has any other number of entries.
    #[track_caller]
    pub fn item(&self) -> T {
        match self.preconditioner {
            // A vertex alone has no neighbour.
            Some(_) => self.raw.item(),
            None => self.mapping.value(self.raw.item()),
        }
    }

    /// Records the value of the raw numbers `raw`.
    pub(super) fn record<'t>(&self, raw: Var<'t, T>) -> Var<'t, T> {
        match &self.preconditioner {
            Some(preconditioner) => preconditioner.record(raw).expect(SHAPE),
            None => self.mapping.record(raw),
        }
    }

    /// Checks that the preconditioner, if there is one, has a vertex for each row.
    pub(super) fn check_preconditioner(&self) -> Result<(), FitError> {
        let Some(preconditioner) = &self.preconditioner else { return Ok(()) };
        if self.mapping != Mapping::Identity {
            let given = format!("{:?} for {:?}", self.mapping, self.name);
            return Err(FitError::setting("a preconditioned parameter", "no mapping", given));
        }
        Ok(preconditioner.check(self.raw.shape())?)
    }

    /// Sets the value.
    pub(super) fn set(&mut self, value: &Tensor<T>) -> Result<(), FitError> {
        let raw = match self.mapping {
            Mapping::Identity => match &self.preconditioner {
                Some(preconditioner) => preconditioner.raw(value)?,
                None => value.clone(),
            },
            mapping => value.map(|value| mapping.raw(value)),
        };
        if let Some(k) = raw.data().iter().position(|raw| !raw.is_finite()) {
            let value = format!("{} in {:?}", value.data()[k], self.name);
            return Err(FitError::setting("parameter", self.mapping.rule(), value));
        }
        self.raw = raw;
        Ok(())
    }

    /// The first entry of the value that is not finite. For a preconditioned parameter it is one of the raw numbers,
    /// since finite ones have a finite value.
    pub(super) fn not_finite(&self) -> Option<f64> {
        let values = self.raw.data().iter().map(|&raw| self.mapping.value(raw));
        values.map(Scalar::to_f64).find(|value| !value.is_finite())
    }
}
