//! Vertices behind the eye, at infinity, at the ends of the range of numbers.

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_fit::{Fit, FitSettings, Parameter, Parameters, from_fn};
use bokashi_render_ops::{Size, depth, rasterize};

use crate::clip_scene::{ClipScene, PixelFace, Rendered, not_finite, orders};
use crate::extreme::{Extreme, Failure, Outcome, Verdict, extremes, keep_error};
use crate::measures::{largest, rounding};
use crate::oracle::compare;

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    6 "all w <= 0", "nothing drawn", all_behind;
    7 "one vertex with w < 0", "the part in front", one_behind;
    8 "two vertices with w < 0", "the part in front", two_behind;
    9 "w = 0", "the face that ends at infinity", at_infinity;
    10 "w = 1e-38", "drawn, or culled and counted", tiny_w;
    11 "w from 1e-6 to 1e6 in a face", "weights within [0, 1]", wide_range_of_w;
    12 "coplanar with the near plane", "drawn", in_the_near_plane;
    13 "outside the depth range", "clipped", outside_the_depth_range;
    23 "coordinates of 1e6 and 1e30 px", "clipped", far_away;
    24 "face that covers the screen", "every pixel", covers_the_screen;
    25 "denormal coordinates", "drawn as others", denormal_coordinates;
    35 "-0.0", "as +0", negative_zero;
    54 "coordinates up to the largest number", "clipped", largest_coordinates;
};

const SIZE: Size = Size { width: 13, height: 11 };

/// The one face of `clip`, in all orders, against the linear system of each pixel.
fn against_the_system<T: Scalar>(scenes: &[Vec<[f64; 4]>], bound: f64) -> Outcome {
    let (mut wrong, mut covered, mut close, mut error) = (0, 0, 0, 0.0_f64);
    let mut finite = true;
    for clip in scenes {
        for order in orders([0, 1, 2]) {
            let scene = ClipScene::new(clip, &[order], SIZE);
            let comparison = compare::<T>(&scene, &scene.draw::<T>()?);
            wrong += comparison.wrong;
            covered += comparison.covered;
            close += comparison.close;
            error = error.maximum_or_nan(comparison.error);
            finite &= scene.rendered::<T>(None)?.is_finite()
                && scene.surface_gradient::<T>()?.iter().all(|bar| bar.is_finite());
        }
    }
    let outcome = format!("{covered} fragments, each with its weights and depth");
    Ok(Verdict::within(outcome, error, bound)
        .and(wrong == 0, format!("{wrong} pixels are covered wrongly"))
        .and(close * 20 <= covered, format!("{close} pixels were too close to an edge to tell"))
        .and(covered > 20, "hardly anything was drawn")
        .and(finite, "a gradient is not finite"))
}

fn all_behind<T: Scalar>() -> Outcome {
    let mut wrong = 0;
    for last in [-0.5, -1e-30, -0.0, 0.0] {
        let clip = [[-0.7, -0.6, 0.0, -1.0], [0.6, -0.5, 0.0, -0.4], [0.2, 0.9, 0.0, last]];
        let scene = ClipScene::new(&clip, &[[0, 1, 2]], SIZE);
        let drawn = scene.draw::<T>()?;
        let rendered = scene.rendered::<T>(None)?;
        let zero = rendered.clip_bar.iter().chain(&rendered.color_bar).all(|&bar| bar == 0.0);
        wrong += usize::from(drawn.count() > 0 || drawn.culled.outside != 1 || !zero);
    }
    Ok(Verdict::exactly("nothing drawn, one face counted as outside, zero gradients", wrong))
}

fn one_behind<T: Scalar>() -> Outcome {
    let scenes = [
        vec![[-0.44, -1.65, 0.11, 1.1], [0.27, -1.26, 0.09, 0.9], [-0.05, 2.0, -0.05, -0.5]],
        vec![[-1.65, -0.55, 0.11, 1.1], [-1.26, 0.36, 0.09, 0.9], [1.2, -0.03, -0.03, -0.3]],
        vec![[0.9, 0.7, 0.3, 1.0], [-0.8, 0.75, 0.2, 1.5], [0.1, 0.2, -0.1, -0.2]],
    ];
    against_the_system::<T>(&scenes, 64.0 * rounding::<T>())
}

fn two_behind<T: Scalar>() -> Outcome {
    let scenes = [
        vec![[0.05, -0.4, 0.1, 1.0], [1.0, -1.5, -0.1, -0.7], [-1.3, -1.2, 0.0, -0.5]],
        vec![[-0.3, 0.2, 0.2, 0.8], [0.9, 0.3, -0.2, -0.9], [0.5, -1.1, 0.0, -0.2]],
    ];
    against_the_system::<T>(&scenes, 64.0 * rounding::<T>())
}

