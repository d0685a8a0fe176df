//! What does f64 cost over f32, operation by operation, and what does it buy?
//!
//! Each operation is recorded on the same inputs, which are exact in f32, and walked back from the
//! same upstream gradient. Times are the tape's own, of the operation alone.

mod cases;
mod inputs;

use bokashi_core::Tensor;
use bokashi_fit::FitError;
use bokashi_report::{Cell, Section, Table};

pub(super) use self::cases::{metal, shaded, textured};
pub(super) use self::inputs::wall;

use self::cases::cases;
use self::inputs::Inputs;
use crate::bench::effort::USUAL;
use crate::bench::operation::{Runner, errors};
use crate::bench::sampling::Timing;
use crate::bench::setting::Bench;

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
    let inputs = Inputs::new(pixels)?;
    let scene = &inputs.scene;
    for (single, double) in cases::<f32>(&inputs).into_iter().zip(cases::<f64>(&inputs)) {
        let (label, name) = (single.label, single.name());
        let (mut single, mut double) = (Runner::new(single), Runner::new(double));
        let mut sample = || {
            let (found, exact) = (single.results(scene)?, double.results(scene)?);
            let entries = exact.iter().map(Tensor::size).max().unwrap_or(1);
            let mut seconds = [Vec::new(), Vec::new()];
            for _ in 0..samples {
                seconds[0].push(single.step(scene)?.both());
                seconds[1].push(double.step(scene)?.both());
            }
            Ok::<_, FitError>((errors(&found, &exact), seconds, entries))
        };
        let Some((errors, seconds, entries)) = study.noted(label, bench.one().install(&mut sample))
        else {
            continue;
        };
        let [single, double] = seconds.map(Timing::of);
        let is_tensor = inputs.signed.size() <= entries && !RENDERING.contains(&name);
        let count = if is_tensor { entries } else { pixels * pixels } as f64;
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

/// The operations whose times are per pixel.
const RENDERING: [&str; 26] = [
    "shade",
    "irradiance",
    "reflect",
    "downsample",
    "tangents",
    "perturbed_normals",
    "transform_normals",
    "project",
    "face_normals",
    "vertex_normals",
    "rasterize",
    "interpolate",
    "image",
    "antialias",
    "depth",
    "depth_of_field",
    "gaussian_blur",
    "squared_error",
    "composite_layers",
    "over",
    "differentials",
    "interpolate_differentials",
    "mipmaps",
    "sample_texture",
    "sample_cube_map",
    "depth_error",
];

#[cfg(test)]
mod tests {
    use std::fs;
    use std::path::Path;

    use bokashi_core::Tape;

    use super::*;

    #[test]
    fn no_operation_is_missing() {
        let crates = Path::new(env!("CARGO_MANIFEST_DIR")).join("../crates");
        let exports = fs::read_to_string(crates.join("render-ops/src/lib.rs")).unwrap();
        // Lists of names go over several lines.
        let exports = exports.split("pub use ").skip(1).filter_map(|rest| rest.split(';').next());
        let exported = exports.flat_map(|path| {
            let names = path.split("::").last().unwrap_or_default();
            names
                .split(',')
                .map(|name| name.trim_matches(|c: char| "{}".contains(c) || c.is_whitespace()))
        });
        // `interpolate_indexed` and `interpolate_differentials_indexed` record what those without an
        // index buffer do, `rasterize_behind` and `depth_layers` what `rasterize` does, `composite`
        // nothing at pixel centres, `exposure` an exponential and a product, `render` what these do.
        let others = [
            "interpolate_indexed",
            "interpolate_differentials_indexed",
            "rasterize_behind",
            "depth_layers",
            "render",
            "composite",
            "exposure",
            "glam",
        ];
        let is_operation = |name: &&str| {
            name.starts_with(|c: char| c.is_ascii_lowercase()) && !others.contains(name)
        };
        let of_core = fs::read_dir(crates.join("core/src/ops")).unwrap();
        let of_core = of_core
            .map(|file| file.unwrap().path().file_stem().unwrap().to_string_lossy().into_owned());
        let mut expected: Vec<_> = exported.filter(is_operation).map(str::to_owned).collect();
        expected.extend(of_core.filter(|name| name != "mod"));
        // What is no function of its own.
        expected.extend(["mipmaps", "sum_over", "image", "squared_error"].map(str::to_owned));
        assert!(expected.len() > 70, "{expected:?}");
        assert!(expected.iter().any(|name| name == "sample_texture"), "{expected:?}");
        let cases = cases::<f32>(&Inputs::new(32).unwrap());
        for name in expected {
            assert!(cases.iter().any(|case| case.name() == name), "{name} is missing");
        }
    }

    #[test]
    fn every_operation_is_on_the_tape_under_its_name_and_is_walked_back() {
        let inputs = Inputs::new(32).unwrap();
        for case in cases::<f32>(&inputs) {
            let (name, tape) = (case.name(), Tape::new());
            let given: Vec<_> = case.inputs.iter().map(|input| tape.leaf(&input.cast())).collect();
            let output = (case.record)(&inputs.scene, &given).unwrap();
            let upstream = Tensor::full(output.shape(), 1.0);
            tape.vjp(&[(output, &upstream)]).unwrap();
            let report = tape.take_report();
            let own = report.operations.iter().find(|entry| entry.name == name);
            let own = own.unwrap_or_else(|| panic!("{name} is not in {report}"));
            assert!(own.calls > 0 && own.backward_calls > 0, "{report}");
        }
    }
}
