//! What a scene does not need costs nothing, changes no bit, and is named.
//!
//! Each row has two steps that differ in one thing: the first computes it, the second has no need
//! of it. Whatever both give (picture, loss, gradients) must be the same to the bit, and the report
//! of the second step's tape must name what was left out.

mod pairs;
mod row;
mod section;
mod step;

use bokashi_core::{Tape, Tensor};
use bokashi_fit::FitError;

use self::pairs::pairs;
pub use self::row::Row;
pub use self::section::section;
use self::step::{Results, Step};
use crate::bench::effort::{Effort, GENEROUS};
use crate::bench::sampling::{Contestant, interleaved};
use crate::bench::setting::Bench;

/// Whether two tensors have the same bits.
fn same_bits(a: &Tensor<f32>, b: &Tensor<f32>) -> bool {
    let bits = |tensor: &Tensor<f32>| tensor.data().iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    a.shape() == b.shape() && bits(a) == bits(b)
}

/// What a step gives, and what its report says.
struct Look {
    results: Results,
    /// What is named as left out.
    named: Vec<String>,
    operations: Vec<&'static str>,
}

/// A look at one step.
fn look(step: &Step) -> Result<Look, FitError> {
    let tape = Tape::new();
    let results = step.take(&mut step.start(), &tape, true)?;
    let report = tape.take_report();
    let left_out = report.left_out.iter();
    let named = left_out.map(|entry| format!("{}: {}", entry.name, entry.reason)).collect();
    let operations = report.operations.iter().map(|entry| entry.name).collect();
    Ok(Look { results, named, operations })
}

/// A step over and over.
fn contestant<'a>(step: &'a Step, bench: &'a Bench) -> Contestant<'a> {
    let (mut start, mut tape) = (step.start(), Tape::new());
    Contestant::new(bench.one(), move || {
        step.take(&mut start, &tape, false)?;
        tape.reset();
        Ok(())
    })
}

/// Measures every row, on one thread.
///
/// # Errors
/// What an operation refuses: none does.
pub fn elision(effort: Effort) -> Result<Vec<Row>, FitError> {
    let bench = Bench::new(effort)?;
    let mut rows = Vec::new();
    for (row, computed, left) in pairs(effort.choose(32, 256))? {
        let (with, mut without) =
            bench.one().install(|| Ok::<_, FitError>((look(&computed)?, look(&left)?)))?;
        let mut left_out = std::mem::take(&mut without.named);
        left_out.retain(|one| !with.named.contains(one));
        let missing = with.operations.iter().filter(|name| !without.operations.contains(name));
        left_out.extend(missing.map(|name| format!("{name}: not recorded")));
        let both = without.results.iter().filter_map(|(name, result)| {
            let (_, other) = with.results.iter().find(|(other, _)| other == name)?;
            // The gradients of the walls' vertices are of different vertices.
            (result.shape() == other.shape()).then(|| (*name, same_bits(result, other)))
        });
        let results = both.collect();
        let mut contestants = [contestant(&computed, &bench), contestant(&left, &bench)];
        let mut timings = interleaved(&mut contestants, effort, GENEROUS).into_iter();
        let mut next = || timings.next().expect("one for each contestant");
        let (with, without) = (next()?, next()?);
        rows.push(Row { row, results, left_out, with, without });
    }
    Ok(rows)
}
