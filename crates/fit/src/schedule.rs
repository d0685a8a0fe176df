//! Schedules of learning rates: a factor for every rate, by step.

use std::f64::consts::PI;

use crate::error::FitError;

/// A factor that multiplies every learning rate, by step.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[cfg_attr(feature = "save", derive(serde::Serialize, serde::Deserialize))]
#[cfg_attr(feature = "save", serde(rename_all = "kebab-case", deny_unknown_fields))]
#[non_exhaustive]
pub enum Schedule {
    /// 1 throughout.
    #[default]
    Constant,
    /// From 1 down to `floor` along half a cosine, and `floor` from `steps` on.
    Cosine {
        /// The step that reaches the floor.
        steps: u64,
        /// The last factor.
        floor: f64,
    },
    /// From 1 down to 0 as `(1 - step / steps)^power`, and 0 from `steps` on. With a larger power, more of the run has
    /// small rates.
    Polynomial {
        /// The step that reaches 0.
        steps: u64,
        /// The power, above 0.
        power: f64,
    },
    /// Halved (for `factor` 1/2) smoothly every `steps`: `factor^(step / steps)`, down to `floor`.
    Exponential {
        /// The number of steps that multiply the rate by `factor` once.
        steps: u64,
        /// The factor, in (0, 1].
        factor: f64,
        /// The least factor, from 0 to 1.
        #[cfg_attr(feature = "save", serde(default))]
        floor: f64,
    },
    /// Multiplied by `factor` at once every `steps`.
    Step {
        /// The number of steps with one rate.
        steps: u64,
        /// The factor, in (0, 1].
        factor: f64,
    },
}

impl Schedule {
    /// The factor of step `step`, counted from 0; NaN for a period of no steps, which
    /// [`Schedule::check`] refuses.
    pub fn factor(&self, step: u64) -> f64 {
        match *self {
            Self::Constant => 1.0,
            Self::Cosine { steps, floor } if step >= steps => floor,
            Self::Cosine { steps, floor } => {
                let done = step as f64 / steps as f64;
                floor + (1.0 - floor) * 0.5 * (1.0 + (PI * done).cos())
            }
            Self::Polynomial { steps, .. } if step >= steps => 0.0,
            Self::Polynomial { steps, power } => ((steps - step) as f64 / steps as f64).powf(power),
            Self::Exponential { steps: 0, .. } | Self::Step { steps: 0, .. } => f64::NAN,
            Self::Exponential { steps, factor, floor } => {
                factor.powf(step as f64 / steps as f64).max(floor)
            }
            Self::Step { steps, factor } => factor.powf((step / steps) as f64),
        }
    }

    /// Checks the factors, floors and periods.
    ///
    /// # Errors
    /// [`FitError::Setting`] for a factor or floor outside its range, or a period of no steps.
    pub fn check(&self) -> Result<(), FitError> {
        match *self {
            Self::Cosine { floor, .. } | Self::Exponential { floor, .. }
                if !(0.0..=1.0).contains(&floor) =>
            {
                Err(FitError::setting("schedule", "a floor from 0 to 1", floor))
            }
            Self::Polynomial { power, .. } if !(power > 0.0 && power.is_finite()) => {
                Err(FitError::setting("schedule", "a finite power above 0", power))
            }
            Self::Exponential { steps: 0, .. } | Self::Step { steps: 0, .. } => {
                Err(FitError::setting("schedule", "a period of at least 1 step", 0))
            }
            Self::Exponential { factor, .. } | Self::Step { factor, .. }
                if !(factor > 0.0 && factor <= 1.0) =>
            {
                Err(FitError::setting("schedule", "a factor above 0 and up to 1", factor))
            }
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cosine_starts_at_one_halves_half_way_and_stays_at_its_floor() {
        let schedule = Schedule::Cosine { steps: 100, floor: 0.25 };
        assert_eq!(schedule.factor(0), 1.0);
        assert!((schedule.factor(50) - 0.625).abs() < 1e-15);
        assert_eq!(schedule.factor(100), 0.25);
        assert_eq!(schedule.factor(u64::MAX), 0.25);
        assert!((0..100).all(|step| schedule.factor(step) > schedule.factor(step + 1)));
    }

    #[test]
    fn a_polynomial_falls_from_one_to_zero_by_its_power() {
        let schedule = Schedule::Polynomial { steps: 100, power: 3.0 };
        assert_eq!(schedule.factor(0), 1.0);
        assert_eq!(schedule.factor(50), 0.125);
        assert_eq!((schedule.factor(100), schedule.factor(101)), (0.0, 0.0));
        let flat = Schedule::Polynomial { steps: 100, power: 0.0 };
        let message = "schedule needs a finite power above 0, got 0";
        assert_eq!(flat.check().unwrap_err().to_string(), message);
    }

    #[test]
    fn exponential_and_step_agree_at_whole_periods() {
        let smooth = Schedule::Exponential { steps: 10, factor: 0.5, floor: 0.0 };
        let sudden = Schedule::Step { steps: 10, factor: 0.5 };
        for period in 0..5 {
            let expected = 0.5_f64.powi(period);
            assert_eq!(smooth.factor(10 * period as u64), expected);
            assert_eq!(sudden.factor(10 * period as u64), expected);
            assert_eq!(sudden.factor(10 * period as u64 + 9), expected);
        }
        assert!((smooth.factor(5) - 0.5_f64.sqrt()).abs() < 1e-15);
        let with_floor = Schedule::Exponential { steps: 10, factor: 0.5, floor: 0.3 };
        assert_eq!([10, 20, 99].map(|step| with_floor.factor(step)), [0.5, 0.3, 0.3]);
    }

    #[test]
    fn schedules_outside_their_range_are_refused() {
        let message = |schedule: Schedule| schedule.check().map_err(|error| error.to_string());
        assert_eq!(message(Schedule::Constant), Ok(()));
        assert_eq!(message(Schedule::Cosine { steps: 0, floor: 0.0 }), Ok(()));
        assert_eq!(Schedule::Cosine { steps: 0, floor: 0.0 }.factor(0), 0.0);
        let floor = message(Schedule::Cosine { steps: 9, floor: 1.5 });
        assert_eq!(floor, Err("schedule needs a floor from 0 to 1, got 1.5".into()));
        let floor = message(Schedule::Exponential { steps: 9, factor: 0.5, floor: -0.5 });
        assert_eq!(floor, Err("schedule needs a floor from 0 to 1, got -0.5".into()));
        let steps = message(Schedule::Step { steps: 0, factor: 0.5 });
        assert_eq!(steps, Err("schedule needs a period of at least 1 step, got 0".into()));
        assert!(Schedule::Step { steps: 0, factor: 0.5 }.factor(3).is_nan());
        assert!(Schedule::Exponential { steps: 0, factor: 0.5, floor: 0.0 }.factor(3).is_nan());
        let factor = message(Schedule::Exponential { steps: 1, factor: f64::NAN, floor: 0.0 });
        assert_eq!(factor, Err("schedule needs a factor above 0 and up to 1, got NaN".into()));
    }
}