fn at_infinity<T: Scalar>() -> Outcome {
    let scenes = [
        vec![[-0.7, -0.6, 0.1, 1.0], [-0.2, 0.8, 0.2, 1.1], [1.0, 0.3, 0.0, 0.0]],
        vec![[0.06, 0.05, 0.0, 1.0], [1.0, 0.1, 0.0, 0.0], [0.1, 1.0, 0.0, 0.0]],
        vec![[-0.7, -0.6, 0.1, 1.0], [0.5, -0.8, 0.2, 1.1], [0.0, 0.0, 0.0, 0.0]],
        vec![[-0.7, -0.6, 0.1, 1.0], [-0.2, 0.8, 0.2, 1.1], [1.0, 0.3, 0.0, -0.0]],
    ];
    // Of the third nothing can be seen: a vertex of zeros has no place.
    let nothing = ClipScene::new(&scenes[2], &[[0, 1, 2]], SIZE);
    let drawn = nothing.draw::<T>()?;
    let scenes = [scenes[0].clone(), scenes[1].clone(), scenes[3].clone()];
    let found = against_the_system::<T>(&scenes, 64.0 * rounding::<T>())?;
    Ok(found.and(
        drawn.count() == 0 && drawn.culled.degenerate == 1,
        "a vertex of zeros is not counted as degenerate",
    ))
}

/// A face in front: x, y and depth of its vertices.
const IN_FRONT: [[f64; 3]; 3] =
    [[-0.75, -0.875, 0.25], [0.9375, -0.625, -0.5], [0.0625, 0.9375, 0.125]];

/// Another one, of 1, 0 and -1 alone: times any number these are exact.
const OF_ONES: [[f64; 3]; 3] = [[-1.0, -1.0, 0.0], [1.0, -1.0, -1.0], [0.0, 1.0, 1.0]];

/// The vertices of `face` with `factors` as their w.
fn weighted(face: [[f64; 3]; 3], factors: [f64; 3]) -> [[f64; 4]; 3] {
    std::array::from_fn(|k| {
        let [x, y, depth] = face[k];
        [x, y, depth, 1.0].map(|c| c * factors[k])
    })
}

/// How the weights in a face in front change where a vertex's coordinates are multiplied: pixels
/// covered wrongly, and the largest error.
fn with_weight<T: Scalar>(face: [[f64; 3]; 3], factors: [f64; 3]) -> Result<(usize, f64), Failure> {
    let clip = |factors| weighted(face, factors);
    let smallest = factors.into_iter().fold(f64::INFINITY, f64::min);
    // In proportion: 1 / w may be beyond the numbers.
    let shares = factors.map(|factor| smallest / factor);
    let (mut wrong, mut error) = (0, 0.0_f64);
    for order in orders([0, 1, 2]) {
        let plain = ClipScene::new(&clip([1.0; 3]), &[order], SIZE).draw::<f64>()?;
        let weighted = ClipScene::new(&clip(factors), &[order], SIZE).draw::<T>()?;
        wrong +=
            weighted.differs_from(&plain.pixels.iter().map(Option::is_some).collect::<Vec<_>>());
        for (seen, plain) in weighted.pixels.iter().zip(&plain.pixels) {
            let (Some(seen), Some(PixelFace { uv: [u, v], depth, .. })) = (seen, plain) else {
                continue;
            };
            let b = [u * shares[order[0] as usize], v * shares[order[1] as usize]];
            let last = (1.0 - u - v) * shares[order[2] as usize];
            let total = b[0] + b[1] + last;
            for (found, expected) in
                [(seen.uv[0], b[0] / total), (seen.uv[1], b[1] / total), (seen.depth, *depth)]
            {
                error = error.maximum_or_nan((found - expected).abs());
            }
            let rest = 1.0 - seen.uv[0] - seen.uv[1];
            let beyond = |weight: f64| (-weight).maximum_or_nan(weight - 1.0).maximum_or_nan(0.0);
            error = error
                .maximum_or_nan(beyond(seen.uv[0]))
                .maximum_or_nan(beyond(seen.uv[1]))
                .maximum_or_nan(beyond(rest));
        }
    }
    Ok((wrong, error))
}

