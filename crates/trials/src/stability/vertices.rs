//! Vertices behind the eye, at infinity, at the ends of the range of numbers.

use bokashi_core::Scalar;
use bokashi_render_ops::Size;

use super::oracle::compare;
use super::row::{Found, Outcome};
use super::scene::{Scene, Seen, largest, orders, rounding};

const SIZE: Size = Size { width: 13, height: 11 };

/// The one face of `clip`, in all orders, against the linear system of each pixel.
fn against_the_system<T: Scalar>(scenes: &[Vec<[f64; 4]>], bound: f64) -> Outcome {
    let (mut wrong, mut covered, mut close, mut error) = (0, 0, 0, 0.0_f64);
    let mut finite = true;
    for clip in scenes {
        for order in orders([0, 1, 2]) {
            let scene = Scene::new(clip, &[order], SIZE);
            let comparison = compare::<T>(&scene, &scene.draw::<T>()?);
            wrong += comparison.wrong;
            covered += comparison.covered;
            close += comparison.close;
            error = error.greater(comparison.error);
            finite &= scene.rendered::<T>(None)?.is_finite()
                && scene.surface_gradient::<T>()?.iter().all(|bar| bar.is_finite());
        }
    }
    let outcome = format!("{covered} fragments, each with its weights and depth");
    Ok(Found::within(outcome, error, bound)
        .and(wrong == 0, format!("{wrong} pixels are covered wrongly"))
        .and(close * 20 <= covered, format!("{close} pixels were too close to an edge to tell"))
        .and(covered > 20, "hardly anything was drawn")
        .and(finite, "a gradient is not finite"))
}

pub(super) fn all_behind<T: Scalar>() -> Outcome {
    let mut wrong = 0;
    for last in [-0.5, -1e-30, -0.0, 0.0] {
        let clip = [[-0.7, -0.6, 0.0, -1.0], [0.6, -0.5, 0.0, -0.4], [0.2, 0.9, 0.0, last]];
        let scene = Scene::new(&clip, &[[0, 1, 2]], SIZE);
        let drawn = scene.draw::<T>()?;
        let rendered = scene.rendered::<T>(None)?;
        let zero = rendered.clip_bar.iter().chain(&rendered.color_bar).all(|&bar| bar == 0.0);
        wrong += usize::from(drawn.count() > 0 || drawn.culled.outside != 1 || !zero);
    }
    Ok(Found::exactly("nothing drawn, one face counted as outside, zero gradients", wrong))
}

pub(super) fn one_behind<T: Scalar>() -> Outcome {
    let scenes = [
        vec![[-0.44, -1.65, 0.11, 1.1], [0.27, -1.26, 0.09, 0.9], [-0.05, 2.0, -0.05, -0.5]],
        vec![[-1.65, -0.55, 0.11, 1.1], [-1.26, 0.36, 0.09, 0.9], [1.2, -0.03, -0.03, -0.3]],
        vec![[0.9, 0.7, 0.3, 1.0], [-0.8, 0.75, 0.2, 1.5], [0.1, 0.2, -0.1, -0.2]],
    ];
    against_the_system::<T>(&scenes, 64.0 * rounding::<T>())
}

pub(super) fn two_behind<T: Scalar>() -> Outcome {
    let scenes = [
        vec![[0.05, -0.4, 0.1, 1.0], [1.0, -1.5, -0.1, -0.7], [-1.3, -1.2, 0.0, -0.5]],
        vec![[-0.3, 0.2, 0.2, 0.8], [0.9, 0.3, -0.2, -0.9], [0.5, -1.1, 0.0, -0.2]],
    ];
    against_the_system::<T>(&scenes, 64.0 * rounding::<T>())
}

pub(super) fn at_infinity<T: Scalar>() -> Outcome {
    let scenes = [
        vec![[-0.7, -0.6, 0.1, 1.0], [-0.2, 0.8, 0.2, 1.1], [1.0, 0.3, 0.0, 0.0]],
        vec![[0.06, 0.05, 0.0, 1.0], [1.0, 0.1, 0.0, 0.0], [0.1, 1.0, 0.0, 0.0]],
        vec![[-0.7, -0.6, 0.1, 1.0], [0.5, -0.8, 0.2, 1.1], [0.0, 0.0, 0.0, 0.0]],
        vec![[-0.7, -0.6, 0.1, 1.0], [-0.2, 0.8, 0.2, 1.1], [1.0, 0.3, 0.0, -0.0]],
    ];
    // Of the third nothing can be seen: a vertex of zeros has no place.
    let nothing = Scene::new(&scenes[2], &[[0, 1, 2]], SIZE);
    let drawn = nothing.draw::<T>()?;
    let scenes = [scenes[0].clone(), scenes[1].clone(), scenes[3].clone()];
    let found = against_the_system::<T>(&scenes, 64.0 * rounding::<T>())?;
    Ok(found.and(
        drawn.count() == 0 && drawn.culled.degenerate == 1,
        "a vertex of zeros is not counted as degenerate",
    ))
}

