//! Textures.

use bokashi_core::{OutputVars, Scalar, Var};
use bokashi_render_ops::{
    self as ops, CubeMap, Detail, Sampler, Texture, TextureBorder, TextureFilter,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::array::{Array, by_type};
use crate::error::Refusal;
use crate::step::{Given, Recorded, record};
use smallvec::smallvec;

fn filter(word: &str, probes: usize) -> PyResult<TextureFilter> {
    match word {
        "nearest" => Ok(TextureFilter::Nearest),
        "bilinear" => Ok(TextureFilter::Bilinear),
        "trilinear" => Ok(TextureFilter::Trilinear),
        "anisotropic" => Ok(TextureFilter::Anisotropic { probes }),
        _ => Err(PyValueError::new_err(format!(
            "filter needs to be nearest, bilinear, trilinear or anisotropic, got {word:?}"
        ))),
    }
}

fn border(word: &str) -> PyResult<TextureBorder> {
    match word {
        "wrap" => Ok(TextureBorder::Wrap),
        "mirror" => Ok(TextureBorder::Mirror),
        "clamp" => Ok(TextureBorder::Clamp),
        "zero" => Ok(TextureBorder::Zero),
        _ => Err(PyValueError::new_err(format!(
            "border needs to be wrap, mirror, clamp or zero, got {word:?}"
        ))),
    }
}

/// Coordinates, level, differentials, bias, and levels: what a sample is made of.
struct SampleInputs<'t, T: Scalar> {
    coordinates: Var<'t, T>,
    detail: Detail<'t, T>,
    levels: Vec<Var<'t, T>>,
}

impl<'t, T: Scalar> SampleInputs<'t, T> {
    fn new(x: &Given<'t, T>) -> Self {
        let detail = match (x[1], x[2]) {
            (Some(level), _) => Detail::Level(level),
            (None, Some(differentials)) => Detail::Differentials { differentials, bias: x[3] },
            (None, None) => Detail::Finest,
        };
        let coordinates = x[0].expect("they are required");
        Self { coordinates, detail, levels: x[4..].iter().copied().flatten().collect() }
    }
}

/// Inputs: coordinates, level, differentials, bias, then the levels, or texels alone. With `mipmaps` coarser levels are
/// made of the texels.
macro_rules! sample {
    ($name:ident, $texture:ident, $call:ident) => {
        #[pyfunction]
        #[pyo3(signature = (
            coordinates, level, differentials, bias, levels, filter="trilinear", borders=("wrap", "wrap"), coarsest=None,
            probes=8, mipmaps=false
        ))]
        #[expect(clippy::too_many_arguments, reason = "Python has names for them")]
        pub fn $name<'py>(
            py: Python<'py>,
            coordinates: Array<'py>,
            level: Option<Array<'py>>,
            differentials: Option<Array<'py>>,
            bias: Option<Array<'py>>,
            levels: Vec<Array<'py>>,
            filter: &str,
            borders: (&str, &str),
            coarsest: Option<usize>,
            probes: usize,
            mipmaps: bool,
        ) -> Recorded<'py> {
            let filter = self::filter(filter, probes)?;
            let borders = [border(borders.0)?, border(borders.1)?];
            let sampler = Sampler { filter, borders, coarsest };
            let mut inputs = vec![Some(&coordinates), level.as_ref(), differentials.as_ref(), bias.as_ref()];
            inputs.extend(levels.iter().map(Some));
            by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
                let inputs_of = SampleInputs::new(x);
                let texture = match inputs_of.levels[..] {
                    [texels] if mipmaps => $texture::with_mipmaps(texels)?,
                    _ => $texture::from_levels(&inputs_of.levels)?,
                };
                Ok(smallvec![ops::$call(&texture, inputs_of.coordinates, inputs_of.detail, sampler)?])
            }))
        }
    };
}

sample!(sample_texture, Texture, sample_texture);
sample!(sample_cube_map, CubeMap, sample_cube_map);

/// The coarser levels of texels `[H, W, C]`, or of a cube map's `[6, S, S, C]`, down to a single texel or level
/// `coarsest`.
#[pyfunction]
#[pyo3(signature = (texels, coarsest=None))]
pub fn mipmaps<'py>(py: Python<'py>, texels: Array<'py>, coarsest: Option<usize>) -> Recorded<'py> {
    let inputs = [Some(&texels)];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let texels = x[0].expect("they are required");
        let levels: OutputVars<'_, T> = match texels.shape().rank() {
            4 => CubeMap::with_mipmaps(texels).map_err(Refusal::from)?.levels().iter().copied().collect(),
            _ => Texture::with_mipmaps(texels).map_err(Refusal::from)?.levels().iter().copied().collect(),
        };
        Ok(levels.into_iter().skip(1).take(coarsest.unwrap_or(usize::MAX)).collect())
    }))
}
