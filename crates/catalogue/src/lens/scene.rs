//! Surfaces in front of an eye at the origin that looks along z, y up.

use std::f64::consts::PI;

use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::interpolate;
use bokashi_render_ops::{Cull, Fragments, Mesh, RasterOptions, RenderError, Sampling, Size};

/// Circles of confusion are given in pixels of pictures with so many along a side, whose focal length is
/// 100 pixels.
pub const UNIT: usize = 96;
const FOCAL_LENGTH: f64 = 100.0;
/// How far the background is away, and its colour.
pub const FAR: f64 = 12.0;
/// The background's colour.
pub const SKY: [f64; 2] = [0.25, 0.7];

/// A square picture in its margin.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    /// Pixels along a side of the picture.
    pub pixels: usize,
    /// Pixels of the margin at each side.
    pub margin: usize,
}

impl Frame {
    /// A picture of so many pixels along a side, in a margin as wide as the widest circle of confusion of
    /// these scenes.
    pub fn new(pixels: usize) -> Self {
        Self { pixels, margin: 12 * pixels / UNIT }
    }

    /// The picture without a margin.
    #[must_use]
    pub fn without_margin(self) -> Self {
        Self { margin: 0, ..self }
    }

    /// The size of the picture and its margin.
    pub fn size(self) -> Size {
        Size::square(self.pixels + 2 * self.margin)
    }

    /// How many of its pixels make one of a picture of [`UNIT`] pixels.
    pub fn scale(self) -> f64 {
        self.pixels as f64 / UNIT as f64
    }
}

/// Surfaces, with the product of two waves as their pattern. They are opaque, but for a pane in front of all
/// others.
#[derive(Debug, Clone, Default)]
pub struct LensScene {
    positions: Vec<[f64; 3]>,
    /// Two phases of the pattern, and two mean colours.
    attributes: Vec<[f64; 4]>,
    faces: Vec<[u32; 3]>,
    cull: Cull,
    pane: Option<Pane>,
}

/// A pane that hides a part of what is behind it.
#[derive(Debug, Clone, Copy)]
struct Pane {
    vertex: usize,
    face: usize,
    alpha: f64,
}

impl LensScene {
    /// With a board from a corner along two sides, and waves of its pattern along each.
    #[must_use]
    pub fn board(
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

    /// With a board that faces the eye, over ranges of x and y.
    #[must_use]
    pub fn wall(self, z: f64, [x, y]: [[f64; 2]; 2], waves: [f64; 2], mean: [f64; 2]) -> Self {
        let sides = [[x[1] - x[0], 0.0, 0.0], [0.0, y[1] - y[0], 0.0]];
        self.board([x[0], y[0], z], sides, waves, mean)
    }

    /// With a board that has a hole over the middle third of its sides.
    #[must_use]
    pub fn frame(
        mut self,
        corner: [f64; 3],
        sides: [[f64; 3]; 2],
        waves: [f64; 2],
        mean: [f64; 2],
    ) -> Self {
        let first = self.positions.len() as u32;
        for k in 0..16 {
            let [a, b] = [k % 4, k / 4].map(|step| f64::from(step) / 3.0);
            let at = |axis: usize| corner[axis] + a * sides[0][axis] + b * sides[1][axis];
            self.positions.push([0, 1, 2].map(at));
            let phases = [a * waves[0], b * waves[1]].map(|phase| 2.0 * PI * phase);
            self.attributes.push([phases[0], phases[1], mean[0], mean[1]]);
        }
        for cell in (0..9).filter(|&cell| cell != 4) {
            let start = first + cell % 3 + 4 * (cell / 3);
            let faces = [[0, 1, 4], [4, 1, 5]];
            self.faces.extend(faces.map(|face: [u32; 3]| face.map(|k| start + k)));
        }
        self
    }

    /// With a ball. Back faces of all surfaces are left out: its far side is seen by no point of the lens.
    #[must_use]
    pub fn ball(self, center: [f64; 3], radius: f64, mean: [f64; 2]) -> Self {
        self.rippled_ball(center, [radius, 0.0], [24, 12], mean)
    }

    /// With a ball of a mean radius and ripples of a share of it, in so many parts around and along its axis: twice
    /// as many faces as the product of both.
    #[must_use]
    pub fn rippled_ball(
        mut self,
        [x, y, z]: [f64; 3],
        [mean_radius, ripple]: [f64; 2],
        [around, along]: [u32; 2],
        mean: [f64; 2],
    ) -> Self {
        let first = self.positions.len() as u32;
        for ring in 0..=along {
            for k in 0..=around {
                let [theta, phi] = [
                    PI * f64::from(ring) / f64::from(along),
                    2.0 * PI * f64::from(k) / f64::from(around),
                ];
                let wave = (5.0 * theta).sin() * (4.0 * phi).sin();
                let radius = mean_radius * (1.0 + ripple * wave);
                let [across, up] = [theta.sin(), theta.cos()];
                let normal = [across * phi.cos(), up, across * phi.sin()];
                let at = [x + radius * normal[0], y + radius * normal[1], z + radius * normal[2]];
                self.positions.push(at);
                self.attributes.push([3.0 * theta, 4.0 * phi, mean[0], mean[1]]);
            }
        }
        for ring in 0..along {
            for k in 0..around {
                let at = |ring: u32, k: u32| first + ring * (around + 1) + k;
                self.faces.push([at(ring, k), at(ring + 1, k), at(ring + 1, k + 1)]);
                self.faces.push([at(ring, k), at(ring + 1, k + 1), at(ring, k + 1)]);
            }
        }
        self.cull = Cull::Back;
        self
    }

    /// The same, where what `add` adds is a pane of this alpha in front of all that is there.
    #[must_use]
    pub fn pane(self, alpha: f64, add: impl FnOnce(Self) -> Self) -> Self {
        let pane = Pane { vertex: self.positions.len(), face: self.faces.len(), alpha };
        Self { pane: Some(pane), ..add(self) }
    }

    /// How many vertices there are.
    pub fn vertices(&self) -> usize {
        self.positions.len()
    }

    /// The distances of the vertices.
    pub fn distances(&self) -> impl Iterator<Item = f64> + '_ {
        self.positions.iter().map(|position| position[2])
    }

