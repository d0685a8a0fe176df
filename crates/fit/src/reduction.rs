//! The sum of partial sums on several ranks, with the bits of the sum on one rank.
//!
//! # The tree
//! Parts are added in the tree of [`Tape::sum_over`](bokashi_core::Tape::sum_over), which depends on their number
//! alone. A rank has neighbouring parts, and so the sums of the largest subtrees within them. Where the halves of a
//! node are on two ranks, one rank sends its half to the other. The rank with more of the node's parts adds. If both
//! have as many, the node above decides. So small subtrees at the end of a rank's parts are added where most of their
//! node is, and few sums are sent.
//!
//! # What crosses the wire
//! First all ranks exchange their values, and which inputs their parts depend on, or their errors. Then gradients are
//! sent in pieces: a rank sends the next piece while the last one is added. Where both ranks have as many parts, each
//! of them adds one half of the numbers, so that messages go both ways at once. At the end all ranks receive the sum.
//!
//! All ranks know all messages beforehand and send them in one order. So no rank waits for ever.

use std::cmp::Ordering;
use std::ops::Range;

use bokashi_core::{PartialSum, Scalar, Shape, Tensor, halves};

use crate::communicator::{Communicator, agree};
use crate::error::FitError;

/// The numbers in one message, 256 KiB in `f32`: so many that the latency of a message hardly counts, and so few that
/// the ranks of a chain work at the same time.
const PIECE: usize = 1 << 16;

/// The sum over all parts, and the number of bytes that all ranks together sent for it.
pub(crate) struct Reduced<T: Scalar> {
    pub(crate) sum: PartialSum<T>,
    pub(crate) bytes: u64,
}

/// An addition of two sums. The result replaces the sum `keep`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Addition {
    keep: usize,
    give: usize,
}

/// An addition of one input.
#[derive(Debug, Clone, Copy)]
struct Step {
    keep: usize,
    give: usize,
    /// Whether the kept sum has no number yet.
    is_first: bool,
}

/// The sums, their ranks, and the additions that make one sum of them.
#[derive(Debug)]
struct Plan<'a> {
    /// The first part of each rank, and the number of all.
    bounds: &'a [usize],
    /// Whether the rank with the second half adds, of two ranks with as many of a node's parts.
    is_second: bool,
    /// The rank of each sum.
    owners: Vec<usize>,
    additions: Vec<Addition>,
    /// The sum that is the whole in the end.
    root: usize,
}

impl<'a> Plan<'a> {
    fn new(bounds: &'a [usize], is_second: bool) -> Self {
        let (owners, additions) = (Vec::new(), Vec::new());
        let mut plan = Self { bounds, is_second, owners, additions, root: 0 };
        plan.root = plan.add(0..bounds[bounds.len() - 1], &mut Vec::new());
        plan
    }

    /// The rank that has the part.
    fn owner(&self, part: usize) -> usize {
        // Of ranks without parts, the bounds are alike.
        self.bounds.partition_point(|&bound| bound <= part) - 1
    }

    /// The number of parts of a range that a rank has.
    fn share(&self, rank: usize, range: &Range<usize>) -> usize {
        let [from, to] = [self.bounds[rank], self.bounds[rank + 1]];
        to.min(range.end).saturating_sub(from.max(range.start))
    }

    /// Plans the sum of a range, whose ancestors in the tree are `above`. Returns the index of the sum.
    fn add(&mut self, range: Range<usize>, above: &mut Vec<Range<usize>>) -> usize {
        let first = self.owner(range.start);
        if self.bounds[first + 1] >= range.end {
            self.owners.push(first);
            return self.owners.len() - 1;
        }
        let Some(parts) = halves(&range) else { unreachable!("a part is on one rank") };
        above.push(range);
        let [first, second] = parts.map(|half| self.add(half, above));
        let (one, other) = if self.is_second { (second, first) } else { (first, second) };
        // Where ranks have as much of this node, they may not of those above.
        let shares = above
            .iter()
            .rev()
            .map(|range| [one, other].map(|sum| self.share(self.owners[sum], range)));
        let order = shares.map(|[one, other]| one.cmp(&other)).find(|order| order.is_ne());
        let (keep, give) = if order == Some(Ordering::Less) { (other, one) } else { (one, other) };
        above.pop();
        self.additions.push(Addition { keep, give });
        keep
    }
}

