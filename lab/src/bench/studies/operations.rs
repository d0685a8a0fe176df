//! What does f64 cost over f32, operation by operation, and what does it buy?
//!
//! Each operation is recorded on the same inputs, which are exact in f32, and walked back from the
//! same upstream gradient. Times are the tape's own, of the operation alone.

use std::sync::Arc;

use bokashi_catalogue::setting::Setting;
use bokashi_catalogue::{Benchmark, ENTRIES, for_each_operation};
use bokashi_check::{Case as OnInputs, Number, Refusal};
use bokashi_core::{Tensor, Var};
use bokashi_fit::FitError;
use bokashi_report::{Cell, Section, Table};

use crate::bench::effort::USUAL;
use crate::bench::operation::{Case, Runner, errors};
use crate::bench::sampling::Timing;
use crate::bench::setting::Bench;

macro_rules! with_folders {
    ($($folder:ident: $($name:ident)*;)*) => {
        &[$($((stringify!($folder), stringify!($name))),*),*]
    };
}

/// The folder and the name of each entry.
const NAMES_OF_ENTRIES: &[(&str, &str)] = for_each_operation!(with_folders);

/// What an operation of the catalogue refuses.
#[derive(Debug, thiserror::Error)]
#[error(transparent)]
struct Refused(Refusal);

fn record<'t, T: Number>(case: &OnInputs, inputs: &[Var<'t, T>]) -> Result<Var<'t, T>, FitError> {
    let output = case.record(inputs[0].tape(), inputs);
    output.map_err(|refusal| FitError::operation(Refused(refusal)))
}

fn runner<T: Number>(benchmark: Benchmark, case: &OnInputs) -> Runner<T, OnInputs> {
    let inputs = case.inputs().iter().map(|input| input.tensor.clone()).collect();
    Runner::new(Case { label: benchmark.label(), inputs, record })
}

pub(super) fn study(bench: &Bench) -> Result<Section, FitError> {
    let pixels = bench.effort.choose(32, 256);
    let samples = bench.effort.samples(1e-3, USUAL);
    let mut study = Section::new(
        "operations",
        "Every operation in f32 and in f64",
        format!(
            "Forward and backward to every input, one thread, by the tape's own clock; samples in \
             turns, {samples} of each. Rendering operations on a sphere of 1024 faces in {pixels} x \
             {pixels} pixels, tensor operations on {} entries; nanoseconds are per pixel and per \
             entry, the larger of inputs and output. Errors are f32's against f64 on the same \
             inputs, as a share of the largest entry: of the output, and of the worst gradient.",
            pixels * pixels
        ),
    );
    let mut table = Table::new(
        "operations",
        "Time and error",
        &[
            ("operation", "operation"),
            ("f32, ns", "f32_minimum_nanoseconds"),
            ("median", "f32_median_nanoseconds"),
            ("f64, ns", "f64_minimum_nanoseconds"),
            ("median", "f64_median_nanoseconds"),
            ("f64 / f32", "ratio"),
            ("error of the output", "output_error"),
            ("of a gradient", "gradient_error"),
        ],
    );
    let setting = Setting::new(pixels).map_err(|refusal| FitError::operation(Refused(refusal)))?;
    let setting = Arc::new(setting);
    let benchmarks = NAMES_OF_ENTRIES.iter().zip(ENTRIES).flat_map(|((folder, _), entry)| {
        let benchmarks = entry().benchmarks().to_vec();
        benchmarks.into_iter().map(move |benchmark| (*folder, benchmark))
    });
    for (folder, benchmark) in benchmarks {
        let (label, case) = (benchmark.label(), benchmark.case(&setting));
        let (mut single, mut double) =
            (runner::<f32>(benchmark, &case), runner::<f64>(benchmark, &case));
        let mut sample = || {
            let (results, exact) = (single.results(&case)?, double.results(&case)?);
            let entries = exact.iter().map(Tensor::size).max().unwrap_or(1);
            let mut seconds = [Vec::new(), Vec::new()];
            for _ in 0..samples {
                seconds[0].push(single.step(&case)?.both());
                seconds[1].push(double.step(&case)?.both());
            }
            Ok::<_, FitError>((errors(&results, &exact), seconds, entries))
        };
        let Some((errors, seconds, entries)) = study.noted(label, bench.one().install(&mut sample))
        else {
            continue;
        };
        let [single, double] = seconds.map(Timing::from_seconds);
        let is_per_entry = folder != "rendering" && setting.pixels() <= entries;
        let count = if is_per_entry { entries } else { setting.pixels() } as f64;
        table.push(vec![
            Cell::text(label),
            single.cell(1e9 * single.minimum / count),
            single.cell(1e9 * single.median / count),
            double.cell(1e9 * double.minimum / count),
            double.cell(1e9 * double.median / count),
            Cell::number(double.minimum / single.minimum),
            Cell::number(errors[0]),
            Cell::number(errors[1]),
        ]);
    }
    study.push_table(table);
    Ok(study)
}
