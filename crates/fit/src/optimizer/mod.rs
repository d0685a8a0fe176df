//! Optimizers: from gradients to new parameters.
//!
//! # Gradient descent
//! `x -= a g`, with `a` the parameter's learning rate times the schedule's factor.
//!
//! # Adam and AMSGrad
//! Steps of about `a` whatever the scale of the gradient: see `adam`.
//!
//! # Failure
//! One NaN would stay in the moments for ever, and an infinite `g^2` would freeze its entry. So two checks come
//! before any change: of all gradients, and of the values that parameters and moments would take. The second
//! check computes the update without storing it. The update itself computes the same bits again.
//!
//! # Updates that vanish
//! An update below half a unit in the last place of its entry does not change the entry. That is no error. Such
//! entries are counted: see [`Parameter::vanished`].

mod adam;
mod descent;
mod entries;
#[cfg(test)]
mod tests;

use bokashi_core::{Gradients, Scalar};

use self::adam::Adam;
use self::descent::{descend, descends_out_of_range};
use self::entries::first_not_finite;
use crate::error::{FitError, Quantity};
use crate::parameter::{Parameter, Parameters, Variables};

/// A rule by which gradients change parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
#[cfg_attr(feature = "save", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "save", serde(rename_all = "kebab-case", deny_unknown_fields))]
#[non_exhaustive]
pub enum Optimizer {
    /// Steps along the gradient.
    GradientDescent,
    /// Steps of about the learning rate, from moving averages of the gradient and its square.
    ///
    /// A gradient that is far larger than usual freezes its entry until the average of squares has forgotten it.
    /// For a gradient of 1e10 among gradients of 1 that takes about 40,000 updates at the usual `beta2`. It
    /// follows from the recurrence and is no error. In `f32` the updates vanish, which [`Parameter::vanished`]
    /// shows.
    Adam {
        /// The decay of the average of the gradient.
        beta1: f64,
        /// The decay of the average of the squared gradient.
        beta2: f64,
        /// Added to the root of the average square.
        epsilon: f64,
    },
    /// Adam with the largest average square so far in its denominators. They never fall, so it stays stable after
    /// convergence. A gradient that is far too large freezes its entry for good.
    AmsGrad {
        /// The decay of the average of the gradient.
        beta1: f64,
        /// The decay of the average of the squared gradient.
        beta2: f64,
        /// Added to the root of the largest average square.
        epsilon: f64,
    },
}

/// Adam with the constants of its authors.
impl Default for Optimizer {
    fn default() -> Self {
        Self::Adam { beta1: 0.9, beta2: 0.999, epsilon: 1e-8 }
    }
}

impl Optimizer {
    /// AMSGrad with the constants of Adam's authors.
    pub const fn ams_grad() -> Self {
        Self::AmsGrad { beta1: 0.9, beta2: 0.999, epsilon: 1e-8 }
    }

