//! One named array, with its rate and its moments.

use bokashi_core::{Scalar, Tensor};

use super::mapping::Mapping;
use crate::error::FitError;

/// A named array with what an optimizer needs to change it.
#[derive(Debug, Clone)]
pub struct Parameter<T> {
    pub(super) name: String,
    /// Values until the parameter joins a list, raw numbers from then on.
    pub(crate) raw: Tensor<T>,
    pub(crate) rate: f64,
    pub(crate) mapping: Mapping,
    pub(crate) frozen: bool,
    /// Whether a loss may do without it.
    pub(crate) is_optional: bool,
    /// Adam's moving average of the gradient; empty until the first update.
    pub(crate) first: Vec<T>,
    /// Adam's moving average of the squared gradient.
    pub(crate) second: Vec<T>,
    /// AMSGrad's largest average square; empty unless it is used.
    pub(crate) greatest: Vec<T>,
    /// How many updates the moving averages have seen.
    pub(crate) updates: u64,
    /// How many entries the last update should have moved and did not.
    pub(crate) vanished: usize,
}

/// The rate of a parameter that was given none: Adam's usual one.
const DEFAULT_RATE: f64 = 1e-3;

impl<T: Scalar> Parameter<T> {
    /// A parameter that starts at `value`, with a rate of 1e-3 and no mapping.
    pub fn new(name: impl Into<String>, value: Tensor<T>) -> Self {
        Self {
            name: name.into(),
            raw: value,
            rate: DEFAULT_RATE,
            mapping: Mapping::Identity,
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

    /// What leads from the raw numbers to the value.
    pub fn mapped_by(&self) -> Mapping {
        self.mapping
    }

    /// Whether both have the same name, shape, learning rate and mapping, and neither or both are
    /// frozen.
    pub fn is_like(&self, other: &Self) -> bool {
        (self.name(), self.raw.shape()) == (other.name(), other.raw.shape())
            && (self.rate, self.mapping, self.frozen) == (other.rate, other.mapping, other.frozen)
    }

    /// The parameter held at its value: recorded as a constant, it costs no gradient.
    #[must_use]
    pub fn frozen(self) -> Self {
        Self { frozen: true, ..self }
    }

    /// The parameter, which a pipeline may now leave unused when a fit starts, and use later. Every
    /// other parameter needs a way to the loss in a fit's first step
    /// ([`FitError::NoWay`](crate::FitError::NoWay)).
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

    /// How many entries the last update left as they were though it was not zero: it was below half
    /// a unit of their last place. Many of them say that the numbers of the fit are too short, the
    /// rate has become too small, or a gradient was once far too large.
    pub fn vanished(&self) -> usize {
        self.vanished
    }

    /// What the optimizer moves.
    pub fn raw(&self) -> &Tensor<T> {
        &self.raw
    }

    /// The value: the mapping of the raw numbers.
    pub fn value(&self) -> Tensor<T> {
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
        self.mapping.value(self.raw.item())
    }

    /// Makes `value` the value.
    pub(super) fn set(&mut self, value: &Tensor<T>) -> Result<(), FitError> {
        let raw = match self.mapping {
            Mapping::Identity => value.clone(),
            mapping => value.map(|value| mapping.raw(value)),
        };
        if let Some(k) = raw.data().iter().position(|raw| !raw.is_finite()) {
            let value = format!("{} in {:?}", value.data()[k], self.name);
            return Err(FitError::setting("parameter", self.mapping.rule(), value));
        }
        self.raw = raw;
        Ok(())
    }

    /// The first entry of the value that is not finite.
    pub(super) fn not_finite(&self) -> Option<f64> {
        let values = self.raw.data().iter().map(|&raw| self.mapping.value(raw));
        values.map(Scalar::to_f64).find(|value| !value.is_finite())
    }
}
