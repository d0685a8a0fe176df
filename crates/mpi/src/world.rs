//! All ranks of an MPI job as a communicator of fits.

use std::sync::{Mutex, MutexGuard, PoisonError};

use bokashi_fit::Communicator;
use mpi::datatype::PartitionMut;
use mpi::environment::Universe;
use mpi::point_to_point::send_receive_into;
use mpi::topology::SimpleCommunicator;
use mpi::traits::{Communicator as _, CommunicatorCollectives as _, Destination as _};
use mpi::traits::{Root as _, Source as _};

/// The most numbers of one message: MPI counts in 32 bits with a sign.
const MOST: usize = 1 << 28;

/// All ranks of a job.
///
/// A rank that is lost ends the job: that is MPI's own rule (`MPI_ERRORS_ARE_FATAL`), and there is no
/// error to return.
#[derive(Debug)]
pub struct World {
    rank: usize,
    size: usize,
    /// Held during calls: MPI is started for one at a time.
    turn: Mutex<()>,
}

impl World {
    /// The ranks of the job that was started as `universe`.
    pub fn new(universe: &Universe) -> Self {
        let world = universe.world();
        // Neither is negative.
        let [rank, size] = [world.rank(), world.size()].map(|number| number as usize);
        Self { rank, size, turn: Mutex::default() }
    }

    fn turn(&self) -> (MutexGuard<'_, ()>, SimpleCommunicator) {
        let turn = self.turn.lock().unwrap_or_else(PoisonError::into_inner);
        (turn, SimpleCommunicator::world())
    }

    fn broadcast_bytes(&self, bytes: &mut Vec<u8>, from: usize) {
        let (_turn, world) = self.turn();
        let root = world.process_at_rank(from as i32);
        let mut length = bytes.len() as u64;
        root.broadcast_into(&mut length);
        bytes.resize(length as usize, 0);
        bytes.chunks_mut(MOST).for_each(|chunk| root.broadcast_into(chunk));
    }

    fn gather(&self, bytes: &[u8]) -> Vec<Vec<u8>> {
        let (_turn, world) = self.turn();
        let mut lengths = vec![0_i32; self.size];
        // What ranks say is short.
        world.all_gather_into(&(bytes.len() as i32), &mut lengths[..]);
        let mut starts = Vec::with_capacity(self.size);
        let mut end = 0;
        for length in &lengths {
            starts.push(end);
            end += length;
        }
        let mut all = vec![0_u8; end as usize];
        if end > 0 {
            let mut parts = PartitionMut::new(&mut all[..], &lengths[..], &starts[..]);
            world.all_gather_varcount_into(bytes, &mut parts);
        }
        let slice =
            |(&start, &length): (&i32, &i32)| all[start as usize..][..length as usize].to_vec();
        starts.iter().zip(&lengths).map(slice).collect()
    }
}

macro_rules! communicator {
    ($($t:ty),*) => {$(
        impl Communicator<$t> for World {
            fn rank(&self) -> usize {
                self.rank
            }

            fn size(&self) -> usize {
                self.size
            }

            fn send(&self, numbers: &[$t], to: usize) {
                let (_turn, world) = self.turn();
                let to = world.process_at_rank(to as i32);
                numbers.chunks(MOST).for_each(|chunk| to.send(chunk));
            }

            fn receive(&self, numbers: &mut [$t], from: usize) {
                let (_turn, world) = self.turn();
                let from = world.process_at_rank(from as i32);
                for chunk in numbers.chunks_mut(MOST) {
                    from.receive_into(chunk);
                }
            }

            fn exchange(&self, given: &[$t], received: &mut [$t], other: usize) {
                let (_turn, world) = self.turn();
                let other = world.process_at_rank(other as i32);
                let [most, other_most] = [given.len(), received.len()];
                for start in (0..most.max(other_most)).step_by(MOST) {
                    let part = |length: usize| start.min(length)..(start + MOST).min(length);
                    let (given, received) = (&given[part(most)], &mut received[part(other_most)]);
                    send_receive_into(given, &other, received, &other);
                }
            }

            fn broadcast(&self, numbers: &mut [$t], from: usize) {
                let (_turn, world) = self.turn();
                let root = world.process_at_rank(from as i32);
                numbers.chunks_mut(MOST).for_each(|chunk| root.broadcast_into(chunk));
            }

            fn broadcast_bytes(&self, bytes: &mut Vec<u8>, from: usize) {
                self.broadcast_bytes(bytes, from);
            }

            fn gather(&self, bytes: &[u8]) -> Vec<Vec<u8>> {
                self.gather(bytes)
            }

            fn barrier(&self) {
                let (_turn, world) = self.turn();
                world.barrier();
            }
        }
    )*};
}

communicator!(f32, f64);
