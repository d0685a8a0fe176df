//! Optimizers: from gradients to new parameters.
//!
//! # Gradient descent
//! `x -= a g`, with `a` the parameter's learning rate times the schedule's factor.
//!
//! # Adam
//! `m = b1 m + (1 - b1) g`, `v = b2 v + (1 - b2) g^2`,
//! `x -= a m / (1 - b1^t) / (sqrt(v / (1 - b2^t)) + epsilon)` in the t-th update, `t = 1, 2, ...`:
//! steps of about `a` whatever the scale of the gradient. At a constant rate it is unstable once it
//! has converged: `v` shrinks with the gradient, and a small gradient then makes a large step. A
//! rate that decays, or a larger epsilon, removes that.
//!
//! # Failure
//! One NaN would poison the moments for ever, and an infinite `g^2` would freeze its entry. So all
//! gradients are checked before anything is changed.
//!
//! # Source
//! Kingma and Ba, *Adam: a method for stochastic optimization*, ICLR 2015, algorithm 1.

use bokashi_core::{Gradients, Scalar};

use crate::error::{FitError, Quantity};
use crate::parameter::{Parameter, Parameters, Variables};

/// How gradients change parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Optimizer {
    /// Steps along the gradient.
    GradientDescent,
    /// Steps of about the learning rate, from moving averages of the gradient and its square.
    Adam {
        /// The decay of the average of the gradient.
        beta1: f64,
        /// The decay of the average of the squared gradient.
        beta2: f64,
        /// Added to the root of the average square.
        epsilon: f64,
    },
}

/// Adam with the constants of its authors, which the paper uses too.
impl Default for Optimizer {
    fn default() -> Self {
        Self::Adam { beta1: 0.9, beta2: 0.999, epsilon: 1e-8 }
    }
}

impl Optimizer {
    /// Checks the constants.
    ///
    /// # Errors
    /// [`FitError::Setting`] unless the betas are from 0 to below 1 and epsilon is finite and above
    /// 0.
    pub fn check(&self) -> Result<(), FitError> {
        let Self::Adam { beta1, beta2, epsilon } = *self else { return Ok(()) };
        for (setting, beta) in [("Adam's beta1", beta1), ("Adam's beta2", beta2)] {
            if !(0.0..1.0).contains(&beta) {
                return Err(FitError::setting(setting, "a number from 0 to below 1", beta));
            }
        }
        if !(epsilon > 0.0 && epsilon.is_finite()) {
            return Err(FitError::setting("Adam's epsilon", "a finite number above 0", epsilon));
        }
        Ok(())
    }

