//! What a lens makes of surfaces in focus, at the eye, at infinity, and of pictures smaller than its circles.

use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    Background, Fragments, LensLayer, LensPicture, RenderError, Size, ThinLens, ThinLensOptions,
    composite, depth_layers, lens_picture, rasterize,
};

use crate::clip_scene::ClipScene;
use crate::extreme::{Extreme, Failure, Outcome, Verdict, extremes, keep_error};
use crate::measures::{difference, has_finite_gradients, motley, numbers, rounding, tensor};

pub(crate) static EXTREMES: &[Extreme] = extremes! {
    193 "a lens: all in focus", "the picture itself", in_focus;
    194 "a lens: distances 0 and infinity", "capped, counted; finite", at_the_eye;
    195 "a lens: aperture 0", "the operation is absent", aperture_zero;
    196 "a lens: one surface, however far", "brightness is kept", one_surface;
    197 "a lens: circles wider than it all", "its mean", larger_than_the_picture;
    198 "a lens: 1 pixel", "the pixel", one_pixel;
    199 "a lens: focus on an edge", "values and gradients are finite, sharp at the edge", focus_on_an_edge;
    200 "a lens: refused input", "an error", refused;
};

const SIZE: Size = Size { width: 9, height: 7 };

/// A triangle in front of another that fills the picture.
fn walls(size: Size) -> ClipScene {
    let mut clip = Vec::new();
    for (reach, z) in [(0.6, -0.5), (4.0, 0.0)] {
        let corners = [[-reach, -reach], [2.0 * reach, -reach], [-reach, 2.0 * reach]];
        clip.extend(corners.map(|[x, y]| [x, y, z, 1.0]));
    }
    ClipScene::new(&clip, &[[0, 1, 2], [3, 4, 5]], size)
}

/// What a lens, focused at 2, sees of layers.
struct LensView<'t, T: Scalar> {
    layers: Vec<Fragments<'t, T>>,
    /// Colours, alphas and distances.
    parts: Vec<[Var<'t, T>; 3]>,
    slopes: Vec<Option<Var<'t, T>>>,
    aperture: Var<'t, T>,
    focus: Var<'t, T>,
}

impl<'t, T: Scalar> LensView<'t, T> {
    /// Walls, the layers of which have these distances.
    fn new(
        tape: &'t Tape<T>,
        size: Size,
        aperture: f64,
        distance: impl Fn(usize, usize) -> f64,
        color: impl Fn(usize) -> f64,
    ) -> Result<Self, Failure> {
        let scene = walls(size);
        let layers = depth_layers(scene.leaf(tape), &scene.mesh()?, size, None)?;
        let mut parts = Vec::new();
        for (layer, fragments) in layers.iter().enumerate() {
            let count = fragments.coverage.count();
            let distances = tensor(&[count], |k| distance(layer, k));
            parts.push([
                tape.leaf(&tensor(&[count, 2], |k| color(k + 31 * layer))),
                tape.constant(&Tensor::full([count], T::ONE)),
                tape.leaf(&distances),
            ]);
        }
        let [aperture, focus] = [aperture, 2.0].map(|x| tape.leaf_scalar(T::from_f64(x)));
        let slopes = vec![None; layers.len()];
        Ok(Self { layers, parts, slopes, aperture, focus })
    }

    /// With distances that change from pixel to pixel by these numbers, in the order of the layers' fragments.
    fn with_slopes(mut self, slope: impl Fn(usize) -> f64) -> Self {
        for (fragments, slopes) in self.layers.iter().zip(&mut self.slopes) {
            let numbers = tensor(&[fragments.coverage.count(), 2], &slope);
            *slopes = Some(self.focus.tape().leaf(&numbers));
        }
        self
    }

    /// With other colours.
    fn with_colors(
        mut self,
        colors: impl Fn(&Fragments<'t, T>) -> Result<Var<'t, T>, Failure>,
    ) -> Result<Self, Failure> {
        for (fragments, parts) in self.layers.iter().zip(&mut self.parts) {
            parts[0] = colors(fragments)?;
        }
        Ok(self)
    }

    fn seen(
        &self,
        background: Background<'t, T>,
        options: &ThinLensOptions,
    ) -> Result<LensPicture<'t, T>, RenderError> {
        let mut layers = Vec::with_capacity(self.layers.len());
        let parts = self.parts.iter().zip(&self.slopes);
        for (fragments, (parts, &slope)) in self.layers.iter().zip(parts) {
            let [premultiplied, alpha, distance] = *parts;
            layers.push(LensLayer { fragments, premultiplied, alpha, distance, slope });
        }
        let lens = ThinLens { aperture: self.aperture, focus: self.focus };
        lens_picture(layers[0], &layers, background, f64::INFINITY, lens, options)
    }

    /// What is seen without a lens.
    fn sharp(&self) -> Result<Vec<f64>, Failure> {
        let picture = composite(self.parts[0][0], &self.layers[0], Background::Zero)?;
        Ok(numbers(&picture.image()?.value()))
    }