    /// The constants beta1, beta2 and epsilon with their names in messages; `None` for gradient descent.
    fn constants(&self) -> Option<[(&'static str, f64); 3]> {
        match *self {
            Self::GradientDescent => None,
            Self::Adam { beta1, beta2, epsilon } => Some([
                ("Adam's beta1", beta1),
                ("Adam's beta2", beta2),
                ("Adam's epsilon", epsilon),
            ]),
            Self::AmsGrad { beta1, beta2, epsilon } => Some([
                ("AMSGrad's beta1", beta1),
                ("AMSGrad's beta2", beta2),
                ("AMSGrad's epsilon", epsilon),
            ]),
        }
    }

    /// Checks the constants.
    ///
    /// # Errors
    /// [`FitError::Setting`] unless the betas are from 0 to below 1 and epsilon is finite and above
    /// 0.
    pub fn check(&self) -> Result<(), FitError> {
        let Some([betas @ .., (setting, epsilon)]) = self.constants() else { return Ok(()) };
        for (setting, beta) in betas {
            if !(0.0..1.0).contains(&beta) {
                return Err(FitError::setting(setting, "a number from 0 to below 1", beta));
            }
        }
        if !(epsilon > 0.0 && epsilon.is_finite()) {
            return Err(FitError::setting(setting, "a finite number above 0", epsilon));
        }
        Ok(())
    }

    /// Updates `parameters`, recorded as `variables`, by their `gradients`. `factor` multiplies every learning rate.
    ///
    /// # Errors
    /// - [`FitError::NotFinite`] where a gradient (or, for Adam and AMSGrad, its square) is infinite
    ///   or NaN, or where the update would make a value so.
    /// - [`FitError::Setting`] where a rate is too large, or epsilon too small, for the numbers of
    ///   the fit.
    ///
    /// All parameters and moments are then as they were.
    #[inline(never)]
    pub fn update<'t, T: Scalar>(
        &self,
        parameters: &mut Parameters<T>,
        variables: &Variables<'t, T>,
        gradients: &Gradients<'t, T>,
        factor: f64,
    ) -> Result<(), FitError> {
        let gradient = |k: usize| gradients.get(variables.list[k].raw).map(|tensor| tensor.data());
        let step = parameters.updates;
        for (k, parameter) in parameters.list.iter().enumerate() {
            if parameter.is_frozen() {
                continue;
            }
            self.check_settings_in::<T>(parameter.rate * factor)?;
            if let Some(gradient) = gradient(k) {
                self.check_gradient(parameter, gradient, step)?;
            }
        }
        for (k, parameter) in parameters.list.iter_mut().enumerate() {
            if !parameter.is_frozen() {
                let rate = parameter.rate * factor;
                self.check_update(parameter, gradient(k), rate, step)?;
            }
        }
        parameters.updates += 1;
        for (k, parameter) in parameters.list.iter_mut().enumerate() {
            parameter.vanished = 0;
            if parameter.is_frozen() {
                continue;
            }
            let rate = parameter.rate * factor;
            parameter.vanished = match self.adam::<T>(parameter.updates + 1, rate) {
                None => descend(parameter, gradient(k), rate),
                Some(adam) => {
                    parameter.updates += 1;
                    adam.step(parameter, gradient(k))
                }
            };
        }
        Ok(())
    }

    /// The `t`-th update of Adam or AMSGrad at learning rate `rate`.
    fn adam<T: Scalar>(&self, t: u64, rate: f64) -> Option<Adam<T>> {
        let [(_, beta1), (_, beta2), (_, epsilon)] = self.constants()?;
        let keeps_the_greatest = matches!(self, Self::AmsGrad { .. });
        Some(Adam::new([beta1, beta2, epsilon], keeps_the_greatest, t, rate))
    }

    /// Checks that the rate, and epsilon, are numbers in `T` too.
    fn check_settings_in<T: Scalar>(&self, rate: f64) -> Result<(), FitError> {
        if !T::from_f64(rate).is_finite() {
            let rule = "a finite number in the precision of the fit";
            return Err(FitError::setting("learning rate", rule, rate));
        }
        match self.constants() {
            Some([.., (setting, epsilon)]) if T::from_f64(epsilon) == T::ZERO => {
                let rule = "a number above 0 in the precision of the fit";
                Err(FitError::setting(setting, rule, epsilon))
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
            let quantity = Quantity::Gradient(name());
            return Err(FitError::NotFinite { quantity, value, step, origin: None });
        }
        if self.constants().is_some()
            && let Some(value) = not_finite(gradient, |g| g * g)
        {
            let quantity = Quantity::SquaredGradient(name());
            return Err(FitError::NotFinite { quantity, value, step, origin: None });
        }
        Ok(())
    }

    /// Checks what an update along a finite `gradient` would make of `parameter`.
    fn check_update<T: Scalar>(
        &self,
        parameter: &mut Parameter<T>,
        gradient: Option<&[T]>,
        rate: f64,
        step: u64,
    ) -> Result<(), FitError> {
        let value = match self.adam::<T>(parameter.updates + 1, rate) {
            None => descends_out_of_range(parameter, gradient, rate),
            Some(adam) => adam.steps_out_of_range(parameter, gradient),
        };
        let Some(value) = value else { return Ok(()) };
        let quantity = Quantity::Update(parameter.name().to_owned());
        let value = value.to_f64();
        Err(FitError::NotFinite { quantity, value, step, origin: None })
    }
}

/// The first `term(entry)` that is not finite.
fn not_finite<T: Scalar>(entries: &[T], term: impl Fn(T) -> T) -> Option<f64> {
    first_not_finite(entries.len(), |k| term(entries[k])).map(Scalar::to_f64)
}
