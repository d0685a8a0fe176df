//! Laws of samples: against the definition, texel by texel.

use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    CubeMap, Detail, Sampler, Texture, TextureBorder, TextureFilter, sample_cube_map,
    sample_texture,
};
use glam::DVec3;
use rayon::ThreadPoolBuilder;

const BORDERS: [TextureBorder; 4] =
    [TextureBorder::Wrap, TextureBorder::Mirror, TextureBorder::Clamp, TextureBorder::Zero];

/// Each border along u beside each along v.
fn pairs() -> impl Iterator<Item = [TextureBorder; 2]> {
    BORDERS.into_iter().flat_map(|u| BORDERS.map(|v| [u, v]))
}

const FILTERS: [TextureFilter; 4] = [
    TextureFilter::Nearest,
    TextureFilter::Bilinear,
    TextureFilter::Trilinear,
    TextureFilter::Anisotropic { probes: 8 },
];

/// Numbers without a pattern, from -1 to 1.
pub(crate) fn motley<T: Scalar>(shape: impl Into<bokashi_core::Shape>, seed: usize) -> Tensor<T> {
    Tensor::from_flat_fn(shape, |k| {
        let k = (k + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15).wrapping_add(seed * 0x1234_5677);
        T::from_f64((k.wrapping_mul(0x2545_f491_4f6c_dd1d) >> 40) as f64 / (1 << 23) as f64 - 1.0)
    })
}

/// Coordinates in and around the texture.
pub(crate) fn coordinates<T: Scalar>(count: usize) -> Tensor<T> {
    motley::<T>([count, 2], 5).map(|u| T::from_f64(0.5) + T::from_f64(1.4) * u)
}

/// Footprints of 0.3 to 30 texels of a texture of some 30, long and short, turned.
pub(crate) fn differentials(count: usize, rows: usize) -> Tensor<f64> {
    let numbers = motley::<f64>([count, 2 * rows], 9);
    Tensor::from_fn([count, rows, 2], |[n, i, k]| {
        f64::powi(2.0, (n % 7) as i32 - 6) * numbers[[n, 2 * i + k]]
    })
}

/// Bilinear, and of the nearest texel, from the definition.
fn expected(
    level: &Tensor<f64>,
    [u, v]: [f64; 2],
    borders: [TextureBorder; 2],
    nearest: bool,
) -> Vec<f64> {
    let &[rows, columns, channels] = &**level.shape() else { panic!("an image") };
    let texel = |i: f64, j: f64| -> Vec<f64> {
        let at = |at: f64, extent: usize, border: TextureBorder| {
            let n = extent as f64;
            Some(match border {
                TextureBorder::Wrap => at.rem_euclid(n),
                TextureBorder::Mirror => {
                    let phase = at.rem_euclid(2.0 * n);
                    phase.min(2.0 * n - 1.0 - phase)
                }
                TextureBorder::Clamp => at.clamp(0.0, n - 1.0),
                TextureBorder::Zero if (0.0..n).contains(&at) => at,
                TextureBorder::Zero => return None,
            } as usize)
        };
        match (at(i, rows, borders[1]), at(j, columns, borders[0])) {
            (Some(i), Some(j)) => level.data()[(i * columns + j) * channels..][..channels].to_vec(),
            _ => vec![0.0; channels],
        }
    };
    if nearest {
        return texel((v * rows as f64).floor(), (u * columns as f64).floor());
    }
    let (x, y) = (u * columns as f64 - 0.5, v * rows as f64 - 0.5);
    let (f, g) = (x - x.floor(), y - y.floor());
    let mut sum = vec![0.0; channels];
    for (di, dj, weight) in [
        (0.0, 0.0, (1.0 - f) * (1.0 - g)),
        (0.0, 1.0, f * (1.0 - g)),
        (1.0, 0.0, (1.0 - f) * g),
        (1.0, 1.0, f * g),
    ] {
        let texel = texel(y.floor() + di, x.floor() + dj);
        sum.iter_mut().zip(texel).for_each(|(sum, texel)| *sum += weight * texel);
    }
    sum
}

fn assert_close(found: &[f64], expected: &[f64], tolerance: f64) {
    assert_eq!(found.len(), expected.len());
    for (k, (found, expected)) in found.iter().zip(expected).enumerate() {
        assert!((found - expected).abs() <= tolerance, "{found} and not {expected} at {k}");
    }
}

