//! The sum of partial sums that lie on several ranks, to the bits of the sum on one.
//!
//! # The tree
//! Parts are added in the tree of [`Tape::sum_over`](bokashi_core::Tape::sum_over), which depends on
//! their number alone. A rank has neighbouring parts, and so the sums of the largest subtrees that lie
//! in its own. Where a node's halves lie on two ranks, one sends its half to the other. Of the two the
//! one that has more of the node's parts adds: so a row of small subtrees at the edge of a rank's parts
//! is added where most of it is, and few sums travel.
//!
//! # What crosses the wire
//! First, from all to all: each rank's values, and which inputs its parts depend on; or its error. Then
//! gradients, in pieces: a rank that has sent a piece goes on with the next while that one is added. At
//! last the sum goes from the root of the tree to all.
//!
//! All ranks know all messages beforehand, and make them in one order: so none waits for ever.

use std::ops::Range;

use bokashi_core::{PartialSum, Scalar, Shape, Tensor, halves};

use crate::communicator::{Communicator, agree};
use crate::error::FitError;

/// Numbers in one message: 256 KiB in `f32`. Far larger than what a message costs by itself, and small
/// enough that the ranks of a chain work at the same time.
const PIECE: usize = 1 << 16;

/// The sum over all parts, and how many bytes all ranks together sent for it.
pub(crate) struct Reduced<T: Scalar> {
    pub(crate) sum: PartialSum<T>,
    pub(crate) bytes: u64,
}

/// Two sums become one, where `keep` is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Addition {
    keep: usize,
    give: usize,
}

/// Which sums there are, on which ranks, and how they become one.
#[derive(Debug)]
struct Plan<'a> {
    /// The first part of each rank, and the number of all.
    bounds: &'a [usize],
    /// By sum: the rank that has it.
    owners: Vec<usize>,
    additions: Vec<Addition>,
}

impl<'a> Plan<'a> {
    /// The plan, and the sum that is the whole in the end.
    fn new(bounds: &'a [usize]) -> (Self, usize) {
        let mut plan = Self { bounds, owners: Vec::new(), additions: Vec::new() };
        let root = plan.add(0..bounds[bounds.len() - 1]);
        (plan, root)
    }

    /// The rank that has the part.
    fn owner(&self, part: usize) -> usize {
        // Of ranks without parts, the bounds are alike.
        self.bounds.partition_point(|&bound| bound <= part) - 1
    }

    /// How many parts of a range a rank has.
    fn share(&self, rank: usize, range: &Range<usize>) -> usize {
        let [from, to] = [self.bounds[rank], self.bounds[rank + 1]];
        to.min(range.end).saturating_sub(from.max(range.start))
    }

    /// The sum of a range.
    fn add(&mut self, range: Range<usize>) -> usize {
        let first = self.owner(range.start);
        if self.bounds[first + 1] >= range.end {
            self.owners.push(first);
            return self.owners.len() - 1;
        }
        let Some(parts) = halves(&range) else { unreachable!("a part is on one rank") };
        let [first, second] = parts.map(|half| self.add(half));
        let share = |sum: usize| self.share(self.owners[sum], &range);
        let (keep, give) =
            if share(first) >= share(second) { (first, second) } else { (second, first) };
        self.additions.push(Addition { keep, give });
        keep
    }
}

