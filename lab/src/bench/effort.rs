//! How much to measure.

/// Fewer samples than this are marked wherever their figure stands.
pub(crate) const ENOUGH_SAMPLES: usize = 30;

/// The usual budget of a contestant, in seconds.
pub(crate) const USUAL: f64 = 0.1;
/// The budget where small differences count.
pub(crate) const GENEROUS: f64 = 1.0;
/// No contestant takes longer, in seconds, however few its samples are then.
const LONGEST: f64 = 2.0;

/// How much to measure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Effort {
    /// Small sizes and a few samples: whether all of it runs, not how fast. A few seconds.
    Quick,
    /// All sizes, at least 30 samples except where they would take too long. Some minutes.
    Full,
}

impl Effort {
    /// The first where little is measured, the second otherwise.
    pub(crate) fn choose<A>(self, quick: A, full: A) -> A {
        if self == Self::Quick { quick } else { full }
    }

    /// How many samples to take of something that takes `seconds` per sample: as many as fit
    /// `budget` seconds, but enough, unless those take too long.
    pub(crate) fn samples(self, seconds: f64, budget: f64) -> usize {
        match self {
            Self::Quick => 3,
            Self::Full => {
                let within = |budget: f64| (budget / seconds) as usize;
                within(budget).clamp(ENOUGH_SAMPLES, 300).min(within(LONGEST).max(3))
            }
        }
    }

    /// What a sample should take at least, so that the clock's own time does not count; several
    /// steps make a sample where one takes less.
    pub(crate) fn sample_seconds(self) -> f64 {
        self.choose(1e-5, 5e-4)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_takes_seconds_has_fewer_samples_than_are_enough() {
        assert_eq!(Effort::Full.samples(1e-3, USUAL), 100);
        assert_eq!(Effort::Full.samples(0.05, USUAL), ENOUGH_SAMPLES);
        assert_eq!(Effort::Full.samples(0.5, GENEROUS), 4);
        assert_eq!(Effort::Full.samples(100.0, USUAL), 3);
        assert!(Effort::Quick.samples(1e-3, USUAL) < ENOUGH_SAMPLES);
    }
}