#[test]
fn samples_of_a_level_are_those_of_the_definition_at_any_size_and_border() {
    let tape = Tape::<f64>::new();
    let uv = coordinates::<f64>(400);
    for shape in [[8, 16, 3], [5, 7, 1], [1, 9, 4], [3, 1, 2], [1, 1, 5]] {
        let texels = motley::<f64>(shape, 1);
        let texture = Texture::new(tape.leaf(&texels)).unwrap();
        for borders in pairs() {
            for filter in [TextureFilter::Nearest, TextureFilter::Bilinear] {
                let sampler = Sampler::new().filter(filter).borders(borders);
                let found =
                    sample_texture(&texture, tape.leaf(&uv), Detail::Finest, sampler).unwrap();
                let nearest = filter == TextureFilter::Nearest;
                for (uv, found) in uv.data().chunks(2).zip(found.value().data().chunks(shape[2])) {
                    let expected = expected(&texels, [uv[0], uv[1]], borders, nearest);
                    assert_close(found, &expected, 1e-13);
                }
            }
        }
    }
}

#[test]
fn a_level_between_two_levels_mixes_their_samples() {
    let tape = Tape::<f64>::new();
    let uv = coordinates::<f64>(300);
    let texture = Texture::with_mipmaps(tape.leaf(&motley([12, 20, 3], 2))).unwrap();
    let count = texture.levels().len();
    assert_eq!(count, 5);
    let of_level = |k: usize| {
        let texels = texture.levels()[k].value();
        let of = |uv: &[f64]| expected(&texels, [uv[0], uv[1]], [TextureBorder::Mirror; 2], false);
        uv.data().chunks(2).flat_map(of).collect::<Vec<_>>()
    };
    let sampler = Sampler::new().border(TextureBorder::Mirror);
    for (level, sampler) in [-3.0, 0.0, 0.3, 1.0, 2.75, 3.999, 4.0, 9.0, 1e30]
        .into_iter()
        .flat_map(|level| [(level, sampler), (level, sampler.coarsest(2))])
    {
        let given = tape.leaf_scalar(level);
        let detail = Detail::Level(given);
        let found = sample_texture(&texture, tape.leaf(&uv), detail, sampler).unwrap().value();
        let top = sampler.coarsest.unwrap_or(count - 1) as f64;
        let level: f64 = level.clamp(0.0, top);
        let (finer, coarser) = (of_level(level as usize), of_level(level.ceil() as usize));
        let share = level.fract();
        let mixed: Vec<_> = finer.iter().zip(coarser).map(|(a, b)| a + share * (b - a)).collect();
        assert_close(found.data(), &mixed, 1e-13);
        // The same by a level for each sample, and bilinear on the nearest level.
        let each = Detail::Level(tape.leaf(&Tensor::full([300], level)));
        let again = sample_texture(&texture, tape.leaf(&uv), each, sampler).unwrap().value();
        assert_eq!(again, found);
        let sampler = sampler.filter(TextureFilter::Bilinear);
        let found = sample_texture(&texture, tape.leaf(&uv), detail, sampler).unwrap().value();
        assert_close(found.data(), &of_level((level + 0.5).floor().min(top) as usize), 1e-13);
    }
}

#[test]
fn the_level_is_the_logarithm_of_the_longer_axis_of_the_footprint() {
    let tape = Tape::<f64>::new();
    let texture = Texture::with_mipmaps(tape.leaf(&motley([64, 32, 1], 3))).unwrap();
    let uv = tape.leaf(&coordinates::<f64>(1));
    // Texels per pixel along u and v; the axes of the footprint turned on the screen by any angle.
    for (along_u, along_v) in [(4.0, 2.0), (1.0, 11.3), (0.4, 0.3), (3.0, 3.0), (90.0, 1.0)] {
        for angle in [0.0_f64, 0.4, 2.0] {
            let (s, c) = angle.sin_cos();
            let (u, v) = (along_u / 32.0, along_v / 64.0);
            let slopes = Tensor::new([1, 2, 2], vec![u * c, -u * s, v * s, v * c]).unwrap();
            for bias in [None, Some(0.7), Some(-0.4)] {
                let detail = Detail::Differentials {
                    differentials: tape.leaf(&slopes),
                    bias: bias.map(|bias| tape.leaf_scalar(bias)),
                };
                let found = sample_texture(&texture, uv, detail, Sampler::new()).unwrap();
                let level = f64::log2(along_u.max(along_v)) + bias.unwrap_or(0.0);
                let by_level = Detail::Level(tape.leaf_scalar(level));
                let same = sample_texture(&texture, uv, by_level, Sampler::new()).unwrap();
                assert_close(found.value().data(), same.value().data(), 1e-12);
            }
        }
    }
}

