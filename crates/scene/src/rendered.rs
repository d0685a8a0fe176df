//! Views of a scene as files: pictures, depth, normals and ids.

use std::path::PathBuf;
use std::sync::Arc;

use bokashi_core::{Tape, Tensor};
use bokashi_fit::FitError;
use bokashi_render_ops::{Coverage, eye_depth};

use crate::error::{Location, SceneError};
use crate::learnables::Values;
use crate::picture::{Picture, Samples};
use crate::renderer::Renderer;
use crate::scene::Scene;
use crate::scene_view::SceneView;

/// The files of a view.
#[derive(Debug, Clone)]
pub struct Rendered {
    /// The view's name.
    pub view: String,
    /// Names, and what stands in the files:
    ///
    /// - `NAME.png`, the picture; `NAME.exr`, its light, with opacity.
    /// - `NAME-depth.exr`, distances along the view axis in units of the scene, 0 where nothing is seen;
    ///   `NAME-depth.png`, the same from black, the farthest, to white, the nearest.
    /// - `NAME-normals.exr`, unit normals in the world, 0 where nothing is seen; `NAME-normals.png`, a half
    ///   added to half of them.
    /// - `NAME-ids.exr`, the face that is seen, from 1 on; `NAME-ids.png`, 16 bits, the instance, from 1 on.
    pub files: Vec<(String, Vec<u8>)>,
}

/// What the names of a view's files end with.
const ENDS: [&str; 8] = [
    ".png",
    ".exr",
    "-depth.exr",
    "-depth.png",
    "-normals.exr",
    "-normals.png",
    "-ids.exr",
    "-ids.png",
];

impl Renderer {
    /// A view of the scene as it was given, smaller `reduce` times along each axis: `[H, W, 3]`, as pixels stand for it.
    ///
    /// # Errors
    /// What the operations refuse.
    pub fn picture(&self, view: usize, reduce: usize) -> Result<Tensor<f32>, SceneError> {
        let tape = Tape::new();
        let values = Values { tape: &tape, learnt: None };
        let drawn = self.draw(&values, view, reduce, false)?;
        Ok(self.image(&values, &drawn, reduce)?.value())
    }
}

impl Scene {
    /// The names of the files of these views, to be checked before they are rendered.
    pub fn rendered_names(&self, views: &[usize]) -> Vec<PathBuf> {
        let names = views.iter().map(|&view| &self.views[view].name);
        names.flat_map(|name| ENDS.map(|end| PathBuf::from(format!("{name}{end}")))).collect()
    }

    /// The views as they are seen, one after the other, smaller `reduce` times along each axis: `[H, W, 3]`, as
    /// pixels stand for it.
    ///
    /// # Errors
    /// As [`Renderer::new`]; of a view, what the operations refuse.
    pub fn pictures(
        &self,
        reduce: usize,
    ) -> Result<impl Iterator<Item = Result<Tensor<f32>, SceneError>> + use<>, SceneError> {
        let renderer = Renderer::new(Arc::new(self.clone()))?;
        Ok((0..self.views.len()).map(move |view| renderer.picture(view, reduce)))
    }

    /// Renders these views, by their numbers, one after the other.
    ///
    /// # Errors
    /// As [`Renderer::new`]; of a view, what the operations refuse.
    pub fn rendered<'a>(
        &self,
        views: &'a [usize],
    ) -> Result<impl Iterator<Item = Result<Rendered, SceneError>> + use<'a>, SceneError> {
        let renderer = Renderer::new(Arc::new(self.clone()))?;
        Ok(views.iter().map(move |&view| rendered(&renderer, view)))
    }
}

/// A note of the circles of confusion that views have at first, and that are cut to the largest one.
/// It draws the views that may have such circles.
///
/// # Errors
/// As [`Scene::rendered`].
pub fn capped_note(scene: &Scene) -> Result<Option<String>, SceneError> {
    if scene.description.pipeline.lens.is_none() || scene.objects.is_empty() {
        return Ok(None);
    }
    let renderer = Renderer::new(Arc::new(scene.clone()))?;
    let (mut total, mut most) = (0, (0, ""));
    for (view, SceneView { name, .. }) in scene.views.iter().enumerate() {
        let tape = Tape::new();
        let values = Values { tape: &tape, learnt: None };
        let capped = renderer.capped(&values, view)?;
        total += capped;
        if capped > most.0 {
            most = (capped, name);
        }
    }
    let (_, worst) = most;
    let rule = "are cut to `largest_radius` of `[pipeline.lens]`: a higher one blurs them as far as they are";
    let note = format!("{total} circles of confusion, most of them in view {worst:?}, {rule}");
    Ok((total > 0).then_some(note))
}

