//! Samples of cube maps, by differentials and a bias.

mod extremes;

use bokashi_check::strategy::{number, tensor};
use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{CubeMap, Detail, Sampler, TextureFilter, sample_cube_map};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::footprints::{cells, samplers, slopes, texture_inputs};
use crate::inputs::{leaf, wide, with_one};

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("sample_cube_map").with_extremes(extremes::EXTREMES);
    for (name, sampler) in samplers() {
        let cases = (select(&[1_usize, 4, 8][..]), 1..4_usize, 4..8_usize).prop_flat_map(
            move |(extent, channels, count)| {
                let direction = vec(-1.0..1.0_f64, 3)
                    .prop_filter("a length", |d| d.iter().map(|x| x * x).sum::<f64>() > 0.05);
                let numbers = (
                    tensor([6, extent, extent, channels], number()),
                    vec(direction, count),
                    slopes::<3>(count, extent),
                    -0.5..0.5_f64,
                );
                numbers.prop_map(move |(texels, all, slopes, bias)| {
                    let directions = Tensor::from_flat_fn([count, 3], |k| all[k / 3][k % 3]);
                    let slopes = slopes.map(|slope| 0.5 * slope);
                    let inputs =
                        texture_inputs(sampler, [texels, directions, slopes, Tensor::scalar(bias)]);
                    Case::new(SampleCubeMap { sampler, extent }, inputs)
                })
            },
        );
        let of = |directions: Input| {
            let inputs = [leaf([6, 4, 4, 1], 0.5), directions, leaf([2, 3, 2], 0.1), leaf([], 0.0)];
            Case::new(SampleCubeMap { sampler, extent: 4 }, inputs)
        };
        entry.check(
            Check::from_cases(format!("sample_cube_map, {name}"), cases)
                .refuses_midway(
                    "sample_cube_map needs directions of shape [N, 3], got shape [2, 2]",
                    of(leaf([2, 2], 0.5)),
                )
                .refuses_midway(
                    "sample_cube_map needs directions other than zero, got zero in row 0",
                    of(leaf([2, 3], 0.0)),
                )
                .refuses_midway(
                    "sample_cube_map needs finite directions, got NaN in row 1",
                    of(with_one([2, 3], 4, f64::NAN)),
                ),
        );
    }
    benchmark!(entry, "sample_cube_map", |s| [s.cube[0], s.cube[1], s.cube[2]], |x| {
        let map = CubeMap::with_mipmaps(x[0])?;
        sample_cube_map(&map, x[1], Detail::Level(x[2]), Sampler::new())?
    });
    entry
}

#[derive(Debug)]
struct SampleCubeMap {
    sampler: Sampler,
    extent: usize,
}

impl Subject for SampleCubeMap {
    /// Texels, directions, differentials and a bias.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let &[texels, directions, differentials, bias] = inputs else {
            return Err("four inputs".into());
        };
        let map = CubeMap::with_mipmaps(texels)?;
        let detail = Detail::Differentials { differentials, bias: Some(bias) };
        let out = sample_cube_map(&map, directions, detail, self.sampler)?;
        let place = |d: &[f64]| {
            let largest = d.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
            let axis = d.iter().position(|x| x.abs() == largest).unwrap();
            let others = [(axis + 1) % 3, (axis + 2) % 3];
            // Axes of the face in any order and sign: only steps count.
            let at = others.map(|k| 0.5 * d[k] / largest + 0.5);
            (2 * axis + usize::from(d[axis] < 0.0), at)
        };
        let probes = match self.sampler.filter {
            TextureFilter::Anisotropic { probes } => probes,
            _ => 1,
        };
        let bias = wide(bias).item();
        let state =
            cells(&wide(directions), &wide(differentials), bias, [probes, self.extent], place);
        Ok(Outcome::from(out).with_state(state))
    }
}
