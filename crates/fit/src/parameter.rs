//! Named parameters: what a fit changes.
//!
//! Each parameter has a learning rate of its own and, where its values are restricted, a mapping
//! from *raw* numbers that an optimizer may move freely: `value = mapping(raw)`. Gradients and
//! rates are those of the raw numbers.

use std::sync::Arc;

use bokashi_core::{Scalar, Tape, Tensor, Var};
use smallvec::SmallVec;

use crate::error::{FitError, Quantity};

/// A smooth one-to-one map from all numbers to the allowed ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[cfg_attr(feature = "save", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "save", serde(rename_all = "kebab-case", deny_unknown_fields))]
#[non_exhaustive]
pub enum Mapping {
    /// All numbers: `value = raw`.
    #[default]
    Identity,
    /// Positive numbers: `value = ln(1 + e^raw)`, which is `raw` for large ones. Steps in raw are
    /// steps of about the same size in value.
    Softplus,
    /// Positive numbers: `value = e^raw`. Steps in raw are relative steps in value.
    Exp,
}

impl Mapping {
    /// The value of `raw`, bitwise as [`Mapping::record`] computes it.
    pub fn value<T: Scalar>(self, raw: T) -> T {
        match self {
            Self::Identity => raw,
            Self::Softplus => raw.greater(T::ZERO) + (-raw.abs()).exp().ln_1p(),
            Self::Exp => raw.exp(),
        }
    }

    /// The raw number of `value`: the inverse, rounded from `f64`. Infinite or NaN for a value
    /// that the mapping does not reach.
    pub fn raw<T: Scalar>(self, value: T) -> T {
        let y = value.to_f64();
        T::from_f64(match self {
            Self::Identity => return value,
            // ln(e^y - 1), which overflows for large y.
            Self::Softplus => y + (-(-y).exp_m1()).ln(),
            Self::Exp => y.ln(),
        })
    }

    /// Records the values of `raw`.
    pub fn record<T: Scalar>(self, raw: Var<'_, T>) -> Var<'_, T> {
        match self {
            Self::Identity => raw,
            Self::Softplus => raw.softplus(),
            Self::Exp => raw.exp(),
        }
    }

    /// The rule that values obey, as the end of "... needs ...".
    fn rule(self) -> &'static str {
        match self {
            Self::Identity => "finite entries",
            Self::Softplus | Self::Exp => "finite entries above 0 under its mapping",
        }
    }
}

/// A named array with what an optimizer needs to change it.
#[derive(Debug, Clone)]
pub struct Parameter<T> {
    name: String,
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

    /// The parameter held at its value: recorded as a constant, it costs no gradient.
    #[must_use]
    pub fn frozen(self) -> Self {
        Self { frozen: true, ..self }
    }

    /// The parameter as one that a pipeline may leave unused when a fit starts, and use later. Of
    /// any other, a fit's first step needs a way to the loss
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

