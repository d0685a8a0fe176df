//! The threads of the program: one pool, made before any work.

use rayon::{ThreadPoolBuildError, ThreadPoolBuilder};

use crate::failure::Failure;

/// More threads than any machine has cores for; ten thousands of them would not even start.
pub const MOST_THREADS: usize = 1024;

/// From where rayon takes a number of threads that nobody gave.
const VARIABLES: [&str; 2] = ["RAYON_NUM_THREADS", "RAYON_RS_NUM_CPUS"];

/// Starts the global pool with `threads` threads, one per core where none are given. The calling
/// thread is one of them: it hands work to no other where it does not pay. All of the program's
/// parallel work has to come from it.
///
/// # Errors
/// [`Failure::Use`] for too many threads in the environment; [`Failure::Work`] where they cannot be
/// started.
pub fn start_threads(threads: Option<usize>) -> Result<(), Failure> {
    started(builder(threads)?.use_current_thread().build_global())
}

/// [`start_threads`] for a program whose work comes from threads of its own, outside the pool.
///
/// # Errors
/// As [`start_threads`].
pub fn start_threads_apart(threads: Option<usize>) -> Result<(), Failure> {
    started(builder(threads)?.build_global())
}

fn builder(threads: Option<usize>) -> Result<ThreadPoolBuilder, Failure> {
    if threads.is_none() {
        for variable in VARIABLES {
            check_variable(variable, &std::env::var(variable).unwrap_or_default())?;
        }
    }
    // Of zero threads rayon makes one per core, or what the environment says.
    Ok(ThreadPoolBuilder::new().num_threads(threads.unwrap_or(0)))
}

fn started(result: Result<(), ThreadPoolBuildError>) -> Result<(), Failure> {
    result.map_err(|error| Failure::Work(format!("threads could not be started: {error}")))
}

/// Rayon takes no notice of what is no number; of a number it would start as many threads.
fn check_variable(variable: &str, value: &str) -> Result<(), Failure> {
    let is_number = !value.is_empty() && value.bytes().all(|byte| byte.is_ascii_digit());
    if is_number && value.parse::<usize>().map_or(true, |threads| threads > MOST_THREADS) {
        let rule = format!("{variable} needs a whole number up to {MOST_THREADS}, got {value}");
        return Err(Failure::Use(rule));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_many_threads_in_the_environment_are_refused() {
        for value in ["", "0", "1", "1024", "all", "-3"] {
            assert_eq!(check_variable("THREADS", value), Ok(()), "{value}");
        }
        for value in ["1025", "999999", "99999999999999999999999"] {
            let error = check_variable("THREADS", value).unwrap_err();
            let rule = "THREADS needs a whole number up to 1024, got";
            assert_eq!(error, Failure::Use(format!("{rule} {value}")));
        }
    }
}
