//! The same extremes with exact coverage: against a sweep (`areas`), by hand, or by what is alike.

use bokashi_core::{Scalar, Tape, Tensor};
use bokashi_render_ops::{
    Background, Coverage, Cull, Fragments, Mesh, RasterOptions, Sampling, Size, antialias, depth,
    interpolate, layer, rasterize, resolve,
};

use super::row::{Failure, Found, Outcome, told};
use super::scene::{BACKGROUND, Scene, difference, largest, motley, numbers, orders, rounding};
use crate::visible_areas;

fn options(size: Size) -> RasterOptions {
    RasterOptions { sampling: Sampling::Exact, ..size.into() }
}

/// How much of each pixel each face covers, from fragments and weights: `[H W, F]`.
fn areas<T: Scalar>(fragments: &Fragments<'_, T>) -> Vec<f64> {
    let coverage = &fragments.coverage;
    let weights = fragments.weight.map_or_else(Vec::new, |weight| numbers(&weight.value()));
    let count = coverage.mesh().faces().len();
    let mut areas = vec![0.0; coverage.size().pixels() * count];
    for (n, (pixel, face)) in coverage.pixels().zip(coverage.faces()).enumerate() {
        areas[pixel * count + face] +=
            n.checked_sub(coverage.centers()).map_or(1.0, |piece| weights[piece]);
    }
    areas
}

/// A picture with exact coverage, and the gradients of `sum u . image`.
#[derive(Debug, PartialEq)]
struct Picture {
    areas: Vec<f64>,
    image: Vec<f64>,
    clip_bar: Vec<f64>,
    color_bar: Vec<f64>,
    background_bar: Vec<f64>,
    /// How far areas and background are from a partition of the pixels.
    parts: f64,
    crowded: usize,
    /// How many faces were not drawn.
    culled: usize,
    /// Numbers that are not finite, and pictures that a layer makes otherwise.
    wrong: usize,
}

impl Picture {
    fn of<T: Scalar>(scene: &Scene) -> Result<Self, Failure> {
        Self::with::<T>(scene, scene.mesh()?, options(scene.size), |k| motley(3 * k + 1))
    }

    fn with<T: Scalar>(
        scene: &Scene,
        mesh: Mesh,
        options: RasterOptions,
        upstream: impl Fn(usize) -> f64,
    ) -> Result<Self, Failure> {
        let tape = Tape::<T>::new();
        let clip = scene.leaf(&tape);
        let number = |k: usize| T::from_f64(motley(k));
        // The last channel is 1 on all faces and 0 behind them: the share that they cover.
        let color = |k: usize| if k % 3 == 2 { T::ONE } else { number(k) };
        let colors = tape.leaf(&Tensor::from_fn([scene.clip.len(), 3], color));
        let behind = [BACKGROUND[0], BACKGROUND[1], 0.0];
        let behind = tape.leaf(&Tensor::from_fn([3], |k| T::from_f64(behind[k])));
        let fragments = rasterize(clip, &mesh, options)?;
        let surface = interpolate(colors, &fragments)?;
        let background = Background::Color(behind);
        let image = resolve(surface, &fragments, background)?;
        let of_layer = layer(surface, &fragments, background)?.image()?;
        let upstream = Tensor::from_fn(image.shape(), |k| T::from_f64(upstream(k)));
        let gradients = tape.vjp(&[(image, &upstream)])?;
        let gradient = |leaf| numbers(&gradients.get_or_zeros(leaf));

        let (areas, faces) = (areas(&fragments), mesh.faces().len());
        let pixels = numbers(&image.value());
        let mut parts = 0.0_f64;
        for (pixel, values) in pixels.chunks_exact(3).enumerate() {
            let own = &areas[pixel * faces..][..faces];
            let covered: f64 = own.iter().sum();
            parts = parts.greater((covered - values[2]).abs()).greater(covered - 1.0);
            parts = own.iter().fold(parts, |parts, &area| parts.greater(-area));
        }
        let [clip_bar, color_bar, background_bar] = [clip, colors, behind].map(gradient);
        let all = [&pixels, &clip_bar, &color_bar, &background_bar];
        let wrong = all.iter().flat_map(|all| all.iter()).filter(|entry| !entry.is_finite());
        let coverage: &Coverage = &fragments.coverage;
        let culled = coverage.culled();
        Ok(Self {
            parts,
            crowded: coverage.boundary_counts().crowded,
            culled: culled.degenerate + culled.outside + culled.facing,
            wrong: wrong.count() + usize::from(of_layer.value() != image.value()),
            areas,
            image: pixels,
            clip_bar,
            color_bar,
            background_bar,
        })
    }

    /// The share of each pixel that some face covers.
    fn covered(&self) -> Vec<f64> {
        self.image.iter().skip(2).step_by(3).copied().collect()
    }
}

/// What may be missing to 1 in a pixel.
fn parts_bound<T: Scalar>() -> f64 {
    if rounding::<T>() > 1e-10 { 1e-6 } else { 1e-12 }
}