    /// Whether both have the same name, shape, learning rate and mapping, and neither or both are
    /// frozen.
    pub fn is_like(&self, other: &Self) -> bool {
        (self.name(), self.raw.shape()) == (other.name(), other.raw.shape())
            && (self.rate, self.mapping, self.frozen) == (other.rate, other.mapping, other.frozen)
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

    /// The value that `raw` stands for.
    pub fn value_at(&self, raw: Tensor<T>) -> Tensor<T> {
        match self.mapping {
            Mapping::Identity => raw,
            mapping => raw.map(|raw| mapping.value(raw)),
        }
    }

    /// The first entry of the value: the value of a scalar. Allocates nothing.
    ///
    /// # Panics
    /// Where the parameter has no entry.
    pub fn item(&self) -> T {
        self.mapping.value(self.raw.item())
    }

    /// Makes `value` the value.
    fn set(&mut self, value: &Tensor<T>) -> Result<(), FitError> {
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
    fn not_finite(&self) -> Option<f64> {
        let values = self.raw.data().iter().map(|&raw| self.mapping.value(raw));
        values.map(Scalar::to_f64).find(|value| !value.is_finite())
    }
}

/// What a saved fit gives back.
#[cfg(feature = "save")]
impl<T: Scalar> Parameters<T> {
    /// The list of `list`, whose raw numbers are what they are.
    ///
    /// # Errors
    /// As [`Parameters::with`].
    pub(crate) fn restored(list: Vec<Parameter<T>>, updates: u64) -> Result<Self, FitError> {
        let mut known = std::collections::HashSet::new();
        for parameter in &list {
            if !known.insert(parameter.name.as_str()) {
                let name = format!("{:?} twice", parameter.name);
                return Err(FitError::setting("a parameter", "a name of its own", name));
            }
            check_rate(&parameter.name, parameter.rate)?;
        }
        let names = list.iter().map(|parameter| parameter.name.clone()).collect();
        let list = Self { list, names, updates };
        list.check_values()?;
        Ok(list)
    }
}

/// A list of named parameters.
#[derive(Debug, Clone)]
pub struct Parameters<T> {
    pub(crate) list: Vec<Parameter<T>>,
    /// The names in the order of the list, shared with every step's variables.
    names: Arc<[String]>,
    /// How many updates there were.
    pub(crate) updates: u64,
}

impl<T> Default for Parameters<T> {
    fn default() -> Self {
        Self { list: Vec::new(), names: Arc::new([]), updates: 0 }
    }
}

impl<T: Scalar> Parameters<T> {
    /// An empty list.
    pub fn new() -> Self {
        Self::default()
    }

    /// The list with `parameter` at its end.
    ///
    /// # Errors
    /// [`FitError::Setting`] for a name that is taken, a rate that is negative or not finite, or
    /// a value that is not finite or that its mapping does not reach.
    pub fn with(mut self, mut parameter: Parameter<T>) -> Result<Self, FitError> {
        if self.names.contains(&parameter.name) {
            let name = format!("{:?} twice", parameter.name);
            return Err(FitError::setting("a parameter", "a name of its own", name));
        }
        check_rate(&parameter.name, parameter.rate)?;
        let value = parameter.raw.clone();
        parameter.set(&value)?;
        self.names = self.names.iter().chain([&parameter.name]).cloned().collect();
        self.list.push(parameter);
        Ok(self)
    }

    /// The parameters in order.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &Parameter<T>> {
        self.list.iter()
    }

    /// The parameter `name`.
    ///
    /// # Errors
    /// [`FitError::UnknownParameter`].
    pub fn get(&self, name: &str) -> Result<&Parameter<T>, FitError> {
        Ok(&self.list[position(&self.names, name)?])
    }

    /// The value of the parameter `name`: the mapping of its raw numbers.
    ///
    /// # Errors
    /// [`FitError::UnknownParameter`].
    pub fn value(&self, name: &str) -> Result<Tensor<T>, FitError> {
        Ok(self.get(name)?.value())
    }

    /// Makes `value` the value of the parameter `name`; its moments stay.
    ///
    /// # Errors
    /// [`FitError::UnknownParameter`]; [`FitError::Setting`] for a value of another shape, not
    /// finite, or not reached by the mapping.
    pub fn set_value(&mut self, name: &str, value: &Tensor<T>) -> Result<(), FitError> {
        let parameter = &mut self.list[position(&self.names, name)?];
        if value.shape() != parameter.raw.shape() {
            let given = format!("{} for {} of {name:?}", value.shape(), parameter.raw.shape());
            return Err(FitError::setting("a new value", "the shape of the old one", given));
        }
        parameter.set(value)
    }

    /// Makes `raw`, of the same shape, the raw numbers of the parameter `name`.
    pub fn set_raw(&mut self, name: &str, raw: Tensor<T>) -> Result<(), FitError> {
        let parameter = &mut self.list[position(&self.names, name)?];
        debug_assert_eq!(raw.shape(), parameter.raw.shape());
        parameter.raw = raw;
        Ok(())
    }

    /// Sets the learning rate of the parameter `name`; 0 freezes it.
    ///
    /// # Errors
    /// [`FitError::UnknownParameter`]; [`FitError::Setting`] for a rate that is negative or not
    /// finite.
    pub fn set_rate(&mut self, name: &str, rate: f64) -> Result<(), FitError> {
        let at = position(&self.names, name)?;
        check_rate(name, rate)?;
        self.list[at].rate = rate;
        Ok(())
    }

    /// Forgets the moments of all parameters, as if there had been no update: a way on after a
    /// gradient that froze some of them.
    pub fn forget_moments(&mut self) {
        for parameter in &mut self.list {
            parameter.first.clear();
            parameter.second.clear();
            parameter.greatest.clear();
            parameter.updates = 0;
        }
    }

    /// Records the parameters on `tape`: a leaf and its mapping each, a constant where frozen.
    ///
    /// Leaves are copies, so that an update in place never copies.
    pub fn record<'t>(&self, tape: &'t Tape<T>) -> Variables<'t, T> {
        let record = |parameter: &Parameter<T>| {
            let raw = if parameter.is_frozen() {
                tape.constant(&parameter.raw)
            } else {
                tape.leaf_copied(&parameter.raw)
            };
            Variable { raw, value: parameter.mapping.record(raw) }
        };
        let list = self.list.iter().map(record).collect();
        Variables { list, names: Arc::clone(&self.names) }
    }

    /// Checks that every value is finite.
    pub(crate) fn check_values(&self) -> Result<(), FitError> {
        for parameter in &self.list {
            if let Some(value) = parameter.not_finite() {
                let (quantity, step) = (Quantity::Value(parameter.name.clone()), self.updates);
                return Err(FitError::NotFinite { quantity, value, step, origin: None });
            }
        }
        Ok(())
    }
}