    /// The faces of the opaque surfaces, and those of the pane, with its alpha.
    pub(super) fn parts(&self) -> Result<(Mesh, Option<(Mesh, f64)>), RenderError> {
        let (faces, pane) = match self.pane {
            None => (&self.faces[..], None),
            Some(pane) => (&self.faces[..pane.face], Some(pane)),
        };
        let mesh = |faces: &[[u32; 3]]| Mesh::new(faces.to_vec(), self.positions.len());
        let pane = match pane {
            None => None,
            Some(pane) => Some((mesh(&self.faces[pane.face..])?, pane.alpha)),
        };
        Ok((mesh(faces)?, pane))
    }

    /// All faces.
    pub(super) fn mesh(&self) -> Result<Mesh, RenderError> {
        Mesh::new(self.faces.clone(), self.positions.len())
    }

    /// Clip positions `[V, 4]`.
    pub fn clip<T: Scalar>(&self, frame: Frame) -> Tensor<T> {
        let scale = 2.0 * FOCAL_LENGTH * frame.scale() / frame.size().width as f64;
        let (near, far) = (0.1, 100.0);
        Tensor::from_fn([self.positions.len(), 4], |[vertex, axis]| {
            let [x, y, z] = self.positions[vertex];
            let depth = ((far + near) * z - 2.0 * far * near) / (far - near);
            T::from_f64([scale * x, scale * y, depth, z][axis])
        })
    }

    /// Attributes of the vertices, the alpha last: `[V, 5]`.
    pub(super) fn attributes<'t, T: Scalar>(&self, tape: &'t Tape<T>) -> Var<'t, T> {
        let alpha = |vertex: usize| match self.pane {
            Some(pane) if vertex >= pane.vertex => pane.alpha,
            _ => 1.0,
        };
        tape.constant(&Tensor::from_fn([self.positions.len(), 5], |[vertex, k]| {
            T::from_f64(self.attributes[vertex].get(k).copied().unwrap_or_else(|| alpha(vertex)))
        }))
    }

    /// How it is drawn with exact coverage.
    pub(super) fn exact(&self, size: Size) -> RasterOptions {
        RasterOptions::new(size).sampling(Sampling::Exact).cull(self.cull)
    }
}

/// What fragments look like: colours `[N, 2]`, alphas `[N]` and distances `[N]`.
pub(super) fn look<'t, T: Scalar>(
    attributes: Var<'t, T>,
    fragments: &Fragments<'t, T>,
) -> Result<[Var<'t, T>; 2], RenderError> {
    let values = interpolate(attributes, fragments)?;
    let waves = values.slice(1, 0..1)?.sin() * values.slice(1, 1..2)?.sin();
    let colors = values.slice(1, 2..4)? + waves * T::from_f64(0.25);
    let alpha = values.slice(1, 4..5)?.reshape([fragments.coverage.count()])?;
    Ok([colors, alpha])
}

/// The background's colour.
pub(super) fn sky<T: Scalar>(tape: &Tape<T>) -> Var<'_, T> {
    tape.constant(&Tensor::new([2], SKY.map(T::from_f64).to_vec()).expect("two numbers"))
}
