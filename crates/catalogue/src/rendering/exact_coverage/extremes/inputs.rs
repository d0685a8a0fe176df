//! What comes in: nothing, refused numbers, and the ends of all ranges.

use bokashi_core::Scalar;
use bokashi_render_ops::Size;

use super::shapes::tetrahedron;
use super::{Checked, Picture, SIZE, options, parts_bound};
use crate::clip_scene::{BACKGROUND, ClipScene, orders};
use crate::extreme::{Extreme, Failure, Outcome, Verdict, extremes};
use crate::measures::{difference, rounding};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    67 "exact: nothing to see", "the background, zero gradients", nothing;
    69 "exact: w <= 0", "the area in front, its slope", behind_the_eye;
    70 "exact: w from 1e-38 to 1e6", "the areas of w = 1", wide_range_of_w;
    71 "exact: ends of the depth range", "clipped, its slope", ends_of_the_depth_range;
    76 "exact: up to the largest number", "clipped", far_away;
    85 "exact: -0.0, 2^k, threads, NaN", "the same bits, nothing masked", upstream_and_bits;
};

fn nothing<T: Scalar>() -> Outcome {
    let front = [[-0.7, -0.6, 0.0, 1.0], [0.6, -0.5, 0.0, 0.4], [0.2, 0.9, 0.0, 1.0]];
    let line = [[-0.5, -0.5, 0.0, 1.0], [0.25, 0.25, 0.0, 1.0], [0.5, 0.5, 0.0, 1.0]];
    let scenes = [
        ClipScene::new(&front, &[], SIZE),
        ClipScene::new(&[], &[], SIZE),
        ClipScene::new(&front, &[[0, 1, 1], [2, 2, 2]], SIZE),
        ClipScene::new(&line, &[[0, 1, 2], [2, 1, 0]], SIZE),
        ClipScene::new(&front.map(|[x, y, z, w]| [x, y, z, -w]), &[[0, 1, 2]], SIZE),
        ClipScene::new(&front.map(|[x, y, _, w]| [x, y, 1.5 * w, w]), &[[0, 1, 2]], SIZE),
        ClipScene::new(&front.map(|[x, y, z, w]| [x + 9.0, y, z, w]), &[[0, 1, 2]], SIZE),
    ];
    let mut wrong = 0;
    for scene in scenes {
        let picture = Picture::new::<T>(&scene)?;
        let behind = [BACKGROUND[0], BACKGROUND[1], 0.0];
        let others = picture.image.chunks_exact(3).filter(|pixel| **pixel != behind);
        let bars = picture.clip_bar.iter().chain(&picture.color_bar);
        wrong += others.count() + bars.filter(|&&bar| bar != 0.0).count() + picture.wrong;
        wrong += picture.culled.abs_diff(scene.faces.len());
    }
    Ok(Verdict::exactly("the background, zero gradients, each face counted", wrong))
}

fn behind_the_eye<T: Scalar>() -> Outcome {
    let scenes = [
        [[-0.44, -1.65, 0.11, 1.1], [0.27, -1.26, 0.09, 0.9], [-0.05, 2.0, -0.05, -0.5]],
        [[-1.65, -0.55, 0.11, 1.1], [-1.26, 0.36, 0.09, 0.9], [1.2, -0.03, -0.03, -0.3]],
        [[0.05, -0.4, 0.1, 1.0], [1.0, -1.5, -0.1, -0.7], [-1.3, -1.2, 0.0, -0.5]],
        [[-0.7, -0.6, 0.1, 1.0], [-0.2, 0.8, 0.2, 1.1], [1.0, 0.3, 0.0, 0.0]],
        [[0.06, 0.05, 0.0, 1.0], [1.0, 0.1, 0.0, 0.0], [0.1, 1.0, 0.0, -0.0]],
    ];
    let mut checked = Checked::default();
    for clip in scenes {
        for order in orders([0, 1, 2]) {
            checked.add::<T>(&ClipScene::new(&clip, &[order], SIZE), true)?;
        }
    }
    Ok(checked.verdict::<T>("each with its area and slope", 1e-13))
}

fn wide_range_of_w<T: Scalar>() -> Outcome {
    let face = [[-0.75, -0.875, 0.25], [0.9375, -0.625, -0.5], [0.0625, 0.9375, 0.125]];
    let weighted = |factors: [f64; 3]| -> Vec<[f64; 4]> {
        let place = |k: usize| [face[k][0], face[k][1], face[k][2], 1.0].map(|c| c * factors[k]);
        (0..3).map(place).collect()
    };
    let plain = Picture::new::<f64>(&ClipScene::new(&weighted([1.0; 3]), &[[0, 1, 2]], SIZE))?;
    let (mut error, mut wrong) = (0.0_f64, 0);
    for powers in [[-20, 0, 20], [20, -20, 0], [-20, 20, 20], [-126, 0, 0], [-126, -126, -126]] {
        let factors = powers.map(|power| f64::powi(2.0, power));
        let found = Picture::new::<T>(&ClipScene::new(&weighted(factors), &[[0, 1, 2]], SIZE))?;
        error = error.maximum_or_nan(difference(&found.areas, &plain.areas));
        // Gradients grow as 1 / w, and 2^126 is near the end of the range.
        wrong += if powers[0] > -30 { found.wrong } else { 0 };
        wrong += found.image.iter().filter(|entry| !entry.is_finite()).count();
    }
    Ok(Verdict::within("the areas of w = 1; finite", error, 4.0 * rounding::<T>())
        .and(wrong == 0, "a number is not finite"))
}

