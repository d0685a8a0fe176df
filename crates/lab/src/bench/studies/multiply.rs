//! What does the tape itself cost?
//!
//! A chain of multiplications, forward and backward: the time per multiplication is the slope
//! between a short chain and a long one, so that what a step costs once does not count.

use std::hint::black_box;

use bokashi_core::{Tape, Tensor};
use bokashi_fit::FitError;

use crate::bench::effort::USUAL;
use crate::bench::sampling::{Contestant, Timing, interleaved};
use crate::bench::setting::Bench;
use crate::bench::study::Study;
use crate::bench::table::{Cell, Table};

/// Lengths of the two chains.
const CHAINS: [usize; 2] = [20, 220];
const LENGTHS: [usize; 4] = [1, 16, 256, 3072];

/// A step of `count` multiplications of `x: [length]`, forward, backward, reset.
fn chain<'a>(length: usize, count: usize, both: bool, bench: &'a Bench) -> Contestant<'a> {
    let (start, factor) = (Tensor::full([length], 0.5_f32), Tensor::full([length], 1.001));
    let mut tape = Tape::new();
    Contestant::new(bench.one(), move || {
        {
            let x = tape.leaf(&start);
            let factor = if both { tape.leaf(&factor) } else { tape.constant(&factor) };
            let mut product = x;
            for _ in 0..count {
                product = product * factor;
            }
            black_box(product.sum().backward()?.get(x));
        }
        tape.reset();
        Ok(())
    })
}

pub(super) fn study(bench: &Bench) -> Result<Study, FitError> {
    let mut study = Study::new(
        "multiply",
        "A multiplication on the tape",
        "Forward and backward of one multiplication of vectors in a chain, f32, one thread: the \
         slope between chains of 20 and of 220. One factor is constant, as in others' figures, or \
         both need a gradient. Others' figures come from crates/lab/peers, where a file of them \
         was given.",
    );
    let mut table = Table::new(
        "multiply",
        "Nanoseconds per multiplication",
        &[
            ("whose", "name"),
            ("factors with a gradient", "factors"),
            ("length 1", "length_1_nanoseconds"),
            ("16", "length_16_nanoseconds"),
            ("256", "length_256_nanoseconds"),
            ("3072", "length_3072_nanoseconds"),
        ],
    );
    for both in [false, true] {
        let mut row = vec![Cell::text("Bokashi"), Cell::text(if both { "both" } else { "one" })];
        for length in LENGTHS {
            let mut chains = CHAINS.map(|count| chain(length, count, both, bench));
            let found = interleaved(&mut chains, bench.effort, USUAL);
            let timings: Result<Vec<Timing>, FitError> = found.into_iter().collect();
            row.push(match study.noted(&format!("length {length}"), timings) {
                None => Cell::Nothing,
                Some(timings) => {
                    let slope =
                        (timings[1].minimum - timings[0].minimum) / (CHAINS[1] - CHAINS[0]) as f64;
                    Cell::timed(&timings[1], 1e9 * slope)
                }
            });
        }
        table.push(row);
    }
    for name in bench.peer_names("multiply") {
        let of = |length: usize| {
            let mut own = bench.peers_of("multiply").filter(|peer| peer.name == name);
            own.find(|peer| peer.length == Some(length)).map(|peer| 1e3 * peer.minimum_microseconds)
        };
        let mut row = vec![Cell::text(&name), Cell::text("one")];
        row.extend(LENGTHS.map(|length| Cell::maybe(of(length))));
        table.push(row);
    }
    study.tables.push(table);
    Ok(study)
}
