//! What samples of textures see, and where they step.

use bokashi_check::Input;
use bokashi_core::Tensor;
use bokashi_render_ops::{Sampler, TextureBorder, TextureFilter};
use glam::EulerRot::ZXZ;
use glam::{DMat3, DVec2};
use proptest::collection::vec;
use proptest::prelude::*;

/// Where a pixel's footprint makes a sample step: the levels and the number of probes.
pub(crate) fn footprint_state(
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
pub(crate) fn cells(
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

/// Differentials of `K` coordinates: footprints of a texel to a few texels, for a texture of such an
/// extent, turned in any way and longer than they are wide. Round footprints are a kink.
pub(crate) fn slopes<const K: usize>(
    count: usize,
    extent: usize,
) -> impl Strategy<Value = Tensor<f64>> {
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
pub(crate) fn texture_inputs(sampler: Sampler, tensors: [Tensor<f64>; 4]) -> Vec<Input> {
    let steps = sampler.filter == TextureFilter::Bilinear;
    let input =
        |(i, tensor)| if steps && i > 1 { Input::constant(tensor) } else { Input::leaf(tensor) };
    tensors.into_iter().enumerate().map(input).collect()
}

pub(crate) fn samplers() -> Vec<(&'static str, Sampler)> {
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