/// What is found of some scenes.
#[derive(Debug, Default)]
struct Checked {
    /// The largest difference of an area from that of the sweep.
    error: f64,
    /// The largest difference of a gradient of areas from the sweep's difference quotient, as a share
    /// of the scene's largest one.
    slope: f64,
    parts: f64,
    wrong: usize,
    crowded: usize,
    /// Pixels that are neither empty nor full.
    partial: usize,
}

impl Checked {
    /// Takes in a scene, whose gradients are those of difference quotients if it is `smooth`.
    fn add<T: Scalar>(&mut self, scene: &Scene, smooth: bool) -> Result<(), Failure> {
        let rounded = scene.clip.iter().map(|p| p.map(|c| T::from_f64(c).to_f64())).collect();
        let scene = Scene { clip: rounded, ..scene.clone() };
        let picture = Picture::of::<T>(&scene)?;
        let width = scene.size.width;
        let swept = |clip: &[[f64; 4]], pixel: usize| {
            visible_areas(clip, &scene.faces, scene.size, [pixel % width, pixel / width])
        };
        let faces = scene.faces.len();
        let mut boundary = Vec::new();
        for (pixel, found) in picture.areas.chunks_exact(faces).enumerate() {
            let expected = swept(&scene.clip, pixel);
            self.error = self.error.greater(difference(found, &expected));
            if expected.iter().any(|&area| 0.0 < area && area < 1.0) {
                boundary.push(pixel);
            }
        }
        self.partial += boundary.len();
        self.parts = self.parts.greater(picture.parts);
        self.wrong += picture.wrong;
        self.crowded += picture.crowded;
        if !smooth {
            return Ok(());
        }
        let found = area_gradient::<T>(&scene)?;
        let most = largest(found.iter().copied()).greater(1e-3);
        for (k, found) in found.into_iter().enumerate() {
            let step = 1e-6 * (1.0 + scene.clip[k / 4][k % 4].abs());
            let loss = |sign: f64| -> f64 {
                let mut clip = scene.clip.clone();
                clip[k / 4][k % 4] += sign * step;
                let areas = boundary.iter().map(|&pixel| (pixel, swept(&clip, pixel)));
                let terms = areas.flat_map(|(pixel, areas)| {
                    let terms = areas.into_iter().enumerate();
                    terms.map(move |(face, area)| motley(pixel * faces + face) * area)
                });
                terms.sum()
            };
            let quotient = (loss(1.0) - loss(-1.0)) / (2.0 * step);
            self.slope = self.slope.greater((found - quotient).abs() / most);
        }
        Ok(())
    }

    /// Areas within `bound`, or the rounding of `T` where that is more.
    fn found<T: Scalar>(self, outcome: &str, bound: f64) -> Found {
        let Self { error, slope, parts, wrong, partial, .. } = self;
        let outcome = format!("{partial} boundary pixels, {outcome}");
        // Difference quotients are off by 1e-6 where an area's second derivative leaps.
        let steep = 64.0 * rounding::<T>() + 1e-5;
        Found::within(outcome, error, bound.max(2.0 * rounding::<T>()))
            .and(parts <= parts_bound::<T>(), format!("parts are off 1 by {parts:.1e}"))
            .and(slope <= steep, format!("a gradient is off by {slope:.1e} of the largest"))
            .and(wrong == 0, format!("{wrong} numbers are not finite, or a layer differs"))
            .and(partial > 0, "no pixel is covered in part")
    }
}

/// The gradient of motley sums of areas with respect to the clip positions.
fn area_gradient<T: Scalar>(scene: &Scene) -> Result<Vec<f64>, Failure> {
    let tape = Tape::<T>::new();
    let clip = scene.leaf(&tape);
    let fragments = rasterize(clip, &scene.mesh()?, options(scene.size))?;
    let weight = fragments.weight.ok_or("exact coverage has weights")?;
    let coverage = &fragments.coverage;
    let places: Vec<_> = coverage.pixels().zip(coverage.faces()).skip(coverage.centers()).collect();
    let count = scene.faces.len();
    let entry = |k: usize| T::from_f64(motley(places[k].0 * count + places[k].1));
    let upstream = Tensor::from_fn(weight.shape(), entry);
    Ok(numbers(&tape.vjp(&[(weight, &upstream)])?.get_or_zeros(clip)))
}