/// A face in front, and how its weights change where a vertex's coordinates are multiplied.
fn with_weight<T: Scalar>(factors: [f64; 3]) -> Result<(usize, f64), super::row::Failure> {
    let ndc = [[-0.75, -0.875], [0.9375, -0.625], [0.0625, 0.9375]];
    let clip = |factors: [f64; 3]| -> Vec<[f64; 4]> {
        let corner = |k: usize| {
            let [x, y] = ndc[k];
            let depth = [0.25, -0.5, 0.125][k];
            [x, y, depth, 1.0].map(|c| c * factors[k])
        };
        (0..3).map(corner).collect()
    };
    let (mut wrong, mut error) = (0, 0.0_f64);
    for order in orders([0, 1, 2]) {
        let plain = Scene::new(&clip([1.0; 3]), &[order], SIZE).draw::<f64>()?;
        let weighted = Scene::new(&clip(factors), &[order], SIZE).draw::<T>()?;
        wrong +=
            weighted.differs_from(&plain.pixels.iter().map(Option::is_some).collect::<Vec<_>>());
        for (seen, plain) in weighted.pixels.iter().zip(&plain.pixels) {
            let (Some(seen), Some(Seen { uv: [u, v], depth, .. })) = (seen, plain) else {
                continue;
            };
            let b = [u / factors[order[0] as usize], v / factors[order[1] as usize]];
            let last = (1.0 - u - v) / factors[order[2] as usize];
            let total = b[0] + b[1] + last;
            for (found, expected) in
                [(seen.uv[0], b[0] / total), (seen.uv[1], b[1] / total), (seen.depth, *depth)]
            {
                error = error.greater((found - expected).abs());
            }
            let rest = 1.0 - seen.uv[0] - seen.uv[1];
            let beyond = |weight: f64| (-weight).greater(weight - 1.0).greater(0.0);
            error =
                error.greater(beyond(seen.uv[0])).greater(beyond(seen.uv[1])).greater(beyond(rest));
        }
    }
    Ok((wrong, error))
}

pub(super) fn tiny_w<T: Scalar>() -> Outcome {
    // Below the smallest normal number of f32; a power of two, so that nothing is rounded.
    let tiny = f64::powi(2.0, -126);
    let (mut wrong, mut error) = (0, 0.0_f64);
    for factors in [[tiny, 1.0, 1.0], [1.0, tiny, tiny], [tiny; 3]] {
        let (pixels, difference) = with_weight::<T>(factors)?;
        wrong += pixels;
        error = error.greater(difference);
    }
    Ok(Found::within("drawn as with w = 1, weights by w", error, 64.0 * rounding::<T>())
        .and(wrong == 0, format!("{wrong} pixels are covered wrongly")))
}

pub(super) fn wide_range_of_w<T: Scalar>() -> Outcome {
    let (mut wrong, mut error) = (0, 0.0_f64);
    for powers in [[-20, 0, 20], [20, -20, 0], [-20, 20, 20], [-20, -20, 20]] {
        let (pixels, difference) = with_weight::<T>(powers.map(|power| f64::powi(2.0, power)))?;
        wrong += pixels;
        error = error.greater(difference);
    }
    let outcome = "weights within [0, 1] and right, w from 1e-6 to 1e6";
    Ok(Found::within(outcome, error, 64.0 * rounding::<T>())
        .and(wrong == 0, format!("{wrong} pixels are covered wrongly")))
}

pub(super) fn in_the_near_plane<T: Scalar>() -> Outcome {
    let mut error = 0.0_f64;
    let mut count = 0;
    for depth in [-1.0, 1.0] {
        let clip: Vec<_> = [[-1.0, -1.0, 1.0], [3.0, -1.0, 1.0], [-2.0, 6.0, 2.0]]
            .iter()
            .map(|&[x, y, w]| [x, y, depth * w, w])
            .collect();
        for order in orders([0, 1, 2]) {
            let drawn = Scene::new(&clip, &[order], SIZE).draw::<T>()?;
            count += drawn.count();
            error = error
                .greater(largest(drawn.pixels.iter().flatten().map(|seen| seen.depth - depth)));
        }
    }
    let all = 12 * SIZE.pixels();
    Ok(Found::within("drawn whole, in the near plane and in the far plane", error, 0.0)
        .and(count == all, format!("{} of {all} pixels are missing", all - count)))
}