    /// Changes `parameters`, recorded as `variables`, by their `gradients`; `factor` multiplies
    /// every learning rate.
    ///
    /// # Errors
    /// [`FitError::NotFinite`] where a gradient (or, for Adam, its square) is infinite or NaN;
    /// [`FitError::Setting`] where a rate is too large, or Adam's epsilon too small, for the
    /// numbers of the fit. All parameters and moments are then as they were.
    pub fn update<'t, T: Scalar>(
        &self,
        parameters: &mut Parameters<T>,
        variables: &Variables<'t, T>,
        gradients: &Gradients<'t, T>,
        factor: f64,
    ) -> Result<(), FitError> {
        let gradient = |k: usize| gradients.get(variables.list[k].raw).map(|tensor| tensor.data());
        for (k, parameter) in parameters.list.iter().enumerate() {
            if parameter.is_frozen() {
                continue;
            }
            self.check_settings_in::<T>(parameter.rate * factor)?;
            if let Some(gradient) = gradient(k) {
                self.check_gradient(parameter, gradient, parameters.updates)?;
            }
        }
        parameters.updates += 1;
        for (k, parameter) in parameters.list.iter_mut().enumerate() {
            if parameter.is_frozen() {
                continue;
            }
            let rate = parameter.rate * factor;
            match *self {
                Self::GradientDescent => descend(parameter, gradient(k), rate),
                Self::Adam { beta1, beta2, epsilon } => {
                    parameter.updates += 1;
                    let adam = Adam { beta1, beta2, epsilon, updates: parameter.updates };
                    adam.step(parameter, gradient(k), rate);
                }
            }
        }
        Ok(())
    }

    /// Checks that the rate, and epsilon, are numbers in `T` too.
    fn check_settings_in<T: Scalar>(&self, rate: f64) -> Result<(), FitError> {
        if !T::from_f64(rate).is_finite() {
            let rule = "a finite number in the precision of the fit";
            return Err(FitError::setting("learning rate", rule, rate));
        }
        match *self {
            Self::Adam { epsilon, .. } if T::from_f64(epsilon) == T::ZERO => {
                let rule = "a number above 0 in the precision of the fit";
                Err(FitError::setting("Adam's epsilon", rule, epsilon))
            }
            _ => Ok(()),
        }
    }

    fn check_gradient<T: Scalar>(
        &self,
        parameter: &Parameter<T>,
        gradient: &[T],
        step: u64,
    ) -> Result<(), FitError> {
        let name = || parameter.name().to_owned();
        if let Some(value) = not_finite(gradient, |g| g) {
            return Err(FitError::NotFinite { quantity: Quantity::Gradient(name()), value, step });
        }
        if let (Self::Adam { .. }, Some(value)) = (self, not_finite(gradient, |g| g * g)) {
            let quantity = Quantity::SquaredGradient(name());
            return Err(FitError::NotFinite { quantity, value, step });
        }
        Ok(())
    }
}

/// The first of `term(entry)` that is not finite.
fn not_finite<T: Scalar>(entries: &[T], term: impl Fn(T) -> T) -> Option<f64> {
    // Without an early exit, so that the usual case is a loop over vectors.
    if entries.iter().fold(true, |finite, &entry| finite & term(entry).is_finite()) {
        return None;
    }
    let values = entries.iter().map(|&entry| term(entry));
    values.filter(|value| !value.is_finite()).map(Scalar::to_f64).next()
}

fn descend<T: Scalar>(parameter: &mut Parameter<T>, gradient: Option<&[T]>, rate: f64) {
    let Some(gradient) = gradient else { return };
    let rate = T::from_f64(rate);
    for (x, &g) in parameter.raw.data_mut().iter_mut().zip(gradient) {
        *x += -rate * g;
    }
}

/// One update of Adam.
struct Adam {
    beta1: f64,
    beta2: f64,
    epsilon: f64,
    /// How many updates the parameter's moments have seen, this one included.
    updates: u64,
}

impl Adam {
    /// Updates `parameter`; without a gradient, as with one of zeros.
    fn step<T: Scalar>(&self, parameter: &mut Parameter<T>, gradient: Option<&[T]>, rate: f64) {
        let Parameter { raw, first, second, .. } = parameter;
        let size = raw.size();
        first.resize(size, T::ZERO);
        second.resize(size, T::ZERO);
        let t = self.updates as f64;
        let rate = T::from_f64(rate / (1.0 - self.beta1.powf(t)));
        let unbias = T::from_f64(1.0 / (1.0 - self.beta2.powf(t)));
        let (keep1, add1) = (T::from_f64(self.beta1), T::from_f64(1.0 - self.beta1));
        let (keep2, add2) = (T::from_f64(self.beta2), T::from_f64(1.0 - self.beta2));
        let epsilon = T::from_f64(self.epsilon);
        let entry = |x: &mut T, m: &mut T, v: &mut T, g: T| {
            *m = keep1 * *m + add1 * g;
            *v = keep2 * *v + add2 * (g * g);
            *x += -rate * *m / ((*v * unbias).sqrt() + epsilon);
        };
        let entries = raw.data_mut().iter_mut().zip(first).zip(second);
        match gradient {
            Some(gradient) => {
                entries.zip(gradient).for_each(|(((x, m), v), &g)| entry(x, m, v, g));
            }
            None => entries.for_each(|((x, m), v)| entry(x, m, v, T::ZERO)),
        }
    }
}