/// Faces in pixels with a depth each.
fn at_depths(faces: &[([[f64; 2]; 3], f64)], size: Size) -> Scene {
    let points: Vec<_> = faces.iter().flat_map(|(corners, _)| *corners).collect();
    let indices: Vec<_> = (0..faces.len() as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    let mut scene = Scene::of_px(&points, &indices, size);
    for (vertex, place) in scene.clip.iter_mut().enumerate() {
        place[2] = faces[vertex / 3].1;
    }
    scene
}

const SIZE: Size = Size { width: 7, height: 6 };

pub(super) fn nothing<T: Scalar>() -> Outcome {
    let front = [[-0.7, -0.6, 0.0, 1.0], [0.6, -0.5, 0.0, 0.4], [0.2, 0.9, 0.0, 1.0]];
    let line = [[-0.5, -0.5, 0.0, 1.0], [0.25, 0.25, 0.0, 1.0], [0.5, 0.5, 0.0, 1.0]];
    let scenes = [
        Scene::new(&front, &[], SIZE),
        Scene::new(&[], &[], SIZE),
        Scene::new(&front, &[[0, 1, 1], [2, 2, 2]], SIZE),
        Scene::new(&line, &[[0, 1, 2], [2, 1, 0]], SIZE),
        Scene::new(&front.map(|[x, y, z, w]| [x, y, z, -w]), &[[0, 1, 2]], SIZE),
        Scene::new(&front.map(|[x, y, _, w]| [x, y, 1.5 * w, w]), &[[0, 1, 2]], SIZE),
        Scene::new(&front.map(|[x, y, z, w]| [x + 9.0, y, z, w]), &[[0, 1, 2]], SIZE),
    ];
    let mut wrong = 0;
    for scene in scenes {
        let picture = Picture::of::<T>(&scene)?;
        let behind = [BACKGROUND[0], BACKGROUND[1], 0.0];
        let others = picture.image.chunks_exact(3).filter(|pixel| **pixel != behind);
        let bars = picture.clip_bar.iter().chain(&picture.color_bar);
        wrong += others.count() + bars.filter(|&&bar| bar != 0.0).count() + picture.wrong;
        wrong += picture.culled.abs_diff(scene.faces.len());
    }
    Ok(Found::exactly("the background, zero gradients, each face counted", wrong))
}

pub(super) fn refused<T: Scalar>() -> Outcome {
    let clip = [[-0.7, -0.6, 0.0, 1.0], [0.6, -0.5, 0.0, 0.4], [0.2, 0.9, 0.0, 1.0]];
    let scene = Scene::new(&clip, &[[0, 1, 2]], SIZE);
    let tape = Tape::<T>::new();
    let positions = scene.leaf(&tape);
    let mut results = Vec::new();
    let empty = Size { width: 0, height: 5 };
    let rule = "an image needs at least one pixel and fewer than 2^32, got 0 x 5";
    results.push((told(rasterize(positions, &scene.mesh()?, options(empty))), rule.to_owned()));
    for bad in [f64::NAN, f64::INFINITY] {
        let mut scene = scene.clone();
        scene.clip[1][2] = bad;
        let [x, y, z, w] = scene.clip[1].map(|c| T::from_f64(c).to_f64());
        let message = format!("clip positions need to be finite, got ({x}, {y}, {z}, {w})");
        let said = told(Picture::of::<T>(&scene));
        results.push((said, format!("{message} at vertex 1")));
    }
    let fragments = rasterize(positions, &scene.mesh()?, options(SIZE))?;
    let image = tape.leaf(&Tensor::zeros([6, 7, 1]));
    let pixels = fragments.coverage.boundary_counts().pixels;
    let rule = "antialias needs one fragment per pixel";
    let message = format!("{rule}, got exact coverage with {pixels} boundary pixels");
    results.push((told(antialias(image, &fragments, positions)), message));
    Ok(Found::refused(results))
}

pub(super) fn behind_the_eye<T: Scalar>() -> Outcome {
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
            checked.add::<T>(&Scene::new(&clip, &[order], SIZE), true)?;
        }
    }
    Ok(checked.found::<T>("each with its area and slope", 1e-13))
}

pub(super) fn wide_range_of_w<T: Scalar>() -> Outcome {
    let face = [[-0.75, -0.875, 0.25], [0.9375, -0.625, -0.5], [0.0625, 0.9375, 0.125]];
    let weighted = |factors: [f64; 3]| -> Vec<[f64; 4]> {
        let place = |k: usize| [face[k][0], face[k][1], face[k][2], 1.0].map(|c| c * factors[k]);
        (0..3).map(place).collect()
    };
    let plain = Picture::of::<f64>(&Scene::new(&weighted([1.0; 3]), &[[0, 1, 2]], SIZE))?;
    let (mut error, mut wrong) = (0.0_f64, 0);
    for powers in [[-20, 0, 20], [20, -20, 0], [-20, 20, 20], [-126, 0, 0], [-126, -126, -126]] {
        let factors = powers.map(|power| f64::powi(2.0, power));
        let found = Picture::of::<T>(&Scene::new(&weighted(factors), &[[0, 1, 2]], SIZE))?;
        error = error.greater(difference(&found.areas, &plain.areas));
        // Gradients grow as 1 / w, and 2^126 is near the end of the range.
        wrong += if powers[0] > -30 { found.wrong } else { 0 };
        wrong += found.image.iter().filter(|entry| !entry.is_finite()).count();
    }
    Ok(Found::within("the areas of w = 1; finite", error, 4.0 * rounding::<T>())
        .and(wrong == 0, "a number is not finite"))
}

