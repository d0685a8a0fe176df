//! Samples of textures, by differentials and a bias.

mod extremes;

use bokashi_check::strategy::{number, tensor};
use bokashi_check::{Applied, Case, Check, Input, Outcome, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{Detail, Sampler, Texture, TextureBorder, TextureFilter, sample_texture};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

use crate::benchmark::benchmark;
use crate::entry::Entry;
use crate::footprints::{cells, samplers, slopes, texture_inputs};
use crate::inputs::{leaf, wide, with_one};
use crate::scenes::motley;

/// A benchmark of a filter, with mipmaps.
macro_rules! filtered {
    ($entry:ident, $label:literal, $filter:expr) => {
        benchmark!($entry, $label, |s| [s.texture[0], s.texture[1], s.texture[2]], |x| {
            let detail = Detail::Differentials { differentials: x[2], bias: None };
            let sampler = Sampler::new().filter($filter);
            sample_texture(&Texture::with_mipmaps(x[0])?, x[1], detail, sampler)?
        });
    };
}

pub(crate) fn entry() -> Entry {
    let mut entry = Entry::new("sample_texture").with_extremes(extremes::EXTREMES);
    for (name, sampler) in samplers() {
        let cases = (select(&[1_usize, 4, 8][..]), 1..4_usize, 4..8_usize).prop_flat_map(
            move |(extent, channels, count)| {
                let numbers = (
                    tensor([extent, extent, channels], number()),
                    vec(-0.9..1.9_f64, 2 * count),
                    slopes::<2>(count, extent),
                    -0.5..0.5_f64,
                );
                numbers.prop_map(move |(texels, uv, slopes, bias)| {
                    let uv = Tensor::from_flat_fn([count, 2], |k| uv[k]);
                    let inputs =
                        texture_inputs(sampler, [texels, uv, slopes, Tensor::scalar(bias)]);
                    Case::new(SampleTexture { sampler, extent }, inputs)
                })
            },
        );
        let of = |uv: Input, slopes: Input| {
            let inputs = [leaf([4, 4, 1], 0.5), uv, slopes, leaf([], 0.0)];
            Case::new(SampleTexture { sampler, extent: 4 }, inputs)
        };
        entry.check(
            Check::from_cases(format!("sample_texture, {name}"), cases)
                .large(1, Just(many_samples(sampler)))
                .refuses_midway(
                    "sample_texture needs coordinates of shape [N, 2], got shape [3]",
                    of(leaf([3], 0.5), leaf([2, 2, 2], 0.1)),
                )
                .refuses_midway(
                    "sample_texture needs finite coordinates, got NaN in row 1",
                    of(with_one([2, 2], 2, f64::NAN), leaf([2, 2, 2], 0.1)),
                )
                // Beyond the first block of numbers that are looked at together.
                .refuses_midway(
                    "sample_texture needs finite coordinates, got NaN in row 699",
                    of(with_one([700, 2], 1398, f64::NAN), leaf([700, 2, 2], 0.1)),
                )
                .refuses_midway(
                    "sample_texture needs differentials of shape [3, 2, 2], got shape [3, 2]",
                    of(leaf([3, 2], 0.5), leaf([3, 2], 0.1)),
                )
                .refuses_midway(
                    "sample_texture needs from 1 to 8 probes, got 9",
                    many_samples(Sampler::new().filter(TextureFilter::Anisotropic { probes: 9 })),
                ),
        );
    }
    benchmark!(entry, "mipmaps", |s| [s.texture[0]], |x| {
        let texture = Texture::with_mipmaps(x[0])?;
        texture.levels()[texture.levels().len() - 1]
    });
    benchmark!(entry, "sample_texture, a single level", |s| [s.texture[0], s.texture[1]], |x| {
        sample_texture(&Texture::new(x[0])?, x[1], Detail::Finest, Sampler::new())?
    });
    filtered!(entry, "sample_texture, nearest", TextureFilter::Nearest);
    filtered!(entry, "sample_texture, bilinear", TextureFilter::Bilinear);
    filtered!(entry, "sample_texture, trilinear", TextureFilter::Trilinear);
    filtered!(entry, "sample_texture, 4 probes", TextureFilter::Anisotropic { probes: 4 });
    entry
}

#[derive(Debug)]
struct SampleTexture {
    sampler: Sampler,
    /// Texels along each axis.
    extent: usize,
}

impl Subject for SampleTexture {
    /// Texels, coordinates, differentials and a bias.
    fn apply<'t, T: Scalar>(&self, _: &'t Tape<T>, inputs: &[Var<'t, T>]) -> Applied<'t, T> {
        let &[texels, coordinates, differentials, bias] = inputs else {
            return Err("four inputs".into());
        };
        let texture = Texture::with_mipmaps(texels)?;
        let detail = Detail::Differentials { differentials, bias: Some(bias) };
        let out = sample_texture(&texture, coordinates, detail, self.sampler)?;
        let [of_u, of_v] = self.sampler.borders;
        let place = |uv: &[f64]| {
            let reduced = |u: f64, border| match border {
                TextureBorder::Wrap => u.rem_euclid(1.0),
                TextureBorder::Mirror => u.rem_euclid(2.0).min(2.0 - u.rem_euclid(2.0)),
                TextureBorder::Clamp => u.clamp(0.0, 1.0),
                TextureBorder::Zero => u,
            };
            (0, [reduced(uv[0], of_u), reduced(uv[1], of_v)])
        };
        // The footprint does not step where the coordinates are brought back.
        let (uv, slopes) = (wide(coordinates), wide(differentials));
        let probes = match self.sampler.filter {
            TextureFilter::Anisotropic { probes } => probes,
            _ => 1,
        };
        let steps = |uv: &[f64]| (0, [uv[0], uv[1]]);
        let bias = wide(bias).item();
        let state = (
            cells(&uv, &slopes, bias, [probes, self.extent], steps),
            cells(&uv, &slopes, bias, [probes, self.extent], place),
        );
        Ok(Outcome::from(out).with_state(state))
    }
}

/// More samples than a piece of work holds.
fn many_samples(sampler: Sampler) -> Case {
    let count = 9000;
    let inputs = [
        Tensor::from_flat_fn([64, 64, 3], motley),
        Tensor::from_flat_fn([count, 2], |k| 0.5 + motley(k + 3)),
        Tensor::from_flat_fn([count, 2, 2], |k| 0.1 * motley(5 * k + 1)),
        Tensor::scalar(0.1),
    ];
    Case::new(SampleTexture { sampler, extent: 64 }, texture_inputs(sampler, inputs))
}