#[cfg(test)]
mod tests {
    use bokashi_core::{Tape, Tensor};

    use super::*;

    fn parameters(start: [f64; 2]) -> Parameters<f64> {
        let one = |name, value| Parameter::new(name, Tensor::scalar(value)).rate(0.1);
        Parameters::new().with(one("x", start[0])).unwrap().with(one("y", start[1])).unwrap()
    }

    /// One update along the gradient `g` of `<g, (x, y)>`.
    fn update(
        optimizer: Optimizer,
        list: &mut Parameters<f64>,
        g: [f64; 2],
    ) -> Result<(), FitError> {
        let tape = Tape::new();
        let variables = list.record(&tape);
        let loss = variables[0] * g[0] + variables[1] * g[1];
        let gradients = loss.backward()?;
        optimizer.update(list, &variables, &gradients, 1.0)
    }

    fn values(list: &Parameters<f64>) -> [f64; 2] {
        ["x", "y"].map(|name| list.get(name).unwrap().item())
    }

    #[test]
    fn descent_goes_the_rate_times_the_gradient() {
        let mut list = parameters([1.0, 2.0]);
        update(Optimizer::GradientDescent, &mut list, [4.0, -2.0]).unwrap();
        assert_eq!(values(&list), [1.0 - 0.1 * 4.0, 2.0 + 0.1 * 2.0]);
    }

    #[test]
    fn the_first_step_of_adam_is_the_rate_whatever_the_gradient() {
        for scale in [1e-3, 1.0, 1e6] {
            let mut list = parameters([1.0, 2.0]);
            update(Optimizer::default(), &mut list, [scale, -3.0 * scale]).unwrap();
            let [x, y] = values(&list);
            // Off by epsilon / gradient.
            assert!((x - 0.9).abs() < 1e-6 && (y - 2.1).abs() < 1e-6, "{x} {y}");
        }
    }

    #[test]
    fn the_first_step_of_a_thawed_parameter_is_its_rate() {
        let mut list = parameters([1.0, 2.0]);
        list.set_rate("y", 0.0).unwrap();
        for _ in 0..2000 {
            update(Optimizer::default(), &mut list, [1.0, 1.0]).unwrap();
        }
        list.set_rate("y", 0.1).unwrap();
        update(Optimizer::default(), &mut list, [1.0, 1.0]).unwrap();
        assert!((values(&list)[1] - 1.9).abs() < 1e-6, "{}", values(&list)[1]);
    }

    #[test]
    fn constants_that_the_numbers_of_a_fit_cannot_hold_change_nothing() {
        let refused = |optimizer: Optimizer, rate: f64| {
            let x = Parameter::new("x", Tensor::scalar(1.0_f32)).rate(rate);
            let mut list = Parameters::new().with(x).unwrap();
            let tape = Tape::new();
            let variables = list.record(&tape);
            // A gradient of 0, which a denominator of 0 would make NaN.
            let gradients = (variables[0] * 0.0).backward().unwrap();
            let error = optimizer.update(&mut list, &variables, &gradients, 1.0).unwrap_err();
            assert_eq!(list.get("x").unwrap().item(), 1.0);
            error.to_string()
        };
        let tiny = Optimizer::Adam { beta1: 0.9, beta2: 0.999, epsilon: 1e-50 };
        assert!(refused(tiny, 0.1).starts_with("Adam's epsilon needs a number above 0 in"));
        let rate = refused(Optimizer::GradientDescent, 1e300);
        assert!(rate.starts_with("learning rate needs a finite number in"), "{rate}");
    }

