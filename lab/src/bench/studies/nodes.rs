//! Where in a pipeline do time and error arise?
//!
//! The same pipeline, which is generic, runs in f32 and in f64 on the same inputs. The tape's report
//! shows it, with the errors that the tape finds in the values and gradients of the f32 recording
//! against the f64 recording.

use bokashi_core::{
    OperationReport, Scalar, Tape, TapeReport, Tensor, ValueError, Var, gradient_errors,
    value_errors,
};
use bokashi_fit::{FitError, squared_error};
use bokashi_render_ops::{Blur, Cull, gaussian_blur};
use bokashi_report::{Cell, Section, Table};

use crate::bench::effort::USUAL;
use crate::bench::pipeline::render;
use crate::bench::scenes::Scene;
use crate::bench::setting::Bench;

/// The blur at the end of the pipeline, in pixels.
const SIGMA: f64 = 1.5;
/// Vertices are up to this far off.
const SHIFT: f64 = 0.01;

/// What a step starts from, exact in f32.
struct Start {
    scene: Scene,
    positions: Tensor<f64>,
    colors: Tensor<f64>,
    target: Tensor<f64>,
}

/// The leaves of a step, in the order of recording.
const LEAVES: [&str; 3] = ["positions", "colours", "sigma"];

impl Start {
    fn new(pixels: usize) -> Result<Self, FitError> {
        let scene = Scene::sphere("sphere1k", 32, 17, pixels)?;
        let exact_in_f32 = |tensor: Tensor<f64>| tensor.cast::<f32>().cast();
        let tape = Tape::new();
        let (positions, colors) = (tape.constant(&scene.positions), tape.constant(&scene.colors));
        let image = render(&scene, Cull::Back, positions, colors)?;
        let target = gaussian_blur(image, tape.constant_scalar(SIGMA), &Blur::default())?.value();
        Ok(Self {
            positions: exact_in_f32(scene.shifted(SHIFT, 1)),
            colors: exact_in_f32(scene.colors.clone()),
            target: exact_in_f32(target),
            scene,
        })
    }

    /// Records a step up to its loss.
    fn record<'t, T: Scalar>(&self, tape: &'t Tape<T>) -> Result<Var<'t, T>, FitError> {
        let (positions, colors) =
            (tape.leaf(&self.positions.cast()), tape.leaf(&self.colors.cast()));
        let image = render(&self.scene, Cull::Back, positions, colors)?;
        let sigma = tape.leaf_scalar(T::from_f64(SIGMA));
        let blurred = gaussian_blur(image, sigma, &Blur::default())?;
        Ok(squared_error(blurred, tape.constant(&self.target.cast()))?)
    }

    /// Takes a step.
    fn step<T: Scalar>(&self, tape: &mut Tape<T>) -> Result<(), FitError> {
        self.record(tape)?.backward()?;
        tape.reset();
        Ok(())
    }

    /// The reports of `times` steps in f32 and of as many in f64, taken in turns.
    fn reports(&self, times: u32) -> Result<(TapeReport, TapeReport), FitError> {
        let (mut single, mut double) = (Tape::<f32>::new(), Tape::<f64>::new());
        for turn in 0..=times {
            self.step(&mut single)?;
            self.step(&mut double)?;
            // The first steps find no buffers.
            if turn == 0 {
                let _ = (single.take_report(), double.take_report());
                single.set_timed(true);
                double.set_timed(true);
            }
        }
        Ok((single.take_report(), double.take_report()))
    }

    /// The errors of f32 against f64: of the values, and of the gradients.
    fn errors(&self) -> Result<[Vec<ValueError>; 2], FitError> {
        let (rough, exact) = (Tape::<f32>::new(), Tape::<f64>::new());
        let (rough_loss, exact_loss) = (self.record(&rough)?, self.record(&exact)?);
        let rough_gradients = rough_loss.backward_to(&rough.variables().collect::<Vec<_>>())?;
        let exact_gradients = exact_loss.backward_to(&exact.variables().collect::<Vec<_>>())?;
        let values = value_errors(&rough, &exact)?;
        Ok([values, gradient_errors(&rough_gradients, &exact_gradients)?])
    }
}

