//! A row of the table: one thing computed, and left out.

use std::cmp::Ordering;

use serde::{Serialize, Serializer, ser::SerializeStruct as _};

use crate::bench::sampling::FEW_SAMPLES;
use crate::bench::sampling::Timing;

/// A row: one thing computed, and left out.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// What the second step has no need of.
    pub row: &'static str,
    /// What both gave, and whether it is the same to the bit.
    pub results: Vec<(&'static str, bool)>,
    /// What the second step's report names as left out and the first one's does not.
    pub left_out: Vec<String>,
    pub(super) with: Timing,
    pub(super) without: Timing,
}

impl Row {
    /// The least time of the step that computes it, in microseconds.
    pub fn microseconds_with(&self) -> f64 {
        1e6 * self.with.minimum
    }

    /// The least time of the step that has no need of it, in microseconds.
    pub fn microseconds_without(&self) -> f64 {
        1e6 * self.without.minimum
    }

    /// How the time of the step that has no need of it compares with the other's: equal where the
    /// ranges between their quartiles meet.
    pub fn time_without(&self) -> Ordering {
        self.without.compare(&self.with)
    }

    /// The same in a word, marked where it comes from few samples.
    pub(super) fn verdict(&self) -> String {
        let word = match self.time_without() {
            Ordering::Less => "faster",
            Ordering::Equal => "equal",
            Ordering::Greater => "SLOWER",
        };
        let is_marked = !(self.with.has_enough_samples() && self.without.has_enough_samples());
        format!("{word}{}", if is_marked { FEW_SAMPLES } else { "" })
    }

    /// Whether all results are the same to the bit.
    pub fn bitwise_equal(&self) -> bool {
        self.results.iter().all(|&(_, same)| same)
    }
}

/// As `{row, microseconds_with, microseconds_without, bitwise_equal}`.
impl Serialize for Row {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut object = serializer.serialize_struct("Row", 4)?;
        object.serialize_field("row", self.row)?;
        object.serialize_field("microseconds_with", &self.microseconds_with())?;
        object.serialize_field("microseconds_without", &self.microseconds_without())?;
        object.serialize_field("bitwise_equal", &self.bitwise_equal())?;
        object.end()
    }
}