fn rendered(renderer: &Renderer, view: usize) -> Result<Rendered, SceneError> {
    let scene = renderer.scene();
    let name = &scene.views[view].name;
    let tape = Tape::new();
    let values = Values { tape: &tape, learnt: None };
    let drawn = renderer.draw(&values, view, 1, true)?;
    // Depth, normals and ids are those of a pinhole.
    let sharp = if drawn.is_sharp() { &drawn } else { &renderer.draw_sharp(&values, view)? };
    let coverage = &sharp.fragments().coverage;
    let mut files = Vec::new();
    let mut add = |what: &str, kind: &str, picture: &Picture| {
        let file = format!("{name}{what}.{kind}");
        let location = Location::new(&file);
        let bytes = match kind {
            "png" => picture.encode_png(&location)?,
            _ => picture.encode_exr(&location)?,
        };
        files.push((file, bytes));
        Ok::<_, SceneError>(())
    };
    let image = renderer.image(&values, &drawn, 1)?;
    let colors = image.slice(2, 0..3).map_err(FitError::from)?.value();
    add("", "png", &Picture::decode(&scene.png_of(&colors)?, &Location::new(name))?)?;
    add("", "exr", &Picture::from_numbers(&sharp.light()?.image()?.value())?)?;

    let depth = dense(coverage, &eye_depth(sharp.fragments())?.values().value(), 1);
    let depths = || depth.data().iter().filter(|&&depth| depth > 0.0);
    let least = depths().fold(f32::INFINITY, |least, &depth| least.min(depth));
    let range =
        (depths().fold(0.0_f32, |most, &depth| most.max(depth)) - least).max(f32::MIN_POSITIVE);
    let nearness = depth.data().iter().map(|&depth| match depth > 0.0 {
        true => ((1.0 - (depth - least) / range) * 254.0) as u8 + 1,
        false => 0,
    });
    let [height, width] = [depth.shape()[0], depth.shape()[1]];
    let gray = |samples: Samples| Picture { width, height, channels: 1, samples };
    let nearness = gray(Samples::U8(nearness.collect()));
    add("-depth", "exr", &Picture::from_numbers(&depth)?)?;
    add("-depth", "png", &nearness)?;

    let normals = renderer.normals(&values, sharp.world, sharp.fragments())?;
    let normals = dense(coverage, &normals.normalize().map_err(FitError::from)?.value(), 3);
    add("-normals", "exr", &Picture::from_numbers(&normals)?)?;
    let shown = normals.data().iter().map(|x| (127.5 * (x + 1.0)).round() as u8);
    let shown = Picture { width, height, channels: 3, samples: Samples::U8(shown.collect()) };
    add("-normals", "png", &shown)?;

    let ids = coverage.triangle_ids();
    let instances = ids.iter().map(|&id| match id.checked_sub(1) {
        Some(face) => renderer.instance(face as usize).map_or(0, |k| (k + 1).min(65_535)) as u16,
        None => 0,
    });
    let instances = gray(Samples::U16(instances.collect()));
    let faces = Tensor::from_flat_fn([height, width, 1], |pixel| ids[pixel] as f32);
    add("-ids", "exr", &Picture::from_numbers(&faces)?)?;
    add("-ids", "png", &instances)?;
    Ok(Rendered { view: name.clone(), files })
}

/// Numbers of fragments `[N]` or `[N, C]` as an image `[H, W, C]`, 0 where nothing is seen.
fn dense(coverage: &Coverage, values: &Tensor<f32>, channels: usize) -> Tensor<f32> {
    let size = coverage.size();
    let fragments: Vec<_> =
        (0..size.width * size.height).map(|pixel| coverage.fragment_at(pixel)).collect();
    Tensor::from_flat_fn([size.height, size.width, channels], |k| {
        fragments[k / channels]
            .map_or(0.0, |fragment| values.data()[fragment * channels + k % channels])
    })
}
