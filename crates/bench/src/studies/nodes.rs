//! Where in a pipeline do time and error arise?
//!
//! The same pipeline, which is generic, in f32 and in f64 on the same inputs: per node, the tape's
//! report and the largest relative error of its value and of its gradient.

use bokashi_core::{Report, Scalar, Tape, Tensor, Var};
use bokashi_fit::{FitError, squared_error};
use bokashi_render_ops::{Blur, Cull, gaussian_blur};

use crate::bench::Bench;
use crate::difference::relative_error;
use crate::effort::USUAL;
use crate::pipeline::render;
use crate::scenes::Scene;
use crate::study::Study;
use crate::table::{Cell, Table};

/// The blur at the end of the pipeline, in pixels.
const SIGMA: f64 = 1.5;

/// The nodes of a step, each with its operation's name, its value and its gradient.
struct Step<T: Scalar> {
    nodes: Vec<(&'static str, Tensor<T>, Tensor<T>)>,
    report: Report,
}

/// Takes one step several times, and looks at the last.
fn step<T: Scalar>(scene: &Scene, target: &Tensor<f64>, times: u32) -> Result<Step<T>, FitError> {
    let mut tape = Tape::<T>::new();
    let (start, colors): (Tensor<T>, Tensor<T>) =
        (scene.shifted(0.01, 1).cast::<f32>().cast(), scene.colors.cast::<f32>().cast());
    let target = target.cast();
    // The first finds no buffers.
    for turn in 0..=times {
        if turn == 1 {
            let _ = tape.take_report();
            tape.set_timed(true);
        }
        let last = turn == times;
        let nodes = {
            let (positions, colors) = (tape.leaf(&start), tape.leaf(&colors));
            let rendered = render(scene, Cull::Back, positions, colors)?;
            let sigma = tape.scalar(T::from_f64(SIGMA));
            let blurred = gaussian_blur(rendered.image, sigma, &Blur::default())?;
            let loss = squared_error(blurred, tape.constant(&target))?;
            let nodes: [(&'static str, Var<'_, T>); 7] = [
                ("project", rendered.clip),
                ("rasterize", rendered.fragments.barycentrics),
                ("interpolate", rendered.surface),
                ("resolve", rendered.jagged),
                ("antialias", rendered.image),
                ("gaussian_blur", blurred),
                ("squared_error", loss),
            ];
            let leaves = [("positions", positions), ("colours", colors), ("sigma", sigma)];
            match last {
                false => {
                    loss.backward()?;
                    Vec::new()
                }
                true => {
                    let all = leaves.into_iter().chain(nodes);
                    let wanted: Vec<Var<'_, T>> = all.clone().map(|(_, var)| var).collect();
                    let gradients = loss.backward_to(&wanted)?;
                    all.map(|(name, var)| (name, var.value(), gradients.get_or_zeros(var)))
                        .collect()
                }
            }
        };
        if last {
            return Ok(Step { nodes, report: tape.take_report() });
        }
        tape.reset();
    }
    unreachable!("the last turn returns")
}

pub(super) fn study(bench: &Bench) -> Result<Study, FitError> {
    let pixels = bench.effort.choose(32, 256);
    let times = bench.effort.samples(1e-3, USUAL) as u32;
    let mut study = Study::new(
        "nodes",
        "A pipeline in f32 beside f64, node by node",
        format!(
            "A sphere of 1024 faces in {pixels} x {pixels} pixels, blurred (sigma {SIGMA}), squared \
             error: the tape's report, mean of {times} steps on one thread, and the largest \
             difference of each node's value and gradient from f64 on the same inputs, as a share \
             of the largest entry. Leaves have gradients alone. An error here has gathered on the \
             way: the table of operations has each one's own."
        ),
    );
    let scene = Scene::sphere("sphere1k", 32, 17, pixels)?;
    let target = {
        let tape = Tape::new();
        let (positions, colors) = (tape.constant(&scene.positions), tape.constant(&scene.colors));
        let image = render(&scene, Cull::Back, positions, colors)?.image;
        let sigma = tape.constant_full([], SIGMA);
        let blurred = gaussian_blur(image, sigma, &Blur::default())?.value();
        // Exact in f32.
        blurred.cast::<f32>().cast()
    };
    let steps = bench.one().install(|| {
        Ok((step::<f32>(&scene, &target, times)?, step::<f64>(&scene, &target, times)?))
    });
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
    if let Some((single, double)) = study.noted("a step", steps) {
        let both = single.nodes.iter().zip(&double.nodes);
        for ((name, value, gradient), (_, exact, exact_gradient)) in both {
            let of = |report: &Report| {
                let found = report.operations.iter().find(|entry| entry.name == *name);
                found.map(|entry| {
                    let mean = |all: f64| all / f64::from(times);
                    let micros = |time: std::time::Duration| 1e6 * mean(time.as_secs_f64());
                    let kilobytes = 1e-3 * mean(entry.bytes as f64);
                    [micros(entry.forward), micros(entry.backward), kilobytes]
                })
            };
            let (a, b) = (of(&single.report), of(&double.report));
            let cell = |report: &Option<[f64; 3]>, at: usize| {
                Cell::maybe(report.map(|figures| figures[at]))
            };
            let is_leaf = a.is_none();
            // The gradient of a loss with respect to itself is 1.
            let is_last = *name == "squared_error";
            table.push(vec![
                Cell::text(*name),
                cell(&a, 0),
                cell(&b, 0),
                cell(&a, 1),
                cell(&b, 1),
                cell(&a, 2),
                cell(&b, 2),
                match is_leaf {
                    true => Cell::Nothing,
                    false => Cell::number(relative_error(value, exact)),
                },
                match is_last {
                    true => Cell::Nothing,
                    false => Cell::number(relative_error(gradient, exact_gradient)),
                },
            ]);
        }
    }
    study.tables.push(table);
    Ok(study)
}
