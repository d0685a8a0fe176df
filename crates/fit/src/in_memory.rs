//! Ranks that are threads of one process: what several ranks do, tried out without a cluster.

use std::collections::{HashMap, VecDeque};
use std::fmt;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use crate::communicator::{Communicator, Ranks};

/// Calls `work` on `size` threads at once, each of which is a rank; what each returns, by rank.
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
/// Where `work` does, on any rank: the others are then told.
pub fn on_ranks<T, R>(size: usize, work: impl Fn(Ranks<T>) -> R + Sync) -> Vec<R>
where
    T: Copy + Send + 'static,
    R: Send,
{
    let office = Arc::new(Office { post: Mutex::default(), came: Condvar::new() });
    std::thread::scope(|scope| {
        let start = |rank| {
            let (office, work) = (Arc::clone(&office), &work);
            scope.spawn(move || {
                let leaves = Leaves(&office);
                let result = work(Arc::new(Rank { rank, size, office: Arc::clone(&office) }));
                std::mem::forget(leaves);
                result
            })
        };
        let threads: Vec<_> = (0..size).map(start).collect();
        let ended: Vec<_> = threads.into_iter().map(|thread| thread.join()).collect();
        ended.into_iter().map(|result| result.expect("a rank panicked")).collect()
    })
}

/// A rank that panics would let the others wait.
struct Leaves<'a, T>(&'a Office<T>);

impl<T> Drop for Leaves<'_, T> {
    fn drop(&mut self) {
        self.0.post().is_over = true;
        self.0.came.notify_all();
    }
}

/// A message: numbers or bytes.
enum Message<T> {
    Numbers(Vec<T>),
    Bytes(Vec<u8>),
}

struct Post<T> {
    /// By sender and receiver, in the order in which they were sent.
    ways: HashMap<(usize, usize), VecDeque<Message<T>>>,
    is_over: bool,
}

impl<T> Default for Post<T> {
    fn default() -> Self {
        Self { ways: HashMap::new(), is_over: false }
    }
}

/// Where messages wait.
struct Office<T> {
    post: Mutex<Post<T>>,
    came: Condvar,
}

impl<T> Office<T> {
    fn post(&self) -> MutexGuard<'_, Post<T>> {
        self.post.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

struct Rank<T> {
    rank: usize,
    size: usize,
    office: Arc<Office<T>>,
}

impl<T> fmt::Debug for Rank<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "rank {} of {}", self.rank, self.size)
    }
}

impl<T> Rank<T> {
    fn put(&self, message: Message<T>, to: usize) {
        self.office.post().ways.entry((self.rank, to)).or_default().push_back(message);
        self.office.came.notify_all();
    }

    fn take(&self, from: usize) -> Message<T> {
        let mut post = self.office.post();
        loop {
            let way = post.ways.get_mut(&(from, self.rank));
            if let Some(message) = way.and_then(VecDeque::pop_front) {
                return message;
            }
            assert!(!post.is_over, "a message from rank {from}, which panicked");
            post = self.office.came.wait(post).unwrap_or_else(PoisonError::into_inner);
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