pub(super) fn ends_of_the_depth_range<T: Scalar>() -> Outcome {
    let mut checked = Checked::default();
    let steep = [[-1.1, -1.0, -2.1, 1.0], [3.0, -1.2, -2.0, 1.0], [-1.3, 3.0, 6.3, 1.0]];
    let eye = [[-0.9, -0.8, 0.9, 1.0], [0.8, -0.9, -2.0, 1.5], [0.1, 0.9, 0.3, 1.0]];
    for clip in [steep, eye] {
        for order in orders([0, 1, 2]) {
            checked.add::<T>(&Scene::new(&clip, &[order], SIZE), true)?;
        }
    }
    // All of the image, exactly in the near plane and in the far one.
    let (mut missing, mut wrong) = (0, 0);
    for end in [-1.0, 1.0] {
        let corners = [[-1.0, -1.0, 1.0], [3.0, -1.0, 1.0], [-2.0, 6.0, 2.0]];
        let clip = corners.map(|[x, y, w]| [x, y, end * w, w]);
        for order in orders([0, 1, 2]) {
            let picture = Picture::of::<T>(&Scene::new(&clip, &[order], SIZE))?;
            missing += picture.covered().iter().filter(|&&covered| covered != 1.0).count();
            wrong += picture.wrong;
        }
    }
    Ok(checked
        .found::<T>("the part within the range, with its slope; all in its planes", 1e-13)
        .and(missing == 0, format!("{missing} pixels in a plane are missing"))
        .and(wrong == 0, "a number is not finite"))
}

pub(super) fn slivers<T: Scalar>() -> Outcome {
    // 2^-23 px wide; from corner to corner; between pixel centres; none of them needs a centre.
    let half = f64::powi(2.0, -24) / 7.0 * 2.0;
    let narrow = [[-half, -0.875, 0.0, 1.0], [half, -0.875, 0.0, 1.0], [0.0, 0.875, 0.0, 1.0]];
    let mut checked = Checked::default();
    for order in orders([0, 1, 2]) {
        checked.add::<T>(&Scene::new(&narrow, &[order], SIZE), false)?;
        let points = [[0.4, 0.3], [6.6, 5.4], [6.6, 5.42]];
        checked.add::<T>(&Scene::of_px(&points, &[order], SIZE), true)?;
        let points = [[2.6, 3.6], [3.4, 3.6], [3.0, 4.4]];
        checked.add::<T>(&Scene::of_px(&points, &[order], SIZE), true)?;
    }
    let area = visible_areas(&narrow, &[[0, 1, 2]], SIZE, [3, 3])[0];
    let found = Picture::of::<T>(&Scene::new(&narrow, &[[0, 1, 2]], SIZE))?.covered()[3 * 7 + 3];
    let off = (found / area - 1.0).abs();
    Ok(checked
        .found::<T>("each sliver with its area", 1e-13)
        .and(off < 1e-6, format!("an area of {area:.1e} px is off by {off:.1e} of it")))
}

pub(super) fn on_pixel_borders<T: Scalar>() -> Outcome {
    // Sides along borders, corners on corners and on borders; of 8 x 8 pixels all is exact.
    let size = Size::square(8);
    let (mut checked, mut steps) = (Checked::default(), 0.0_f64);
    for points in [
        [[2.0, 1.0], [6.0, 1.0], [2.0, 5.0]],
        [[1.0, 4.0], [7.0, 4.0], [4.0, 7.0]],
        [[3.0, 2.0], [3.0, 6.0], [7.0, 4.0]],
        [[3.0, 2.5], [5.5, 6.0], [1.25, 5.0]],
        [[3.0, 3.0], [4.0, 3.0], [3.0, 4.0]],
    ] {
        for order in orders([0, 1, 2]) {
            let scene = Scene::of_px(&points, &[order], size);
            checked.add::<T>(&scene, false)?;
            // The whole area's slope, whichever pixels its sides are in: a side from p to q, moved
            // by the mean of its ends, covers q_y - p_y more. One along a border has no gradient.
            let is_area = |k: usize| f64::from(u8::from(k % 3 == 2));
            let found = Picture::with::<T>(&scene, scene.mesh()?, options(size), is_area)?;
            let along = |p: [f64; 2], q: [f64; 2]| p[0] == q[0] && p[0].fract() == 0.0;
            let side = |p: [f64; 2], q: [f64; 2]| if along(p, q) { 0.0 } else { q[1] - p[1] };
            let [a, b, c] = points;
            let turn = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
            for (k, [p, q, r]) in [[a, b, c], [b, c, a], [c, a, b]].into_iter().enumerate() {
                // Half of both, and 4 pixels to a unit of clip space.
                let expected = 2.0 * turn.signum() * (side(p, q) + side(r, p));
                steps = steps.greater((found.clip_bar[4 * k] - expected).abs());
            }
        }
    }
    Ok(checked
        .found::<T>("exact; all sides' slope but for those along a border", 8e-15)
        .and(steps <= 64.0 * rounding::<T>(), format!("a face's slope is off by {steps:.1e}")))
}

