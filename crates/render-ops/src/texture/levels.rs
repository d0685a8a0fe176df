//! Textures and cube maps: levels of detail, from the finest on.

use bokashi_core::{Scalar, Shape, Tape, Tensor, TensorError, Var};
use glam::DVec3;

use crate::cube_faces::towards_texel;
use crate::error::RenderError;
use crate::mipmaps::{half, halved};

/// An image that is looked up on surfaces, perhaps with coarser levels of itself.
#[derive(Debug, Clone)]
pub struct Texture<'t, T: Scalar> {
    pub(super) levels: Vec<Var<'t, T>>,
}

/// Six images around a point, one on each side of a cube, that are looked up by direction; perhaps
/// with coarser levels of themselves.
///
/// Faces are +x, -x, +y, -y, +z, -z. Seen from the middle of the cube, they are laid out as in OpenGL.
#[derive(Debug, Clone)]
pub struct CubeMap<'t, T: Scalar> {
    pub(super) levels: Vec<Var<'t, T>>,
}

/// A texture that does not change, which outlives a step: see [`Texture::constant`].
#[derive(Debug, Clone)]
pub struct ConstantTexture<T: Scalar> {
    levels: Vec<Tensor<T>>,
}

/// A cube map that does not change, which outlives a step: see [`CubeMap::constant`].
#[derive(Debug, Clone)]
pub struct ConstantCubeMap<T: Scalar> {
    levels: Vec<Tensor<T>>,
}

/// # Errors
/// [`RenderError::Shape`] with `rule`.
fn refused<T>(operation: &'static str, rule: String, shape: Shape) -> Result<T, RenderError> {
    Err(RenderError::Shape { operation, rule, shape })
}

/// Whether there is an entry, and texels have numbers of 32 bits.
fn can_be_counted(texels: usize, channels: usize) -> bool {
    texels * channels > 0 && i32::try_from(texels).is_ok()
}

/// All levels down to a single texel or level `coarsest`.
///
/// # Errors
/// None that a level of the right shape causes.
fn levels_to<'t, T: Scalar>(
    finest: Var<'t, T>,
    coarsest: usize,
) -> Result<Vec<Var<'t, T>>, RenderError> {
    let mut levels = vec![finest];
    let mut level = finest;
    while levels.len() <= coarsest {
        let shape = level.shape();
        let &[.., height, width, _] = &*shape else { return Ok(levels) };
        if height <= 1 && width <= 1 {
            return Ok(levels);
        }
        level = halved(level)?;
        levels.push(level);
    }
    Ok(levels)
}

/// The levels on `tape`, as constants. It copies nothing.
fn constants<'t, T: Scalar>(levels: &[Tensor<T>], tape: &'t Tape<T>) -> Vec<Var<'t, T>> {
    levels.iter().map(|level| tape.constant(level)).collect()
}

/// The levels, where each has half the extents of the level before.
///
/// # Errors
/// [`RenderError::Shape`] where a level has another shape; [`TensorError::Inputs`] without a level;
/// [`TensorError::ForeignVariable`] for variables of several tapes.
fn checked<'t, T: Scalar>(
    operation: &'static str,
    levels: &[Var<'t, T>],
) -> Result<Vec<Var<'t, T>>, RenderError> {
    let Some(first) = levels.first() else {
        let rule = "at least one level".into();
        return Err(TensorError::Inputs { operation, rule, given: 0 }.into());
    };
    let mut expected = first.shape().to_vec();
    for (k, level) in levels.iter().enumerate() {
        if !std::ptr::eq(level.tape(), first.tape()) {
            return Err(TensorError::ForeignVariable { operation }.into());
        }
        if *level.shape() != expected[..] {
            return refused(operation, format!("a level {k} of shape {expected:?}"), level.shape());
        }
        if let [.., height, width, _] = expected.as_mut_slice() {
            (*height, *width) = (half(*height), half(*width));
        }
    }
    Ok(levels.to_vec())
}

impl<'t, T: Scalar> Texture<'t, T> {
    const OPERATION: &'static str = "a texture";

    fn check(texels: Var<'t, T>) -> Result<(), RenderError> {
        match *texels.shape() {
            [height, width, channels] if can_be_counted(height * width, channels) => Ok(()),
            _ => refused(
                Self::OPERATION,
                "texels of shape [H, W, C], at least one entry and less than 2^31 texels".into(),
                texels.shape(),
            ),
        }
    }

    /// The texture of `texels: [H, W, C]` without coarser levels.
    ///
    /// # Errors
    /// [`RenderError::Shape`] unless the texels are `[H, W, C]` with at least one entry and less
    /// than 2^31 texels.
    pub fn new(texels: Var<'t, T>) -> Result<Self, RenderError> {
        Self::check(texels)?;
        Ok(Self { levels: vec![texels] })
    }

    /// The texture of `texels: [H, W, C]` with all coarser levels, each half as large along each axis,
    /// rounded down. Gradients of the coarser levels lead back to the texels. The levels cost a third
    /// of the texels' memory again; make them once per step, and not once per sample.
    ///
    /// # Errors
    /// As [`Texture::new`].
    pub fn with_mipmaps(texels: Var<'t, T>) -> Result<Self, RenderError> {
        Self::with_mipmaps_to(texels, usize::MAX)
    }

    /// The same without the levels that are coarser than level `coarsest`: for samplers that use none of
    /// them, see [`Sampler::coarsest`](crate::Sampler::coarsest). Level 0 has the texels as they are.
    ///
    /// # Errors
    /// As [`Texture::new`].
    pub fn with_mipmaps_to(texels: Var<'t, T>, coarsest: usize) -> Result<Self, RenderError> {
        Self::check(texels)?;
        Ok(Self { levels: levels_to(texels, coarsest)? })
    }

