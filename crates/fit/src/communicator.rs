//! Messages between the ranks of a job, which are its processes.
//!
//! A job of several ranks does one fit. Each rank has all parameters, and computes the gradients of some of
//! the views. [`Alone`] is the only rank of its job.
//!
//! # The order of calls
//! All ranks make the same calls in the same order, but that [`Communicator::send`] on one rank meets
//! [`Communicator::receive`] on another. So all ranks must know whatever decides about a call: see
//! [`agree`].

use std::fmt::Debug;
use std::ops::Range;
use std::sync::Arc;

use bokashi_core::Scalar;
use bokashi_core::mixing::mixed;

use crate::error::FitError;
use crate::given::{Given, described, differences};
use crate::parameter::Parameters;

/// A rank of a job, which exchanges numbers `T` with the other ranks.
///
/// No call returns an error: a job that loses a rank ends.
pub trait Communicator<T>: Debug + Send + Sync {
    /// The number of this rank, from 0.
    fn rank(&self) -> usize;

    /// The number of ranks.
    fn size(&self) -> usize;

    /// Sends `numbers` to the rank `to`, which must receive as many.
    fn send(&self, numbers: &[T], to: usize);

    /// Receives `numbers` from the rank `from`.
    fn receive(&self, numbers: &mut [T], from: usize);

    /// Sends `given` to the rank `other` and receives its numbers at the same time. Both make this call.
    fn exchange(&self, given: &[T], received: &mut [T], other: usize) {
        if self.rank() < other {
            self.send(given, other);
            self.receive(received, other);
        } else {
            self.receive(received, other);
            self.send(given, other);
        }
    }

    /// Gives all ranks the `numbers` of the rank `from`. All ranks have the same count.
    fn broadcast(&self, numbers: &mut [T], from: usize);

    /// Gives all ranks the `bytes` of the rank `from`, of any count.
    fn broadcast_bytes(&self, bytes: &mut Vec<u8>, from: usize);

    /// Gathers a message of any length from each rank, in the order of ranks.
    fn gather(&self, message: &[u8]) -> Vec<Vec<u8>>;

    /// Returns when all ranks have called it.
    fn barrier(&self) {
        self.gather(&[]);
    }
}

/// The only rank of a job.
#[derive(Debug, Clone, Copy, Default)]
pub struct Alone;

impl<T> Communicator<T> for Alone {
    fn rank(&self) -> usize {
        0
    }

    fn size(&self) -> usize {
        1
    }

    fn send(&self, _numbers: &[T], _to: usize) {}

    fn receive(&self, _numbers: &mut [T], _from: usize) {}

    fn broadcast(&self, _numbers: &mut [T], _from: usize) {}

    fn broadcast_bytes(&self, _bytes: &mut Vec<u8>, _from: usize) {}

    fn gather(&self, message: &[u8]) -> Vec<Vec<u8>> {
        vec![message.to_vec()]
    }
}

/// A rank, shared by all parts of a fit that send messages.
pub type Ranks<T> = Arc<dyn Communicator<T>>;

/// The range of items, of `count`, that belong to a rank of `size`. Ranks have about equally many.
///
/// A bound may move by a 16th of a block, to the number that is roundest in binary. Then the sum of a block
/// consists of few subtrees, and fewer sums are sent: for 1000 views on 4 ranks 4, not 12. So the largest
/// block is at most an 8th too large, which is less than views differ in their work.
pub fn block(count: usize, rank: usize, size: usize) -> Range<usize> {
    let bound = |rank: usize| {
        // Indices are far below 2^64 / size.
        let (even, slack) = (rank * count / size, count / size / 16);
        if rank == size {
            return count;
        }
        let rounded = |bit: u32| (even + slack) >> bit << bit;
        let bits = (0..usize::BITS - 1).rev();
        bits.map(rounded).find(|&bound| bound + slack >= even).unwrap_or(even)
    };
    bound(rank)..bound(rank + 1)
}