/// A fan of `count` faces around a point, in pixels, its corners on a circle.
fn fan(center: [f64; 2], radius: f64, count: u32, size: Size) -> Scene {
    let mut points = vec![center];
    points.extend((0..count).map(|k| {
        let (sin, cos) = (f64::from(k) / f64::from(count) * std::f64::consts::TAU).sin_cos();
        [center[0] + radius * cos, center[1] + radius * sin]
    }));
    let faces: Vec<_> =
        (0..count).map(|k| orders([0, 1 + k, 1 + (k + 1) % count])[k as usize % 6]).collect();
    Scene::of_px(&points, &faces, size)
}

pub(super) fn fans<T: Scalar>() -> Outcome {
    let size = Size::square(16);
    let (mut error, mut parts, mut wrong) = (0.0_f64, 0.0_f64, 0);
    for center in [[8.0, 8.0], [8.5, 8.5], [7.7, 8.3]] {
        for count in [3, 4, 5, 13, 64, 512] {
            let scene = fan(center, 6.3, count, size);
            let picture = Picture::of::<T>(&scene)?;
            let angle = std::f64::consts::TAU / f64::from(count);
            let area = 0.5 * f64::from(count) * 6.3 * 6.3 * angle.sin();
            let found: f64 = picture.covered().iter().sum();
            // Some 20 pixels of the rim hold up to 9 faces each of 64, but of 512 up to 50.
            error = error.greater((found / area - 1.0).abs());
            parts = parts.greater(picture.parts);
            wrong += picture.wrong + picture.crowded;
        }
    }
    // Corners are rounded to f32.
    Ok(Found::within("the polygon's area, each pixel covered once", error, 8.0 * rounding::<T>())
        .and(parts <= parts_bound::<T>(), format!("parts are off 1 by {parts:.1e}"))
        .and(wrong == 0, format!("{wrong} numbers not finite, or pixels crowded")))
}

pub(super) fn t_junction<T: Scalar>() -> Outcome {
    let size = Size::square(16);
    let (mut gap, mut parts, mut wrong) = (0.0_f64, 0.0_f64, 0);
    for share in (1..23).map(|k| f64::from(k) / 23.0) {
        let ends = [[0.5, 2.5], [15.3, 13.7]];
        let between = [0, 1].map(|axis| ends[0][axis] + share * (ends[1][axis] - ends[0][axis]));
        let beyond = |end: [f64; 2], x: f64, y: f64| [end[0] + x, end[1] + y];
        let [high, other_high] = [beyond(ends[0], -3.0, -40.0), beyond(ends[1], 3.0, -40.0)];
        let [low, other_low] = [beyond(ends[0], -3.0, 40.0), beyond(ends[1], 3.0, 40.0)];
        let points = [ends[0], ends[1], between, high, other_high, low, other_low];
        let faces = [[0, 1, 4], [0, 4, 3], [0, 2, 5], [2, 1, 6], [2, 6, 5]];
        let picture = Picture::of::<T>(&Scene::of_px(&points, &faces, size))?;
        let inner = |pixel: usize| (1..15).contains(&(pixel % 16));
        let covered = picture.covered();
        let gaps = covered.iter().enumerate().filter(|(pixel, _)| inner(*pixel));
        gap = gap.greater(largest(gaps.map(|(_, covered)| 1.0 - covered)));
        parts = parts.greater(picture.parts);
        wrong += picture.wrong;
    }
    // Positions of up to 1 are rounded, in units of 8 px.
    Ok(Found::within("a gap as wide as rounding", gap, 16.0 * rounding::<T>())
        .and(parts <= parts_bound::<T>(), format!("parts are off 1 by {parts:.1e}"))
        .and(wrong == 0, "a number is not finite"))
}

pub(super) fn far_away<T: Scalar>() -> Outcome {
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
                    let picture = Picture::of::<T>(&Scene::new(&clip, &[order], size))?;
                    for (pixel, found) in picture.covered().into_iter().enumerate() {
                        let above = (line - (pixel / 16) as f64).clamp(0.0, 1.0);
                        let expected = if sign > 0.0 { above } else { 1.0 - above };
                        error = error.greater((found - expected).abs());
                    }
                    parts = parts.greater(picture.parts);
                    wrong += picture.wrong;
                }
            }
        }
    }
    Ok(Found::within("half-planes and the whole image", error, 1e-13 + 2.0 * rounding::<T>())
        .and(parts <= parts_bound::<T>(), format!("parts are off 1 by {parts:.1e}"))
        .and(wrong == 0, format!("{wrong} numbers are not finite")))
}