#[test]
fn an_anisotropic_sample_is_the_mean_of_probes_on_a_finer_level() {
    let tape = Tape::<f64>::new();
    let texture = Texture::with_mipmaps(tape.leaf(&motley([64, 64, 2], 3))).unwrap();
    let uv = [0.41, 0.37];
    // A footprint 12 texels long and 3 wide: four probes, on the level of texels of 3.
    let (s, c) = 0.7_f64.sin_cos();
    let slopes = [12.0 * c, -3.0 * s, 12.0 * s, 3.0 * c].map(|slope| slope / 64.0);
    let detail = Detail::Differentials {
        differentials: tape.leaf(&Tensor::new([1, 2, 2], slopes.to_vec()).unwrap()),
        bias: None,
    };
    let sampler = |probes| Sampler::new().filter(TextureFilter::Anisotropic { probes });
    let at = |uv: [f64; 2]| tape.leaf(&Tensor::new([1, 2], uv.to_vec()).unwrap());
    for (probes, taken) in [(1, 1), (2, 2), (4, 4), (8, 4)] {
        let found = sample_texture(&texture, at(uv), detail, sampler(probes)).unwrap().value();
        let mut mean = vec![0.0; 2];
        for k in 0..taken {
            let offset = (k as f64 + 0.5) / taken as f64 - 0.5;
            let level = Detail::Level(tape.leaf_scalar(f64::log2(12.0 / taken as f64)));
            let probe = at([uv[0] + offset * slopes[0], uv[1] + offset * slopes[2]]);
            let probe = sample_texture(&texture, probe, level, Sampler::new()).unwrap().value();
            mean.iter_mut().zip(probe.data()).for_each(|(m, p)| *m += p / taken as f64);
        }
        assert_close(found.data(), &mean, 1e-12);
    }
}

#[test]
fn a_texture_that_is_linear_in_the_coordinates_comes_out_exactly_at_any_level() {
    let tape = Tape::<f64>::new();
    // Away from the border by the half texel of the coarsest level but one.
    let uv = motley::<f64>([500, 2], 4).map(|u| 0.5 + 0.08 * u);
    let slopes = differentials(500, 2).map(|slope| 0.1 * slope);
    for [height, width] in [[32, 64], [45, 31], [27, 21]] {
        let linear = |u: f64, v: f64, c: usize| [0.3, -2.0][c] * u + [1.0, 0.7][c] * v - 0.2;
        let texels = Tensor::from_fn([height, width, 2], |[i, j, c]| {
            linear((j as f64 + 0.5) / width as f64, (i as f64 + 0.5) / height as f64, c)
        });
        let texture = Texture::with_mipmaps(tape.leaf(&texels)).unwrap();
        for filter in &FILTERS[1..] {
            let bias = Some(tape.leaf(&motley::<f64>([500], 8).map(|b| 2.0 * b)));
            let detail = Detail::Differentials { differentials: tape.leaf(&slopes), bias };
            let sampler = Sampler::new().filter(*filter).coarsest(3);
            let found = sample_texture(&texture, tape.leaf(&uv), detail, sampler).unwrap().value();
            for (uv, found) in uv.data().chunks(2).zip(found.data().chunks(2)) {
                let expected = [0, 1].map(|c| linear(uv[0], uv[1], c));
                assert_close(found, &expected, 1e-13);
            }
        }
    }
}

/// Samples of a texture or of a cube map, with all that can have a gradient.
struct Scene<'t, T: Scalar> {
    levels: Vec<Var<'t, T>>,
    moves: Vec<Var<'t, T>>,
    out: Var<'t, T>,
}