/// Adds up the sums of all ranks. `sums_of_rank` are those of this rank, for the parts `bounds[rank]..bounds[rank +
/// 1]`. `shapes` are the shapes of the inputs; `None` for an input that needs no gradient.
///
/// # Errors
/// As [`agree`]: that of the first rank whose parts were refused.
pub(crate) fn reduced<T: Scalar>(
    ranks: &dyn Communicator<T>,
    bounds: &[usize],
    shapes: &[Option<Shape>],
    sums_of_rank: Result<Vec<PartialSum<T>>, FitError>,
) -> Result<Reduced<T>, FitError> {
    let mut sums_of_rank = sums_of_rank;
    let head = sums_of_rank.as_mut().map(|sums| head(sums)).map_err(|error| error.clone());
    let heads = agree(ranks, head)?;
    let sums_of_rank = sums_of_rank?;
    let plans = [false, true].map(|is_second| Plan::new(bounds, is_second));
    let mut sums = Sums::new(ranks, &plans[0].owners, shapes, sums_of_rank, &heads);
    let bytes_of_heads: usize = heads.iter().map(|head| head.len() + 1).sum();
    let mut numbers = 0;
    for (input, shape) in shapes.iter().enumerate() {
        let Some(shape) = shape else { continue };
        numbers += sums.add_input(input, shape, &plans);
    }
    let [Plan { additions, root, .. }, _] = &plans;
    let gradients = std::mem::take(&mut sums.gradients[*root]);
    // Values are few: every rank adds them all.
    for &Addition { keep, give } in additions {
        let give = sums.values[give];
        sums.values[keep] += give;
    }
    let others = ranks.size() as u64 - 1;
    let bytes = bytes_of_heads as u64 * others + numbers * size_of::<T>() as u64;
    Ok(Reduced { sum: PartialSum::new(sums.values[*root], gradients), bytes })
}

/// The sum of one tensor of each rank, all of the same shape. All ranks return it. Tensors are added in a tree that
/// depends on the number of ranks alone.
///
/// # Errors
/// None.
pub fn sum_over_ranks<T: Scalar>(
    ranks: &dyn Communicator<T>,
    tensor: Tensor<T>,
) -> Result<Tensor<T>, FitError> {
    let shape = tensor.shape().clone();
    let bounds: Vec<_> = (0..=ranks.size()).collect();
    let sums = vec![PartialSum::new(T::ZERO.widen(), vec![Some(tensor)])];
    let Reduced { mut sum, .. } = reduced(ranks, &bounds, &[Some(shape.clone())], Ok(sums))?;
    Ok(sum.gradients.pop().flatten().unwrap_or_else(|| Tensor::zeros(shape)))
}

/// The bytes about sums that all ranks exchange: values, and which inputs have a gradient.
fn head<T: Scalar>(sums: &[PartialSum<T>]) -> Vec<u8> {
    let bytes_of = |sum: &PartialSum<T>| {
        let mut bytes = sum.value.to_f64().to_le_bytes().to_vec();
        bytes.extend(sum.gradients.iter().map(|gradient| u8::from(gradient.is_some())));
        bytes
    };
    sums.iter().flat_map(bytes_of).collect()
}

/// All sums. A rank has the gradients of its own sums.
struct Sums<'a, T: Scalar> {
    ranks: &'a dyn Communicator<T>,
    owners: &'a [usize],
    values: Vec<T::Wide>,
    /// By sum and input: whether a part depends on it.
    is_used: Vec<Vec<bool>>,
    /// By sum and input: the gradient. Those of other ranks' sums are `None`, but for the whole in the end.
    gradients: Vec<Vec<Option<Tensor<T>>>>,
}

impl<'a, T: Scalar> Sums<'a, T> {
    fn new(
        ranks: &'a dyn Communicator<T>,
        owners: &'a [usize],
        shapes: &[Option<Shape>],
        sums_of_rank: Vec<PartialSum<T>>,
        heads: &[Vec<u8>],
    ) -> Self {
        let inputs = shapes.len();
        let mut heads: Vec<_> = heads.iter().map(|head| head.chunks(8 + inputs)).collect();
        let mut sums_of_rank = sums_of_rank.into_iter();
        let mut sums =
            Self { ranks, owners, values: Vec::new(), is_used: Vec::new(), gradients: Vec::new() };
        for &owner in owners {
            let head = heads[owner].next().unwrap_or_default();
            let value = head.first_chunk().map_or(f64::NAN, |&bytes| f64::from_le_bytes(bytes));
            sums.values.push(T::Wide::from_f64(value));
            sums.is_used.push(head.iter().skip(8).map(|&byte| byte == 1).collect());
            let of_this = (owner == ranks.rank()).then(|| sums_of_rank.next()).flatten();
            sums.gradients.push(of_this.map_or_else(|| vec![None; inputs], |sum| sum.gradients));
        }
        sums
    }

