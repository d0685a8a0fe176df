//! Ranks that are threads of one process, to try out several ranks without a cluster.

use std::collections::{HashMap, VecDeque};
use std::fmt;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use crate::communicator::{Communicator, Ranks};

/// Calls `work` on `size` threads at once, each of which is a rank. Returns the results by rank.
///
/// ```
/// use bokashi_fit::on_ranks;
///
/// let said = on_ranks::<f32, _>(3, |ranks| {
///     let mut numbers = [ranks.rank() as f32];
///     ranks.broadcast(&mut numbers, 2);
///     numbers[0]
/// });
/// assert_eq!(said, [2.0; 3]);
/// ```
///
/// # Panics
/// Where `work` panics on any rank. Other ranks then panic too, so that none waits.
pub fn on_ranks<T, R>(size: usize, work: impl Fn(Ranks<T>) -> R + Sync) -> Vec<R>
where
    T: Copy + Send + 'static,
    R: Send,
{
    let channel = Arc::new(Channel { queues: Mutex::default(), arrived: Condvar::new() });
    std::thread::scope(|scope| {
        let start = |rank| {
            let (channel, work) = (Arc::clone(&channel), &work);
            scope.spawn(move || {
                let guard = PanicGuard(&channel);
                let result = work(Arc::new(Rank { rank, size, channel: Arc::clone(&channel) }));
                std::mem::forget(guard);
                result
            })
        };
        let threads: Vec<_> = (0..size).map(start).collect();
        let ended: Vec<_> = threads.into_iter().map(|thread| thread.join()).collect();
        ended.into_iter().map(|result| result.expect("a rank panicked")).collect()
    })
}

/// Tells the other ranks if this one panics: they would wait for ever.
struct PanicGuard<'a, T>(&'a Channel<T>);

impl<T> Drop for PanicGuard<'_, T> {
    fn drop(&mut self) {
        self.0.lock().is_over = true;
        self.0.arrived.notify_all();
    }
}

/// A message: numbers or bytes.
enum Message<T> {
    Numbers(Vec<T>),
    Bytes(Vec<u8>),
}

/// The messages under way, and whether a rank has panicked.
struct Queues<T> {
    /// The messages by sender and receiver, in the order in which they were sent.
    messages: HashMap<(usize, usize), VecDeque<Message<T>>>,
    is_over: bool,
}

impl<T> Default for Queues<T> {
    fn default() -> Self {
        Self { messages: HashMap::new(), is_over: false }
    }
}

/// The queues that all ranks share.
struct Channel<T> {
    queues: Mutex<Queues<T>>,
    arrived: Condvar,
}

impl<T> Channel<T> {
    fn lock(&self) -> MutexGuard<'_, Queues<T>> {
        self.queues.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

struct Rank<T> {
    rank: usize,
    size: usize,
    channel: Arc<Channel<T>>,
}

impl<T> fmt::Debug for Rank<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "rank {} of {}", self.rank, self.size)
    }
}

impl<T> Rank<T> {
    fn put(&self, message: Message<T>, to: usize) {
        self.channel.lock().messages.entry((self.rank, to)).or_default().push_back(message);
        self.channel.arrived.notify_all();
    }

    fn take(&self, from: usize) -> Message<T> {
        let mut queues = self.channel.lock();
        loop {
            let queue = queues.messages.get_mut(&(from, self.rank));
            if let Some(message) = queue.and_then(VecDeque::pop_front) {
                return message;
            }
            assert!(!queues.is_over, "a message from rank {from}, which panicked");
            queues = self.channel.arrived.wait(queues).unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn take_bytes(&self, from: usize) -> Vec<u8> {
        match self.take(from) {
            Message::Bytes(bytes) => bytes,
            Message::Numbers(_) => panic!("bytes from rank {from}, not numbers"),
        }
    }

    fn others(&self) -> impl Iterator<Item = usize> + use<T> {
        let this = self.rank;
        (0..self.size).filter(move |&rank| rank != this)
    }
}

impl<T: Copy + Send + 'static> Communicator<T> for Rank<T> {
    fn rank(&self) -> usize {
        self.rank
    }

    fn size(&self) -> usize {
        self.size
    }

    fn send(&self, numbers: &[T], to: usize) {
        self.put(Message::Numbers(numbers.to_vec()), to);
    }

    fn receive(&self, numbers: &mut [T], from: usize) {
        match self.take(from) {
            Message::Numbers(sent) => numbers.copy_from_slice(&sent),
            Message::Bytes(_) => panic!("numbers from rank {from}, not bytes"),
        }
    }

    fn broadcast(&self, numbers: &mut [T], from: usize) {
        if from == self.rank {
            self.others().for_each(|to| self.send(numbers, to));
        } else {
            self.receive(numbers, from);
        }
    }

    fn broadcast_bytes(&self, bytes: &mut Vec<u8>, from: usize) {
        if from == self.rank {
            self.others().for_each(|to| self.put(Message::Bytes(bytes.clone()), to));
        } else {
            *bytes = self.take_bytes(from);
        }
    }

    fn gather(&self, message: &[u8]) -> Vec<Vec<u8>> {
        self.others().for_each(|to| self.put(Message::Bytes(message.to_vec()), to));
        let message_of =
            |from| if from == self.rank { message.to_vec() } else { self.take_bytes(from) };
        (0..self.size).map(message_of).collect()
    }
}
