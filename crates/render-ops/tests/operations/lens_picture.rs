//! A lens against the mean of pictures through its points.

use std::f64::consts::PI;
use std::ops::Range;

use bokashi_core::parallel::merge_ranges;
use bokashi_core::{Tape, Tensor, Var};
use bokashi_render_ops::{
    Background, Cull, Fragments, LensLayer, LensPicture, Mesh, RasterOptions, RenderError,
    Sampling, Size, ThinLens, ThinLensOptions, composite, depth_layers, eye_depth, interpolate,
    lens_picture, rasterize,
};

/// Pixels along a side of a picture, and of the margin around it.
const PIXELS: usize = 96;
const MARGIN: usize = 12;
/// The focal length of all cameras, in pixels.
const FOCAL_LENGTH: f64 = 100.0;
/// How far the background is away, and its colour.
const FAR: f64 = 12.0;
const SKY: [f64; 2] = [0.25, 0.7];

/// Surfaces in front of an eye at the origin that looks along z.
#[derive(Debug, Default)]
struct Scene {
    positions: Vec<[f64; 3]>,
    /// Two phases of a pattern, and two mean colours.
    attributes: Vec<[f64; 4]>,
    faces: Vec<[u32; 3]>,
    cull: Cull,
}

impl Scene {
    /// With a board from a corner along two sides, and waves of its pattern along each.
    fn board(
        mut self,
        corner: [f64; 3],
        sides: [[f64; 3]; 2],
        waves: [f64; 2],
        mean: [f64; 2],
    ) -> Self {
        let first = self.positions.len() as u32;
        for [a, b] in [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]] {
            let at = |axis: usize| corner[axis] + a * sides[0][axis] + b * sides[1][axis];
            self.positions.push([0, 1, 2].map(at));
            let phases = [a * waves[0], b * waves[1]].map(|phase| 2.0 * PI * phase);
            self.attributes.push([phases[0], phases[1], mean[0], mean[1]]);
        }
        self.faces.extend([[0, 1, 2], [2, 1, 3]].map(|face: [u32; 3]| face.map(|k| first + k)));
        self
    }

    /// With a board that faces the eye, around the middle of the picture.
    fn wall(self, z: f64, [x, y]: [[f64; 2]; 2], waves: [f64; 2], mean: [f64; 2]) -> Self {
        let sides = [[x[1] - x[0], 0.0, 0.0], [0.0, y[1] - y[0], 0.0]];
        self.board([x[0], y[0], z], sides, waves, mean)
    }

    /// With a ball.
    fn ball(mut self, [x, y, z]: [f64; 3], radius: f64, mean: [f64; 2]) -> Self {
        const AROUND: u32 = 24;
        const ALONG: u32 = 12;
        let first = self.positions.len() as u32;
        for ring in 0..=ALONG {
            for k in 0..=AROUND {
                let [theta, phi] = [
                    PI * f64::from(ring) / f64::from(ALONG),
                    2.0 * PI * f64::from(k) / f64::from(AROUND),
                ];
                let [across, up] = [theta.sin(), theta.cos()];
                let normal = [across * phi.cos(), up, across * phi.sin()];
                self.positions.push([
                    x + radius * normal[0],
                    y + radius * normal[1],
                    z + radius * normal[2],
                ]);
                self.attributes.push([3.0 * theta, 4.0 * phi, mean[0], mean[1]]);
            }
        }
        for ring in 0..ALONG {
            for k in 0..AROUND {
                let at = |ring: u32, k: u32| first + ring * (AROUND + 1) + k;
                self.faces.push([at(ring, k), at(ring + 1, k), at(ring + 1, k + 1)]);
                self.faces.push([at(ring, k), at(ring + 1, k + 1), at(ring, k + 1)]);
            }
        }
        self.cull = Cull::Back;
        self
    }

    fn mesh(&self) -> Mesh {
        Mesh::new(self.faces.clone(), self.positions.len()).unwrap()
    }

    /// Clip positions in a picture of `pixels` pixels along a side.
    fn clip(&self, pixels: usize) -> Tensor<f64> {
        let scale = 2.0 * FOCAL_LENGTH / pixels as f64;
        let (near, far) = (0.1, 100.0);
        Tensor::from_fn([self.positions.len(), 4], |[vertex, axis]| {
            let [x, y, z] = self.positions[vertex];
            let depth = ((far + near) * z - 2.0 * far * near) / (far - near);
            [scale * x, scale * y, depth, z][axis]
        })
    }

    fn attributes<'t>(&self, tape: &'t Tape<f64>) -> Var<'t, f64> {
        tape.constant(&Tensor::from(self.attributes.clone()))
    }
}

/// What is seen of fragments: `[N, 2]`.
fn colors<'t>(
    attributes: Var<'t, f64>,
    fragments: &Fragments<'t, f64>,
) -> Result<Var<'t, f64>, RenderError> {
    let values = interpolate(attributes, fragments)?;
    let waves = values.slice(1, 0..1)?.sin() * values.slice(1, 1..2)?.sin();
    Ok(values.slice(1, 2..4)? + waves * 0.25)
}

