//! A step on a mesh from a file: from positions and what colours them to a loss and its gradients.

use std::collections::HashSet;
use std::hint::black_box;

use bokashi_core::{Tape, Tensor, Var};
use bokashi_fit::FitError;
use bokashi_render_ops::{
    Background, Coverage, Cull, Detail, Fragments, Mesh, Picture, PixelLoss, RasterOptions,
    Sampler, Silhouettes, Size, Texture, differentials, interpolate_differentials_indexed,
    interpolate_indexed, project, rasterize, sample_texture,
};
use glam::DMat4;

use crate::bench::mesh_file::{Look, MeshFile};
use crate::bench::scenes::Scene;

/// How a mesh is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Way {
    Antialias,
    /// Exact coverage, no edge a seam.
    Plain,
    /// Exact coverage, creases found in each step.
    Exact,
}

/// All of them, in the order of columns.
pub(super) const WAYS: [Way; 3] = [Way::Antialias, Way::Plain, Way::Exact];

/// Positions are off as those of the step's table: this share of the image, 0.3 pixels at 256.
const SHIFT: f64 = 0.3 / 256.0;
/// Colours and texels are this far off in the reference image.
const TINT: f32 = 0.05;

/// What is drawn, and from where.
pub(super) struct View<'a> {
    pub(super) file: &'a MeshFile,
    pub(super) camera: DMat4,
    pub(super) size: Size,
    pub(super) cull: Cull,
}

impl View<'_> {
    /// The view as a scene, a colour per vertex.
    pub(super) fn scene(&self) -> Scene {
        Scene {
            name: self.file.name.clone(),
            mesh: self.file.mesh.clone(),
            positions: self.file.positions.clone(),
            colors: self.file.vertex_colors(),
            camera: self.camera,
            size: self.size,
            has_creases: false,
        }
    }

    /// Positions off within the image plane.
    pub(super) fn shifted(&self) -> Tensor<f64> {
        self.scene().jittered(SHIFT * self.size.width as f64, 0)
    }
}

/// How many there are of what a step works on.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Counts {
    /// Faces of which anything is seen.
    pub(super) faces: usize,
    /// All fragments.
    pub(super) fragments: usize,
    pub(super) boundary: usize,
    pub(super) pieces: usize,
}

impl Counts {
    fn new(coverage: &Coverage) -> Self {
        let counts = coverage.boundary_counts();
        Self {
            faces: coverage.faces().collect::<HashSet<_>>().len(),
            fragments: coverage.count(),
            boundary: counts.pixels,
            pieces: counts.pieces,
        }
    }
}

/// A fit of a mesh to one image, one step after the other.
pub(super) struct Stepper {
    mesh: Mesh,
    options: RasterOptions,
    has_creases: bool,
    camera: DMat4,
    positions: Tensor<f32>,
    /// Colours, or none.
    colors: Option<Tensor<f32>>,
    /// Which of the colours or of the texture coordinates the corners have.
    indices: Mesh,
    /// Texture coordinates, and the levels of the texture: it is known.
    texture: Option<(Tensor<f32>, Vec<Tensor<f32>>)>,
    reference: PixelLoss<f32>,
    tape: Tape<f32>,
}

impl Stepper {
    /// From `positions` to the image of the file's own, whose colours are a little off.
    pub(super) fn new(
        view: &View<'_>,
        way: Way,
        positions: &Tensor<f64>,
    ) -> Result<Self, FitError> {
        let View { file, camera, size, cull } = view;
        let silhouettes =
            if way == Way::Antialias { Silhouettes::Antialias } else { Silhouettes::Exact };
        let tinted = |texels: &Tensor<f32>| texels.map(|x: f32| (x + TINT).min(1.0));
        let (colors, indices, texture) = match &file.look {
            Look::Colors(rows, indices) => (Some(rows.clone()), indices.clone(), None),
            Look::Places(rows) => (Some(rows.clone()), file.mesh.clone(), None),
            Look::Texture(coordinates, indices, texels) => {
                let levels = levels(&tinted(texels))?;
                (None, indices.clone(), Some((coordinates.clone(), levels)))
            }
        };
        let mut stepper = Self {
            mesh: file.mesh.clone(),
            options: RasterOptions::new(*size).cull(*cull).silhouettes(silhouettes),
            has_creases: way == Way::Exact,
            camera: *camera,
            positions: file.positions.cast(),
            colors: colors.as_ref().map(tinted),
            indices,
            texture,
            reference: PixelLoss::squared(
                &Tensor::zeros([size.height, size.width, 3]),
                &Tensor::zeros([3]),
            )?,
            tape: Tape::new(),
        };
        let image = {
            let tape = Tape::new();
            let positions = tape.constant(&stepper.positions);
            let colors = stepper.colors.as_ref().map(|colors| tape.constant(colors));
            stepper.picture(positions, colors)?.image()?.value()
        };
        stepper.reference = PixelLoss::squared(&image, &Tensor::zeros([3]))?;
        stepper.positions = positions.cast();
        stepper.colors = colors;
        if let (Look::Texture(.., texels), Some((_, mipmaps))) = (&file.look, &mut stepper.texture)
        {
            *mipmaps = levels(texels)?;
        }
        Ok(stepper)
    }