/// Gathers a message from each rank, unless a rank failed. So all ranks learn of a failure, and none waits
/// for the rank that failed.
///
/// # Errors
/// This rank's error if no lower rank has one; otherwise [`FitError::Elsewhere`].
pub fn agree<T, E: From<FitError> + ToString>(
    ranks: &dyn Communicator<T>,
    result: Result<Vec<u8>, E>,
) -> Result<Vec<Vec<u8>>, E> {
    if ranks.size() == 1 {
        return Ok(vec![result?]);
    }
    let message = match &result {
        Ok(bytes) => [&[0], &**bytes].concat(),
        Err(error) => [&[1], error.to_string().as_bytes()].concat(),
    };
    let mut all = ranks.gather(&message);
    if let Some(rank) = all.iter().position(|message| message.first() != Some(&0)) {
        if rank == ranks.rank() {
            result?;
        }
        let message = all[rank].get(1..).unwrap_or_default();
        let message = String::from_utf8_lossy(message).into_owned();
        return Err(FitError::Elsewhere { rank, message }.into());
    }
    all.iter_mut().for_each(|message| *message = message.split_off(1));
    Ok(all)
}

/// The result of this rank, unless a rank failed.
///
/// # Errors
/// As [`agree`].
pub fn agreed<T, R, E: From<FitError> + ToString>(
    ranks: &dyn Communicator<T>,
    result: Result<R, E>,
) -> Result<R, E> {
    let (outcome, made) = match result {
        Ok(made) => (Ok(Vec::new()), Some(made)),
        Err(error) => (Err(error), None),
    };
    agree(ranks, outcome)?;
    made.ok_or_else(|| unreachable!("a rank that failed said so"))
}

/// Checks that all ranks have the same parameters and moments, to the bit, after `step` updates. A difference
/// means that machines do not compute alike.
///
/// # Errors
/// [`FitError::Apart`] on all ranks, with the first rank that differs from rank 0.
pub fn check_same<T: Scalar>(
    ranks: &dyn Communicator<T>,
    parameters: &Parameters<T>,
    step: u64,
) -> Result<(), FitError> {
    if ranks.size() == 1 {
        return Ok(());
    }
    let all = ranks.gather(&fingerprint(parameters).to_le_bytes());
    match all.iter().position(|print| *print != all[0]) {
        Some(rank) => Err(FitError::Apart { step, rank }),
        None => Ok(()),
    }
}

/// Checks before the first step that all ranks were given the same files and settings. With different
/// settings ranks would wait for each other for ever.
///
/// # Errors
/// [`FitError::Unlike`] on all ranks, with the first rank that differs from rank 0, and the difference.
pub fn check_alike<T>(ranks: &dyn Communicator<T>, given: &Given) -> Result<(), FitError> {
    if ranks.size() == 1 {
        return Ok(());
    }
    // Names and values are words without such a byte.
    let joined = |words: &[&str]| words.join("\0").into_bytes();
    let parts = |bytes: &[u8]| -> Vec<String> {
        let words = bytes.split(|&byte| byte == 0);
        words.map(|word| String::from_utf8_lossy(word).into_owned()).collect()
    };
    let words: Vec<_> = given.iter().flat_map(|(name, value)| [&**name, &**value]).collect();
    let mut first = joined(&words);
    ranks.broadcast_bytes(&mut first, 0);
    let first = parts(&first);
    let first = first.chunks_exact(2).map(|pair| (pair[0].clone(), pair[1].clone())).collect();
    let differing = differences(given, &first);
    let message = differing.first().map_or(Vec::new(), |differing| {
        joined(&[
            &differing.name,
            described(differing.this.as_ref()),
            described(differing.other.as_ref()),
        ])
    });
    let all = ranks.gather(&message);
    let Some(rank) = all.iter().position(|message| !message.is_empty()) else { return Ok(()) };
    let mut words = parts(&all[rank]).into_iter();
    let mut next = || words.next().unwrap_or_default();
    Err(FitError::Unlike { name: next(), ranks: [rank, 0], values: [next(), next()] })
}