fn exact_options(scene: &Scene, pixels: usize) -> RasterOptions {
    RasterOptions::new(Size::square(pixels)).sampling(Sampling::Exact).cull(scene.cull)
}

/// What the point `[p_x, p_y]` of the unit disc sees of `scene` through the lens.
fn through<'t>(
    scene: &Scene,
    lens: ThinLens<'t, f64>,
    point: [f64; 2],
) -> Result<Var<'t, f64>, RenderError> {
    let tape = lens.focus.tape();
    let clip = tape.constant(&scene.clip(PIXELS));
    let w = clip.slice(1, 3..4)?;
    let row = tape.constant(&Tensor::new([1, 4], vec![point[0], point[1], 0.0, 0.0])?);
    let shift = (w - lens.focus) * (lens.aperture * (2.0 / PIXELS as f64));
    let clip = clip - shift.matmul(row)?;
    let attributes = scene.attributes(tape);
    let options = exact_options(scene, PIXELS);
    let fragments = rasterize(clip, &scene.mesh(), options.creases(&[attributes.into()]))?;
    let sky = Background::Color(tape.constant(&Tensor::from(SKY)));
    composite(colors(attributes, &fragments)?, &fragments, sky)?.image()
}

/// Point k of `count` that share the unit disc evenly.
fn point(k: usize, count: usize) -> [f64; 2] {
    let radius = ((k as f64 + 0.5) / count as f64).sqrt();
    let angle = k as f64 * PI * (3.0 - 5.0_f64.sqrt());
    [radius * angle.cos(), radius * angle.sin()]
}

fn lens_on(tape: &Tape<f64>, [aperture, focus]: [f64; 2]) -> ThinLens<'_, f64> {
    ThinLens { aperture: tape.leaf_scalar(aperture), focus: tape.leaf_scalar(focus) }
}

/// The mean of what `count` points of the lens see.
fn mean_through(scene: &Scene, numbers: [f64; 2], count: usize) -> Vec<f64> {
    let mut mean = vec![0.0; 2 * PIXELS * PIXELS];
    let view = |views: Range<usize>| {
        let tape = Tape::new();
        let image = through(scene, lens_on(&tape, numbers), point(views.start, count));
        image.unwrap().value()
    };
    merge_ranges(count, 1, view, |image| {
        for (mean, &entry) in mean.iter_mut().zip(image.data()) {
            *mean += entry / count as f64;
        }
    });
    mean
}

/// The root mean square of the difference, in percent of full intensity.
fn percent_off(found: &[f64], truth: &[f64]) -> f64 {
    let sum: f64 = found.iter().zip(truth).map(|(a, b)| (a - b) * (a - b)).sum();
    100.0 * (sum / found.len() as f64).sqrt()
}

/// What the lens sees.
fn drawn<'t>(scene: &Scene, lens: ThinLens<'t, f64>) -> Result<LensPicture<'t, f64>, RenderError> {
    let tape = lens.focus.tape();
    let pixels = PIXELS + 2 * MARGIN;
    let clip = tape.constant(&scene.clip(pixels));
    let (mesh, attributes) = (scene.mesh(), scene.attributes(tape));
    let options = exact_options(scene, pixels);
    let visible = rasterize(clip, &mesh, options.creases(&[attributes.into()]))?;
    let hidden = depth_layers(clip, &mesh, options.sampling(Sampling::Center), Some(3))?;
    let layer = |fragments| -> Result<_, RenderError> {
        let premultiplied = colors(attributes, fragments)?;
        let alpha = tape.constant_full([fragments.coverage.count()], 1.0);
        let distance = eye_depth(fragments)?.values();
        Ok(LensLayer { fragments, premultiplied, alpha, distance })
    };
    let behind: Vec<_> = hidden.iter().map(layer).collect::<Result<_, _>>()?;
    let sky = Background::Color(tape.constant(&Tensor::from(SKY)));
    let options = ThinLensOptions { margin: MARGIN, ..ThinLensOptions::default() };
    lens_picture(layer(&visible)?, &behind, sky, FAR, lens, &options)
}

fn front_board() -> Scene {
    let scene = Scene::default();
    let scene = scene.wall(2.0, [[-0.5, 0.45], [-0.6, 0.4]], [4.0, 4.0], [0.7, 0.3]);
    scene.wall(4.0, [[-4.0, 4.0], [-4.0, 4.0]], [16.0, 12.0], [0.4, 0.6])
}

