//! Textures of one texel, of odd sizes, looked up far outside and at any level.

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{
    CubeMap, Detail, MOST_PROBES, Sampler, Texture, TextureBorder, TextureFilter, sample_texture,
};

use crate::extreme::{Extreme, Failure, Outcome, Verdict, extremes, keep_error};
use crate::measures::{
    difference, is_finite, leaf, motley, motley_leaf, numbers, rounding, rows, values_and_gradients,
};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    171 "textures: one texel", "its texel, no slope", one_texel;
    172 "textures: odd sizes", "linear at every level", odd_sizes;
    173 "textures: coordinates of 1e6, 1e30", "as the border says", far_coordinates;
    174 "textures: level or footprint beyond", "the nearest, no gradient", any_detail;
    176 "textures: refused input", "an error", refused;
};

const BORDERS: [TextureBorder; 4] =
    [TextureBorder::Wrap, TextureBorder::Mirror, TextureBorder::Clamp, TextureBorder::Zero];

const FILTERS: [TextureFilter; 3] =
    [TextureFilter::Nearest, TextureFilter::Bilinear, TextureFilter::Trilinear];

fn one_texel<T: Scalar>() -> Outcome {
    let mut wrong = 0;
    let places = [[0.5, 0.5], [0.0, 1.0], [-3.7, 0.2], [1e6, -1e6]];
    for border in &BORDERS[..3] {
        for filter in FILTERS {
            let tape = Tape::<T>::new();
            let texels = leaf(&tape, &[1, 1, 2], &[0.7, -0.3]);
            let uv = rows(&tape, &places);
            let texture = Texture::with_mipmaps(texels)?;
            wrong += usize::from(texture.levels().len() != 1);
            let sampler = Sampler::new().border(*border).filter(filter);
            let detail = Detail::Level(leaf(&tape, &[], &[0.8]));
            let found =
                values_and_gradients(sample_texture(&texture, uv, detail, sampler)?, &[uv])?;
            let expected = numbers(&texels.value()).repeat(places.len());
            // The weights of the texel have the sum 1, but for rounding.
            wrong += usize::from(difference(&found[0], &expected) > 2.0 * rounding::<T>());
            wrong += usize::from(found[1].iter().any(|&bar| bar != 0.0));
        }
    }
    // Beyond the texel's centre it fades.
    let tape = Tape::<T>::new();
    let texture = Texture::new(leaf(&tape, &[1, 1, 1], &[1.0]))?;
    let sampler = Sampler::new().border(TextureBorder::Zero);
    let uv = rows(&tape, &[[0.5, 0.5], [0.5, 1.25], [0.0, 0.0], [-0.5, 0.5], [9.0, 0.5]]);
    let found = sample_texture(&texture, uv, Detail::Finest, sampler)?;
    wrong += usize::from(numbers(&found.value()) != [1.0, 0.25, 0.25, 0.0, 0.0]);
    Ok(Verdict::exactly("its texel, no slope", wrong))
}

/// Height and width of each level.
fn extents([mut height, mut width]: [usize; 2]) -> Vec<[usize; 2]> {
    let mut all = vec![[height, width]];
    while height > 1 || width > 1 {
        (height, width) = ((height / 2).max(1), (width / 2).max(1));
        all.push([height, width]);
    }
    all
}

fn odd_sizes<T: Scalar>() -> Outcome {
    let mut error = 0.0_f64;
    let mut lost = 0.0_f64;
    let sizes = [[1, 9], [9, 1], [7, 5], [6, 4], [3, 1], [2, 3], [131, 63], [1, 127]];
    for [height, width] in sizes {
        let tape = Tape::<T>::new();
        let plane = |u: f64, v: f64| 0.2 + 0.5 * u - 0.75 * v;
        let texels: Vec<_> = (0..height * width)
            .map(|k| {
                let (row, column) = ((k / width) as f64, (k % width) as f64);
                plane((column + 0.5) / width as f64, (row + 0.5) / height as f64)
            })
            .collect();
        let texels = leaf(&tape, &[height, width, 1], &texels);
        let texture = Texture::with_mipmaps(texels)?;
        let extents = extents([height, width]);
        let made = texture.levels().iter().map(|level| level.shape());
        if !made.eq(extents.iter().map(|&[rows, columns]| [rows, columns, 1].into())) {
            return Ok(Verdict::failed("levels of other extents"));
        }
        for (level, pair) in extents.windows(2).enumerate() {
            // Where no sample reaches beyond the outermost centres of the coarser level.
            let [rows_there, columns_there] = pair[1].map(|extent| extent as f64);
            let inside = |t: f64, extent: f64| 0.5 + (t - 0.5) * (1.0 - 1.0 / extent);
            let places: Vec<_> = (0..12)
                .map(|k| {
                    let [s, t] = [motley(7 * k) + 0.4, motley(11 * k + 3) + 0.4];
                    [inside(s, columns_there), inside(t, rows_there)]
                })
                .collect();
            let uv = rows(&tape, &places);
            for part in [0.0, 0.375, 1.0] {
                let detail = Detail::Level(leaf(&tape, &[], &[level as f64 + part]));
                let sampler = Sampler::new().border(TextureBorder::Clamp);
                let found = values_and_gradients(
                    sample_texture(&texture, uv, detail, sampler)?,
                    &[texels],
                )?;
                let expected: Vec<_> = places.iter().map(|&[u, v]| plane(u, v)).collect();
                error = error.maximum_or_nan(difference(&found[0], &expected));
                // Each sample's weights have the sum 1.
                let passed_on: f64 = (0..places.len()).map(|k| motley(5 * k + 2)).sum();
                lost = lost.maximum_or_nan((found[1].iter().sum::<f64>() - passed_on).abs());
            }
        }
    }
    let bound = 64.0 * rounding::<T>();
    Ok(Verdict::within("a linear texture at every level", error, bound)
        .and(lost <= 64.0 * bound, format!("{lost:.1e} of the gradients is lost")))
}