/// How many gradients of `scene` are infinite, and how many are wrong: NaN, or infinite where
/// `is_bounded(vertex)` says that they are numbers.
fn infinite_gradients<T: Scalar>(
    scene: &ClipScene,
    is_bounded: impl Fn(usize) -> bool,
) -> Result<[usize; 2], Failure> {
    let rendered = scene.rendered::<T>(Some(0.9))?;
    let (mut infinite, mut wrong) = (0, 0);
    for bars in [&rendered.clip_bar, &scene.surface_gradient::<T>()?] {
        for (k, bar) in bars.iter().enumerate() {
            infinite += usize::from(bar.is_infinite());
            wrong += usize::from(bar.is_nan() || bar.is_infinite() && is_bounded(k / 4));
        }
    }
    // All others are numbers, wherever the vertices are.
    let others = Rendered { clip_bar: Vec::new(), ..rendered };
    Ok([infinite, wrong + usize::from(!others.is_finite())])
}

/// What a fit of the positions of `scene` says to their gradient.
fn fit_of_positions<T: Scalar>(scene: &ClipScene) -> Result<Result<(), String>, Failure> {
    let shape = [scene.clip.len(), 4];
    let start = Tensor::from_flat_fn(shape, |k| T::from_f64(scene.clip[k / 4][k % 4]));
    let parameters = Parameters::new().with(Parameter::new("positions", start))?;
    let mut fit = Fit::new(parameters, FitSettings::default())?;
    let mesh = scene.mesh()?;
    Ok(keep_error(fit.step(&mut from_fn(|_: &Tape<T>, variables| {
        Ok(depth(&rasterize(variables.get("positions")?, &mesh, scene.size)?)?.sum())
    }))))
}

/// The message of a fit whose gradient is beyond the numbers.
fn is_refusal(said: &Result<(), String>) -> bool {
    let refusal = |number| {
        format!("the gradient of \"positions\" needs to be finite, got {number} at step 0")
    };
    let starts =
        |said: &String| ["inf", "-inf"].iter().any(|number| said.starts_with(&refusal(number)));
    said.as_ref().is_err_and(starts)
}

/// The largest number of `T`, and the smallest above 0.
fn ends_of_range<T: Scalar>() -> [f64; 2] {
    if rounding::<T>() > 1e-10 {
        [f64::from(f32::MAX), f64::from(f32::from_bits(1))]
    } else {
        [f64::MAX, f64::from_bits(1)]
    }
}

fn tiny_w<T: Scalar>() -> Outcome {
    let [most, least] = ends_of_range::<T>();
    // The smallest normal number of f32, where nothing is rounded; 1e-38, below it; in either
    // precision one far below its normal numbers, of which 1/16 is a number; the smallest of all.
    // 2^-1060, which `powi` may take for 0, or 2^-140.
    let below_normal = if least < 1e-300 { f64::from_bits(1 << 14) } else { f64::powi(2.0, -140) };
    let (mut wrong, mut error, mut off, mut infinite) = (0, 0.0_f64, 0, 0);
    for (face, tiny) in [
        (IN_FRONT, f64::powi(2.0, -126)),
        (IN_FRONT, 1e-38),
        (IN_FRONT, below_normal),
        (OF_ONES, least),
    ] {
        for factors in [[tiny, 1.0, 1.0], [1.0, tiny, tiny], [tiny; 3]] {
            let (pixels, difference) = with_weight::<T>(face, factors)?;
            wrong += pixels;
            error = error.maximum_or_nan(difference);
            // A gradient grows as 1 / w. At w = 1 those here are far below 2^20.
            let scene = ClipScene::new(&weighted(face, factors), &[[0, 1, 2]], SIZE);
            let is_bounded = |vertex: usize| factors[vertex] * most > f64::powi(2.0, 20);
            let [beyond, others] = infinite_gradients::<T>(&scene, is_bounded)?;
            infinite += beyond;
            off += others;
        }
    }
    let smallest = ClipScene::new(&weighted(OF_ONES, [least; 3]), &[[0, 1, 2]], SIZE);
    let said = fit_of_positions::<T>(&smallest)?;
    let outcome = "drawn as with w = 1, weights by w; gradients grow as 1 / w, up to infinity, \
                   which a fit refuses by name";
    Ok(Verdict::within(outcome, error, 64.0 * rounding::<T>())
        .and(wrong == 0, format!("{wrong} pixels are covered wrongly"))
        .and(off == 0, format!("{off} gradients are NaN, or infinite without need"))
        .and(infinite > 0, "no gradient is infinite")
        .and(is_refusal(&said), format!("a fit says {said:?}")))
}