/// Adds up the sums of all ranks: `own` are those of this one, of the parts `bounds[rank]..bounds[rank + 1]`.
/// `shapes` are those of the inputs, or nothing for an input that needs no gradient.
///
/// # Errors
/// As [`agree`]: that of the first rank whose parts were refused.
pub(crate) fn reduced<T: Scalar>(
    ranks: &dyn Communicator<T>,
    bounds: &[usize],
    shapes: &[Option<Shape>],
    own: Result<Vec<PartialSum<T>>, FitError>,
) -> Result<Reduced<T>, FitError> {
    let mut own = own;
    let head = own.as_mut().map(|sums| head(sums)).map_err(|error| error.clone());
    let heads = agree(ranks, head)?;
    let own = own?;
    let (plan, root) = Plan::new(bounds);
    let mut sums = Sums::new(ranks, &plan, shapes, own, &heads);
    let said: usize = heads.iter().map(|head| head.len() + 1).sum();
    let mut numbers = 0;
    for (input, shape) in shapes.iter().enumerate() {
        let Some(shape) = shape else { continue };
        numbers += sums.add_input(input, shape, &plan.additions, root);
    }
    let gradients = std::mem::take(&mut sums.gradients[root]);
    // Values are few: every rank adds them all.
    for &Addition { keep, give } in &plan.additions {
        let give = sums.values[give];
        sums.values[keep] += give;
    }
    let others = ranks.size() as u64 - 1;
    let bytes = said as u64 * others + numbers * size_of::<T>() as u64;
    Ok(Reduced { sum: PartialSum::new(sums.values[root], gradients), bytes })
}

/// The sum of as many tensors as there are ranks, of which each has one; all have the same shape. All
/// ranks know it then, and its bits are those of a tree that depends on the number of ranks alone.
///
/// # Errors
/// None of its own.
pub fn sum_over_ranks<T: Scalar>(
    ranks: &dyn Communicator<T>,
    own: Tensor<T>,
) -> Result<Tensor<T>, FitError> {
    let shape = own.shape().clone();
    let bounds: Vec<_> = (0..=ranks.size()).collect();
    let own = vec![PartialSum::new(T::ZERO.widen(), vec![Some(own)])];
    let Reduced { mut sum, .. } = reduced(ranks, &bounds, &[Some(shape.clone())], Ok(own))?;
    Ok(sum.gradients.pop().flatten().unwrap_or_else(|| Tensor::zeros(shape)))
}

/// What all ranks have to know of sums: values, and which inputs have a gradient.
fn head<T: Scalar>(sums: &[PartialSum<T>]) -> Vec<u8> {
    let of = |sum: &PartialSum<T>| {
        let mut bytes = sum.value.to_f64().to_le_bytes().to_vec();
        bytes.extend(sum.gradients.iter().map(|gradient| u8::from(gradient.is_some())));
        bytes
    };
    sums.iter().flat_map(of).collect()
}

/// All sums, of which each rank has the gradients of its own.
struct Sums<'a, T: Scalar> {
    ranks: &'a dyn Communicator<T>,
    owners: &'a [usize],
    values: Vec<T::Wide>,
    /// By sum and input: whether a part depends on it.
    is_used: Vec<Vec<bool>>,
    /// By sum and input; of other ranks' sums nothing, but for the whole in the end.
    gradients: Vec<Vec<Option<Tensor<T>>>>,
}

impl<'a, T: Scalar> Sums<'a, T> {
    fn new(
        ranks: &'a dyn Communicator<T>,
        plan: &'a Plan<'_>,
        shapes: &[Option<Shape>],
        own: Vec<PartialSum<T>>,
        heads: &[Vec<u8>],
    ) -> Self {
        let inputs = shapes.len();
        let mut heads: Vec<_> = heads.iter().map(|head| head.chunks(8 + inputs)).collect();
        let mut own = own.into_iter();
        let mut sums = Self {
            ranks,
            owners: &plan.owners,
            values: Vec::new(),
            is_used: Vec::new(),
            gradients: Vec::new(),
        };
        for &owner in &plan.owners {
            let head = heads[owner].next().unwrap_or_default();
            let value = head.first_chunk().map_or(f64::NAN, |&bytes| f64::from_le_bytes(bytes));
            sums.values.push(T::Wide::from_f64(value));
            sums.is_used.push(head.iter().skip(8).map(|&byte| byte == 1).collect());
            let of_this = (owner == ranks.rank()).then(|| own.next()).flatten();
            sums.gradients.push(of_this.map_or_else(|| vec![None; inputs], |sum| sum.gradients));
        }
        sums
    }

