//! Scenes in clip space, drawn in either precision.

use bokashi_core::{Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    Background, Blur, Cull, Culled, Mesh, RasterOptions, RenderError, Size, antialias, composite,
    depth, gaussian_blur, interpolate, rasterize,
};

use crate::extreme::Failure;
use crate::measures::{motley, numbers};

/// Vertices in clip space, faces, and an image's size.
#[derive(Debug, Clone)]
pub(crate) struct ClipScene {
    pub(crate) clip: Vec<[f64; 4]>,
    pub(crate) faces: Vec<[u32; 3]>,
    pub(crate) size: Size,
}

/// What a pixel sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PixelFace {
    pub(crate) face: u32,
    pub(crate) uv: [f64; 2],
    pub(crate) depth: f64,
}

/// What each pixel sees, row by row from the top, and which faces were not drawn.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Drawn {
    pub(crate) pixels: Vec<Option<PixelFace>>,
    pub(crate) culled: Culled,
}

impl Drawn {
    pub(crate) fn count(&self) -> usize {
        self.pixels.iter().flatten().count()
    }

    pub(crate) fn faces(&self) -> Vec<Option<u32>> {
        self.pixels.iter().map(|seen| seen.map(|seen| seen.face)).collect()
    }

    /// How many pixels are covered here and not there, or there and not here.
    pub(crate) fn differs_from(&self, covered: &[bool]) -> usize {
        self.pixels
            .iter()
            .zip(covered)
            .filter(|(seen, covered)| seen.is_some() != **covered)
            .count()
    }
}

/// An antialiased image `[H, W, 2]` and the gradients of `sum u . image`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Rendered {
    pub(crate) image: Vec<f64>,
    pub(crate) clip_bar: Vec<f64>,
    pub(crate) color_bar: Vec<f64>,
    pub(crate) background_bar: Vec<f64>,
    pub(crate) sigma_bar: f64,
}

impl Rendered {
    pub(crate) fn is_finite(&self) -> bool {
        let all = [&self.image, &self.clip_bar, &self.color_bar, &self.background_bar];
        all.iter().all(|numbers| numbers.iter().all(|number| number.is_finite()))
            && self.sigma_bar.is_finite()
    }
}

/// The background of every scene.
pub(crate) const BACKGROUND: [f64; 2] = [0.25, -0.5];

/// The clip position of a point in pixels from the image's top left corner, where the centre of
/// column i is at i + 1/2.
pub(crate) fn at_px(size: Size, x: f64, y: f64) -> [f64; 4] {
    [2.0 * x / size.width as f64 - 1.0, 1.0 - 2.0 * y / size.height as f64, 0.0, 1.0]
}

/// The six orders of a face's corners.
pub(crate) fn orders([a, b, c]: [u32; 3]) -> [[u32; 3]; 6] {
    [[a, b, c], [b, c, a], [c, a, b], [c, b, a], [b, a, c], [a, c, b]]
}

impl ClipScene {
    pub(crate) fn new(clip: &[[f64; 4]], faces: &[[u32; 3]], size: Size) -> Self {
        Self { clip: clip.to_vec(), faces: faces.to_vec(), size }
    }

    /// Points in pixels from the top left corner.
    pub(crate) fn from_px(points: &[[f64; 2]], faces: &[[u32; 3]], size: Size) -> Self {
        let clip = points.iter().map(|&[x, y]| at_px(size, x, y)).collect();
        Self { clip, faces: faces.to_vec(), size }
    }

    pub(crate) fn with_faces(&self, faces: &[[u32; 3]]) -> Self {
        Self { faces: faces.to_vec(), ..self.clone() }
    }

    pub(crate) fn mesh(&self) -> Result<Mesh, RenderError> {
        Mesh::new(self.faces.clone(), self.clip.len())
    }