    /// The fragments of the mesh; its creases are resolved where the way has them.
    fn fragments<'t>(
        &self,
        clip: Var<'t, f32>,
        rows: Var<'t, f32>,
    ) -> Result<Fragments<'t, f32>, FitError> {
        let shown = [(rows, &self.indices).into()];
        let creases = if self.has_creases { &shown[..] } else { &[] };
        Ok(rasterize(clip, &self.mesh, self.options.creases(creases))?)
    }

    fn picture<'t>(
        &self,
        positions: Var<'t, f32>,
        colors: Option<Var<'t, f32>>,
    ) -> Result<Picture<'t, f32>, FitError> {
        let tape = positions.tape();
        let clip = project(positions, &self.camera, None)?;
        let coordinates = self.texture.as_ref().map(|(rows, _)| tape.constant(rows));
        let rows = colors.or(coordinates).expect("there are colours or a texture");
        let fragments = self.fragments(clip, rows)?;
        let mut surface = interpolate_indexed(rows, &self.indices, &fragments)?;
        if let Some((_, levels)) = &self.texture {
            let levels: Vec<_> = levels.iter().map(|level| tape.constant(level)).collect();
            let texture = Texture::from_levels(&levels)?;
            let bends = differentials(&fragments)?;
            let differentials =
                interpolate_differentials_indexed(rows, &self.indices, &fragments, bends)?;
            let detail = Detail::Differentials { differentials, bias: None };
            surface = sample_texture(&texture, surface, detail, Sampler::new())?;
        }
        Ok(fragments.picture(surface, Background::Zero)?)
    }

    /// One step of a fit without its optimizer; the loss, and the gradient of the positions.
    pub(super) fn step(&mut self) -> Result<(f32, Tensor<f32>), FitError> {
        let tape = std::mem::take(&mut self.tape);
        let loss_and_gradient = {
            let positions = tape.leaf(&self.positions);
            let colors = self.colors.as_ref().map(|colors| tape.leaf(colors));
            let loss = self.picture(positions, colors)?.loss(&self.reference)?;
            let gradients = loss.backward()?;
            black_box(colors.map(|colors| gradients.get(colors).is_some()));
            (loss.item(), gradients.get_or_zeros(positions))
        };
        self.tape = tape;
        self.tape.reset();
        Ok(loss_and_gradient)
    }

    /// What its picture is made of.
    pub(super) fn counts(&self) -> Result<Counts, FitError> {
        let tape = Tape::new();
        let clip = project(tape.constant(&self.positions), &self.camera, None)?;
        let rows = match (&self.colors, &self.texture) {
            (Some(colors), _) => tape.constant(colors),
            (None, Some((coordinates, _))) => tape.constant(coordinates),
            (None, None) => unreachable!("there are colours or a texture"),
        };
        Ok(Counts::new(&self.fragments(clip, rows)?.coverage))
    }
}

/// A texture and its mipmaps.
fn levels(texels: &Tensor<f32>) -> Result<Vec<Tensor<f32>>, FitError> {
    let tape = Tape::new();
    let texture = Texture::with_mipmaps(tape.constant(texels))?;
    Ok(texture.levels().iter().map(|level| level.value()).collect())
}