    #[test]
    fn adam_follows_its_recurrence() {
        let mut list = parameters([1.0, 2.0]);
        let (mut x, mut m, mut v) = (1.0, 0.0, 0.0);
        for t in 1..=50 {
            let g = (t as f64).sin();
            update(Optimizer::default(), &mut list, [g, 0.0]).unwrap();
            m = 0.9 * m + 0.1 * g;
            v = 0.999 * v + 0.001 * g * g;
            let unbiased = (m / (1.0 - 0.9_f64.powi(t)), v / (1.0 - 0.999_f64.powi(t)));
            x -= 0.1 * unbiased.0 / (unbiased.1.sqrt() + 1e-8);
        }
        assert!((values(&list)[0] - x).abs() < 1e-12);
        assert_eq!(values(&list)[1], 2.0);
    }

    #[test]
    fn a_gradient_that_is_not_finite_changes_nothing_and_is_named() {
        for optimizer in [Optimizer::GradientDescent, Optimizer::default()] {
            for bad in [f64::NAN, f64::INFINITY] {
                let mut list = parameters([1.0, 2.0]);
                update(optimizer, &mut list, [0.5, 0.5]).unwrap();
                let before = list.clone();
                // The first parameter's gradient is fine: it must not have moved either.
                let error = update(optimizer, &mut list, [0.5, bad]).unwrap_err();
                let quantity = Quantity::Gradient("y".into());
                assert!(matches!(
                    error,
                    FitError::NotFinite { quantity: found, step: 1, .. } if found == quantity
                ));
                assert_eq!(list.updates, before.updates);
                for (after, before) in list.iter().zip(before.iter()) {
                    assert_eq!(after.raw, before.raw);
                    assert_eq!(after.first, before.first);
                    assert_eq!(after.second, before.second);
                }
            }
        }
    }

    #[test]
    fn a_gradient_whose_square_overflows_is_refused_by_adam_alone() {
        let mut list = parameters([1.0, 2.0]);
        assert!(update(Optimizer::GradientDescent, &mut list, [1e200, 0.0]).is_ok());
        let error = update(Optimizer::default(), &mut list, [1e200, 0.0]).unwrap_err();
        let message = "the squared gradient of \"x\" needs to be finite, got inf at step 1";
        assert_eq!(error.to_string(), message);
    }

    #[test]
    fn frozen_parameters_stay() {
        for optimizer in [Optimizer::GradientDescent, Optimizer::default()] {
            let mut list = parameters([1.0, 2.0]);
            list.set_rate("x", 0.0).unwrap();
            update(optimizer, &mut list, [1.0, 1.0]).unwrap();
            let [x, y] = values(&list);
            assert_eq!(x, 1.0);
            assert!(y < 2.0);
        }
    }

    #[test]
    fn a_parameter_that_the_loss_ignores_coasts_on_its_moments() {
        let mut list = parameters([1.0, 2.0]);
        let optimizer = Optimizer::default();
        update(optimizer, &mut list, [1.0, 1.0]).unwrap();
        let mut zeros = list.clone();
        update(optimizer, &mut zeros, [0.0, 1.0]).unwrap();

        let tape = Tape::new();
        let variables = list.record(&tape);
        let gradients = variables[1].backward().unwrap();
        assert!(gradients.get(variables[0]).is_none());
        optimizer.update(&mut list, &variables, &gradients, 1.0).unwrap();
        assert_eq!(values(&list), values(&zeros));
    }

    #[test]
    fn constants_outside_their_range_are_refused() {
        let adam = |beta1, beta2, epsilon| Optimizer::Adam { beta1, beta2, epsilon }.check();
        assert!(adam(0.0, 0.0, 1e-8).is_ok());
        let message = |result: Result<(), FitError>| result.unwrap_err().to_string();
        let rule = "needs a number from 0 to below 1, got 1";
        assert_eq!(message(adam(1.0, 0.9, 1e-8)), format!("Adam's beta1 {rule}"));
        assert_eq!(message(adam(0.9, 1.0, 1e-8)), format!("Adam's beta2 {rule}"));
        let epsilon = "Adam's epsilon needs a finite number above 0, got 0";
        assert_eq!(message(adam(0.9, 0.9, 0.0)), epsilon);
    }
}