    pub(crate) fn leaf<'t, T: Scalar>(&self, tape: &'t Tape<T>) -> Var<'t, T> {
        let entry = |k: usize| T::from_f64(self.clip[k / 4][k % 4]);
        tape.leaf(&Tensor::from_flat_fn([self.clip.len(), 4], entry))
    }

    pub(crate) fn draw<T: Scalar>(&self) -> Result<Drawn, RenderError> {
        self.draw_culling::<T>(Cull::None)
    }

    pub(crate) fn draw_culling<T: Scalar>(&self, cull: Cull) -> Result<Drawn, RenderError> {
        let tape = Tape::<T>::new();
        let options = RasterOptions::new(self.size).cull(cull);
        let fragments = rasterize(self.leaf(&tape), &self.mesh()?, options)?;
        let coverage = &fragments.coverage;
        let (uv, depth) = (fragments.barycentrics.value(), depth(&fragments)?.value());
        let faces: Vec<_> = coverage.faces().collect();
        let seen = |n: usize| PixelFace {
            face: faces[n] as u32,
            uv: [uv.data()[2 * n].to_f64(), uv.data()[2 * n + 1].to_f64()],
            depth: depth.data()[n].to_f64(),
        };
        let pixel = |pixel| coverage.fragment_at(pixel).map(seen);
        let pixels = (0..self.size.pixels()).map(pixel).collect();
        Ok(Drawn { pixels, culled: coverage.culled() })
    }

    /// How many of the faces, each drawn alone, cover each pixel.
    pub(crate) fn layers<T: Scalar>(&self) -> Result<Vec<usize>, RenderError> {
        let mut layers = vec![0; self.size.pixels()];
        for &face in &self.faces {
            let drawn = self.with_faces(&[face]).draw::<T>()?;
            for (count, seen) in layers.iter_mut().zip(drawn.pixels) {
                *count += usize::from(seen.is_some());
            }
        }
        Ok(layers)
    }

    /// The gradient of `sum u + 2 v + 3 depth` with respect to the clip positions.
    pub(crate) fn surface_gradient<T: Scalar>(&self) -> Result<Vec<f64>, Failure> {
        let tape = Tape::<T>::new();
        let clip = self.leaf(&tape);
        let fragments = rasterize(clip, &self.mesh()?, self.size)?;
        let uv_bar = Tensor::from_flat_fn(fragments.barycentrics.shape(), |k| {
            T::from_f64(1.0 + (k % 2) as f64)
        });
        let depth = depth(&fragments)?;
        let depth_bar = Tensor::full(depth.shape(), T::from_f64(3.0));
        let seeds = [(fragments.barycentrics, &uv_bar), (depth, &depth_bar)];
        Ok(numbers(&tape.vjp(&seeds)?.get_or_zeros(clip)))
    }

    /// The antialiased image of motley colours, blurred with `sigma` where there is one, and
    /// gradients for motley upstream.
    pub(crate) fn rendered<T: Scalar>(&self, sigma: Option<f64>) -> Result<Rendered, Failure> {
        self.rendered_with::<T>(sigma, |k| motley(3 * k + 1))
    }

    /// The same with the upstream gradient `upstream(k)` at entry k of the image.
    pub(crate) fn rendered_with<T: Scalar>(
        &self,
        sigma: Option<f64>,
        upstream: impl Fn(usize) -> f64,
    ) -> Result<Rendered, Failure> {
        let tape = Tape::<T>::new();
        let clip = self.leaf(&tape);
        let number = |k: usize| T::from_f64(motley(k));
        let colors = tape.leaf(&Tensor::from_flat_fn([self.clip.len(), 2], number));
        let behind = tape.leaf(&Tensor::from_flat_fn([2], |k| T::from_f64(BACKGROUND[k])));
        let fragments = rasterize(clip, &self.mesh()?, self.size)?;
        let surface = interpolate(colors, &fragments)?;
        let picture = antialias(composite(surface, &fragments, Background::Color(behind))?)?;
        let mut image = picture.image()?;
        let deviation = tape.leaf_scalar(T::from_f64(sigma.unwrap_or(1.0)));
        if sigma.is_some() {
            image = gaussian_blur(image, deviation, &Blur::default())?;
        }
        let upstream = Tensor::from_flat_fn(image.shape(), |k| T::from_f64(upstream(k)));
        let gradients = tape.vjp(&[(image, &upstream)])?;
        let gradient = |leaf| numbers(&gradients.get_or_zeros(leaf));
        Ok(Rendered {
            image: numbers(&image.value()),
            clip_bar: gradient(clip),
            color_bar: gradient(colors),
            background_bar: gradient(behind),
            sigma_bar: gradient(deviation)[0],
        })
    }
}

/// 1 where a number of the image, or a gradient of it or of the surface, is not finite.
pub(crate) fn not_finite<T: Scalar>(scene: &ClipScene) -> Result<usize, Failure> {
    let finite = scene.rendered::<T>(Some(0.9))?.is_finite()
        && scene.surface_gradient::<T>()?.iter().all(|bar| bar.is_finite());
    Ok(usize::from(!finite))
}

/// How many faces lie over one pixel.
const MANY: usize = 1_000_000;

/// Faces that share an edge, all over the middle pixel of 3 x 3, each with a depth of its own at its
/// third vertex; and the nearest one, with that depth.
pub(crate) fn many_faces<T: Scalar>() -> Result<(Tensor<T>, Mesh, usize, f64), Failure> {
    let depth = |k: usize| ((k * 7919 + 13) % MANY) as f64 / f64::powi(2.0, 20);
    let clip = |k: usize| match k {
        0 => [-0.25, -0.25, 0.0, 1.0],
        1 => [0.25, -0.25, 0.0, 1.0],
        k => [0.0, 0.25, depth(k - 2), 1.0],
    };
    let clip = Tensor::from_flat_fn([MANY + 2, 4], |k| T::from_f64(clip(k / 4)[k % 4]));
    let mesh = Mesh::new((0..MANY as u32).map(|k| [0, 1, k + 2]).collect(), MANY + 2)?;
    let nearest = (0..MANY).min_by(|&a, &b| depth(a).total_cmp(&depth(b))).unwrap_or(0);
    Ok((clip, mesh, nearest, depth(nearest)))
}
