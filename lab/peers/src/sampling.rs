//! Samples: the least and the median time of something, in microseconds.

use std::time::Instant;

const SAMPLES: usize = 100;
const ENOUGH: usize = 30;
/// No figure takes longer, once there are enough samples.
const SECONDS: f64 = 0.3;

/// The time of each of several contestants, taken in turns: `[minimum, median]` microseconds.
pub fn interleaved(contestants: &mut [&mut dyn FnMut()]) -> Vec<[f64; 2]> {
    let mut all = vec![Vec::new(); contestants.len()];
    contestants.iter_mut().for_each(|run| run());
    let start = Instant::now();
    let budget = SECONDS * contestants.len() as f64;
    for round in 0..SAMPLES {
        if round >= ENOUGH && start.elapsed().as_secs_f64() > budget {
            break;
        }
        for (run, samples) in contestants.iter_mut().zip(&mut all) {
            let start = Instant::now();
            run();
            samples.push(1e6 * start.elapsed().as_secs_f64());
        }
    }
    let sorted = all.into_iter().map(|mut samples| {
        samples.sort_by(f64::total_cmp);
        [samples[0], samples[samples.len() / 2]]
    });
    sorted.collect()
}
