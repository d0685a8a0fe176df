//! How a job of several ranks begins and ends.
//!
//! Ranks end together. What goes wrong on one of them in the middle of a fit is told to all, and the
//! first says it. So is a signal. Whoever ends in another way - the first rank, which writes, or a
//! panic - ends the whole job: the others would wait for it.

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use bokashi_cli::failure::{Failure, ended};
use bokashi_fit::{Communicator, Ranks};
use mpi::Threading;
use mpi::topology::SimpleCommunicator;
use mpi::traits::Communicator as _;

use crate::world::World;

/// Long for a pipe on a busy machine, and short for who waits.
const BEFORE_ABORT: Duration = Duration::from_millis(300);

/// The status of a program that panicked.
const PANICKED: i32 = 101;

/// Does `work` as one rank of an MPI job, and ends the job with its failure.
pub fn as_rank(work: impl FnOnce(&Ranks<f32>) -> Result<(), Failure>) -> ExitCode {
    // Calls come from any thread, one at a time.
    let failed = |message: &str| ended("bokashi-mpi", Err(Failure::Work(message.to_owned())));
    let (universe, threading) = match mpi::initialize_with_threading(Threading::Serialized) {
        Some(started) => started,
        None => return failed("MPI was started before"),
    };
    if !matches!(threading, Threading::Serialized | Threading::Multiple) {
        return failed("this MPI takes calls from one thread alone");
    }
    let world = World::new(&universe);
    let is_first = Communicator::<f32>::rank(&world) == 0;
    let ranks: Ranks<f32> = Arc::new(world);
    match catch_unwind(AssertUnwindSafe(|| work(&ranks))) {
        Ok(Ok(())) => ExitCode::SUCCESS,
        // The first rank has heard it, and speaks; MPI waits for it as the universe ends.
        Ok(Err(failure)) if !is_first => ExitCode::from(failure.status()),
        // All ranks have heard it. An abort would meet mpirun, which ends the job by itself where it got the
        // signal: Open MPI 4.1 then hung in one job of twenty, after all ranks had ended.
        Ok(Err(failure @ Failure::Interrupted { .. })) => ended("bokashi-mpi", Err(failure)),
        Ok(Err(failure)) => {
            let status = failure.status();
            ended("bokashi-mpi", Err(failure));
            // What was said is on its way to mpirun, and MPICH's abort may overtake it.
            std::thread::sleep(BEFORE_ABORT);
            SimpleCommunicator::world().abort(status.into())
        }
        // The panic has said what it is.
        Err(_) => SimpleCommunicator::world().abort(PANICKED),
    }
}