    /// Makes the gradient of the first plan's root that of the whole, on all ranks, for one input; returns
    /// how many numbers were sent. Each plan adds a half of the numbers.
    fn add_input(&mut self, input: usize, shape: &Shape, plans: &[Plan<'_>; 2]) -> u64 {
        if !self.is_used.iter().any(|uses| uses[input]) {
            return 0;
        }
        let size = shape.size();
        let half = if size > PIECE { size / 2 } else { size };
        let halves = [0..half, half..size];
        let steps = plans.each_ref().map(|plan| self.steps(input, &plan.additions));
        // What is received, or added to nothing, needs a place.
        let rank = self.ranks.rank();
        for (steps, half) in steps.iter().zip(&halves) {
            for step in steps.iter().flatten().filter(|step| step.is_first && !half.is_empty()) {
                if self.owners[step.keep] == rank {
                    self.gradients[step.keep][input].get_or_insert_with(|| Tensor::zeros(shape));
                }
            }
        }
        let mut sent = 0;
        let mut buffer = vec![T::ZERO; PIECE.min(size)];
        for offset in (0..size - size / 2).step_by(PIECE) {
            let pieces = halves.each_ref().map(|half| {
                let start = (half.start + offset).min(half.end);
                start..(start + PIECE).min(half.end)
            });
            for (first, second) in steps[0].iter().zip(&steps[1]) {
                let [first, second] =
                    [(first, &pieces[0]), (second, &pieces[1])].map(|(step, piece)| {
                        step.filter(|_| !piece.is_empty()).map(|step| (step, piece))
                    });
                sent += self.add_at_node(input, first, second, &mut buffer);
            }
        }
        self.spread(input, shape, plans.each_ref().map(|plan| plan.root), half);
        sent + (self.ranks.size() as u64 - 1) * size as u64
    }

    /// The steps of all additions for one input. An addition without a gradient has none.
    fn steps(&self, input: usize, additions: &[Addition]) -> Vec<Option<Step>> {
        let mut is_used: Vec<_> = self.is_used.iter().map(|uses| uses[input]).collect();
        let step_of = |&Addition { keep, give }: &Addition| {
            is_used[give].then(|| {
                let is_first = !std::mem::replace(&mut is_used[keep], true);
                Step { keep, give, is_first }
            })
        };
        additions.iter().map(step_of).collect()
    }

    /// Adds pieces of both halves at one node; returns how many numbers were sent.
    fn add_at_node(
        &mut self,
        input: usize,
        first: Option<(Step, &Range<usize>)>,
        second: Option<(Step, &Range<usize>)>,
        buffer: &mut [T],
    ) -> u64 {
        let rank = self.ranks.rank();
        if let (Some((one, of_one)), Some((other, of_other))) = (first, second)
            && let ([from, to], [back, forth]) = (self.way(one), self.way(other))
            && from != to
            && [from, to] == [forth, back]
        {
            // Each gives the other what that one keeps.
            let ways = if rank == to {
                Some(((one, of_one), (other, of_other), from))
            } else if rank == from {
                Some(((other, of_other), (one, of_one), to))
            } else {
                None
            };
            if let Some(((kept, piece), (given, given_piece), partner)) = ways {
                let buffer = &mut buffer[..piece.len()];
                if let Some(given) = &self.gradients[given.give][input] {
                    self.ranks.exchange(&given.data()[given_piece.clone()], buffer, partner);
                }
                self.keep(input, kept, piece, buffer);
            }
            return (of_one.len() + of_other.len()) as u64;
        }
        let mut sent = 0;
        for (step, piece) in [first, second].into_iter().flatten() {
            let [from, to] = self.way(step);
            let buffer = &mut buffer[..piece.len()];
            if to != from {
                sent += piece.len() as u64;
            }
            if from == rank {
                let Some(given) = &self.gradients[step.give][input] else { continue };
                let given = &given.data()[piece.clone()];
                if to != rank {
                    self.ranks.send(given, to);
                    continue;
                }
                buffer.copy_from_slice(given);
            } else if to == rank {
                self.ranks.receive(buffer, from);
            } else {
                continue;
            }
            self.keep(input, step, piece, buffer);
        }
        sent
    }

    /// The ranks that send and receive in a step.
    fn way(&self, step: Step) -> [usize; 2] {
        [step.give, step.keep].map(|sum| self.owners[sum])
    }

    /// Adds a received piece to the kept sum.
    fn keep(&mut self, input: usize, step: Step, piece: &Range<usize>, given: &[T]) {
        let Some(kept) = &mut self.gradients[step.keep][input] else { return };
        let kept = &mut kept.data_mut()[piece.clone()];
        if step.is_first {
            // Zero and a number are another zero where the number is -0.
            kept.copy_from_slice(given);
        } else {
            kept.iter_mut().zip(given).for_each(|(kept, &given)| *kept += given);
        }
    }

    /// Gives all ranks the whole: the first `half` of its numbers from the one root, the rest from the other.
    fn spread(&mut self, input: usize, shape: &Shape, roots: [usize; 2], half: usize) {
        let [first, second] = roots;
        let rank = self.ranks.rank();
        let ranks = roots.map(|root| self.owners[root]);
        let mut whole = self.gradients[first][input].take().filter(|_| rank == ranks[0]);
        if rank == ranks[1] && first != second && half < shape.size() {
            let rest = self.gradients[second][input].take();
            match (&mut whole, rest) {
                (Some(whole), Some(rest)) => {
                    whole.data_mut()[half..].copy_from_slice(&rest.data()[half..]);
                }
                (whole, rest) => *whole = rest,
            }
        }
        let mut whole = whole.unwrap_or_else(|| Tensor::zeros(shape));
        let (front, back) = whole.data_mut().split_at_mut(half);
        // Of two ranks, each has what the other lacks.
        if self.ranks.size() == 2 && ranks[0] != ranks[1] && !back.is_empty() {
            match rank == ranks[0] {
                true => self.ranks.exchange(front, back, ranks[1]),
                false => self.ranks.exchange(back, front, ranks[0]),
            }
        } else {
            self.ranks.broadcast(front, ranks[0]);
            if !back.is_empty() {
                self.ranks.broadcast(back, ranks[1]);
            }
        }
        self.gradients[first][input] = Some(whole);
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
    fn a_sum_of_many_pieces_has_the_bits_of_the_tree() {
        let size = 2 * PIECE + 3;
        let part = |rank: usize| Tensor::from_flat_fn([size], |k| ((k * (rank + 3)) as f32).sin());
        for count in [2, 3, 4, 5, 7, 8] {
            fn tree(range: Range<usize>, part: &dyn Fn(usize) -> Vec<f32>) -> Vec<f32> {
                match halves(&range) {
                    Some(parts) if range.len() > 1 => {
                        let [first, second] = parts.map(|half| tree(half, part));
                        first.iter().zip(&second).map(|(a, b)| a + b).collect()
                    }
                    _ => part(range.start),
                }
            }
            let expected = tree(0..count, &|rank| part(rank).data().to_vec());
            let found =
                on_ranks(count, |ranks| sum_over_ranks(&*ranks, part(ranks.rank())).unwrap());
            for (rank, sum) in found.iter().enumerate() {
                assert!(sum.data() == expected, "rank {rank} of {count}");
            }
        }
    }

    #[test]
    fn what_is_added_to_nothing_keeps_its_sign() {
        for giver in [0, 1] {
            let found = on_ranks(2, |ranks| {
                let zero = Tensor::from_flat_fn([2 * PIECE], |_| -0.0_f32);
                let shapes = [Some(zero.shape().clone())];
                let own = (ranks.rank() == giver).then_some(zero);
                let own = vec![PartialSum::new(0.0, vec![own])];
                reduced(&*ranks, &[0, 1, 2], &shapes, Ok(own)).unwrap().sum.gradients.pop()
            });
            for sum in found {
                let sum = sum.flatten().unwrap();
                assert!(sum.data().iter().all(|x| x.to_bits() == (-0.0_f32).to_bits()));
            }
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
            let plans = [false, true].map(|is_second| Plan::new(&bounds, is_second));
            for plan in plans {
                assert_eq!(plan.additions.len(), plan.owners.len() - 1);
                // Each sum is given once, but for the whole.
                let mut given: Vec<_> = plan.additions.iter().map(|own| own.give).collect();
                given.push(plan.root);
                given.sort_unstable();
                assert_eq!(given, (0..plan.owners.len()).collect::<Vec<_>>());
                let is_sent = |own: &&Addition| plan.owners[own.keep] != plan.owners[own.give];
                let sent = plan.additions.iter().filter(is_sent).count();
                assert!(
                    sent <= 3 * (size - 1),
                    "{count} parts on {size} ranks: {sent} sums travel"
                );
            }
        }
    }
}
