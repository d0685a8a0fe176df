//! Differentials, textures and cube maps.

use bokashi_check::strategy::{number, tensor};
use bokashi_check::{Case, Check, Input, Outcome, Refusal, Subject};
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    CubeMap, Detail, RasterOptions, Sampler, Sampling, Texture, TextureBorder, TextureFilter,
    differentials, interpolate_differentials, interpolate_differentials_indexed, rasterize,
    sample_cube_map, sample_texture,
};
use glam::EulerRot::ZXZ;
use glam::{DMat3, DVec2};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

use crate::rendering::{check, leaf, wide};
use crate::scenes::{Scene, motley, scenes};

#[derive(Debug)]
struct Differentials {
    scene: Scene,
    sampling: Sampling,
}

impl Subject for Differentials {
    /// Clip positions, and perhaps attributes, whose own differentials come out then.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
        let options = RasterOptions::new(self.scene.size).sampling(self.sampling);
        let fragments = rasterize(inputs[0], &self.scene.mesh, options)?;
        let slopes = differentials(&fragments)?;
        let out = match inputs {
            [_] => vec![slopes],
            _ => vec![
                interpolate_differentials(inputs[1], &fragments, slopes)?,
                interpolate_differentials_indexed(
                    inputs[1],
                    fragments.coverage.mesh(),
                    &fragments,
                    slopes,
                )?,
            ],
        };
        let pieces: Vec<_> = fragments.coverage.boundary().map(|(_, own)| own.len()).collect();
        let ids: Vec<_> = fragments.coverage.faces().zip(fragments.coverage.pixels()).collect();
        Ok(Outcome::from(out).with_state(ids).with_state(pieces))
    }
}

/// Scenes whose weights do not change by many times more in one pixel than in another: derivatives of
/// derivatives are off by the square of that factor. So no slivers, and no vertex a million times
/// farther away than another.
fn wide_scenes() -> impl Iterator<Item = (&'static str, BoxedStrategy<Scene>)> {
    let is_near = |scene: &Scene| scene.clip.data().iter().all(|entry| entry.abs() < 1e3);
    let wide = scenes().into_iter().filter(|(kind, _)| !kind.contains("sliver"));
    wide.map(move |(kind, scenes)| {
        (kind, scenes.prop_filter("a vertex far behind another", is_near).boxed())
    })
}

#[test]
fn differentials_of_barycentrics() {
    for (kind, scenes) in wide_scenes() {
        let cases = scenes.prop_map(|scene| {
            let clip = Input::leaf(scene.clip.clone());
            Case::new(Differentials { scene, sampling: Sampling::Center }, [clip])
        });
        check(Check::of_cases(format!("differentials, {kind}"), cases));
    }
}

#[test]
fn differentials_of_attributes() {
    for (kind, scenes) in wide_scenes() {
        let cases = (scenes, 1..4_usize).prop_map(|(scene, channels)| {
            let vertices = scene.mesh.vertex_count();
            let attributes = Tensor::from_flat_fn([vertices, channels], motley);
            let inputs = [scene.clip.clone(), attributes].map(Input::leaf);
            Case::new(Differentials { scene, sampling: Sampling::Center }, inputs)
        });
        check(Check::of_cases(format!("interpolate_differentials, {kind}"), cases));
    }
}

/// Where a pixel's footprint makes a sample step: the levels and the number of probes.
fn footprint_state(
    j: [[f64; 2]; 2],
    bias: f64,
    levels: usize,
    probes: usize,
) -> (usize, f64, [f64; 2]) {
    let (g00, g11) = (j[0][0].powi(2) + j[1][0].powi(2), j[0][1].powi(2) + j[1][1].powi(2));
    let g01 = j[0][0] * j[0][1] + j[1][0] * j[1][1];
    let root = (0.25 * (g00 - g11).powi(2) + g01 * g01).sqrt();
    let long = (0.5 * (g00 + g11) + root).sqrt();
    let short = (j[0][0] * j[1][1] - j[0][1] * j[1][0]).abs() / long;
    let count = ((long / short.max(1.0)).round() as usize).clamp(1, probes);
    let level = ((long / count as f64).log2() + bias).clamp(0.0, (levels - 1) as f64);
    // The right singular vector, by its angle.
    let angle = 0.5 * (2.0 * g01).atan2(g00 - g11);
    (count, level, [angle.cos(), angle.sin()])
}