pub(super) fn outside_the_depth_range<T: Scalar>() -> Outcome {
    // z / w = 2 y: visible for |y| <= 1/2, which no pixel centre lies on.
    let size = Size { width: 8, height: 32 };
    let clip = [[-1.0, -1.0, -2.0, 1.0], [3.0, -1.0, -2.0, 1.0], [-1.0, 3.0, 6.0, 1.0]];
    let drawn = Scene::new(&clip, &[[0, 1, 2]], size).draw::<T>()?;
    let y = |pixel: usize| 1.0 - (2 * (pixel / 8) + 1) as f64 / 32.0;
    let covered: Vec<_> = (0..size.pixels()).map(|pixel| y(pixel).abs() <= 0.5).collect();
    let seen = drawn.pixels.iter().enumerate();
    let error = largest(seen.filter_map(|(k, seen)| seen.map(|seen| seen.depth - 2.0 * y(k))));
    let beyond = Scene::new(&clip.map(|[x, y, _, w]| [x, y, 1.5 * w, w]), &[[0, 1, 2]], size);
    let beyond = beyond.draw::<T>()?;
    let wrong = drawn.differs_from(&covered);
    Ok(Found::within("the part within the range, each depth right", error, 8.0 * rounding::<T>())
        .and(wrong == 0, format!("{wrong} pixels are covered wrongly"))
        .and(
            beyond.count() == 0 && beyond.culled.outside == 1,
            "a face beyond the far plane shows",
        ))
}

/// The strip from a level base line to vertices `far` pixels away.
fn strip<T: Scalar>(far: f64) -> Result<usize, super::row::Failure> {
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
            let scene = Scene::new(&clip, &[order], size);
            wrong += scene.draw::<T>()?.differs_from(&covered);
            let finite = scene.rendered::<T>(None)?.is_finite()
                && scene.surface_gradient::<T>()?.iter().all(|bar| bar.is_finite());
            wrong += usize::from(!finite);
        }
    }
    Ok(wrong)
}

pub(super) fn far_away<T: Scalar>() -> Outcome {
    let mut wrong = 0;
    for far in [1e6, 1e30] {
        wrong += strip::<T>(far)?;
    }
    Ok(Found::exactly("the half-planes above and below a level line; finite gradients", wrong))
}

pub(super) fn largest_coordinates<T: Scalar>() -> Outcome {
    let most = if rounding::<T>() > 1e-10 { f64::from(f32::MAX) } else { f64::MAX };
    let mut wrong = 0;
    for far in [most.sqrt(), most.powf(0.75), most / 64.0, most] {
        wrong += strip::<T>(far)?;
    }
    Ok(Found::exactly("as at 1e30 px, up to the largest number there is", wrong))
}

pub(super) fn denormal_coordinates<T: Scalar>() -> Outcome {
    let least =
        if rounding::<T>() > 1e-10 { f64::from(f32::from_bits(1)) } else { f64::from_bits(1) };
    let unit = [[-60.0, -50.0, 3.0, 64.0], [61.0, -40.0, -5.0, 64.0], [3.0, 55.0, 7.0, 48.0]];
    let drawn = |unit_size: f64| {
        Scene::new(&unit.map(|p| p.map(|c| c * unit_size)), &[[0, 1, 2]], SIZE).draw::<T>()
    };
    let (plain, denormal) = (drawn(1.0)?, drawn(least)?);
    Ok(Found::exactly("bitwise as the same face a normal size", usize::from(plain != denormal))
        .and(plain.count() > 20, "hardly anything was drawn"))
}

pub(super) fn negative_zero<T: Scalar>() -> Outcome {
    let size = Size::square(5);
    let clip =
        |zero: f64| [[zero, zero, zero, 1.0], [0.9, zero, zero, 1.0], [zero, 0.9, zero, 1.0]];
    let mut wrong = 0;
    for order in orders([0, 1, 2]) {
        let scene = |zero| Scene::new(&clip(zero), &[order], size);
        let (plus, minus) = (scene(0.0), scene(-0.0));
        wrong += usize::from(plus.draw::<T>()? != minus.draw::<T>()?);
        wrong += usize::from(plus.rendered::<T>(Some(0.8))? != minus.rendered::<T>(Some(0.8))?);
        wrong += usize::from(plus.surface_gradient::<T>()? != minus.surface_gradient::<T>()?);
        wrong += usize::from(plus.draw::<T>()?.count() == 0);
    }
    Ok(Found::exactly("the image and every gradient as with +0", wrong))
}

pub(super) fn covers_the_screen<T: Scalar>() -> Outcome {
    let mut missing = 0;
    for far in [3.0, 1e3, 1e6] {
        for order in orders([0, 1, 2]) {
            let clip = [[-far, -far, 0.0, 1.0], [far, -far, 0.0, 1.0], [0.0, far, 0.0, 1.0]];
            missing += SIZE.pixels() - Scene::new(&clip, &[order], SIZE).draw::<T>()?.count();
        }
    }
    Ok(Found::exactly("every pixel", missing))
}