    /// Makes the gradient of the `root` that of the whole, on all ranks, for one input; returns how many
    /// numbers were sent.
    fn add_input(
        &mut self,
        input: usize,
        shape: &Shape,
        additions: &[Addition],
        root: usize,
    ) -> u64 {
        // Who is added to what, where there is something to add.
        let mut steps = Vec::new();
        for &Addition { keep, give } in additions {
            if self.is_used[give][input] {
                let is_first = !std::mem::replace(&mut self.is_used[keep][input], true);
                steps.push((keep, give, is_first));
            }
        }
        if !self.is_used[root][input] {
            return 0;
        }
        let own = self.ranks.rank();
        // What is received, or added to nothing, needs a place.
        for &(keep, _, is_first) in &steps {
            if is_first && self.owners[keep] == own {
                self.gradients[keep][input] = Some(Tensor::zeros(shape));
            }
        }
        let size = shape.size();
        let mut sent = 0;
        let mut buffer = vec![T::ZERO; PIECE.min(size)];
        for start in (0..size).step_by(PIECE) {
            let piece = start..(start + PIECE).min(size);
            for &(keep, give, is_first) in &steps {
                let [to, from] = [keep, give].map(|sum| self.owners[sum]);
                let buffer = &mut buffer[..piece.len()];
                if to != from {
                    sent += piece.len() as u64;
                }
                if from == own {
                    let Some(given) = &self.gradients[give][input] else { continue };
                    let given = &given.data()[piece.clone()];
                    if to != own {
                        self.ranks.send(given, to);
                        continue;
                    }
                    buffer.copy_from_slice(given);
                } else if to == own {
                    self.ranks.receive(buffer, from);
                } else {
                    continue;
                }
                let Some(kept) = &mut self.gradients[keep][input] else { continue };
                let kept = &mut kept.data_mut()[piece.clone()];
                if is_first {
                    // Zero and a number are another zero where the number is -0.
                    kept.copy_from_slice(buffer);
                } else {
                    kept.iter_mut().zip(&*buffer).for_each(|(kept, &given)| *kept += given);
                }
            }
        }
        let whole = &mut self.gradients[root][input];
        let whole = whole.get_or_insert_with(|| Tensor::zeros(shape));
        self.ranks.broadcast(whole.data_mut(), self.owners[root]);
        sent + (self.ranks.size() as u64 - 1) * size as u64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::communicator::block;
    use crate::in_memory::on_ranks;

    #[test]
    fn the_sum_of_tensors_is_known_to_all_ranks() {
        for size in [1, 2, 5] {
            let found = on_ranks(size, |ranks| {
                let own = Tensor::from_flat_fn([3], |k| (10 * ranks.rank() + k) as f32);
                sum_over_ranks(&*ranks, own).unwrap()
            });
            let pairs = (size * (size - 1) / 2 * 10) as f32;
            let expected = Tensor::from_flat_fn([3], |k| pairs + (size * k) as f32);
            assert!(found.iter().all(|sum| *sum == expected), "{found:?}");
        }
    }

    #[test]
    fn each_part_is_added_once_and_few_sums_travel() {
        for (count, size) in [
            (1, 4),
            (8, 4),
            (100, 3),
            (1000, 4),
            (1000, 7),
            (5000, 7),
            (10000, 64),
            (5, 7),
            (64, 64),
        ] {
            let bounds = (0..size).map(|rank| block(count, rank, size).start);
            let bounds: Vec<_> = bounds.chain([count]).collect();
            let (plan, root) = Plan::new(&bounds);
            assert_eq!(plan.additions.len(), plan.owners.len() - 1);
            // Each sum is given once, but for the whole.
            let mut given: Vec<_> = plan.additions.iter().map(|own| own.give).collect();
            given.push(root);
            given.sort_unstable();
            assert_eq!(given, (0..plan.owners.len()).collect::<Vec<_>>());
            let is_sent = |own: &&Addition| plan.owners[own.keep] != plan.owners[own.give];
            let sent = plan.additions.iter().filter(is_sent).count();
            assert!(sent <= 3 * (size - 1), "{count} parts on {size} ranks: {sent} sums travel");
        }
    }
}