pub(super) fn coplanar<T: Scalar>() -> Outcome {
    // Tilted planes, faces in all orders of their corners, over one another and side by side.
    let corners = [[0.9, 0.8], [6.2, 1.3], [3.1, 5.4], [5.7, 5.1]];
    let place = |[x, y]: [f64; 2]| {
        let [a, b, ..] = super::scene::at_px(SIZE, x, y);
        let w = 1.0 + 0.25 * a - 0.125 * b;
        [a * w, b * w, 0.3 * a * w + 0.2 * b * w + 0.125 * w, w]
    };
    let clip = corners.map(place);
    let alone = Picture::of::<T>(&Scene::new(&clip, &[[0, 1, 2]], SIZE))?.covered();
    let both = Picture::of::<T>(&Scene::new(&clip, &[[0, 1, 2], [1, 3, 2]], SIZE))?.covered();
    let (mut error, mut parts, mut wrong) = (0.0_f64, 0.0_f64, 0);
    for first in orders([0, 1, 2]) {
        for second in orders([0, 1, 2]) {
            let scene = Scene::new(&clip, &[first, second, first], SIZE);
            let picture = Picture::of::<T>(&scene)?;
            error = error.greater(difference(&picture.covered(), &alone));
            // In one plane to within rounding, which f32 positions are not.
            let later = picture.areas.chunks_exact(3).map(|areas| areas[1] + areas[2]);
            error = error.greater(largest(later));
            let scene = Scene::new(&clip, &[first, second, [1, 3, 2], [0, 3, 2], first], SIZE);
            let more = Picture::of::<T>(&scene)?;
            error = error.greater(largest(
                more.covered().iter().zip(&both).map(|(found, both)| both - found),
            ));
            parts = parts.greater(picture.parts).greater(more.parts);
            wrong += picture.wrong + more.wrong;
        }
    }
    Ok(Found::within("the lower index; what is covered, once", error, 8.0 * rounding::<T>())
        .and(parts <= parts_bound::<T>(), format!("parts are off 1 by {parts:.1e}"))
        .and(wrong == 0, "a number is not finite"))
}

/// Faces over the whole image with the depths `planes`: of 1, x and y in clip space.
fn planes(planes: &[[f64; 3]], size: Size) -> Scene {
    let corners = [[-3.0, -3.0], [9.0, -3.0], [-3.0, 9.0]];
    let clip: Vec<_> = planes
        .iter()
        .flat_map(|[one, x, y]| corners.map(|[a, b]| [a, b, one + x * a + y * b, 1.0]))
        .collect();
    let faces: Vec<_> = (0..planes.len() as u32).map(|k| [3 * k, 3 * k + 1, 3 * k + 2]).collect();
    Scene::new(&clip, &faces, size)
}

pub(super) fn crossing_faces<T: Scalar>() -> Outcome {
    let size = Size::square(4);
    let mut checked = Checked::default();
    // Along the diagonal through pixels' corners; along their borders; through one line, in fives and
    // threes; anywhere.
    for (scene, smooth) in [
        (planes(&[[0.0, 0.125, 0.125], [0.0, -0.125, -0.125]], size), false),
        (planes(&[[0.0, 0.125, 0.0], [0.0, -0.125, 0.0]], size), false),
        (planes(&[[0.0, 0.125, 0.0625], [0.0; 3], [0.0, -0.125, -0.0625]], size), false),
        (
            planes(&[[0.1, 0.05, 0.02], [0.0; 3], [-0.1, -0.05, -0.02], [0.2, 0.1, 0.04]], size),
            false,
        ),
        (planes(&[[0.011, 0.07, 0.03], [-0.02, 0.013, -0.06], [0.005, -0.06, 0.02]], size), true),
    ] {
        checked.add::<T>(&scene, smooth)?;
    }
    Ok(checked.found::<T>("each face up to the line, with its slope", 1e-9))
}

pub(super) fn crowded<T: Scalar>() -> Outcome {
    // Strips behind one another within a pixel, each a little wider, and a face over its neighbours.
    let size = Size { width: 4, height: 3 };
    const STRIPS: usize = 2_100;
    let mut faces: Vec<_> = (0..STRIPS)
        .map(|k| {
            let share = k as f64 / STRIPS as f64;
            let right = 1.05 + 0.9 * share;
            let corners = [[1.02, 1.1], [right, 1.1], [1.02, 1.9]];
            (corners, -0.5 + share)
        })
        .collect();
    faces.push(([[0.3, 0.2], [3.8, 0.4], [2.9, 2.7]], 0.75));
    let scene = at_depths(&faces, size);
    let picture = Picture::of::<T>(&scene)?;
    let (mut exact, mut sampled, mut inside) = (0.0_f64, 0.0_f64, 0.0_f64);
    for (pixel, found) in picture.covered().into_iter().enumerate() {
        let swept =
            visible_areas(&scene.clip, &scene.faces[STRIPS - 1..], size, [pixel % 4, pixel / 4]);
        let off = (found - swept.iter().sum::<f64>()).abs();
        if pixel == 5 {
            (sampled, inside) = (off, found);
        } else {
            exact = exact.greater(off);
        }
    }
    Ok(Found::within("sampled there alone, exact beside it", exact, 16.0 * rounding::<T>())
        .and(picture.crowded == 1, format!("{} pixels are crowded", picture.crowded))
        .and(sampled < 0.04 && inside > 0.3, format!("the samples are off by {sampled:.1e}"))
        .and(picture.parts <= parts_bound::<T>(), "parts are off 1")
        .and(picture.wrong == 0, "a number is not finite"))
}