/// The texels beside which each probe of each sample lies, on the levels that it is taken from.
fn cells(
    coordinates: &Tensor<f64>,
    differentials: &Tensor<f64>,
    bias: f64,
    [sampler, extents]: [usize; 2],
    place: impl Fn(&[f64]) -> (usize, [f64; 2]),
) -> Vec<(usize, usize, Vec<[i64; 3]>)> {
    let (probes, levels) = (sampler, extents.ilog2() as usize + 1);
    let k = coordinates.shape()[1];
    let rows = coordinates.data().chunks(k).zip(differentials.data().chunks(2 * k));
    rows.map(|(row, slopes)| {
        // How the place moves, by differences.
        let n = extents as f64;
        let along = |k: usize| {
            let by = |h: f64| {
                let moved: Vec<_> =
                    row.iter().enumerate().map(|(i, x)| x + h * slopes[2 * i + k]).collect();
                place(&moved).1
            };
            let h = 1e-6;
            let (after, before) = (by(h), by(-h));
            [0, 1].map(|i| n * (after[i] - before[i]) / (2.0 * h))
        };
        let (x, y) = (along(0), along(1));
        let (count, level, v) = footprint_state([[x[0], y[0]], [x[1], y[1]]], bias, levels, probes);
        let mut cells = Vec::new();
        for probe in 0..count {
            let t = (probe as f64 + 0.5) / count as f64 - 0.5;
            let moved: Vec<_> = (0..k)
                .map(|i| row[i] + t * (slopes[2 * i] * v[0] + slopes[2 * i + 1] * v[1]))
                .collect();
            let (face, at) = place(&moved);
            for level in [level.floor(), level.ceil()] {
                let extent = (extents >> level as usize).max(1) as f64;
                let [s, t] = at.map(|at| (at * extent - 0.5).floor() as i64);
                cells.push([face as i64, s, t]);
            }
        }
        (count, level.ceil() as usize, cells)
    })
    .collect()
}

#[derive(Debug)]
struct SampleTexture {
    sampler: Sampler,
    /// Texels along each axis.
    extent: usize,
}

