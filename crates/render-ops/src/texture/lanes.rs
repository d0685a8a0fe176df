//! Blocks of probes, number by number: loops over arrays become vectors.

/// Probes in a block: several vectors of any machine, and few enough for all numbers of a block to stay
/// in a processor's first cache.
pub(super) const LANES: usize = 64;

/// A number of each probe of a block.
pub(super) type Lanes<T> = [T; LANES];
