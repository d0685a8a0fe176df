//! What a lens sees, from one view: with what is hidden, and without it.

use bokashi_core::{Scalar, Tensor, Var};
use bokashi_render_ops::{
    Background, Border, Filter, Lens, LensLayer, LensOptions, LensPicture, RenderError, Sampling,
    ThinLens, ThinLensOptions, depth_layers, depth_of_field, downsample, eye_depth, lens_picture,
    rasterize,
};

use super::scene::{FAR, Frame, LensScene, look, sky};
use super::truth::pinhole;

/// What `lens_picture` makes of clip positions in a picture with its margin.
///
/// # Errors
/// What the operations refuse.
pub fn draw<'t, T: Scalar>(
    scene: &LensScene,
    frame: Frame,
    clip: Var<'t, T>,
    lens: ThinLens<'t, T>,
) -> Result<LensPicture<'t, T>, RenderError> {
    let tape = clip.tape();
    let (mesh, attributes) = (scene.mesh()?, scene.attributes(tape));
    let options = scene.exact(frame.size());
    let visible = rasterize(clip, &mesh, options.creases(&[attributes.into()]))?;
    let hidden = depth_layers(clip, &mesh, options.sampling(Sampling::Center), Some(3))?;
    let layer = |fragments| {
        let [colors, alpha] = look(attributes, fragments)?;
        let premultiplied = colors * alpha.reshape([fragments.coverage.count(), 1])?;
        LensLayer::from_fragments(fragments, premultiplied, alpha)
    };
    let behind = hidden.iter().map(layer).collect::<Result<Vec<_>, _>>()?;
    let usual = ThinLensOptions::default();
    let largest_radius = usual.largest_radius * frame.scale().max(1.0);
    let options = ThinLensOptions { margin: frame.margin, largest_radius, ..usual };
    lens_picture(layer(&visible)?, &behind, Background::Color(sky(tape)), FAR, lens, &options)
}

/// What `lens_picture` makes of so many samples along each side of a pixel, the mean over each pixel: `[H, W, 2]`.
///
/// # Errors
/// What the operations refuse.
pub fn draw_samples<'t, T: Scalar>(
    scene: &LensScene,
    frame: Frame,
    clip: Var<'t, T>,
    lens: ThinLens<'t, T>,
    samples: usize,
) -> Result<Var<'t, T>, RenderError> {
    let fine = Frame { pixels: samples * frame.pixels, margin: samples * frame.margin };
    let lens = ThinLens { aperture: lens.aperture * T::from_f64(samples as f64), ..lens };
    let image = draw(scene, fine, clip, lens)?.image;
    downsample(image, samples, &Filter::Box, Border::Clamp)
}

/// What `depth_of_field` makes of them, the margin cut off.
///
/// # Errors
/// What the operations refuse.
pub fn gather<'t, T: Scalar>(
    scene: &LensScene,
    frame: Frame,
    clip: Var<'t, T>,
    lens: ThinLens<'t, T>,
) -> Result<Var<'t, T>, RenderError> {
    let image = pinhole(scene, frame, clip)?;
    let attributes = scene.attributes(clip.tape());
    let options = scene.exact(frame.size());
    let visible = rasterize(clip, &scene.mesh()?, options.creases(&[attributes.into()]))?;
    let depth = eye_depth(&visible)?.image(&visible, FAR)?;
    // A disc of radius K has the standard deviation K / 2 along each axis.
    let lens = Lens { aperture: lens.aperture * T::from_f64(0.5), focus: lens.focus };
    let image = depth_of_field(image, depth, lens, &LensOptions::default())?.image;
    let inner = frame.margin..frame.margin + frame.pixels;
    Ok(image.slice(0, inner.clone())?.slice(1, inner)?)
}

/// How far away what a pinhole sees of clip positions at pixel centres is: `[H, W]`.
///
/// # Errors
/// What the operations refuse.
pub fn distances(
    scene: &LensScene,
    frame: Frame,
    clip: Var<'_, f64>,
) -> Result<Tensor<f64>, RenderError> {
    let options = scene.exact(frame.size()).sampling(Sampling::Center);
    let fragments = rasterize(clip, &scene.mesh()?, options)?;
    Ok(eye_depth(&fragments)?.image(&fragments, FAR)?.distances().value())
}
