//! Many fits that have nothing to do with each other, as one job: each rank takes the next.
//!
//! Each fit is a process of its own, so whatever becomes of it harms no other. The first rank hands out
//! fits and takes what is said of them; meanwhile its own fit runs.

mod ended;
mod fits;
mod table;

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

use bokashi_cli::failure::Failure;
use bokashi_cli::interrupt::Interrupt;
use bokashi_fit::{Ranks, agree, agreed};
use mpi::topology::SimpleCommunicator;
use mpi::traits::{Communicator as _, Destination as _, MatchedReceiveVec as _, Source as _};

use self::ended::Ended;
pub use self::fits::{Fit, of_paper, read};
use self::table::write;

/// The first word of a command line that asks for one fit, without MPI.
pub const ALONE: &str = "alone";

/// Between two looks at what goes on: far below the shortest fit, and nothing for a processor.
const PAUSE: Duration = Duration::from_millis(5);

/// No fit is left.
const NONE: u64 = u64::MAX;

/// The most bytes that are kept of what a failed fit said.
const MOST_SAID: usize = 2000;

/// What a rank tells the first: how its last fit ended, and whether it was asked to end.
type Answer = (Option<Ended>, bool);

/// A fit under way.
struct Running {
    fit: usize,
    child: Child,
    started: Instant,
    folder: PathBuf,
    /// Whether it was asked to end.
    is_asked: bool,
}

impl Running {
    fn start(fits: &[Fit], fit: usize, out: &Path) -> Result<Self, String> {
        let Fit { name, paper, arguments } = &fits[fit];
        let folder = out.join(name);
        let failed = |error: std::io::Error| format!("it could not be started: {error}");
        fs::create_dir_all(&folder).map_err(failed)?;
        let errors = File::create(folder.join("errors.txt")).map_err(failed)?;
        let mut command = Command::new(std::env::current_exe().map_err(failed)?);
        let paper = paper.then_some("paper");
        command.arg(ALONE).args(paper).arg("fit").args(arguments).arg("--quiet");
        command.arg("--out").arg(&folder).arg("--json").arg(folder.join("fit.json"));
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(errors);
        let child = command.spawn().map_err(failed)?;
        Ok(Self { fit, child, started: Instant::now(), folder, is_asked: false })
    }

    /// How it ended, once it has.
    fn ended(&mut self, rank: usize) -> Option<Ended> {
        let failure = match self.child.try_wait() {
            Ok(None) => return None,
            Ok(Some(status)) if status.success() => None,
            Ok(Some(status)) => {
                let text = fs::read_to_string(self.folder.join("errors.txt")).unwrap_or_default();
                let text = text.trim().trim_start_matches("bokashi-mpi: ");
                let start = (0..=text.len().min(MOST_SAID))
                    .rev()
                    .find(|&index| text.is_char_boundary(index));
                let text = &text[..start.unwrap_or(0)];
                Some(if text.is_empty() { status.to_string() } else { text.to_owned() })
            }
            Err(error) => Some(error.to_string()),
        };
        let seconds = self.started.elapsed().as_secs_f64();
        Some(Ended { fit: self.fit, rank, seconds, failure })
    }

    /// Asks the fit to save itself and end.
    fn ask_to_end(&mut self) {
        if !std::mem::replace(&mut self.is_asked, true)
            && let Some(process) = rustix::process::Pid::from_raw(self.child.id() as i32)
        {
            // It may have ended by itself meanwhile.
            let _ = rustix::process::kill_process(process, rustix::process::Signal::TERM);
        }
    }
}