/// A hash of all raw numbers and moments.
fn fingerprint<T: Scalar>(parameters: &Parameters<T>) -> u64 {
    let mix_numbers = |hash: u64, numbers: &[T]| {
        let words = numbers.iter().map(|number| number.to_f64().to_bits());
        words.fold(mixed(hash ^ numbers.len() as u64), |hash, word| mixed(hash ^ word))
    };
    parameters.list.iter().fold(0, |hash, parameter| {
        let all = [parameter.raw.data(), &parameter.first, &parameter.second, &parameter.greatest];
        all.into_iter().fold(hash, mix_numbers)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::in_memory::on_ranks;
    use crate::parameter::Parameter;
    use bokashi_core::Tensor;

    #[test]
    fn blocks_are_neighbours_and_about_as_large_as_each_other() {
        for (count, size) in [(10, 3), (2, 7), (0, 4), (100, 3), (1000, 4), (5000, 7), (1000, 64)] {
            let blocks: Vec<_> = (0..size).map(|rank| block(count, rank, size)).collect();
            assert!(blocks.windows(2).all(|pair| pair[0].end == pair[1].start));
            assert_eq!((blocks[0].start, blocks[size - 1].end), (0, count));
            let even = count / size;
            assert!(blocks.iter().all(|own| own.len().abs_diff(even) <= 1 + even / 8));
        }
        assert_eq!(block(1000, 1, 4), 256..512);
    }

    #[test]
    fn an_error_of_one_rank_is_an_error_of_all() {
        let heard = on_ranks::<f64, _>(4, |ranks| {
            let own = match ranks.rank() {
                2 | 3 => Err(FitError::setting("view", "an image", ranks.rank())),
                rank => Ok(vec![rank as u8]),
            };
            agree(&*ranks, own).unwrap_err().to_string()
        });
        let own = "view needs an image, got 2";
        let elsewhere = format!("rank 2: {own}");
        assert_eq!(heard, [&elsewhere, &elsewhere, own, &elsewhere]);
        let said = on_ranks::<f64, _>(3, |ranks| {
            agree::<_, FitError>(&*ranks, Ok(vec![7; ranks.rank()])).unwrap()
        });
        assert!(said.iter().all(|all| *all == [vec![], vec![7], vec![7, 7]]));
    }

    #[test]
    fn a_bit_that_differs_is_found_with_its_step_and_rank() {
        let check = |odd: usize| {
            on_ranks::<f32, _>(4, |ranks| {
                let x = if ranks.rank() == odd { 1.0_f32.next_up() } else { 1.0 };
                let list = Parameters::new().with(Parameter::new("x", Tensor::scalar(x)));
                check_same(&*ranks, &list.unwrap(), 12)
            })
        };
        assert!(check(9).iter().all(Result::is_ok));
        for found in check(3) {
            let said = found.unwrap_err().to_string();
            assert_eq!(said, "all ranks need the same parameters, got others on rank 3 at step 12");
        }
    }

    #[test]
    fn ranks_that_were_given_something_else_are_named() {
        let check = |odd: usize, name: &str| {
            on_ranks::<f32, _>(4, |ranks| {
                let mut own = Given::from([("a".into(), "1".into()), ("b".into(), "2".into())]);
                if ranks.rank() >= odd {
                    own.insert(name.into(), "3".into());
                }
                check_alike(&*ranks, &own)
            })
        };
        assert!(check(9, "b").iter().all(Result::is_ok));
        let rule = "all ranks need the same files and settings, got another";
        for (odd, name, said) in [
            (2, "b", "b on rank 2: it has 3, and rank 0 has 2"),
            (3, "c", "c on rank 3: it has 3, and rank 0 has nothing"),
        ] {
            for found in check(odd, name) {
                assert_eq!(found.unwrap_err().to_string(), format!("{rule} {said}"));
            }
        }
    }
}