fn scene<'t, T: Scalar>(
    tape: &'t Tape<T>,
    is_cube: bool,
    [count, extent, channels]: [usize; 3],
    sampler: Sampler,
) -> Scene<'t, T> {
    let k = 2 + usize::from(is_cube);
    let differentials = tape.leaf(&differentials(count, k).cast());
    let bias = tape.leaf(&motley([count], 7));
    let detail = Detail::Differentials { differentials, bias: Some(bias) };
    if is_cube {
        let texels = tape.leaf(&motley([6, extent, extent, channels], 1));
        let map = CubeMap::with_mipmaps(texels).unwrap();
        let directions = tape.leaf(&motley([count, 3], 6));
        let out = sample_cube_map(&map, directions, detail, sampler).unwrap();
        Scene { levels: map.levels().to_vec(), moves: vec![directions, differentials, bias], out }
    } else {
        let texels = tape.leaf(&motley([extent, extent + 3, channels], 1));
        let texture = Texture::with_mipmaps(texels).unwrap();
        let uv = tape.leaf(&coordinates(count));
        let out = sample_texture(&texture, uv, detail, sampler).unwrap();
        Scene { levels: texture.levels().to_vec(), moves: vec![uv, differentials, bias], out }
    }
}

#[test]
fn backward_is_the_adjoint_of_forward_in_the_texels_of_all_levels() {
    let turned = BORDERS.into_iter().zip(BORDERS.into_iter().cycle().skip(1)).map(|(u, v)| [u, v]);
    let borders = BORDERS.map(|border| [border; 2]).into_iter().chain(turned);
    let borders = borders.map(|borders| (false, borders));
    for (is_cube, borders) in borders.chain([(true, [TextureBorder::Wrap; 2])]) {
        for filter in FILTERS {
            for size in [[40, 9, 3], [3000, 37, 2], [9000, 70, 5]] {
                let tape = Tape::<f64>::new();
                let sampler = Sampler::new().filter(filter).borders(borders);
                let Scene { levels, out, .. } = scene(&tape, is_cube, size, sampler);
                let upstream = motley(out.shape(), 11);
                // Each level on its own: samples are linear in all levels together.
                let gradients = tape.vjp_to(&[(out, &upstream)], &levels).unwrap();
                let dot = |a: &Tensor<f64>, b: &Tensor<f64>| -> f64 {
                    a.data().iter().zip(b.data()).map(|(a, b)| a * b).sum()
                };
                // What later levels say of earlier levels is not theirs.
                let held: Vec<_> = levels.iter().map(|level| tape.leaf(&level.value())).collect();
                let again = held_samples(&tape, is_cube, size, sampler, &held);
                let held_gradients = tape.vjp_to(&[(again, &upstream)], &held).unwrap();
                let back: f64 = held
                    .iter()
                    .map(|&level| dot(&held_gradients.get_or_zeros(level), &level.value()))
                    .sum();
                let there = dot(&again.value(), &upstream);
                assert_eq!(again.value(), out.value());
                approx::assert_relative_eq!(there, back, max_relative = 1e-10, epsilon = 1e-11);
                let folded = dot(&gradients.get_or_zeros(levels[0]), &levels[0].value());
                approx::assert_relative_eq!(folded, back, max_relative = 1e-10, epsilon = 1e-10);
            }
        }
    }
}

/// The same samples of levels that are given.
fn held_samples<'t>(
    tape: &'t Tape<f64>,
    is_cube: bool,
    [count, ..]: [usize; 3],
    sampler: Sampler,
    levels: &[Var<'t, f64>],
) -> Var<'t, f64> {
    let k = 2 + usize::from(is_cube);
    let detail = Detail::Differentials {
        differentials: tape.leaf(&differentials(count, k)),
        bias: Some(tape.leaf(&motley([count], 7))),
    };
    if is_cube {
        let map = CubeMap::from_levels(levels).unwrap();
        sample_cube_map(&map, tape.leaf(&motley([count, 3], 6)), detail, sampler).unwrap()
    } else {
        let texture = Texture::from_levels(levels).unwrap();
        sample_texture(&texture, tape.leaf(&coordinates(count)), detail, sampler).unwrap()
    }
}