/// Does all `fits`, with results in folders of `out` by their names, and writes a table of them.
///
/// # Errors
/// [`Failure::Work`] with the number of fits that failed and what the first said; [`Failure::Interrupted`]
/// by a signal to any rank, when the fits under way have ended.
pub fn run(
    fits: &[Fit],
    out: &Path,
    ranks: &Ranks<f32>,
    interrupt: &Interrupt,
) -> Result<(), Failure> {
    let made = fs::create_dir_all(out);
    let made = made.map_err(|error| Failure::Work(format!("{}: {error}", out.display())));
    agreed(&**ranks, made)?;
    let world = SimpleCommunicator::world();
    let ended = match ranks.rank() {
        0 => hand_out(fits, out, &world, interrupt),
        rank => {
            take(fits, out, rank, &world, interrupt);
            Vec::new()
        }
    };
    let signal = interrupt.signal().map_or(0, |signal| signal.unsigned_abs() as u8);
    let all = agree::<_, Failure>(&**ranks, Ok(vec![signal]))?;
    let signal = all.iter().flatten().find(|&&signal| signal != 0);
    if ranks.rank() == 0 {
        write(fits, &ended, out)?;
    }
    let failed: Vec<_> = ended.iter().filter(|ended| ended.failure.is_some()).collect();
    if let Some(&signal) = signal {
        let done = ended.len() - failed.len();
        let message = format!("interrupted with {done} of {} fits done", fits.len());
        return Err(Failure::Interrupted { signal: signal.into(), message });
    }
    match failed.first() {
        None => Ok(()),
        Some(first) => {
            let message = first.failure.clone().unwrap_or_default();
            let (count, all, name) = (failed.len(), fits.len(), &fits[first.fit].name);
            Err(Failure::Work(format!(
                "{count} of {all} fits failed, the first: {name}: {message}"
            )))
        }
    }
}

/// The first rank: hands out fits, and does some itself. Returns how they ended, in their order.
fn hand_out(
    fits: &[Fit],
    out: &Path,
    world: &SimpleCommunicator,
    interrupt: &Interrupt,
) -> Vec<Ended> {
    let mut next = 0..fits.len();
    let mut ended = Vec::<Ended>::new();
    let mut current = None::<Running>;
    let mut others = world.size() - 1;
    let mut is_over = false;
    loop {
        is_over |= interrupt.signal().is_some();
        while let Some(message) = world.any_process().immediate_matched_probe() {
            let (bytes, status) = message.matched_receive_vec::<u8>();
            let (last, is_signalled) = serde_json::from_slice::<Answer>(&bytes).unwrap_or_default();
            ended.extend(last);
            is_over |= is_signalled;
            let fit = if is_over { None } else { next.next() }.map_or(NONE, |fit| fit as u64);
            others -= i32::from(fit == NONE);
            world.process_at_rank(status.source_rank()).send(&fit);
        }
        if let Some(running) = &mut current {
            if is_over {
                running.ask_to_end();
            }
            if let Some(done) = running.ended(0) {
                ended.push(done);
                current = None;
            }
        }
        if current.is_none() {
            match if is_over { None } else { next.next() } {
                Some(fit) => match Running::start(fits, fit, out) {
                    Ok(running) => current = Some(running),
                    Err(message) => ended.push(not_started(fit, 0, message)),
                },
                None if others == 0 => break,
                None => {}
            }
        }
        std::thread::sleep(PAUSE);
    }
    ended.sort_by_key(|ended| ended.fit);
    ended
}

fn not_started(fit: usize, rank: usize, message: String) -> Ended {
    Ended { fit, rank, seconds: 0.0, failure: Some(message) }
}

/// Any other rank: asks for a fit, does it, says how it ended, and asks for the next.
fn take(fits: &[Fit], out: &Path, rank: usize, world: &SimpleCommunicator, interrupt: &Interrupt) {
    let first = world.process_at_rank(0);
    let mut last = None::<Ended>;
    loop {
        // Names and numbers alone have a JSON.
        let answer: Answer = (last.take(), interrupt.signal().is_some());
        first.send(&serde_json::to_vec(&answer).unwrap_or_default()[..]);
        while first.immediate_probe().is_none() {
            std::thread::sleep(PAUSE);
        }
        let (fit, _) = first.receive::<u64>();
        if fit == NONE {
            return;
        }
        let fit = fit as usize;
        last = Some(match Running::start(fits, fit, out) {
            Err(message) => not_started(fit, rank, message),
            Ok(mut running) => loop {
                if interrupt.signal().is_some() {
                    running.ask_to_end();
                }
                if let Some(ended) = running.ended(rank) {
                    break ended;
                }
                std::thread::sleep(PAUSE);
            },
        });
    }
}
