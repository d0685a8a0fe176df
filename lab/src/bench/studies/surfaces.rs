//! What does it cost to make a million fragments look like something?
//!
//! Textures, light and a lens on as many fragments as an image of 1024 x 1024 pixels has, and views side
//! by side. Inputs are smooth across the image, as those of a real surface are.

use bokashi_catalogue::setting::wall;
use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_fit::{
    Fit, FitError, FitSettings, Parameter, Parameters, Pipeline, mean_squared_error, views,
};
use bokashi_render_ops::{
    Blur, CubeMap, Cull, DepthImage, Detail, Iris, Lens, LensOptions, Light, Material, Radius,
    Sampler, Surface, Texture, TextureFilter, depth_of_field, gaussian_blur, sample_cube_map,
    sample_texture, shade,
};
use bokashi_report::{Cell, Section, Table};
use glam::{DMat4, DVec3};

use crate::bench::effort::USUAL;
use crate::bench::operation::{Case, Record, Runner, errors};
use crate::bench::pipeline::render;
use crate::bench::sampling::{Contestant, Timing, interleaved};
use crate::bench::scenes::Scene;
use crate::bench::setting::Bench;

/// The largest standard deviation of the lens, in pixels, and that of the blur beside it.
const APERTURE: f64 = 6.0;

/// A lens of an image, distances, aperture and focus: Gaussian within `tolerance`, or through an iris.
fn through_lens<'t, T: Scalar>(
    v: &[Var<'t, T>],
    tolerance: f64,
    iris: Option<Iris>,
) -> Result<Var<'t, T>, FitError> {
    let lens = Lens { aperture: v[2], focus: v[3] };
    let radius = Radius::Tolerance(tolerance);
    let options = LensOptions { radius, iris, ..LensOptions::default() };
    Ok(depth_of_field(v[0], DepthImage::from_distances(v[1]), lens, &options)?.image)
}

/// Samples of a texture with mipmaps, by the inputs texels, coordinates and differentials.
fn textured<'t, T: Scalar>(
    v: &[Var<'t, T>],
    filter: TextureFilter,
) -> Result<Var<'t, T>, FitError> {
    let detail = Detail::Differentials { differentials: v[2], bias: None };
    let texture = Texture::with_mipmaps(v[0])?;
    Ok(sample_texture(&texture, v[1], detail, Sampler::new().filter(filter))?)
}

