//! A list of named parameters.

use std::sync::Arc;

use bokashi_core::{Scalar, Tape, Tensor};

use super::single::Parameter;
use super::variables::{Variable, Variables, position};
use crate::error::{FitError, Quantity};

/// Lists of saved fits.
#[cfg(feature = "save")]
impl<T: Scalar> Parameters<T> {
    /// The list of parameters with these raw numbers, as saved.
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
            parameter.check_preconditioner()?;
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
    /// The number of updates.
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
    /// - [`FitError::Setting`] for a name that is taken, for a rate that is negative or not finite, and for a mapping
    ///   beside a preconditioner.
    /// - [`FitError::Setting`] for a value that is not finite, or that its mapping does not reach.
    /// - `TensorError::Shape` for a preconditioner of another number of vertices.
    pub fn with(mut self, mut parameter: Parameter<T>) -> Result<Self, FitError> {
        if self.names.contains(&parameter.name) {
            let name = format!("{:?} twice", parameter.name);
            return Err(FitError::setting("a parameter", "a name of its own", name));
        }
        check_rate(&parameter.name, parameter.rate)?;
        parameter.check_preconditioner()?;
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

    /// The value of the parameter `name`: what its mapping or preconditioner makes of its raw numbers.
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

    /// Replaces the parameter of the same name by `parameter`. The new one may have another shape and another
    /// preconditioner, as after a mesh got other vertices. `carry` maps each of the optimizer's moments, which have the
    /// shape of the old values, to the new shape.
    ///
    /// # Errors
    /// [`FitError::UnknownParameter`]; those of `carry`; [`FitError::Setting`] for moments of another shape than
    /// that of the parameter. The list is then as it was.
    pub fn replace(
        &mut self,
        parameter: &Parameter<T>,
        carry: impl Fn(&Tensor<T>) -> Result<Tensor<T>, FitError>,
    ) -> Result<(), FitError> {
        let index = position(&self.names, &parameter.name)?;
        let (old, shape) = (&self.list[index], parameter.raw.shape());
        let carried = |moments: &Vec<T>| {
            if moments.is_empty() {
                return Ok(Vec::new());
            }
            let carried = carry(&Tensor::new(old.raw.shape(), moments.clone())?)?;
            if carried.shape() == shape {
                return Ok(carried.data().to_vec());
            }
            let given = format!("{} for {shape} of {:?}", carried.shape(), parameter.name);
            Err(FitError::setting("moments", "the shape of their parameter", given))
        };
        let (first, second) = (carried(&old.first)?, carried(&old.second)?);
        let (greatest, updates) = (carried(&old.greatest)?, old.updates);
        self.list[index] = Parameter { first, second, greatest, updates, ..parameter.clone() };
        Ok(())
    }

    /// The parameters of `other` in its order. Those that this list has too are taken from this list.
    #[must_use]
    pub fn with_those_of(&self, other: &Self) -> Self {
        let own = |parameter: &Parameter<T>| self.get(&parameter.name).unwrap_or(parameter).clone();
        let list = other.list.iter().map(own).collect();
        Self { list, names: Arc::clone(&other.names), updates: self.updates }
    }

    /// Sets the learning rate of the parameter `name`; 0 freezes it.
    ///
    /// # Errors
    /// [`FitError::UnknownParameter`]; [`FitError::Setting`] for a rate that is negative or not
    /// finite.
    pub fn set_rate(&mut self, name: &str, rate: f64) -> Result<(), FitError> {
        let index = position(&self.names, name)?;
        check_rate(name, rate)?;
        self.list[index].rate = rate;
        Ok(())
    }

    /// Forgets the moments of all parameters, as before the first update: for instance after a far too large gradient.
    pub fn forget_moments(&mut self) {
        for parameter in &mut self.list {
            parameter.first.clear();
            parameter.second.clear();
            parameter.greatest.clear();
            parameter.updates = 0;
        }
    }

    /// Records the parameters on `tape`: each as a leaf and its mapping, or as a constant where it is frozen.
    ///
    /// Leaves are copies, so an update in place never copies.
    #[inline(never)]
    pub fn record<'t>(&self, tape: &'t Tape<T>) -> Variables<'t, T> {
        let record = |parameter: &Parameter<T>| {
            let raw = if parameter.is_frozen() {
                tape.constant(&parameter.raw)
            } else {
                tape.leaf_copied(&parameter.raw)
            };
            Variable { raw, value: parameter.record(raw) }
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

#[cfg(test)]
mod tests {
    use super::super::mapping::Mapping;
    use super::*;

    #[test]
    fn values_that_a_mapping_does_not_reach_are_refused() {
        for (mapping, value) in [
            (Mapping::Softplus, 0.0),
            (Mapping::Softplus, -1.0),
            (Mapping::Exp, 0.0),
            (Mapping::Exp, -1.0),
            (Mapping::Sigmoid, 0.0),
            (Mapping::Sigmoid, 1.0),
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

    #[test]
    fn a_parameter_of_another_shape_has_the_moments_that_were_carried_over() {
        use crate::optimizer::Optimizer;

        let list = |start: Tensor<f64>| Parameters::new().with(Parameter::new("v", start));
        let mut short = list(Tensor::from([1.0, 2.0])).unwrap();
        let tape = Tape::new();
        let variables = short.record(&tape);
        let gradients = variables[0].square().sum().backward().unwrap();
        Optimizer::default().update(&mut short, &variables, &gradients, 1.0).unwrap();
        let before = short.clone();
        let long = list(Tensor::from([3.0, 4.0, 5.0])).unwrap();
        let mean = |x: f64, y: f64| 0.5 * (x + y);
        let carry = |old: &Tensor<f64>| {
            let [a, b] = [old.data()[0], old.data()[1]];
            Ok(Tensor::from([a, mean(a, b), b]))
        };
        short.replace(long.get("v").unwrap(), carry).unwrap();
        let (old, new) = (before.get("v").unwrap(), short.get("v").unwrap());
        assert_eq!((new.raw(), new.updates), (long.get("v").unwrap().raw(), 1));
        for (old, new) in [(&old.first, &new.first), (&old.second, &new.second)] {
            assert_eq!(**new, [old[0], mean(old[0], old[1]), old[1]]);
        }
        assert!(new.greatest.is_empty());
        let error = short.replace(old, |all| Ok(all.clone())).unwrap_err().to_string();
        assert_eq!(error, "moments needs the shape of their parameter, got [3] for [2] of \"v\"");
        assert_eq!(short.get("v").unwrap().first.len(), 3);
        let other = Parameters::new().with(Parameter::new("w", Tensor::scalar(1.0))).unwrap();
        assert!(short.replace(other.get("w").unwrap(), |all| Ok(all.clone())).is_err());
    }

    #[test]
    fn a_list_with_those_of_another_keeps_its_own() {
        let parameter = |name, value| Parameter::new(name, Tensor::scalar(value));
        let list = |all: &[(&'static str, f64)]| {
            let with =
                |list: Parameters<f64>, &(name, value): &_| list.with(parameter(name, value));
            all.iter().try_fold(Parameters::new(), with).unwrap()
        };
        let mut own = list(&[("a", 1.0), ("b", 2.0), ("c", 3.0)]);
        own.updates = 7;
        let found = own.with_those_of(&list(&[("c", 9.0), ("d", 4.0), ("a", 9.0)]));
        let all: Vec<_> = found.iter().map(|it| (it.name(), it.raw().item())).collect();
        assert_eq!(all, [("c", 3.0), ("d", 4.0), ("a", 1.0)]);
        assert_eq!((found.value("d").unwrap().item(), found.updates), (4.0, 7));
        assert!(found.get("b").is_err());
    }

    #[cfg(feature = "precondition")]
    #[test]
    fn a_preconditioned_parameter_starts_at_its_value_and_steps_smoothly() {
        use crate::optimizer::Optimizer;
        use crate::preconditioner::Preconditioner;
        use crate::topology::Topology;

        // A strip of 40 faces.
        let faces: Vec<_> = (0..40).map(|k| [k, k + 1, k + 2]).collect();
        let topology = Topology::new(&faces, 42).unwrap();
        let smooth = Preconditioner::new(&topology, 19.0).unwrap();
        let start = Tensor::from_flat_fn([42, 3], |k| (k % 5) as f64);
        let v = || Parameter::new("v", start.clone()).rate(0.5).preconditioned(&smooth);
        let mut list = Parameters::new().with(v()).unwrap();
        let off = |list: &Parameters<f64>, other: &Tensor<f64>| -> Vec<f64> {
            let value = list.value("v").unwrap();
            value.data().iter().zip(other.data()).map(|(v, other)| v - other).collect()
        };
        assert!(off(&list, &start).iter().all(|off| off.abs() < 1e-13));
        let tape = Tape::new();
        let variables = list.record(&tape);
        assert_eq!(variables[0].value(), list.value("v").unwrap());
        // The gradient of one vertex moves its neighbours along: no step is a third of another's.
        let gradients = (variables[0].slice(0, 20..21).unwrap().sum()).backward().unwrap();
        Optimizer::default().update(&mut list, &variables, &gradients, 1.0).unwrap();
        let steps = off(&list, &start);
        let neighbors = (15..25).map(|vertex| steps[3 * vertex]);
        assert!(neighbors.clone().all(|step| step < 0.0));
        let pairs = neighbors.clone().zip(neighbors.skip(1));
        assert!(pairs.into_iter().all(|(a, b)| a / b < 3.0 && b / a < 3.0));
        list.set_value("v", &start).unwrap();
        assert!(off(&list, &start).iter().all(|off| off.abs() < 1e-13));
        // What does not fit.
        let said = |parameter| Parameters::new().with(parameter).unwrap_err().to_string();
        let message = "a preconditioned parameter needs no mapping, got Exp for \"v\"";
        assert_eq!(said(v().mapping(Mapping::Exp)), message);
        let short = Parameter::new("v", Tensor::<f64>::zeros([41, 3])).preconditioned(&smooth);
        let message = "precondition needs shape [42] or [42, C], got shape [41, 3]";
        assert_eq!(said(short), message);
        assert!(v().is_like(&v()) && !v().is_like(&Parameter::new("v", start.clone()).rate(0.5)));
    }
}
