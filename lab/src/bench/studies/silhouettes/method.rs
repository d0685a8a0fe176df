//! The ways to make an image that has a gradient at its silhouettes.

use bokashi_core::Var;
use bokashi_fit::FitError;
use bokashi_render_ops::{Cull, RasterOptions, Silhouettes};

use crate::bench::pipeline::{picture, render};
use crate::bench::scenes::Scene;

/// Which edges are seams.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Seams {
    None,
    /// Those at which colours bend.
    Creases,
    All,
}

/// A way to make an image of a scene.
pub(super) struct Method {
    /// For people, and for programs.
    pub(super) name: &'static str,
    pub(super) key: &'static str,
    pub(super) seams: Seams,
    pub(super) image: Image,
}

/// The image of a scene with other positions and colours.
pub(super) type Image =
    for<'t> fn(&Scene, Cull, Var<'t, f32>, Var<'t, f32>) -> Result<Var<'t, f32>, FitError>;

/// All methods; another one is another row.
pub(super) const METHODS: [Method; 7] = [
    method("no antialias", "no_antialias", |scene, cull, p, c| {
        let options = RasterOptions::new(scene.size).cull(cull).silhouettes(Silhouettes::Aliased);
        Ok(picture(scene, options, p, c)?.image()?)
    }),
    method("antialias", "antialias", render),
    method("antialias, 2x2", "antialias_2x2", |scene, cull, p, c| {
        supersampled(2, scene, cull, p, c)
    }),
    method("antialias, 4x4", "antialias_4x4", |scene, cull, p, c| {
        supersampled(4, scene, cull, p, c)
    }),
    method("exact, no seams", "exact_no_seams", exact),
    Method { seams: Seams::Creases, ..method("exact", "exact", exact) },
    Method { seams: Seams::All, ..method("exact, all edges", "exact_all_edges", exact) },
];

/// With exact coverage.
fn exact<'t>(
    scene: &Scene,
    cull: Cull,
    positions: Var<'t, f32>,
    colors: Var<'t, f32>,
) -> Result<Var<'t, f32>, FitError> {
    let options = RasterOptions::new(scene.size).cull(cull).silhouettes(Silhouettes::Exact);
    Ok(picture(scene, options, positions, colors)?.image()?)
}

const fn method(name: &'static str, key: &'static str, image: Image) -> Method {
    Method { name, key, seams: Seams::None, image }
}

/// `times` x `times` antialiased pixels make one.
fn supersampled<'t>(
    times: usize,
    scene: &Scene,
    cull: Cull,
    positions: Var<'t, f32>,
    colors: Var<'t, f32>,
) -> Result<Var<'t, f32>, FitError> {
    let pixels = scene.size.width;
    let large = render(&scene.with_pixels(times * pixels), cull, positions, colors)?;
    let split = large.reshape([pixels, times, pixels, times, 3])?;
    Ok(split.mean_axis(3)?.mean_axis(1)?)
}