fn cases<T: Scalar>(pixels: usize) -> Vec<Case<T, ()>> {
    let mut all: Vec<Case<T, ()>> = Vec::new();
    let mut add = |label, inputs: &[&Tensor<f64>], record: Record<T, ()>| {
        let inputs = inputs.iter().map(|&tensor| tensor.clone()).collect();
        all.push(Case { label, inputs, record });
    };
    let count = pixels * pixels;
    // As far across the image as down, from 0 to 1, and exact in f32.
    let position = |k: usize| [k % pixels, k / pixels].map(|k| k as f64 / pixels as f64);
    let rows = |entry: fn([f64; 2]) -> [f64; 3]| {
        Tensor::from_fn([count, 3], |[k, c]| f64::from(entry(position(k))[c] as f32))
    };
    let numbers = |entry: fn([f64; 2]) -> f64| {
        Tensor::from_flat_fn([count], |k| f64::from(entry(position(k)) as f32))
    };
    let mut state = 1_u64;
    let mut uniform = |low: f64, high: f64| {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        low + (high - low) * (state >> 40) as f64 / 16_777_216.0
    };
    let [texels, places, footprints] = &wall(pixels, &mut uniform);
    // In f32 a coordinate beyond the border wraps to another one than in f64, by a rounding.
    let places = &places.map(|x| f64::from((x - x.floor()) as f32));
    add("sample_texture, bilinear", &[texels, places], |_, v| {
        let sampler = Sampler::new().filter(TextureFilter::Bilinear);
        Ok(sample_texture(&Texture::new(v[0])?, v[1], Detail::Finest, sampler)?)
    });
    let texture = [texels, places, footprints];
    add("mipmaps and sample_texture, trilinear", &texture, |_, v| {
        textured(&[v[0], v[1], v[2].detach()], TextureFilter::Trilinear)
    });
    add("mipmaps and sample_texture, trilinear, and to the differentials", &texture, |_, v| {
        textured(v, TextureFilter::Trilinear)
    });
    add("mipmaps and sample_texture, 8 probes", &texture, |_, v| {
        textured(&[v[0], v[1], v[2].detach()], TextureFilter::Anisotropic { probes: 8 })
    });
    // From pole to pole, around each of them.
    let directions = rows(|[x, y]| {
        let (sine, cosine) = (std::f64::consts::PI * y).sin_cos();
        let (east, north) = (std::f64::consts::TAU * x).sin_cos();
        [sine * east, sine * north, cosine]
    });
    let side = pixels / 4;
    let faces = Tensor::from_flat_fn([6, side, side, 3], |_| uniform(0.0, 1.0));
    add("sample_cube_map, bilinear", &[&faces, &directions], |_, v| {
        let sampler = Sampler::new().filter(TextureFilter::Bilinear);
        Ok(sample_cube_map(&CubeMap::new(v[0])?, v[1], Detail::Finest, sampler)?)
    });
    let normals = rows(|[x, y]| [x - 0.5, y - 0.5, 1.0]);
    let eyes = rows(|[x, y]| [0.5 - x, 0.25 - y, 2.0]);
    let base = rows(|[x, y]| [x, y, 0.5]);
    let (roughness, metallic) = (numbers(|[x, _]| 0.1 + 0.8 * x), numbers(|[_, y]| y));
    let light = [Tensor::from([0.25, 0.5, 1.0]), Tensor::from([1.0, 2.0, 3.0])];
    let lit = [&normals, &eyes, &base, &roughness, &metallic, &light[0], &light[1]];
    add("shade, metallic-roughness", &lit, |_, v| {
        let surface = Surface { normals: v[0], views: v[1], positions: Some(v[1]) };
        let (base_color, roughness, metallic) = (v[2], v[3], v[4]);
        let material = Material::MetallicRoughness {
            base_color,
            roughness,
            metallic,
            conserves_energy: false,
        };
        let light = Light::Directional { direction: v[5], irradiance: v[6] };
        Ok(shade(&surface, &material, &[light])?)
    });
    let image = Tensor::from_flat_fn([pixels, pixels, 3], |_| uniform(0.0, 1.0));
    let distances = Tensor::from_flat_fn([pixels, pixels], |k| 1.0 + 4.0 * position(k)[1]);
    add("gaussian_blur, sigma 6", &[&image, &Tensor::scalar(APERTURE)], |_, v| {
        let options = Blur { radius: Radius::Tolerance(1e-2), ..Blur::default() };
        Ok(gaussian_blur(v[0], v[1], &options)?)
    });
    let lens = [Tensor::scalar(APERTURE), Tensor::scalar(2.0)];
    let inputs = [&image, &distances, &lens[0], &lens[1]];
    add("depth_of_field, aperture 6, tolerance 1e-2", &inputs, |_, v| through_lens(v, 1e-2, None));
    add("depth_of_field, aperture 6, tolerance 1e-3", &inputs, |_, v| through_lens(v, 1e-3, None));
    add("depth_of_field, aperture 6, a disc", &inputs, |_, v| {
        through_lens(v, 1e-3, Some(Iris::Disc))
    });
    add("depth_of_field, aperture 6, six blades", &inputs, |_, v| {
        through_lens(v, 1e-3, Some(Iris::Polygon { blades: 6, rotation: 0.0 }))
    });
    all
}

pub(super) fn study(bench: &Bench) -> Result<Section, FitError> {
    let pixels = bench.effort.choose(32, 1024);
    let mut study = Section::new(
        "surfaces",
        "Textures, light and a lens on a million fragments",
        format!(
            "As many fragments as {pixels} x {pixels} pixels have, 3 channels, f32. Forward and backward \
             by the tape's own clock, with the gradients of every input; those of the differentials \
             only where they are named. A whole step is by the clock on the wall: the operation \
             runs forward and backward on inputs that are not copied, and the tape is reset. Errors \
             are f32's against f64 on the same inputs, as a share of the largest entry: of the \
             output, and of the worst gradient. They are errors of rounding; a lens adds at most \
             its tolerance. With 8 probes a rounding can move a probe to the next texel, across \
             which the gradient jumps."
        ),
    );
    let mut table = Table::new(
        "surfaces",
        "Time and error",
        &[
            ("operation", "operation"),
            ("threads", "threads"),
            ("forward, ms", "forward_minimum_milliseconds"),
            ("and backward, ms", "both_minimum_milliseconds"),
            ("whole step, ms", "step_minimum_milliseconds"),
            ("median, ms", "step_median_milliseconds"),
            ("error of the output", "output_error"),
            ("of a gradient", "gradient_error"),
        ],
    );
    let samples = bench.effort.samples(0.03, USUAL);
    for (single, double) in cases::<f32>(pixels).into_iter().zip(cases::<f64>(pixels)) {
        let label = single.label;
        let (mut single, mut double) = (Runner::new(single), Runner::new(double));
        let exact = bench.widest().install(|| double.results(&()));
        drop(double);
        let measured = exact.and_then(|exact| {
            let errors = errors(&single.results(&())?, &exact);
            let mut seconds = vec![[const { Vec::new() }; 3]; bench.pools.len()];
            for _ in 0..samples {
                for (pool, [forward, both, step]) in bench.pools.iter().zip(&mut seconds) {
                    let seconds = pool.install(|| single.step(&()))?;
                    forward.push(seconds.forward);
                    both.push(seconds.both());
                    step.push(seconds.step);
                }
            }
            Ok((errors, seconds))
        });
        let Some((errors, seconds)) = study.noted(label, measured) else { continue };
        for (pool, seconds) in bench.pools.iter().zip(seconds) {
            let [forward, both, step] = seconds.map(Timing::from_seconds);
            table.push(vec![
                Cell::text(label),
                Cell::Count(pool.current_num_threads()),
                forward.cell(1e3 * forward.minimum),
                both.cell(1e3 * both.minimum),
                step.cell(1e3 * step.minimum),
                step.cell(1e3 * step.median),
                Cell::number(errors[0]),
                Cell::number(errors[1]),
            ]);
        }
    }
    for name in bench.peer_names("surfaces") {
        let peer_of = |passes: &str| {
            let mut peers = bench.peers_of("surfaces").filter(|peer| peer.name == name);
            peers.find(|peer| peer.scene.as_deref() == Some(passes))
        };
        let (forward, both) = (peer_of("forward"), peer_of("forward and backward"));
        let milliseconds = |microseconds: Option<f64>| Cell::maybe(microseconds.map(|t| 1e-3 * t));
        table.push(vec![
            Cell::text(name),
            forward.and_then(|peer| peer.threads).map_or(Cell::Nothing, Cell::Count),
            milliseconds(forward.map(|peer| peer.minimum_microseconds)),
            Cell::Nothing,
            milliseconds(both.map(|peer| peer.minimum_microseconds)),
            milliseconds(both.map(|peer| peer.median_microseconds)),
            Cell::maybe(forward.and_then(|peer| peer.error)),
            Cell::maybe(both.and_then(|peer| peer.error)),
        ]);
    }
    study.push_table(table);
    let views = side_by_side(bench, &mut study);
    let views = study.noted("views", views);
    study.push_tables(views);
    Ok(study)
}