pub(super) fn study(bench: &Bench) -> Result<Section, FitError> {
    let pixels = bench.effort.choose(32, 256);
    let times = bench.effort.samples(1e-3, USUAL) as u32;
    let mut study = Section::new(
        "nodes",
        "A pipeline in f32 beside f64, node by node",
        format!(
            "A sphere of 1024 faces in {pixels} x {pixels} pixels, blurred (sigma {SIGMA}), with a \
             squared error. The times and bytes are from the tape's report: the mean of {times} \
             steps on one thread, f32 and f64 in turns. The errors are the largest difference of \
             each node's values and gradients from f64 on the same inputs, as a share of the \
             largest entry. Leaves have gradients alone. Errors gather along the pipeline: the \
             table of operations has the error of each operation alone."
        ),
    );
    let mut table = Table::new(
        "nodes",
        "The tape's report with its errors",
        &[
            ("node", "node"),
            ("forward f32, µs", "f32_forward_microseconds"),
            ("f64", "f64_forward_microseconds"),
            ("backward f32, µs", "f32_backward_microseconds"),
            ("f64", "f64_backward_microseconds"),
            ("kB f32", "f32_kilobytes"),
            ("f64", "f64_kilobytes"),
            ("error of value", "value_error"),
            ("of gradient", "gradient_error"),
        ],
    );
    let start = Start::new(pixels)?;
    let measured =
        bench.one().install(|| Ok::<_, FitError>((start.reports(times)?, start.errors()?)));
    if let Some(((single, double), [values, gradients])) = study.noted("a step", measured) {
        let leaves = gradients.iter().filter(|error| error.operation.is_none());
        for (name, leaf) in LEAVES.into_iter().zip(leaves) {
            let mut row = vec![Cell::text(name)];
            row.resize(table.columns.len() - 1, Cell::Nothing);
            row.push(Cell::maybe(leaf.error));
            table.push(row);
        }
        let single = single.with_errors(&values).with_gradient_errors(&gradients);
        let mean = |all: f64| Cell::number(all / f64::from(times));
        for entry in &single.operations {
            let other = double.operations.iter().find(|other| other.name == entry.name);
            let mut row = vec![Cell::text(entry.name)];
            let figures: [fn(&OperationReport) -> f64; 3] = [
                |entry| 1e6 * entry.forward.as_secs_f64(),
                |entry| 1e6 * entry.backward.as_secs_f64(),
                |entry| 1e-3 * entry.bytes as f64,
            ];
            for figure in figures {
                row.push(mean(figure(entry)));
                row.push(other.map_or(Cell::Nothing, |other| mean(figure(other))));
            }
            row.extend([Cell::maybe(entry.error), Cell::maybe(entry.gradient_error)]);
            table.push(row);
        }
    }
    study.push_table(table);
    Ok(study)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_node_has_an_error_of_value_and_gradient_and_every_leaf_one_of_gradient() {
        let start = Start::new(32).unwrap();
        let [values, gradients] = start.errors().unwrap();
        let leaves = gradients.iter().filter(|error| error.operation.is_none());
        assert_eq!(leaves.count(), LEAVES.len());
        let (report, _) = start.reports(2).unwrap();
        let report = report.with_errors(&values).with_gradient_errors(&gradients);
        let names: Vec<&str> = report.operations.iter().map(|entry| entry.name).collect();
        let expected = ["project", "rasterize", "interpolate", "antialias", "image"];
        assert_eq!(names[..5], expected);
        assert_eq!(names[5..], ["gaussian_blur", "squared_error"]);
        for entry in &report.operations {
            // The gradients of what is interpolated lead past `rasterize`.
            let backward = if entry.name == "rasterize" { 0 } else { 2 };
            assert_eq!((entry.calls, entry.backward_calls), (2, backward), "{report}");
            let small = |error: Option<f64>| (0.0..1e-3).contains(&error.unwrap());
            assert!(small(entry.error) && small(entry.gradient_error), "{report}");
        }
        assert!(report.operations[0].error > Some(0.0), "{report}");
    }
}
