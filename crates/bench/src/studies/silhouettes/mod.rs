//! How good is the gradient of a silhouette, and what does it cost?
//!
//! The truth is the gradient of `<g, a(p)>`, where `a` is the picture of vertices `p` averaged over
//! the area of each pixel (`scanlines`), and `g` one fixed upstream gradient per image, that of the
//! squared error against a target. A method gives the gradient of `<g, image(p)>` for an image of its
//! own.

mod cases;
mod scanlines;
mod truth;

use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_fit::FitError;
use bokashi_render_ops::{
    Background, Cull, RasterOptions, Sampling, interpolate, project, rasterize, resolve,
};

use crate::bench::Bench;
use crate::pipeline::render;
use crate::scenes::Scene;

type Image<T> = for<'t> fn(&Scene, Cull, Var<'t, T>, Var<'t, T>) -> Result<Var<'t, T>, FitError>;

/// A way to make an image of a scene with other positions and colours.
struct Method<T: Scalar> {
    name: &'static str,
    /// Whether every edge is a seam.
    has_seams: bool,
    image: Image<T>,
}

/// All methods; another one is another row.
const fn methods<T: Scalar>() -> [Method<T>; 6] {
    [
        Method {
            name: "no antialias",
            has_seams: false,
            image: |s, k, p, c| Ok(render(s, k, p, c)?.jagged),
        },
        Method {
            name: "antialias",
            has_seams: false,
            image: |s, k, p, c| Ok(render(s, k, p, c)?.image),
        },
        Method {
            name: "antialias, 2x2",
            has_seams: false,
            image: |s, k, p, c| supersampled(2, s, k, p, c),
        },
        Method {
            name: "antialias, 4x4",
            has_seams: false,
            image: |s, k, p, c| supersampled(4, s, k, p, c),
        },
        Method { name: "exact coverage", has_seams: false, image: exact },
        Method { name: "exact coverage, all edges", has_seams: true, image: exact },
    ]
}

/// The picture with exact coverage.
fn exact<'t, T: Scalar>(
    scene: &Scene,
    cull: Cull,
    positions: Var<'t, T>,
    colors: Var<'t, T>,
) -> Result<Var<'t, T>, FitError> {
    let clip = project(positions, &scene.camera, None)?;
    let options = RasterOptions { cull, sampling: Sampling::Exact, ..scene.size.into() };
    let fragments = rasterize(clip, &scene.mesh, options)?;
    Ok(resolve(interpolate(colors, &fragments)?, &fragments, Background::Zero)?)
}

/// `times` x `times` antialiased pixels make one.
fn supersampled<'t, T: Scalar>(
    times: usize,
    scene: &Scene,
    cull: Cull,
    positions: Var<'t, T>,
    colors: Var<'t, T>,
) -> Result<Var<'t, T>, FitError> {
    let pixels = scene.size.width;
    let large = render(&scene.at(times * pixels), cull, positions, colors)?.image;
    let split = large.reshape([pixels, times, pixels, times, 3])?;
    Ok(split.mean_axis(3)?.mean_axis(1)?)
}

/// The image and the gradient that `method` gives, by coordinate.
fn gradient<T: Scalar>(
    method: &Method<T>,
    scene: &Scene,
    cull: Cull,
    upstream: &Tensor<T>,
    tape: &mut Tape<T>,
) -> Result<[Vec<f64>; 2], FitError> {
    let found = {
        let positions = tape.leaf(&scene.positions.cast());
        let image = (method.image)(scene, cull, positions, tape.constant(&scene.colors.cast()))?;
        let gradients = tape.vjp(&[(image, upstream)])?;
        [image.value(), gradients.get_or_zeros(positions)]
    };
    tape.reset();
    Ok(found.map(|found| found.data().iter().map(|entry| entry.to_f64()).collect()))
}

pub(super) fn study(bench: &Bench) -> Result<crate::study::Study, FitError> {
    let sizes = [8, 16, 32, 64];
    for (name, seeds, make) in cases::CASES {
        let mut all = vec![vec![[0.0; 2]; 0]; sizes.len() * 6];
        let (mut noise, mut pn) = (0.0_f64, 0.0_f64);
        if std::env::var("CASE").is_ok_and(|c| !name.contains(&c)) {
            continue;
        }
        for seed in 0..seeds.min(std::env::var("SEEDS").map_or(99, |d| d.parse().unwrap())) {
            let case = make(seed)?;
            let truths = bench.widest().install(|| truth::truths(&case, Cull::None, &sizes));
            println!(
                "seed {seed} noise {:?}",
                truths.iter().map(|t| [t.noise, t.picture_noise]).collect::<Vec<_>>()
            );
            for (at, truth) in truths.iter().enumerate() {
                noise = noise.max(truth.noise);
                pn = pn.max(truth.picture_noise);
                for (k, method) in methods::<f64>().iter().enumerate() {
                    let mut scene = case.scene.at(truth.pixels);
                    if method.has_seams {
                        scene.mesh = scene.mesh.with_seams(|_, _| true);
                    }
                    let [image, g] = gradient(
                        method,
                        &scene,
                        Cull::None,
                        &truth.upstream.cast(),
                        &mut Tape::new(),
                    )?;
                    if k >= 4 {
                        println!(
                            "  {:3} {k} {:.5} {:.5} at {:?}",
                            truth.pixels,
                            truth.error(&g),
                            truth.picture_error(&image),
                            truth.worst(&image)
                        );
                    }
                    all[at * 6 + k].push([truth.error(&g), truth.picture_error(&image)]);
                }
            }
        }
        println!("{name}: noise {noise:.5} picture {pn:.6}");
        for (at, size) in sizes.iter().enumerate() {
            for (k, method) in methods::<f64>().iter().enumerate() {
                let v = &mut all[at * 6 + k];
                let p = v.iter().map(|v| v[1]).fold(0.0, f64::max);
                v.sort_by(|a, b| a[0].total_cmp(&b[0]));
                println!(
                    "  {size:3} {:28} median {:.4} max {:.4}  picture {:.5}",
                    method.name,
                    v[v.len() / 2][0],
                    v[v.len() - 1][0],
                    p
                );
            }
        }
    }
    todo!()
}