/// How many views there are.
const VIEWS: usize = 8;

/// A fit of colours and places to eight views of a sphere, and its pipeline.
fn fit_of_views(scene: &Scene) -> Result<(Fit<f32>, impl Pipeline<f32> + Send), FitError> {
    let cameras: Vec<_> = (0..VIEWS)
        .map(|k| {
            let turn =
                DMat4::from_axis_angle(DVec3::Y, k as f64 * std::f64::consts::TAU / VIEWS as f64);
            Scene { camera: scene.camera * turn, ..scene.clone() }
        })
        .collect();
    let pixels = [scene.size.height, scene.size.width, 3];
    let target = Tensor::from_flat_fn(pixels, |k| (k % 7) as f32 / 7.0);
    let parameters = Parameters::new()
        .with(Parameter::new("positions", scene.positions.cast::<f32>()).rate(1e-6))?
        .with(Parameter::new("colors", scene.colors.cast()).rate(1e-6))?;
    let pipeline = views(VIEWS, move |view, tape: &Tape<f32>, list| {
        let image = render(&cameras[view.index], Cull::Back, list[0], list[1])?;
        Ok(mean_squared_error(image, tape.constant(&target))?)
    });
    Ok((Fit::new(parameters, FitSettings::default())?, pipeline))
}

/// Eight views on each number of threads.
fn side_by_side(bench: &Bench, study: &mut Section) -> Result<Table, FitError> {
    let scene = match bench.effort.choose(true, false) {
        true => Scene::sphere("sphere1k", 32, 17, 32)?,
        false => Scene::sphere("sphere20k", 144, 70, 256)?,
    };
    let mut table = Table::new(
        "views",
        "A step over eight views of a sphere, each on a tape of its own",
        &[
            ("scene", "scene"),
            ("threads", "threads"),
            ("time, ms", "minimum_milliseconds"),
            ("median, ms", "median_milliseconds"),
            ("same bits", "same_bits"),
        ],
    );
    let mut learnt = Vec::new();
    let mut contestants = Vec::new();
    for pool in &bench.pools {
        let (mut fit, mut pipeline) = fit_of_views(&scene)?;
        // All that a fit saves, its means of gradients among it.
        learnt.push(pool.install(|| {
            fit.step(&mut pipeline)?;
            fit.step(&mut pipeline)?;
            fit.to_bytes()
        })?);
        contestants.push(Contestant::new(pool, move || fit.step(&mut pipeline).map(drop)));
    }
    let timings = interleaved(&mut contestants, bench.effort, USUAL);
    for ((pool, timing), learnt_here) in bench.pools.iter().zip(timings).zip(&learnt) {
        let Some(timing) = study.noted(&scene.name, timing) else { continue };
        table.push(vec![
            Cell::text(&scene.name),
            Cell::Count(pool.current_num_threads()),
            timing.cell(1e3 * timing.minimum),
            timing.cell(1e3 * timing.median),
            Cell::text(if *learnt_here == learnt[0] { "yes" } else { "NO" }),
        ]);
    }
    Ok(table)
}