fn ends_of_the_depth_range<T: Scalar>() -> Outcome {
    let mut checked = Checked::default();
    let steep = [[-1.1, -1.0, -2.1, 1.0], [3.0, -1.2, -2.0, 1.0], [-1.3, 3.0, 6.3, 1.0]];
    let eye = [[-0.9, -0.8, 0.9, 1.0], [0.8, -0.9, -2.0, 1.5], [0.1, 0.9, 0.3, 1.0]];
    for clip in [steep, eye] {
        for order in orders([0, 1, 2]) {
            checked.add::<T>(&ClipScene::new(&clip, &[order], SIZE), true)?;
        }
    }
    // All of the image, exactly in the near plane and in the far one.
    let (mut missing, mut wrong) = (0, 0);
    for end in [-1.0, 1.0] {
        let corners = [[-1.0, -1.0, 1.0], [3.0, -1.0, 1.0], [-2.0, 6.0, 2.0]];
        let clip = corners.map(|[x, y, w]| [x, y, end * w, w]);
        for order in orders([0, 1, 2]) {
            let picture = Picture::new::<T>(&ClipScene::new(&clip, &[order], SIZE))?;
            missing += picture.covered().iter().filter(|&&covered| covered != 1.0).count();
            wrong += picture.wrong;
        }
    }
    Ok(checked
        .verdict::<T>("the part within the range, with its slope; all in its planes", 1e-13)
        .and(missing == 0, format!("{missing} pixels in a plane are missing"))
        .and(wrong == 0, "a number is not finite"))
}

fn far_away<T: Scalar>() -> Outcome {
    let most = if rounding::<T>() > 1e-10 { f64::from(f32::MAX) } else { f64::MAX };
    let size = Size { width: 16, height: 8 };
    let (mut error, mut parts, mut wrong) = (0.0_f64, 0.0_f64, 0);
    for far in [16.0, 1e3, 1e6, 1e30, most.sqrt(), most.powf(0.75), most / 64.0, most] {
        for sign in [1.0, -1.0] {
            // Above or below a line at 2.75 px from the top; or all of the image.
            for (base, line) in [(0.3125, 2.75), (-sign * far, 4.0 + 4.0 * sign)] {
                let clip = [[-far, base], [far, base], [far / 4.0, sign * far]];
                let clip = clip.map(|[x, y]| [x, y, 0.0, 1.0]);
                for order in orders([0, 1, 2]) {
                    let picture = Picture::new::<T>(&ClipScene::new(&clip, &[order], size))?;
                    for (pixel, found) in picture.covered().into_iter().enumerate() {
                        let above = (line - (pixel / 16) as f64).clamp(0.0, 1.0);
                        let expected = if sign > 0.0 { above } else { 1.0 - above };
                        error = error.maximum_or_nan((found - expected).abs());
                    }
                    parts = parts.maximum_or_nan(picture.parts);
                    wrong += picture.wrong;
                }
            }
        }
    }
    Ok(Verdict::within("half-planes and the whole image", error, 1e-13 + 2.0 * rounding::<T>())
        .and(parts <= parts_bound::<T>(), format!("parts are off 1 by {parts:.1e}"))
        .and(wrong == 0, format!("{wrong} numbers are not finite")))
}

fn upstream_and_bits<T: Scalar>() -> Outcome {
    let zero = |zero: f64| {
        let clip = [[zero, zero, zero, 1.0], [0.9, zero, zero, 1.0], [zero, 0.9, zero, 1.0]];
        ClipScene::new(&clip, &[[0, 1, 2]], SIZE)
    };
    let mut wrong = usize::from(Picture::new::<T>(&zero(0.0))? != Picture::new::<T>(&zero(-0.0))?);
    // Times a power of two; times one that makes coordinates subnormal.
    let unit = [[-60.0, -50.0, 3.0, 64.0], [61.0, -40.0, -5.0, 64.0], [3.0, 55.0, 7.0, 48.0]];
    let least =
        if rounding::<T>() > 1e-10 { f64::from(f32::from_bits(1)) } else { f64::from_bits(1) };
    let image = |size: f64| {
        let scene = ClipScene::new(&unit.map(|p| p.map(|c| c * size)), &[[0, 1, 2]], SIZE);
        Picture::new::<T>(&scene).map(|picture| (picture.image, picture.areas))
    };
    let plain = image(1.0)?;
    for size in [0.125, 1024.0, f64::powi(2.0, 100), least] {
        wrong += usize::from(image(size)? != plain);
    }
    // Upstream of 0 gives 0, of NaN what is not finite.
    let scene = zero(0.0);
    let with =
        |upstream: f64| Picture::with::<T>(&scene, scene.mesh()?, options(SIZE), |_| upstream);
    let none = with(0.0)?;
    wrong += none.clip_bar.iter().chain(&none.color_bar).filter(|&&bar| bar != 0.0).count();
    let masked = with(f64::NAN)?.clip_bar;
    wrong += usize::from(masked.iter().all(|bar| bar.is_finite()));
    // The same bits on any number of threads.
    let large =
        ClipScene { size: Size { width: 150, height: 130 }, ..tetrahedron([3.0, 3.0], 2.5, SIZE) };
    let bits = |threads: usize| -> Result<_, Failure> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        pool.install(|| Picture::new::<T>(&large))
    };
    let one = bits(1)?;
    wrong += usize::from(bits(2)? != one) + usize::from(bits(4)? != one) + one.wrong;
    Ok(Verdict::exactly(
        "-0.0 as +0, times 2^k and on any threads the same bits; no NaN masked",
        wrong,
    ))
}
