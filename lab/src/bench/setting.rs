//! What every study is given, and how its figures come about.

use std::path::Path;
use std::{fs, io};

use bokashi_fit::FitError;
use rayon::{ThreadPool, ThreadPoolBuilder};
use serde::Deserialize;

use crate::bench::effort::Effort;
use crate::bench::machine::Machine;
use crate::bench::mesh_file::MeshFile;

/// A measurement of someone else's code, as the package `lab/peers` writes it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Peer {
    /// Which study it belongs to: `scenes`, `blur` or `surfaces`.
    pub study: String,
    /// Whose code.
    pub name: String,
    /// The scene, for `scenes`; which passes, for `surfaces`.
    pub scene: Option<String>,
    /// Width and height in pixels, for `blur`.
    pub pixels: Option<usize>,
    /// The standard deviation in pixels, for `blur`.
    pub sigma: Option<f64>,
    /// How many threads, for `surfaces`.
    pub threads: Option<usize>,
    /// The least time of its samples.
    pub minimum_microseconds: f64,
    /// Their median.
    pub median_microseconds: f64,
    /// The largest error against the exact result, as a share of the largest entry.
    pub error: Option<f64>,
}

/// Reads the measurements that the package `lab/peers` wrote.
///
/// # Errors
/// Where the file can't be read, or holds something else.
pub fn read_peers(file: &Path) -> io::Result<Vec<Peer>> {
    serde_json::from_slice(&fs::read(file)?).map_err(io::Error::from)
}

/// What every study is given.
pub(crate) struct Bench {
    pub(crate) effort: Effort,
    /// Pools of one thread and of two, or of as many as there are cores where that is less.
    pub(crate) pools: Vec<ThreadPool>,
    pub(crate) peers: Vec<Peer>,
    pub(crate) meshes: Vec<MeshFile>,
}

impl Bench {
    /// Without anything from files.
    pub(crate) fn new(effort: Effort) -> Result<Self, FitError> {
        let cores = std::thread::available_parallelism().map_or(1, usize::from);
        let pool = |threads: usize| {
            let built = ThreadPoolBuilder::new().num_threads(threads).build();
            built.map_err(FitError::operation)
        };
        let pools = (1..=cores.min(2)).map(pool).collect::<Result<_, _>>()?;
        Ok(Self { effort, pools, peers: Vec::new(), meshes: Vec::new() })
    }

    /// The pool of one thread.
    pub(crate) fn one(&self) -> &ThreadPool {
        &self.pools[0]
    }

    /// The largest pool.
    pub(crate) fn widest(&self) -> &ThreadPool {
        self.pools.last().expect("there is one pool at least")
    }

    /// The peers of one study.
    pub(crate) fn peers_of(&self, study: &'static str) -> impl Iterator<Item = &Peer> {
        self.peers.iter().filter(move |peer| peer.study == study)
    }

    /// The names of the peers of one study, each once, in the order of their first figures.
    pub(crate) fn peer_names(&self, study: &'static str) -> Vec<String> {
        let mut names: Vec<String> = Vec::new();
        for peer in self.peers_of(study) {
            if !names.contains(&peer.name) {
                names.push(peer.name.clone());
            }
        }
        names
    }
}

/// How the figures came about.
pub(crate) fn method(effort: Effort) -> String {
    let machine = Machine::here();
    let few = match effort {
        Effort::Quick => {
            " THIS IS A QUICK RUN: small sizes, three samples each; its times mean nothing."
        }
        Effort::Full => "",
    };
    format!(
        "{machine}. Times are the minimum of the samples where nothing else is said; samples are \
         taken in turns, at least 30 of each, and figures from fewer are marked *. A sample enters \
         its thread pool once, on one thread as on two, and takes as many steps as make half a \
         millisecond or more, after as many that are not timed.{few}"
    )
}