fn wide_range_of_w<T: Scalar>() -> Outcome {
    let (mut wrong, mut error, mut off) = (0, 0.0_f64, 0);
    for powers in [[-20, 0, 20], [20, -20, 0], [-20, 20, 20], [-20, -20, 20]] {
        let factors = powers.map(|power| f64::powi(2.0, power));
        let (pixels, difference) = with_weight::<T>(IN_FRONT, factors)?;
        wrong += pixels;
        error = error.maximum_or_nan(difference);
        off += not_finite::<T>(&ClipScene::new(&weighted(IN_FRONT, factors), &[[0, 1, 2]], SIZE))?;
    }
    let outcome = "weights within [0, 1] and right, w from 1e-6 to 1e6; finite gradients";
    Ok(Verdict::within(outcome, error, 64.0 * rounding::<T>())
        .and(wrong == 0, format!("{wrong} pixels are covered wrongly"))
        .and(off == 0, "a gradient is not finite"))
}

fn in_the_near_plane<T: Scalar>() -> Outcome {
    let mut error = 0.0_f64;
    let (mut count, mut off) = (0, 0);
    for depth in [-1.0, 1.0] {
        let clip: Vec<_> = [[-1.0, -1.0, 1.0], [3.0, -1.0, 1.0], [-2.0, 6.0, 2.0]]
            .iter()
            .map(|&[x, y, w]| [x, y, depth * w, w])
            .collect();
        for order in orders([0, 1, 2]) {
            let scene = ClipScene::new(&clip, &[order], SIZE);
            let drawn = scene.draw::<T>()?;
            count += drawn.count();
            off += not_finite::<T>(&scene)?;
            error = error.maximum_or_nan(largest(
                drawn.pixels.iter().flatten().map(|seen| seen.depth - depth),
            ));
        }
    }
    let all = 12 * SIZE.pixels();
    let outcome = "drawn whole, in the near plane and in the far plane; finite gradients";
    Ok(Verdict::within(outcome, error, 0.0)
        .and(off == 0, "a gradient is not finite")
        .and(count == all, format!("{} of {all} pixels are missing", all - count)))
}

fn outside_the_depth_range<T: Scalar>() -> Outcome {
    // z / w = 2 y: visible for |y| <= 1/2, which no pixel centre lies on.
    let size = Size { width: 8, height: 32 };
    let clip = [[-1.0, -1.0, -2.0, 1.0], [3.0, -1.0, -2.0, 1.0], [-1.0, 3.0, 6.0, 1.0]];
    let scene = ClipScene::new(&clip, &[[0, 1, 2]], size);
    let off = not_finite::<T>(&scene)?;
    let drawn = scene.draw::<T>()?;
    let y = |pixel: usize| 1.0 - (2 * (pixel / 8) + 1) as f64 / 32.0;
    let covered: Vec<_> = (0..size.pixels()).map(|pixel| y(pixel).abs() <= 0.5).collect();
    let seen = drawn.pixels.iter().enumerate();
    let error = largest(seen.filter_map(|(k, seen)| seen.map(|seen| seen.depth - 2.0 * y(k))));
    // Beyond either end; and beside the image.
    let others = [1.5, -1.5].map(|depth| clip.map(|[x, y, _, w]| [x, y, depth * w, w]));
    let mut shown = 0;
    for clip in others.into_iter().chain([clip.map(|[x, y, _, w]| [x + 9.0, y, 0.0, w])]) {
        let beyond = ClipScene::new(&clip, &[[0, 1, 2]], size).draw::<T>()?;
        shown += beyond.count() + beyond.culled.outside.abs_diff(1);
    }
    let wrong = drawn.differs_from(&covered);
    let outcome = "the part within the range, each depth right; finite gradients";
    Ok(Verdict::within(outcome, error, 8.0 * rounding::<T>())
        .and(off == 0, "a gradient is not finite")
        .and(wrong == 0, format!("{wrong} pixels are covered wrongly"))
        .and(shown == 0, "a face beyond the range, or beside the image, shows"))
}

/// The strip from a level base line to vertices `far` pixels away.
fn strip<T: Scalar>(far: f64) -> Result<usize, Failure> {
    let size = Size { width: 16, height: 8 };
    // The centres of rows 0 to 2 lie above the line, those of rows 3 to 7 below.
    let base = 0.25;
    let mut wrong = 0;
    for (sign, first, last) in [(1.0, 0, 3), (-1.0, 3, 8)] {
        let clip =
            [[-far, base, 0.0, 1.0], [far, base, 0.0, 1.0], [far / 4.0, sign * far, 0.0, 1.0]];
        let covered: Vec<_> =
            (0..size.pixels()).map(|pixel| (first..last).contains(&(pixel / 16))).collect();
        for order in orders([0, 1, 2]) {
            let scene = ClipScene::new(&clip, &[order], size);
            let drawn = scene.draw::<T>()?;
            let is_weight = |weight: &f64| (0.0..=1.0).contains(weight);
            let seen = drawn.pixels.iter().flatten();
            wrong +=
                seen.filter(|seen| !seen.uv.iter().all(is_weight) || seen.depth != 0.0).count();
            wrong += drawn.differs_from(&covered);
            let finite = scene.rendered::<T>(None)?.is_finite()
                && scene.surface_gradient::<T>()?.iter().all(|bar| bar.is_finite());
            wrong += usize::from(!finite);
        }
    }
    Ok(wrong)
}

