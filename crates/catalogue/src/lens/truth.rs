//! What a lens sees: the mean of what its points see.

use std::f64::consts::PI;
use std::ops::Range;

use bokashi_core::parallel::merge_ranges;
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{Background, RenderError, ThinLens, composite, rasterize};

use super::scene::{Frame, LensScene, look, sky};

/// Point `k` of `count` that share the unit disc evenly, on a spiral turned by `turn`.
pub fn point(k: usize, count: usize, turn: f64) -> [f64; 2] {
    let radius = ((k as f64 + 0.5) / count as f64).sqrt();
    let angle = turn + k as f64 * PI * (3.0 - 5.0_f64.sqrt());
    [radius * angle.cos(), radius * angle.sin()]
}

/// What the point `[p_x, p_y]` of the unit disc sees of clip positions through the lens: `[H, W, 2]`.
///
/// # Errors
/// What the operations refuse.
pub fn through<'t, T: Scalar>(
    scene: &LensScene,
    frame: Frame,
    clip: Var<'t, T>,
    lens: ThinLens<'t, T>,
    point: [f64; 2],
) -> Result<Var<'t, T>, RenderError> {
    let (tape, size) = (clip.tape(), frame.size());
    // A lens point moves what is `w` away by its circle of confusion times w in clip space.
    let unit = T::from_f64(2.0 / size.width as f64);
    let row = [point[0], point[1], 0.0, 0.0].map(T::from_f64).to_vec();
    let row = tape.constant(&Tensor::new([1, 4], row)?);
    let shift = (clip.slice(1, 3..4)? - lens.focus) * (lens.aperture * unit);
    pinhole(scene, frame, clip - shift.matmul(row)?)
}

/// What a pinhole sees: `[H, W, 2]`, silhouettes by exact coverage.
///
/// # Errors
/// What the operations refuse.
pub fn pinhole<'t, T: Scalar>(
    scene: &LensScene,
    frame: Frame,
    clip: Var<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    let tape = clip.tape();
    let attributes = scene.attributes(tape);
    let options = scene.exact(frame.size());
    let (solid, pane) = scene.parts()?;
    let draw = |mesh, background| -> Result<_, RenderError> {
        let fragments = rasterize(clip, mesh, options.creases(&[attributes.into()]))?;
        let [colors, _] = look(attributes, &fragments)?;
        composite(colors, &fragments, background)?.image()
    };
    let image = draw(&solid, Background::Color(sky(tape)))?;
    let Some((pane, alpha)) = pane else { return Ok(image) };
    let hidden = draw(&pane, Background::Image(image))?;
    let [clear, alpha] = [1.0 - alpha, alpha].map(T::from_f64);
    Ok(image * clear + hidden * alpha)
}

/// The mean of what points `points` of `count` see, on a spiral turned by `turn`; `numbers` are the aperture, in
/// pixels of the picture, and the focus.
///
/// # Errors
/// What the operations refuse.
pub fn mean_through<T: Scalar>(
    scene: &LensScene,
    frame: Frame,
    numbers: [f64; 2],
    count: usize,
    turn: f64,
) -> Result<Tensor<T>, RenderError> {
    const AT_ONCE: usize = 8;
    let sum_of = |views: Range<usize>| -> Result<Vec<T::Wide>, RenderError> {
        let mut sum = Vec::new();
        let mut tape = Tape::<T>::new();
        for k in views {
            tape.reset();
            let clip = tape.constant(&scene.clip(frame));
            let [aperture, focus] = numbers.map(|number| tape.constant_scalar(T::from_f64(number)));
            let lens = ThinLens { aperture, focus };
            let image = through(scene, frame, clip, lens, point(k, count, turn))?.value();
            sum.resize(image.data().len(), T::Wide::ZERO);
            sum.iter_mut().zip(image.data()).for_each(|(sum, &entry)| *sum += entry.widen());
        }
        Ok(sum)
    };
    let mut mean = vec![T::Wide::ZERO; 2 * frame.size().pixels()];
    let mut fault = Ok(());
    merge_ranges(count, AT_ONCE, sum_of, |sum| match sum {
        Ok(sum) => mean.iter_mut().zip(sum).for_each(|(mean, entry)| *mean += entry),
        Err(error) => fault = Err(error),
    });
    fault?;
    let share = T::Wide::from_f64((count as f64).recip());
    let side = frame.size().width;
    Ok(Tensor::from_flat_fn([side, side, 2], |k| T::narrow(mean[k] * share)))
}