    fn has_finite_gradients(&self, out: Var<'t, T>) -> Result<bool, Failure> {
        let all = self.parts.iter().flat_map(|&[colors, _, distances]| [colors, distances]);
        let all =
            all.chain([self.aperture, self.focus]).chain(self.slopes.iter().copied().flatten());
        let all: Vec<_> = all.collect();
        has_finite_gradients(out, &all)
    }
}

fn in_focus<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let view = LensView::new(&tape, SIZE, 4.0, |_, _| 2.0, motley)?;
    let found = view.seen(Background::Zero, &ThinLensOptions::default())?;
    let error = difference(&numbers(&found.image.value()), &view.sharp()?);
    let finite = view.has_finite_gradients(found.image)?;
    Ok(Verdict::within("the picture without a lens", error, 4.0 * rounding::<T>())
        .and(finite && found.capped == 0, "a gradient is not finite, or something is capped"))
}

fn at_the_eye<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let far = [0.0, -0.0, 1e-40, 1e-6, 2.0, f64::INFINITY];
    let steep = [0.0, 0.3, -2.0, f64::INFINITY, f64::NEG_INFINITY, 1e30, -1e-9];
    let view = LensView::new(&tape, SIZE, 4.0, |layer, k| far[(k + layer) % 6], |_| 0.5)?;
    let view = view.with_slopes(|k| steep[k % 7]);
    // As large as the circle at infinity, which is not cut.
    let options = ThinLensOptions { largest_radius: 4.0, ..ThinLensOptions::default() };
    let sky = Background::Color(tape.leaf(&Tensor::full([2], T::from_f64(0.5))));
    let found = view.seen(sky, &options)?;
    let image = numbers(&found.image.value());
    let error = difference(&image, &vec![0.5; image.len()]);
    let counts = view.layers.iter().map(|layer| layer.coverage.count());
    let near = |(layer, count): (usize, usize)| (0..count).filter(|k| (k + layer) % 6 < 4).count();
    // In layers as they are listed, of which the first is there twice.
    let own: Vec<usize> = counts.enumerate().map(near).collect();
    let capped = own[0] + own.iter().sum::<usize>();
    Ok(Verdict::within("gray stays gray", error, 64.0 * rounding::<T>())
        .and(found.capped == capped, format!("{} of {capped} are counted", found.capped))
        .and(view.has_finite_gradients(found.image)?, "a gradient is not finite"))
}

fn aperture_zero<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let view = LensView::new(&tape, SIZE, 0.0, |_, k| 0.3 * k as f64, motley)?;
    let found = view.seen(Background::Zero, &ThinLensOptions::default())?;
    let error = difference(&numbers(&found.image.value()), &view.sharp()?);
    let margin = ThinLensOptions { margin: 2, ..ThinLensOptions::default() };
    let cut = view.seen(Background::Zero, &margin)?.image;
    Ok(Verdict::within("the picture without a lens, to the bit", error, 0.0)
        .and(*cut.shape() == [3, 5, 2], format!("its shape without a margin is {}", cut.shape()))
        .and(!format!("{:?}", tape.take_report()).contains("lens_picture"), "it is recorded"))
}

fn one_surface<T: Scalar>() -> Outcome {
    let mut error = 0.0_f64;
    for z in [0.5, 1.0, 1.9, 2.0, 2.1, 7.0, f64::INFINITY] {
        let tape = Tape::<T>::new();
        let size = Size { width: 49, height: 47 };
        // Light in the middle, from where no circle reaches the border.
        let view = LensView::new(&tape, size, 3.0, |_, _| z, |_| 1.0)?;
        let spot = tensor(&[size.pixels(), 2], |k| {
            let [row, column] = [k / 2 / size.width, k / 2 % size.width];
            let is_near = row.abs_diff(23) < 4 && column.abs_diff(24) < 4;
            if is_near { motley(k) } else { 0.0 }
        });
        let spot = tape.constant(&spot);
        let view = view.with_colors(|fragments| {
            let pixels = fragments.coverage.pixels().map(|pixel| pixel as u32);
            Ok(spot.gather_rows(&pixels.collect())?)
        })?;
        let found = view.seen(Background::Zero, &ThinLensOptions::default())?;
        let sum = |image: &[f64]| image.iter().sum::<f64>() / image.len() as f64;
        let kept = sum(&numbers(&found.image.value())) - sum(&view.sharp()?);
        error = error.maximum_or_nan(kept.abs());
    }
    Ok(Verdict::within("the sum of all pixels", error, 32.0 * rounding::<T>()))
}