#[test]
fn a_crowd_of_samples_in_one_texel_is_summed_in_parts() {
    let count = 100_000;
    let run = |extent: usize| {
        let tape = Tape::<f32>::new();
        let texels = tape.leaf(&Tensor::full([extent, extent, 1], 1.0));
        let uv = tape.constant(&coordinates(count));
        let texture = Texture::new(texels).unwrap();
        let out = sample_texture(&texture, uv, Detail::Finest, Sampler::new()).unwrap();
        let tenths = Tensor::full([count, 1], 0.1);
        tape.vjp(&[(out, &tenths)]).unwrap().get_or_zeros(texels)
    };
    let total = f64::from(0.1_f32) * count as f64;
    assert_eq!(run(1).data(), [total as f32]);
    let sum: f64 = run(3).data().iter().map(|&x| f64::from(x)).sum();
    approx::assert_relative_eq!(sum, total, max_relative = 1e-6);
}

#[test]
fn the_bits_are_the_same_on_any_number_of_threads_and_in_recycled_memory() {
    let run = |threads: usize, is_cube: bool, filter: TextureFilter| {
        let pool = ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| {
            let mut tape = Tape::<f32>::new();
            let mut last = None;
            for _ in 0..2 {
                tape.reset();
                let sampler = Sampler::new().filter(filter);
                let Scene { levels, moves, out } = scene(&tape, is_cube, [50_000, 90, 3], sampler);
                let gradients = tape.vjp(&[(out, &motley(out.shape(), 3))]).unwrap();
                let bars = levels[..1].iter().chain(&moves).map(|&v| gradients.get_or_zeros(v));
                let found = (out.value(), bars.collect::<Vec<_>>());
                if let Some(last) = last.replace(found.clone()) {
                    assert!(last == found);
                }
            }
            last
        })
    };
    for is_cube in [false, true] {
        for filter in FILTERS {
            let alone = run(1, is_cube, filter);
            for threads in [2, 3, 4] {
                assert!(run(threads, is_cube, filter) == alone, "{threads} {filter:?}");
            }
        }
    }
}

/// A direction through `(s, t)` of a face, from -1 to 1, with OpenGL's axes written out.
fn through(face: usize, s: f64, t: f64) -> [f64; 3] {
    [[1.0, -t, -s], [-1.0, -t, s], [s, 1.0, t], [s, -1.0, -t], [s, -t, 1.0], [-s, -t, -1.0]][face]
}

fn directions<'t>(tape: &'t Tape<f64>, all: &[[f64; 3]]) -> Var<'t, f64> {
    tape.leaf(&Tensor::new([all.len(), 3], all.concat()).unwrap())
}

#[test]
fn a_direction_through_the_middle_of_a_texel_shows_that_texel() {
    let tape = Tape::<f64>::new();
    let texels = motley::<f64>([6, 4, 4, 2], 1);
    let map = CubeMap::new(tape.leaf(&texels)).unwrap();
    let middle = |at: usize| (2 * at + 1) as f64 / 4.0 - 1.0;
    let all: Vec<_> = (0..96)
        .map(|k| through(k / 16, middle(k % 4), middle(k / 4 % 4)).map(|x| 3.5 * x))
        .collect();
    let found = sample_cube_map(&map, directions(&tape, &all), Detail::Finest, Sampler::new());
    assert_close(found.unwrap().value().data(), texels.data(), 1e-14);

    let units = all.iter().flat_map(|&towards| DVec3::from_array(towards).normalize().to_array());
    let units: Vec<_> = units.collect();
    assert_close(CubeMap::<f64>::directions(4).data(), &units, 1e-15);
}