fn check_rate(name: &str, rate: f64) -> Result<(), FitError> {
    if rate.is_finite() && rate >= 0.0 {
        return Ok(());
    }
    let given = format!("{rate} for {name:?}");
    Err(FitError::setting("learning rate", "a finite number from 0 up", given))
}

fn position(names: &[String], name: &str) -> Result<usize, FitError> {
    let found = names.iter().position(|known| known == name);
    found.ok_or_else(|| FitError::UnknownParameter { name: name.into(), known: names.to_vec() })
}

/// A parameter on a tape.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Variable<'t, T: Scalar> {
    pub(crate) raw: Var<'t, T>,
    pub(crate) value: Var<'t, T>,
}

/// The parameters on a tape, for one step.
#[derive(Debug, Clone)]
pub struct Variables<'t, T: Scalar> {
    /// Up to eight need no allocation.
    pub(crate) list: SmallVec<[Variable<'t, T>; 8]>,
    names: Arc<[String]>,
}

impl<'t, T: Scalar> Variables<'t, T> {
    /// The value of the parameter `name`.
    ///
    /// # Errors
    /// [`FitError::UnknownParameter`].
    pub fn get(&self, name: &str) -> Result<Var<'t, T>, FitError> {
        Ok(self.list[position(&self.names, name)?].value)
    }

    /// The values of all parameters, in the order of the list.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = Var<'t, T>> + '_ {
        self.list.iter().map(|variable| variable.value)
    }

    /// The names of the parameters that are among `inputs`.
    pub(crate) fn names_among(&self, inputs: &[Var<'t, T>]) -> Vec<String> {
        let is_among = |variable: &Variable<'t, T>| {
            inputs.iter().any(|input| input.is(variable.raw) || input.is(variable.value))
        };
        let named = self.list.iter().zip(&*self.names);
        named.filter(|(variable, _)| is_among(variable)).map(|(_, name)| name.clone()).collect()
    }

    /// The raw numbers of the parameter `name`: the leaf that gradients are with respect to.
    ///
    /// # Errors
    /// [`FitError::UnknownParameter`].
    pub fn raw(&self, name: &str) -> Result<Var<'t, T>, FitError> {
        Ok(self.list[position(&self.names, name)?].raw)
    }
}

/// The value of the parameter at a place in the list.
impl<'t, T: Scalar> std::ops::Index<usize> for Variables<'t, T> {
    type Output = Var<'t, T>;

    fn index(&self, index: usize) -> &Var<'t, T> {
        &self.list[index].value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MAPPINGS: [Mapping; 3] = [Mapping::Identity, Mapping::Softplus, Mapping::Exp];