fn larger_than_the_picture<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let view = LensView::new(&tape, SIZE, 600.0, |_, _| f64::INFINITY, motley)?;
    let options = ThinLensOptions { largest_radius: 300.0, ..ThinLensOptions::default() };
    let found = view.seen(Background::Zero, &options)?;
    let image = numbers(&found.image.value());
    let sharp = view.sharp()?;
    let mean = |c: usize| sharp.iter().skip(c).step_by(2).sum::<f64>() / SIZE.pixels() as f64;
    let means = [mean(0), mean(1)];
    let error = difference(&image, &means.repeat(SIZE.pixels()));
    let capped = 2 * view.layers[0].coverage.count() + view.layers[1].coverage.count();
    Ok(Verdict::within("the mean of the picture", error, 2e-3)
        .and(found.capped == capped, format!("{} of {capped} are counted", found.capped)))
}

fn one_pixel<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let view = LensView::new(&tape, Size::square(1), 9.0, |_, _| 7.0, motley)?;
    let found = view.seen(Background::Zero, &ThinLensOptions::default())?;
    let error = difference(&numbers(&found.image.value()), &view.sharp()?);
    Ok(Verdict::within("the pixel", error, 64.0 * rounding::<T>())
        .and(view.has_finite_gradients(found.image)?, "a gradient is not finite"))
}

/// A wall whose distance is that of the focus along a line of pixels, and steps from one side of it to the other
/// between its layers.
fn focus_on_an_edge<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let size = Size::square(15);
    let scene = ClipScene::new(
        &[[-4.0, -4.0], [8.0, -4.0], [-4.0, 8.0]].map(|[x, y]| [x, y, 0.0, 1.0]),
        &[[0, 1, 2]],
        size,
    );
    let fragments = rasterize(scene.leaf(&tape), &scene.mesh()?, size)?;
    let rows: Vec<_> = fragments.coverage.pixels().map(|pixel| pixel / size.width).collect();
    let count = rows.len();
    let distances = tape.leaf(&tensor(&[count], |k| 2.0 + 0.05 * (rows[k] as f64 - 7.0)));
    let colors = tape.leaf(&tensor(&[count, 2], motley));
    let alpha = tape.leaf(&tensor(&[count], |_| 1.0));
    let slope = Some(tape.leaf(&tensor(&[count, 2], |k| if k % 2 == 1 { 0.05 } else { 0.0 })));
    let (fragments, premultiplied, distance) = (&fragments, colors, distances);
    let layer = LensLayer { fragments, premultiplied, alpha, distance, slope };
    let [aperture, focus] = [4.0, 2.0].map(|x| tape.leaf_scalar(T::from_f64(x)));
    let lens = ThinLens { aperture, focus };
    let options = ThinLensOptions::default();
    let found = lens_picture(layer, &[], Background::Zero, f64::INFINITY, lens, &options)?;
    let image = numbers(&found.image.value());
    let sharp = numbers(&composite(colors, fragments, Background::Zero)?.image()?.value());
    let edge = 2 * size.width * 7..2 * size.width * 8;
    let error = difference(&image[edge.clone()], &sharp[edge]);
    let all = [colors, alpha, distances, aperture, focus].into_iter().chain(slope);
    let finite = has_finite_gradients(found.image, &all.collect::<Vec<_>>())?;
    // Rows a pixel away have circles of a tenth of a pixel, which hardly reach it.
    Ok(Verdict::within("the picture at the edge", error, 4e-3)
        .and(finite, "a gradient is not finite"))
}

fn refused<T: Scalar>() -> Outcome {
    let tape = Tape::<T>::new();
    let view = LensView::new(&tape, SIZE, 1.0, |_, _| 1.0, motley)?;
    let by = |options| keep_error(view.seen(Background::Zero, &options));
    let plain = ThinLensOptions::default();
    let mut results = vec![(
        by(ThinLensOptions { margin: 4, ..plain }),
        "lens_picture needs a margin of less than half of 7 pixels, got 4".to_owned(),
    )];
    for largest_radius in [-1.0, 1025.0, f64::NAN] {
        let rule = "a largest radius from 0 to 1024 pixels";
        results.push((
            by(ThinLensOptions { largest_radius, ..plain }),
            format!("lens_picture needs {rule}, got {largest_radius}"),
        ));
    }
    let mut wrong = LensView::new(&tape, SIZE, 1.0, |_, _| 1.0, motley)?;
    wrong.layers.swap(0, 1);
    wrong.parts.swap(0, 1);
    let is_alone = |&pixel: &usize| view.layers[1].coverage.fragment_at(pixel).is_none();
    let alone = view.layers[0].coverage.pixels().find(is_alone).ok_or("the layers are alike")?;
    results.push((
        keep_error(wrong.seen(Background::Zero, &plain)),
        format!(
            "layers need to follow each other from the front, got layer 1 at pixel {alone}, where \
             layer 0 is not"
        ),
    ));
    for (focus, rule) in
        [(0.0, "a finite and positive focus"), (f64::NAN, "a finite and positive focus")]
    {
        wrong.focus = tape.leaf_scalar(T::from_f64(focus));
        let message = format!("lens_picture needs {rule}, got {focus}");
        results.push((keep_error(wrong.seen(Background::Zero, &plain)), message));
    }
    Ok(Verdict::refused(results))
}