#[test]
fn no_edge_or_corner_of_a_cube_is_seen() {
    let tape = Tape::<f64>::new();
    for extent in [1, 2, 7, 16] {
        let map = CubeMap::with_mipmaps(tape.leaf(&motley([6, extent, extent, 3], 1))).unwrap();
        // Both sides of each edge, all along it.
        let (mut here, mut there) = (Vec::new(), Vec::new());
        for face in 0..6 {
            for k in -50..=50 {
                let along = k as f64 / 50.0;
                for side in [-1.0, 1.0] {
                    for (s, t) in [(side, along), (along, side)] {
                        let (near, far) = (1.0 - 1e-9, 1.0 + 1e-9);
                        let by = |f: f64| {
                            if s == side && s.abs() == 1.0 && t.abs() < 1.0 {
                                through(face, s * f, t)
                            } else {
                                through(face, s, t * f)
                            }
                        };
                        here.push(by(near));
                        there.push(by(far));
                    }
                }
            }
        }
        for level in [0.0, 0.5, 1.0] {
            let sample = |all: &[[f64; 3]]| {
                let detail = Detail::Level(tape.leaf_scalar(level));
                sample_cube_map(&map, directions(&tape, all), detail, Sampler::new())
                    .unwrap()
                    .value()
            };
            assert_close(sample(&here).data(), sample(&there).data(), 1e-6);
        }
        // Constant maps stay constant, also in the corners.
        let flat = CubeMap::new(tape.leaf(&Tensor::full([6, extent, extent, 1], 0.3))).unwrap();
        let found =
            sample_cube_map(&flat, directions(&tape, &here), Detail::Finest, Sampler::new());
        assert!(found.unwrap().value().data().iter().all(|x| (x - 0.3).abs() < 1e-15));
    }
}

#[test]
fn what_no_gradient_can_reach_is_left_out() {
    let tape = Tape::<f64>::new();
    let texels = tape.leaf(&motley([8, 8, 1], 1));
    let uv = tape.leaf(&coordinates(10));
    let level = tape.leaf_scalar(1.3);
    let mipmaps = Texture::with_mipmaps(texels).unwrap();
    let sample = |texture: &Texture<'_, f64>, detail, filter| {
        let out = sample_texture(texture, uv, detail, Sampler::new().filter(filter)).unwrap();
        let gradients = out.sum().backward().unwrap();
        [uv, level]
            .map(|v| gradients.get(v).is_some_and(|bar| bar.data().iter().any(|&x| x != 0.0)))
    };
    let by_level = Detail::Level(level);
    assert_eq!(sample(&mipmaps, by_level, TextureFilter::Nearest), [false, false]);
    assert_eq!(sample(&mipmaps, by_level, TextureFilter::Bilinear), [true, false]);
    assert_eq!(sample(&mipmaps, by_level, TextureFilter::Trilinear), [true, true]);
    let single = Texture::new(texels).unwrap();
    assert_eq!(sample(&single, by_level, TextureFilter::Trilinear), [true, false]);
    let left_out = tape.take_report().left_out;
    assert!(left_out.iter().any(|of| of.reason == "detail: there is a single level"));
}

#[test]
fn coordinates_have_the_slopes_of_the_borders_along_their_axes() {
    let texels = motley::<f64>([5, 7, 2], 1);
    let uv = coordinates::<f64>(200);
    let upstream = motley::<f64>([200, 2], 3);
    for borders in pairs() {
        let sampler = Sampler::new().filter(TextureFilter::Bilinear).borders(borders);
        let loss = |uv: &Tensor<f64>| -> f64 {
            let of = |uv: &[f64]| expected(&texels, [uv[0], uv[1]], borders, false);
            let samples = uv.data().chunks(2).flat_map(of);
            samples.zip(upstream.data()).map(|(sample, bar)| sample * bar).sum()
        };
        let tape = Tape::<f64>::new();
        let texture = Texture::new(tape.constant(&texels)).unwrap();
        let leaf = tape.leaf(&uv);
        let out = sample_texture(&texture, leaf, Detail::Finest, sampler).unwrap();
        let bars = tape.vjp_to(&[(out, &upstream)], &[leaf]).unwrap().get_or_zeros(leaf);
        // Two quotients agree where no kink lies between.
        let step = 1e-6;
        let mut compared = 0;
        for k in 0..uv.data().len() {
            let moved = |by: f64| {
                loss(&Tensor::from_flat_fn(uv.shape(), |j| {
                    uv.data()[j] + if j == k { by } else { 0.0 }
                }))
            };
            let [left, here, right] = [-step, 0.0, step].map(moved);
            let slopes = [(here - left) / step, (right - here) / step];
            if (slopes[0] - slopes[1]).abs() < 1e-6 {
                compared += 1;
                approx::assert_abs_diff_eq!(bars.data()[k], slopes[0], epsilon = 1e-6);
            }
        }
        assert!(compared > 300, "{borders:?}: {compared}");
    }
}