/// How many faces lie over one pixel.
const MANY: usize = 1_000_000;

pub(super) fn many_faces_in_a_pixel<T: Scalar>() -> Outcome {
    // As without exact coverage: all share an edge, and the depth of their third vertex decides.
    let depth_of = |k: usize| ((k * 7919 + 13) % MANY) as f64 / f64::powi(2.0, 20);
    let clip = |k: usize| match k {
        0 => [-0.25, -0.25, 0.0, 1.0],
        1 => [0.25, -0.25, 0.0, 1.0],
        k => [0.0, 0.25, depth_of(k - 2), 1.0],
    };
    let tape = Tape::<T>::new();
    let positions = tape.leaf(&Tensor::from_fn([MANY + 2, 4], |k| T::from_f64(clip(k / 4)[k % 4])));
    let faces = (0..MANY as u32).map(|k| [0, 1, k + 2]).collect();
    let mesh = Mesh::new(faces, MANY + 2)?;
    let fragments = rasterize(positions, &mesh, options(Size::square(3)))?;
    let weight = fragments.weight.ok_or("exact coverage has weights")?;
    let nearest = (0..MANY).min_by(|&a, &b| depth_of(a).total_cmp(&depth_of(b))).unwrap_or(0);
    let coverage = &fragments.coverage;
    let wrong = coverage.faces().filter(|&face| face != nearest).count();
    // 3/4 by 3/4 of the pixel, halved.
    let error = (numbers(&weight.value()).iter().sum::<f64>() - 0.28125).abs();
    let seen = depth(&fragments)?;
    let bars = (seen.sum() + weight.sum()).backward()?.get_or_zeros(positions);
    Ok(Found::within("the nearest alone, sampled; finite gradients", error, 0.04)
        .and(wrong == 0 && coverage.count() == 1, format!("{wrong} other faces are seen"))
        .and(coverage.boundary_counts().crowded == 1, "the pixel is not sampled")
        .and(bars.is_finite(), "a gradient is not finite"))
}

/// A tetrahedron around a point in pixels.
fn tetrahedron([x, y]: [f64; 2], radius: f64, size: Size) -> Scene {
    let corners = [[1.0, 0.1, -0.2], [-0.6, 0.9, 0.3], [-0.5, -0.8, 0.1], [0.1, 0.05, 0.9]];
    let points = corners.map(|[a, b, _]| [x + radius * a, y + radius * b]);
    let faces = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]];
    let mut scene = Scene::of_px(&points, &faces, size);
    for (place, corner) in scene.clip.iter_mut().zip(corners) {
        place[2] = 0.5 * corner[2];
    }
    scene
}

pub(super) fn smaller_than_a_pixel<T: Scalar>() -> Outcome {
    let mut checked = Checked::default();
    for radius in [0.4, 0.1] {
        // Within a pixel, beside its centre; over a border.
        for center in [[3.45, 2.55], [3.03, 2.6], [2.98, 3.01]] {
            checked.add::<T>(&tetrahedron(center, radius, SIZE), true)?;
        }
    }
    Ok(checked.found::<T>("each closed mesh with its area and slope", 1e-12))
}

pub(super) fn turning_edge_on<T: Scalar>() -> Outcome {
    let mut checked = Checked::default();
    for power in [4, 10, 20, 40, 60, 1000] {
        let flat = 3.0 * f64::powi(2.0, -power);
        let points = [[1.2, 2.25], [5.7, 2.25], [3.3, 2.25 + flat]];
        checked.add::<T>(&Scene::of_px(&points, &[[0, 1, 2]], SIZE), power < 12)?;
        // Into the depth.
        let mut deep = Scene::of_px(&points, &[[0, 1, 2]], SIZE);
        deep.clip[2][2] = 0.9;
        checked.add::<T>(&deep, power < 12)?;
    }
    Ok(checked.found::<T>("areas down to 0; finite gradients", 1e-13))
}

pub(super) fn seams_everywhere<T: Scalar>() -> Outcome {
    // Of w = 1 colours are linear, so that it does not matter where a pixel is cut.
    let mut scenes = vec![fan([3.4, 3.2], 2.6, 7, SIZE), tetrahedron([3.3, 2.8], 2.9, SIZE)];
    scenes.push(fan([3.5, 3.5], 2.5, 5, SIZE));
    let (mut error, mut parts, mut wrong) = (0.0_f64, 0.0_f64, 0);
    for scene in scenes {
        let plain = Picture::of::<T>(&scene)?;
        let mesh = scene.mesh()?.with_seams(|_, _| true);
        let cut = Picture::with::<T>(&scene, mesh, options(scene.size), |k| motley(3 * k + 1))?;
        error = error.greater(difference(&cut.covered(), &plain.covered()));
        // What a pixel without a boundary shows at its centre is no mean where faces meet in it.
        let is_cut = |pixel: &usize| {
            let count = scene.faces.len();
            cut.areas[pixel * count..][..count].iter().filter(|&&area| area > 0.0).count() > 1
        };
        for pixel in (0..scene.size.pixels()).filter(|pixel| !is_cut(pixel)) {
            let own = 3 * pixel..3 * pixel + 3;
            error = error.greater(difference(&cut.image[own.clone()], &plain.image[own]));
        }
        parts = parts.greater(cut.parts);
        wrong += cut.wrong + cut.crowded;
    }
    Ok(Found::within("what is covered stays", error, 16.0 * rounding::<T>())
        .and(parts <= parts_bound::<T>(), format!("parts are off 1 by {parts:.1e}"))
        .and(wrong == 0, "a number is not finite"))
}