    /// The texture of `levels` of the caller's own, the finest first. Each has half the height and
    /// width of the level before, rounded down, and at least 1.
    ///
    /// # Errors
    /// [`RenderError::Shape`] where a level has another shape; `TensorError::Inputs` without a level;
    /// `TensorError::ForeignVariable` for variables of several tapes.
    pub fn from_levels(levels: &[Var<'t, T>]) -> Result<Self, RenderError> {
        if let Some(&first) = levels.first() {
            Self::check(first)?;
        }
        Ok(Self { levels: checked(Self::OPERATION, levels)? })
    }

    /// The levels, the finest first.
    pub fn levels(&self) -> &[Var<'t, T>] {
        &self.levels
    }

    /// The texture without its tape, for other steps and other tapes: of texels that do not change, whose
    /// mipmaps need be made once. It copies nothing.
    pub fn constant(&self) -> ConstantTexture<T> {
        ConstantTexture { levels: self.levels.iter().map(|level| level.value()).collect() }
    }
}

impl<T: Scalar> ConstantTexture<T> {
    /// The texture on `tape`, as constants: samples of it have no gradient of the texels. It copies
    /// nothing.
    pub fn on<'t>(&self, tape: &'t Tape<T>) -> Texture<'t, T> {
        Texture { levels: constants(&self.levels, tape) }
    }

    /// The levels, the finest first.
    pub fn levels(&self) -> &[Tensor<T>] {
        &self.levels
    }
}

impl<'t, T: Scalar> CubeMap<'t, T> {
    const OPERATION: &'static str = "a cube map";

    fn check(texels: Var<'t, T>) -> Result<(), RenderError> {
        match *texels.shape() {
            [6, height, width, channels]
                if height == width && can_be_counted(6 * height * width, channels) =>
            {
                Ok(())
            }
            _ => refused(
                Self::OPERATION,
                "texels of shape [6, S, S, C], at least one entry and less than 2^31 texels".into(),
                texels.shape(),
            ),
        }
    }

    /// The cube map of `texels: [6, S, S, C]` without coarser levels.
    ///
    /// # Errors
    /// [`RenderError::Shape`] unless the texels are `[6, S, S, C]` with at least one entry and less
    /// than 2^31 texels.
    pub fn new(texels: Var<'t, T>) -> Result<Self, RenderError> {
        Self::check(texels)?;
        Ok(Self { levels: vec![texels] })
    }

    /// The cube map of `texels: [6, S, S, C]` with all coarser levels, as in
    /// [`Texture::with_mipmaps`]. Each face is averaged alone.
    ///
    /// # Errors
    /// As [`CubeMap::new`].
    pub fn with_mipmaps(texels: Var<'t, T>) -> Result<Self, RenderError> {
        Self::with_mipmaps_to(texels, usize::MAX)
    }

    /// The same without the levels that are coarser than level `coarsest`, as in
    /// [`Texture::with_mipmaps_to`].
    ///
    /// # Errors
    /// As [`CubeMap::new`].
    pub fn with_mipmaps_to(texels: Var<'t, T>, coarsest: usize) -> Result<Self, RenderError> {
        Self::check(texels)?;
        Ok(Self { levels: levels_to(texels, coarsest)? })
    }

    /// The cube map of `levels` of the caller's own, as in [`Texture::from_levels`]: light that was
    /// filtered for each roughness, say.
    ///
    /// # Errors
    /// As [`Texture::from_levels`].
    pub fn from_levels(levels: &[Var<'t, T>]) -> Result<Self, RenderError> {
        if let Some(&first) = levels.first() {
            Self::check(first)?;
        }
        Ok(Self { levels: checked(Self::OPERATION, levels)? })
    }

    /// The direction to the centre of each texel of cube maps with this side, `[6, S, S, 3]`, of length 1:
    /// for filling a map with what a function says of directions.
    ///
    /// ```
    /// use bokashi_render_ops::CubeMap;
    ///
    /// // The texel in the middle of +x.
    /// let directions = CubeMap::<f64>::directions(3);
    /// assert_eq!(directions.data()[12..15], [1.0, 0.0, 0.0]);
    /// ```
    pub fn directions(side: usize) -> Tensor<T> {
        let mut unit = DVec3::X;
        Tensor::from_fn([6, side, side, 3], |[face, row, column, axis]| {
            if axis == 0 {
                let towards = towards_texel(face, [row as isize, column as isize], side);
                unit = DVec3::from_array(towards).normalize();
            }
            T::from_f64(unit[axis])
        })
    }

    /// The levels, the finest first.
    pub fn levels(&self) -> &[Var<'t, T>] {
        &self.levels
    }

    /// The cube map without its tape, as in [`Texture::constant`].
    pub fn constant(&self) -> ConstantCubeMap<T> {
        ConstantCubeMap { levels: self.levels.iter().map(|level| level.value()).collect() }
    }
}

impl<T: Scalar> ConstantCubeMap<T> {
    /// The cube map on `tape`, as in [`ConstantTexture::on`].
    pub fn on<'t>(&self, tape: &'t Tape<T>) -> CubeMap<'t, T> {
        CubeMap { levels: constants(&self.levels, tape) }
    }

    /// The levels, the finest first.
    pub fn levels(&self) -> &[Tensor<T>] {
        &self.levels
    }
}