fn far_away<T: Scalar>() -> Outcome {
    let mut wrong = 0;
    for far in [1e6, 1e30] {
        wrong += strip::<T>(far)?;
    }
    Ok(Verdict::exactly("the half-planes above and below a level line; finite gradients", wrong))
}

fn largest_coordinates<T: Scalar>() -> Outcome {
    let [most, _] = ends_of_range::<T>();
    let mut wrong = 0;
    for far in [most.sqrt(), most.powf(0.75), most / 64.0, most] {
        wrong += strip::<T>(far)?;
    }
    Ok(Verdict::exactly("as at 1e30 px, up to the largest number there is", wrong))
}

fn denormal_coordinates<T: Scalar>() -> Outcome {
    let [_, least] = ends_of_range::<T>();
    let unit = [
        [-60.0, -50.0, 3.0, 64.0],
        [61.0, -40.0, -5.0, 64.0],
        [30.0, 55.0, 7.0, 60.0],
        [-40.0, 44.0, -9.0, 48.0],
    ];
    // In every row both faces are seen: terms of a gradient have either sign.
    let faces = [[0, 1, 2], [0, 2, 3]];
    let scene = |size: f64| ClipScene::new(&unit.map(|p| p.map(|c| c * size)), &faces, SIZE);
    let (plain, denormal) = (scene(1.0).draw::<T>()?, scene(least).draw::<T>()?);
    let image = |size| scene(size).rendered::<T>(Some(0.9)).map(|rendered| rendered.image);
    let wrong = usize::from(plain != denormal) + usize::from(image(1.0)? != image(least)?);
    // 1 / least is beyond the numbers, and so are gradients.
    let [infinite, off] = infinite_gradients::<T>(&scene(least), |_| false)?;
    let said = fit_of_positions::<T>(&scene(least))?;
    let outcome = "bitwise as the same face a normal size; gradients up to infinity, which a fit \
                   refuses by name";
    Ok(Verdict::exactly(outcome, wrong)
        .and(plain.count() > 20, "hardly anything was drawn")
        .and(off == 0, format!("{off} gradients are NaN"))
        .and(infinite > 0, "no gradient is infinite")
        .and(is_refusal(&said), format!("a fit says {said:?}")))
}

fn negative_zero<T: Scalar>() -> Outcome {
    let size = Size::square(5);
    let clip =
        |zero: f64| [[zero, zero, zero, 1.0], [0.9, zero, zero, 1.0], [zero, 0.9, zero, 1.0]];
    let mut wrong = 0;
    for order in orders([0, 1, 2]) {
        let scene = |zero| ClipScene::new(&clip(zero), &[order], size);
        let (plus, minus) = (scene(0.0), scene(-0.0));
        wrong += usize::from(plus.draw::<T>()? != minus.draw::<T>()?);
        wrong += usize::from(plus.rendered::<T>(Some(0.8))? != minus.rendered::<T>(Some(0.8))?);
        wrong += usize::from(plus.surface_gradient::<T>()? != minus.surface_gradient::<T>()?);
        wrong += usize::from(plus.draw::<T>()?.count() == 0);
    }
    Ok(Verdict::exactly("the image and every gradient as with +0", wrong))
}

fn covers_the_screen<T: Scalar>() -> Outcome {
    let (mut missing, mut off) = (0, 0);
    for far in [3.0, 1e3, 1e6] {
        for order in orders([0, 1, 2]) {
            let clip = [[-far, -far, 0.0, 1.0], [far, -far, 0.0, 1.0], [0.0, far, 0.0, 1.0]];
            let scene = ClipScene::new(&clip, &[order], SIZE);
            missing += SIZE.pixels() - scene.draw::<T>()?.count();
            off += not_finite::<T>(&scene)?;
        }
    }
    Ok(Verdict::exactly("every pixel; finite gradients", missing)
        .and(off == 0, "a gradient is not finite"))
}