fn far_coordinates<T: Scalar>() -> Outcome {
    let mut wrong = 0;
    // An even number, and a quarter more where there is such a number.
    for far in [1e6_f64, -1e6, 1e30, -1e30] {
        for border in BORDERS {
            let part = if far.abs() < 1e30 { 0.25 } else { 0.0 };
            let near = match border {
                TextureBorder::Wrap | TextureBorder::Mirror => part,
                _ => far.signum() * 50.0,
            };
            let run = |coordinate: f64| {
                let tape = Tape::<T>::new();
                let texels = motley_leaf(&tape, &[8, 4, 2]);
                let uv = rows(&tape, &[[coordinate, 0.25], [0.375, coordinate], [coordinate; 2]]);
                let texture = Texture::with_mipmaps(texels)?;
                let detail = Detail::Level(leaf(&tape, &[], &[0.5]));
                let sampler = Sampler::new().border(border);
                values_and_gradients(sample_texture(&texture, uv, detail, sampler)?, &[texels, uv])
            };
            let (found, mut expected) = (run(far + part)?, run(near)?);
            if part == 0.0 {
                // Where numbers are whole, nothing is left of a texture's slope.
                [0, 3, 4, 5].into_iter().for_each(|k| expected[2][k] = 0.0);
            }
            wrong += usize::from(found != expected || !is_finite(&found));
            let is_outside = border == TextureBorder::Zero;
            wrong += usize::from(is_outside && found[0].iter().any(|&entry| entry != 0.0));
        }
    }
    // Nothing but a number is left of the largest ones: any result of the texture will do.
    for border in BORDERS {
        let tape = Tape::<T>::new();
        let texels = motley_leaf(&tape, &[5, 3, 1]);
        let most = if rounding::<T>() < 1e-10 { 1.7e308 } else { 3.4e38 };
        let uv = rows(&tape, &[[most, -most], [-most, 1e-30], [1e-40, most]]);
        let texture = Texture::with_mipmaps(texels)?;
        let sampler = Sampler::new().border(border);
        let out = sample_texture(&texture, uv, Detail::Finest, sampler)?;
        let found = values_and_gradients(out, &[texels, uv])?;
        let beyond = found[0].iter().any(|entry| entry.abs() > 0.6);
        wrong += usize::from(beyond || !is_finite(&found));
    }
    Ok(Verdict::exactly("as the border says, finite", wrong))
}

/// Samples of motley texels, and the gradients of texels, coordinates and what stands for the level.
fn at_detail<T: Scalar>(
    shape: &[usize],
    entries: &[f64],
    filter: TextureFilter,
) -> Result<Vec<Vec<f64>>, Failure> {
    let tape = Tape::<T>::new();
    let texels = motley_leaf(&tape, &[16, 8, 2]);
    let uv = rows(&tape, &[[0.3, 0.6], [0.9, 0.1]]);
    let texture = Texture::with_mipmaps(texels)?;
    let own = leaf(&tape, shape, entries);
    let detail = match shape.len() {
        3 => Detail::Differentials { differentials: own, bias: None },
        _ => Detail::Level(own),
    };
    let out = sample_texture(&texture, uv, detail, Sampler::new().filter(filter))?;
    values_and_gradients(out, &[texels, uv, own])
}