impl Subject for SampleTexture {
    /// Texels, coordinates, differentials and a bias.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
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

/// Differentials of `K` coordinates: footprints of a texel to a few texels, for a texture of such an
/// extent, turned in any way and longer than they are wide. Round footprints are a kink.
fn slopes<const K: usize>(count: usize, extent: usize) -> impl Strategy<Value = Tensor<f64>> {
    let footprint = (0.5..8.0_f64, 1.3..6.0_f64, 0.0..6.3_f64, 0.0..6.3_f64, 0.0..3.1_f64);
    vec(footprint, count).prop_map(move |footprints| {
        let all = footprints.into_iter().map(|(long, ratio, turn, spin, tilt)| {
            let (v, frame) = (DVec2::from_angle(turn), DMat3::from_euler(ZXZ, spin, tilt, turn));
            let flat = DMat3::from_rotation_z(spin);
            let [a, b] = [0, 1].map(|k| if K == 2 { flat.col(k) } else { frame.col(k) });
            let [along, across] = [long, long / ratio].map(|texels| texels / extent as f64);
            [0, 1, 2].map(|i| (a[i] * along * v + b[i] * across * v.perp()).to_array())
        });
        let all: Vec<_> = all.collect();
        Tensor::from_fn([count, K, 2], |[n, i, k]| all[n][i][k])
    })
}

/// Texels and coordinates are leaves, and so are differentials and bias, unless samples are step
/// functions of them.
fn inputs(sampler: Sampler, tensors: [Tensor<f64>; 4]) -> Vec<Input> {
    let steps = sampler.filter == TextureFilter::Bilinear;
    let input =
        |(i, tensor)| if steps && i > 1 { Input::constant(tensor) } else { Input::leaf(tensor) };
    tensors.into_iter().enumerate().map(input).collect()
}

fn samplers() -> Vec<(&'static str, Sampler)> {
    let all = [
        ("trilinear, wrap", TextureFilter::Trilinear, TextureBorder::Wrap),
        ("trilinear, mirror", TextureFilter::Trilinear, TextureBorder::Mirror),
        ("bilinear, clamp", TextureFilter::Bilinear, TextureBorder::Clamp),
        ("anisotropic, zero", TextureFilter::Anisotropic { probes: 4 }, TextureBorder::Zero),
        ("anisotropic, wrap", TextureFilter::Anisotropic { probes: 8 }, TextureBorder::Wrap),
    ];
    let sampler = |filter, border| Sampler::new().filter(filter).border(border);
    let mixed = Sampler::new().borders([TextureBorder::Mirror, TextureBorder::Clamp]);
    let all = all.map(|(name, filter, border)| (name, sampler(filter, border)));
    all.into_iter().chain([("trilinear, mirror beside clamp", mixed)]).collect()
}

#[test]
fn sample_texture_by_differentials_and_a_bias() {
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
                    let inputs = inputs(sampler, [texels, uv, slopes, Tensor::scalar(bias)]);
                    Case::new(SampleTexture { sampler, extent }, inputs)
                })
            },
        );
        let of = |uv: Input, slopes: Input| {
            let inputs = [leaf([4, 4, 1], 0.5), uv, slopes, leaf([], 0.0)];
            Case::new(SampleTexture { sampler, extent: 4 }, inputs)
        };
        check(
            Check::of_cases(format!("sample_texture, {name}"), cases)
                .large(1, Just(many_samples(sampler)))
                .refuses_midway(
                    "coordinates of three entries",
                    of(leaf([2, 3], 0.5), leaf([2, 2, 2], 0.1)),
                )
                .refuses_midway(
                    "coordinates that are no number",
                    of(leaf([2, 2], f64::NAN), leaf([2, 2, 2], 0.1)),
                )
                .refuses_midway(
                    "differentials of other samples",
                    of(leaf([2, 2], 0.5), leaf([3, 2, 2], 0.1)),
                ),
        );
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
    Case::new(SampleTexture { sampler, extent: 64 }, self::inputs(sampler, inputs))
}

#[derive(Debug)]
struct SampleCubeMap {
    sampler: Sampler,
    extent: usize,
}

impl Subject for SampleCubeMap {
    /// Texels, directions, differentials and a bias.
    fn apply<'t, T: Scalar>(
        &self,
        _tape: &'t Tape<T>,
        inputs: &[Var<'t, T>],
    ) -> Result<Outcome<'t, T>, Refusal> {
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

#[test]
fn sample_cube_map_by_differentials_and_a_bias() {
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
                        inputs(sampler, [texels, directions, slopes, Tensor::scalar(bias)]);
                    Case::new(SampleCubeMap { sampler, extent }, inputs)
                })
            },
        );
        let of = |directions: Input| {
            let inputs = [leaf([6, 4, 4, 1], 0.5), directions, leaf([2, 3, 2], 0.1), leaf([], 0.0)];
            Case::new(SampleCubeMap { sampler, extent: 4 }, inputs)
        };
        check(
            Check::of_cases(format!("sample_cube_map, {name}"), cases)
                .refuses_midway("directions of two entries", of(leaf([2, 2], 0.5)))
                .refuses_midway("a direction of no length", of(leaf([2, 3], 0.0))),
        );
    }
}