pub(super) fn strips_and_single_pixels<T: Scalar>() -> Outcome {
    let mut checked = Checked::default();
    for (width, height) in [(1, 1), (16, 1), (1, 16), (2, 1), (70, 1), (1, 70)] {
        let (w, h) = (width as f64, height as f64);
        for order in orders([0, 1, 2]) {
            let points = [[-0.47 * w, -h], [1.1 * w, 0.63 * h], [0.27 * w, 1.7 * h]];
            checked.add::<T>(&Scene::of_px(&points, &[order], Size { width, height }), true)?;
        }
    }
    Ok(checked.found::<T>("each with its area and slope", 1e-13))
}

pub(super) fn upstream_and_bits<T: Scalar>() -> Outcome {
    let zero = |zero: f64| {
        let clip = [[zero, zero, zero, 1.0], [0.9, zero, zero, 1.0], [zero, 0.9, zero, 1.0]];
        Scene::new(&clip, &[[0, 1, 2]], SIZE)
    };
    let mut wrong = usize::from(Picture::of::<T>(&zero(0.0))? != Picture::of::<T>(&zero(-0.0))?);
    // Times a power of two; times one that makes coordinates subnormal.
    let unit = [[-60.0, -50.0, 3.0, 64.0], [61.0, -40.0, -5.0, 64.0], [3.0, 55.0, 7.0, 48.0]];
    let least =
        if rounding::<T>() > 1e-10 { f64::from(f32::from_bits(1)) } else { f64::from_bits(1) };
    let image = |size: f64| {
        let scene = Scene::new(&unit.map(|p| p.map(|c| c * size)), &[[0, 1, 2]], SIZE);
        Picture::of::<T>(&scene).map(|picture| (picture.image, picture.areas))
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
        Scene { size: Size { width: 150, height: 130 }, ..tetrahedron([3.0, 3.0], 2.5, SIZE) };
    let bits = |threads: usize| -> Result<_, Failure> {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
        pool.install(|| Picture::of::<T>(&large))
    };
    let one = bits(1)?;
    wrong += usize::from(bits(2)? != one) + usize::from(bits(4)? != one) + one.wrong;
    Ok(Found::exactly(
        "-0.0 as +0, times 2^k and on any threads the same bits; no NaN masked",
        wrong,
    ))
}

pub(super) fn sides_and_edges<T: Scalar>() -> Outcome {
    let corners = [[0.9, 0.8], [6.2, 1.3], [3.1, 5.4], [5.9, 5.5]];
    let quad = Scene::of_px(&corners, &[[0, 2, 1], [1, 2, 3]], SIZE);
    let whole = Picture::of::<T>(&quad)?;
    let (mut error, mut wrong) = (0.0_f64, whole.wrong);
    // Back faces by flag.
    for (cull, is_drawn) in [(Cull::Back, true), (Cull::Front, false)] {
        let options = RasterOptions { cull, ..options(SIZE) };
        let found = Picture::with::<T>(&quad, quad.mesh()?, options, |k| motley(3 * k + 1))?;
        wrong += usize::from((found.culled == 0) != is_drawn);
        wrong += usize::from(is_drawn && found != whole);
        wrong += found.covered().iter().filter(|&&covered| !is_drawn && covered != 0.0).count();
    }
    // Vertices of their own at the inner edge; a third face at it, behind the others.
    let mut split = quad.clone();
    split.clip.extend([quad.clip[1], quad.clip[2]]);
    split.faces = vec![[0, 2, 1], [4, 5, 3]];
    let mut three = quad.clone();
    let [x, y, ..] = super::scene::at_px(SIZE, 3.5, 2.5);
    three.clip.push([x, y, 0.5, 1.0]);
    three.faces.push([1, 2, 4]);
    for scene in [split, three] {
        let found = Picture::of::<T>(&scene)?;
        error = error.greater(difference(&found.covered(), &whole.covered()));
        error = error.greater(found.parts);
        wrong += found.wrong;
    }
    Ok(Found::within(
        "by flag; edges of one or three faces hide nothing",
        error,
        parts_bound::<T>(),
    )
    .and(wrong == 0, format!("{wrong} things are wrong")))
}