fn any_detail<T: Scalar>() -> Outcome {
    let mut wrong = 0;
    // Levels that there are from 0 to 4.
    for filter in FILTERS {
        for (there, beyond) in [(0.0, [-1e-3, -7.0, -1e30]), (4.0, [4.001, 9.0, 1e30])] {
            let expected = at_detail::<T>(&[], &[there], filter)?;
            for level in beyond {
                let found = at_detail::<T>(&[], &[level], filter)?;
                wrong += usize::from(found[..3] != expected[..3] || found[3] != [0.0]);
            }
        }
    }
    // A footprint of nothing sees the finest level, a huge footprint the coarsest.
    let least = if rounding::<T>() < 1e-10 { 1e-310 } else { 1e-42 };
    let most = if rounding::<T>() < 1e-10 { 1e300 } else { 1e37 };
    for (level, sizes) in [(0.0, [0.0, least, 1e-12, 1e-30]), (4.0, [9.0, 1e12, 1e30, most])] {
        let expected = at_detail::<T>(&[], &[level], TextureFilter::Trilinear)?;
        for size in sizes {
            for footprint in [[1.0, 0.0, 0.0, 1.0], [1.0, 0.5, 0.25, -1.0], [0.0, 0.0, 1.0, 1.0]] {
                let entries: Vec<_> = footprint.repeat(2).iter().map(|x| size * x).collect();
                let shape = [2, 2, 2];
                let found = at_detail::<T>(&shape, &entries, TextureFilter::Trilinear)?;
                let has_slope = found[3].iter().any(|&bar| bar != 0.0);
                wrong += usize::from(found[..3] != expected[..3] || has_slope);
                let probes = TextureFilter::Anisotropic { probes: MOST_PROBES };
                let found = at_detail::<T>(&shape, &entries, probes)?;
                // Samples of texels are within those.
                let beyond = found[0].iter().any(|entry| entry.abs() > 0.61);
                wrong += usize::from(beyond || !is_finite(&found));
            }
        }
    }
    Ok(Verdict::exactly("the nearest level, without a gradient", wrong))
}

fn refused<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let zeros = |shape: &[usize]| tape.leaf(&Tensor::zeros(shape));
    let texture = Texture::with_mipmaps(zeros(&[4, 6, 2]))?;
    let uv = zeros(&[2, 2]);
    let at = |coordinates: [[f64; 2]; 2]| {
        keep_error(sample_texture(
            &texture,
            rows(&tape, &coordinates),
            Detail::Finest,
            Sampler::new(),
        ))
    };
    let with = |detail, filter| {
        keep_error(sample_texture(&texture, uv, detail, Sampler::new().filter(filter)))
    };
    let by = |entry: f64| Detail::Differentials {
        differentials: tape.leaf(&Tensor::full([2, 2, 2], T::from_f64(entry))),
        bias: None,
    };
    let probes = |probes| TextureFilter::Anisotropic { probes };
    let level = |entry| Detail::Level(leaf(&tape, &[], &[entry]));
    let levels = |shapes: &[&[usize]]| {
        let levels: Vec<_> = shapes.iter().map(|shape| zeros(shape)).collect();
        keep_error(Texture::from_levels(&levels))
    };
    let sample = "sample_texture needs";
    let texels = "a texture needs texels of shape [H, W, C], at least one entry and less than 2^31 \
                  texels, got shape";
    let results = vec![
        (
            at([[0.0, 0.0], [f64::NAN, 0.0]]),
            format!("{sample} finite coordinates, got NaN in row 1"),
        ),
        (
            at([[0.0, f64::INFINITY], [0.0, 0.0]]),
            format!("{sample} finite coordinates, got inf in row 0"),
        ),
        (with(level(f64::NAN), FILTERS[2]), format!("{sample} finite levels, got NaN in row 0")),
        (
            with(by(f64::NEG_INFINITY), FILTERS[2]),
            format!("{sample} finite differentials, got -inf in row 0"),
        ),
        (with(by(1.0), probes(0)), format!("{sample} from 1 to 8 probes, got 0")),
        (
            with(level(1.0), probes(3)),
            format!("{sample} differentials for more than one probe, got 3"),
        ),
        (
            with(Detail::Level(zeros(&[3])), FILTERS[2]),
            format!("{sample} levels of shape [2], or a single number, got shape [3]"),
        ),
        (levels(&[]), "a texture needs at least one level, got 0 inputs".into()),
        (
            levels(&[&[4, 6, 2], &[2, 2, 2]]),
            "a texture needs a level 1 of shape [2, 3, 2], got shape [2, 2, 2]".into(),
        ),
        (levels(&[&[0, 6, 2]]), format!("{texels} [0, 6, 2]")),
        (keep_error(Texture::new(zeros(&[4, 0, 2]))), format!("{texels} [4, 0, 2]")),
        (
            keep_error(CubeMap::new(zeros(&[6, 2, 3, 1]))),
            "a cube map needs texels of shape [6, S, S, C], at least one entry and less than 2^31 \
             texels, got shape [6, 2, 3, 1]"
                .into(),
        ),
    ];
    Ok(Verdict::refused(results))
}
