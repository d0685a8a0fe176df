//! Settings as fields of a file. A tag is the place of a variant in its list here: new ones go to the
//! ends.

use super::bytes::{Reader, Writer};
use crate::error::FitError;
use crate::fit::FitSettings;
use crate::optimizer::Optimizer;
use crate::parameter::Mapping;
use crate::schedule::Schedule;

/// The mappings by their tags.
const MAPPINGS: [Mapping; 3] = [Mapping::Identity, Mapping::Softplus, Mapping::Exp];

/// The tag of `value`: its place in `all`.
pub fn tag<V: PartialEq>(all: &[V], value: &V) -> u8 {
    let at = all.iter().position(|known| known == value);
    at.expect("the list names all variants") as u8
}

impl Writer {
    /// A mapping.
    pub fn mapping(&mut self, mapping: Mapping) {
        self.byte(tag(&MAPPINGS, &mapping));
    }

    /// An optimizer.
    pub fn optimizer(&mut self, optimizer: &Optimizer) {
        let mut put = |tag, constants: &[f64]| {
            self.byte(tag);
            constants.iter().for_each(|&constant| self.number(constant));
        };
        match *optimizer {
            Optimizer::GradientDescent => put(0, &[]),
            Optimizer::Adam { beta1, beta2, epsilon } => put(1, &[beta1, beta2, epsilon]),
            Optimizer::AmsGrad { beta1, beta2, epsilon } => put(2, &[beta1, beta2, epsilon]),
        }
    }

    /// A schedule.
    pub fn schedule(&mut self, schedule: &Schedule) {
        let mut put = |tag, steps, constant| {
            self.byte(tag);
            self.count(steps);
            self.number(constant);
        };
        match *schedule {
            Schedule::Constant => self.byte(0),
            Schedule::Cosine { steps, floor } => put(1, steps, floor),
            Schedule::Polynomial { steps, power } => put(2, steps, power),
            Schedule::Exponential { steps, factor } => put(3, steps, factor),
            Schedule::Step { steps, factor } => put(4, steps, factor),
        }
    }

    /// The settings of a fit.
    pub fn fit_settings(&mut self, settings: &FitSettings) {
        self.count(settings.steps);
        self.optimizer(&settings.optimizer);
        self.schedule(&settings.schedule);
        self.option(settings.loss_below, Self::number);
        self.option(settings.patience, Self::count);
        self.option(settings.gradient_below, Self::number);
    }
}

impl Reader<'_> {
    /// A mapping.
    ///
    /// # Errors
    /// [`FitError::Saved`] where the bytes are none.
    pub fn mapping(&mut self) -> Result<Mapping, FitError> {
        self.one_of(&MAPPINGS, "a mapping")
    }

    /// An optimizer.
    ///
    /// # Errors
    /// [`FitError::Saved`] where the bytes are none.
    pub fn optimizer(&mut self) -> Result<Optimizer, FitError> {
        let what = "the optimizer";
        let constants = |reader: &mut Self| {
            Ok::<_, FitError>([reader.number(what)?, reader.number(what)?, reader.number(what)?])
        };
        let optimizer = match self.one_of(&[0, 1, 2], what)? {
            0 => Optimizer::GradientDescent,
            1 => {
                let [beta1, beta2, epsilon] = constants(self)?;
                Optimizer::Adam { beta1, beta2, epsilon }
            }
            _ => {
                let [beta1, beta2, epsilon] = constants(self)?;
                Optimizer::AmsGrad { beta1, beta2, epsilon }
            }
        };
        optimizer.check()?;
        Ok(optimizer)
    }

    /// A schedule.
    ///
    /// # Errors
    /// [`FitError::Saved`] where the bytes are none.
    pub fn schedule(&mut self) -> Result<Schedule, FitError> {
        let what = "the schedule";
        let tag = self.one_of(&[0, 1, 2, 3, 4], what)?;
        if tag == 0 {
            return Ok(Schedule::Constant);
        }
        let (steps, constant) = (self.count(what)?, self.number(what)?);
        let schedule = match tag {
            1 => Schedule::Cosine { steps, floor: constant },
            2 => Schedule::Polynomial { steps, power: constant },
            3 => Schedule::Exponential { steps, factor: constant },
            _ => Schedule::Step { steps, factor: constant },
        };
        schedule.check()?;
        Ok(schedule)
    }

    /// The settings of a fit.
    ///
    /// # Errors
    /// [`FitError::Saved`] where the bytes are none.
    pub fn fit_settings(&mut self) -> Result<FitSettings, FitError> {
        let settings = FitSettings {
            steps: self.count("the number of steps")?,
            optimizer: self.optimizer()?,
            schedule: self.schedule()?,
            loss_below: self.option("the loss limit", Self::number)?,
            patience: self.option("the patience", Self::count)?,
            gradient_below: self.option("the gradient limit", Self::number)?,
        };
        settings.check()?;
        Ok(settings)
    }
}