fn fences() -> Scene {
    let mut scene = Scene::default();
    for k in -5..=5 {
        let x = 0.3 * f64::from(k) + 0.05;
        scene = scene.wall(2.0, [[x, x + 0.14], [-2.0, 2.0]], [0.5, 10.0], [0.75, 0.3]);
        let y = 0.5 * f64::from(k) - 0.08;
        scene = scene.wall(4.0, [[-4.0, 4.0], [y, y + 0.25]], [14.0, 0.5], [0.3, 0.7]);
    }
    scene.wall(8.0, [[-8.0, 8.0], [-8.0, 8.0]], [20.0, 16.0], [0.5, 0.5])
}

fn slope() -> Scene {
    let floor = [[8.0, 0.0, 0.0], [0.0, 0.0, 5.0]];
    let scene = Scene::default().board([-4.0, -0.7, 1.2], floor, [8.0, 2.0], [0.4, 0.6]);
    let sides = [[1.0, 0.0, 1.2], [0.1, 1.3, 0.3]];
    scene.board([-0.5, -0.7, 2.0], sides, [5.0, 5.0], [0.7, 0.3])
}

fn balls() -> Scene {
    let scene = Scene::default();
    let scene = scene.ball([-0.3, 0.2, 2.0], 0.35, [0.7, 0.3]);
    let scene = scene.ball([0.5, -0.1, 2.6], 0.4, [0.3, 0.65]);
    let scene = scene.ball([0.0, -0.8, 3.2], 0.5, [0.6, 0.6]);
    let scene = scene.ball([-1.0, -0.3, 4.2], 0.6, [0.45, 0.3]);
    scene.ball([0.9, 1.1, 5.5], 0.9, [0.3, 0.4])
}

/// A scene, aperture and focus, and how far off its picture may be, in percent of full intensity.
fn rows() -> [(&'static str, Scene, [f64; 2], f64); 5] {
    [
        ("board in front", front_board(), [5.0, 4.0], 0.2),
        ("wall behind", front_board(), [10.0, 2.0], 0.2),
        ("slanted board on a floor", slope(), [7.0, 3.0], 1.2),
        ("two fences", fences(), [2.5, 8.0], 1.4),
        ("five balls", balls(), [8.0, 3.0], 0.9),
    ]
}

#[test]
fn a_lens_sees_the_mean_of_what_its_points_see() {
    let shape = [PIXELS, PIXELS, 2];
    for (name, scene, numbers, reach) in rows() {
        let tape = Tape::new();
        let lens = lens_on(&tape, numbers);
        let image = drawn(&scene, lens).unwrap().image;
        let truth = mean_through(&scene, numbers, 192);
        let off = percent_off(image.value().data(), &truth);
        // How the picture moves with aperture and focus, as a share of how the truth moves.
        let moves = [lens.aperture, lens.focus].into_iter().enumerate().map(|(k, leaf)| {
            let [before, after] = [1.0 / 1.03, 1.03].map(|factor| {
                let mut moved = numbers;
                moved[k] *= factor;
                (moved[k], mean_through(&scene, moved, 96))
            });
            let difference = |entry: usize| after.1[entry] - before.1[entry];
            let difference = Tensor::from_flat_fn(shape, difference);
            let square: f64 = difference.data().iter().map(|x| x * x).sum();
            let gradients = tape.vjp(&[(image, &difference)]).unwrap();
            gradients.get_or_zeros(leaf).item() * (after.0 - before.0) / square
        });
        let moves: Vec<_> = moves.collect();
        println!("{name}: {off:.3} %, moves {moves:.3?}");
        assert!(off <= reach, "{name}: off by {off} %");
        assert!(moves.iter().all(|share| (share - 1.0).abs() < 0.15), "{name}: {moves:?}");
    }
}

#[test]
fn gradients_are_linear_in_the_gradient_of_the_picture() {
    let tape = Tape::new();
    let lens = lens_on(&tape, [7.0, 3.0]);
    let image = drawn(&slope(), lens).unwrap().image;
    let motley = |seed: usize| {
        Tensor::from_flat_fn([PIXELS, PIXELS, 2], |k| {
            ((k * 7919 + seed) % 1009) as f64 / 504.0 - 1.0
        })
    };
    let of = |upstream: &Tensor<f64>| {
        let gradients = tape.vjp(&[(image, upstream)]).unwrap();
        [lens.aperture, lens.focus].map(|leaf| gradients.get_or_zeros(leaf).item())
    };
    let (one, other) = (motley(13), motley(400));
    let both = Tensor::from_flat_fn(one.shape(), |k| one.data()[k] + other.data()[k]);
    let [of_one, of_other, of_both] = [&one, &other, &both].map(of);
    for k in 0..2 {
        let off = of_both[k] - of_one[k] - of_other[k];
        let size = of_one[k].abs() + of_other[k].abs();
        assert!(off.abs() <= 1e-12 * (1.0 + size), "{off} of {size}");
    }
    for factor in [2.0_f64.powi(-40), 2.0_f64.powi(40)] {
        assert_eq!(of(&one.map(|entry| entry * factor)), of_one.map(|entry| entry * factor));
    }
    assert_eq!(of(&Tensor::zeros(one.shape())), [0.0; 2]);
}
