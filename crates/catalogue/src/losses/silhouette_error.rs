//! What two masks do not have in common.

use bokashi_check::{Case, subject};
use bokashi_fit::silhouette_error;
use proptest::prelude::*;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::inputs::leaf;
use crate::references::{ROWS, large, laws, pair};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("silhouette_error");
    subject!(Silhouette: |x| silhouette_error(x[0], x[1])?);
    let masks = pair(&[3, 4], (0.05..1.0).boxed());
    entry.check(laws("silhouette", Silhouette, masks, large(&[ROWS, ROWS])).refuses(
        "silhouette_error needs two masks of one shape, got shapes [2] and [3]",
        Case::new(Silhouette, vec![leaf([2], 1.0), leaf([3], 1.0)]),
    ));
    benchmark!(entry, "silhouette_error", |s| [s.image, s.aliased], |x| {
        silhouette_error(x[0], x[1])?
    });
    entry
}