    #[test]
    fn raw_undoes_value_and_value_undoes_raw() {
        for mapping in MAPPINGS {
            for y in [1e-300, 1e-9, 0.3, 1.0, 2.0, 40.0, 1e3, 1e8] {
                // e^x loses |x| units of the last place.
                let back = mapping.value(mapping.raw(y));
                assert!((back - y).abs() <= 1e-15 * y * 700.0, "{mapping:?} {y} {back}");
            }
            for y in [2.0_f32, 0.5, 4.0] {
                let back = mapping.value(mapping.raw(y));
                assert!((back - y).abs() <= 3e-7 * y, "{mapping:?} {y} {back}");
            }
        }
    }

    #[test]
    fn a_value_is_bitwise_what_the_tape_records() {
        let tape = Tape::<f32>::new();
        for mapping in MAPPINGS {
            for k in -400..400 {
                let raw = 0.1 * k as f32;
                let recorded = mapping.record(tape.scalar(raw)).item();
                assert_eq!(mapping.value(raw).to_bits(), recorded.to_bits(), "{mapping:?} {raw}");
            }
        }
    }

    #[test]
    fn values_that_a_mapping_does_not_reach_are_refused() {
        for (mapping, value) in [
            (Mapping::Softplus, 0.0),
            (Mapping::Softplus, -1.0),
            (Mapping::Exp, 0.0),
            (Mapping::Exp, -1.0),
            (Mapping::Identity, f64::NAN),
            (Mapping::Softplus, f64::INFINITY),
        ] {
            let parameter = Parameter::new("sigma", Tensor::scalar(value)).mapping(mapping);
            let error = Parameters::new().with(parameter).unwrap_err();
            let message = format!("parameter needs {}, got {value} in \"sigma\"", mapping.rule());
            assert_eq!(error.to_string(), message);
        }
    }

    #[test]
    fn names_are_unique_and_rates_from_zero_up() {
        let one = || Tensor::scalar(1.0_f32);
        let list = Parameters::new().with(Parameter::new("a", one())).unwrap();
        let twice = list.clone().with(Parameter::new("a", one())).unwrap_err();
        assert_eq!(twice.to_string(), "a parameter needs a name of its own, got \"a\" twice");
        for rate in [-1.0, f64::NAN, f64::INFINITY] {
            let error = list.clone().with(Parameter::new("b", one()).rate(rate)).unwrap_err();
            let rule = "learning rate needs a finite number from 0 up, got";
            assert_eq!(error.to_string(), format!("{rule} {rate} for \"b\""));
        }
        let unknown = list.value("b").unwrap_err();
        let message = "a parameter's name needs to be one of [\"a\"], got \"b\"";
        assert_eq!(unknown.to_string(), message);
    }

    #[test]
    fn frozen_parameters_need_no_gradient() {
        let parameter = |name| Parameter::new(name, Tensor::scalar(2.0_f64));
        let list = Parameters::new()
            .with(parameter("free").mapping(Mapping::Exp))
            .and_then(|list| list.with(parameter("frozen").frozen().mapping(Mapping::Softplus)))
            .and_then(|list| list.with(parameter("still").rate(0.0)))
            .unwrap();
        let tape = Tape::new();
        let variables = list.record(&tape);
        for (k, needs) in [true, false, false].into_iter().enumerate() {
            assert_eq!(variables[k].needs_gradient(), needs);
            assert!((variables[k].item() - 2.0).abs() < 1e-15);
        }
        assert!(variables.get("still").is_ok());
        assert!(variables.get("gone").is_err());
    }

    #[test]
    fn setting_a_value_goes_through_the_mapping_and_keeps_the_shape() {
        let sigma = Parameter::new("sigma", Tensor::scalar(2.0_f64)).mapping(Mapping::Exp);
        let mut list = Parameters::new().with(sigma).unwrap();
        list.set_value("sigma", &Tensor::scalar(4.0)).unwrap();
        assert_eq!(list.get("sigma").unwrap().raw().item(), 4.0_f64.ln());
        let error = list.set_value("sigma", &Tensor::zeros([2])).unwrap_err();
        let message = "a new value needs the shape of the old one, got [2] for [] of \"sigma\"";
        assert_eq!(error.to_string(), message);
        assert!(list.set_value("sigma", &Tensor::scalar(-1.0)).is_err());
        assert_eq!(list.get("sigma").unwrap().item(), 4.0_f64.ln().exp());
    }
}
