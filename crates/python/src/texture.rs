//! Textures.

use bokashi_core::{OutputVars, Scalar, Tape, Tensor, Var};
use bokashi_render_ops::{
    self as ops, ConstantCubeMap, ConstantTexture, CubeMap, Detail, Sampler, TextureBorder,
    TextureFilter,
};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use smallvec::smallvec;

use crate::array::{Array, Number, NumberType, View, by_type};
use crate::casts::Casts;
use crate::error::{Refusal, RenderError};
use crate::step::{Given, Recorded, record};
use crate::threads::released;

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
/// made of the texels, and with `constant` all levels are those of a constant texture.
macro_rules! sample {
    ($name:ident, $texture:ident, $kind:ident) => {
        #[pyfunction]
        #[pyo3(signature = (
            coordinates, level, differentials, bias, levels, filter="trilinear", borders=("wrap", "wrap"), coarsest=None,
            probes=8, mipmaps=false, constant=None
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
            constant: Option<&Texture>,
        ) -> Recorded<'py> {
            let filter = self::filter(filter, probes)?;
            let borders = [border(borders.0)?, border(borders.1)?];
            let sampler = Sampler { filter, borders, coarsest };
            let mut inputs = vec![Some(&coordinates), level.as_ref(), differentials.as_ref(), bias.as_ref()];
            inputs.extend(levels.iter().map(Some));
            by_type!(&inputs, T => {
                let levels = constant.map(Texture::cast::<T>).transpose()?;
                let constant = levels.map(|levels| levels.$kind()).transpose()?;
                record::<T>(py, &inputs, |tape, x| {
                    let inputs_of = SampleInputs::new(x);
                    let texture = match (&inputs_of.levels[..], &constant) {
                        (_, Some(constant)) => constant.on(tape),
                        (&[texels], None) if mipmaps => {
                            ops::$texture::with_mipmaps_to(texels, coarsest.unwrap_or(usize::MAX))?
                        }
                        (levels, None) => ops::$texture::from_levels(levels)?,
                    };
                    Ok(smallvec![ops::$name(&texture, inputs_of.coordinates, inputs_of.detail, sampler)?])
                })
            })
        }
    };
}

sample!(sample_texture, Texture, plane);
sample!(sample_cube_map, CubeMap, cube);

/// The coarser levels of texels `[H, W, C]`, or of a cube map's `[6, S, S, C]`, down to a single texel or level
/// `coarsest`.
#[pyfunction]
#[pyo3(signature = (texels, coarsest=None))]
pub fn mipmaps<'py>(py: Python<'py>, texels: Array<'py>, coarsest: Option<usize>) -> Recorded<'py> {
    let inputs = [Some(&texels)];
    by_type!(&inputs, T => record::<T>(py, &inputs, |_, x| {
        let levels = levels_to(x[0].expect("they are required"), coarsest)?;
        Ok(levels.into_iter().skip(1).collect())
    }))
}

/// All levels of texels, or of a cube map's, down to a single texel or level `coarsest`.
fn levels_to<'t, T: Scalar>(
    texels: Var<'t, T>,
    coarsest: Option<usize>,
) -> Result<OutputVars<'t, T>, ops::RenderError> {
    let coarsest = coarsest.unwrap_or(usize::MAX);
    Ok(match texels.shape().rank() {
        4 => CubeMap::with_mipmaps_to(texels, coarsest)?.levels().iter().copied().collect(),
        _ => ops::Texture::with_mipmaps_to(texels, coarsest)?.levels().iter().copied().collect(),
    })
}

const CHECKED: &str = "levels of the same shapes are a texture";

/// The levels of a constant texture or cube map.
#[derive(Clone)]
enum Levels<T: Scalar> {
    Plane(ConstantTexture<T>),
    Cube(ConstantCubeMap<T>),
}

impl<T: Number> Levels<T> {
    fn new(
        py: Python<'_>,
        texels: &Array<'_>,
        mips: &[Array<'_>],
        coarsest: Option<usize>,
    ) -> PyResult<Self> {
        let views = std::iter::once(texels).chain(mips).map(Array::view::<T>);
        let views: Vec<_> = views.collect::<PyResult<_>>()?;
        let made = released(py, || {
            let tape = Tape::<T>::new();
            let mut levels = Vec::new();
            for (shape, entries) in views {
                levels.push(tape.constant_of(shape, &entries)?);
            }
            if let [texels] = levels[..] {
                levels = levels_to(texels, coarsest)?.to_vec();
            }
            Ok::<_, Refusal>(match levels[0].shape().rank() {
                4 => Self::Cube(CubeMap::from_levels(&levels)?.constant()),
                _ => Self::Plane(ops::Texture::from_levels(&levels)?.constant()),
            })
        });
        Ok(made?)
    }

    /// The same levels of other numbers.
    fn cast<U: Number>(&self) -> Levels<U> {
        let tape = Tape::<U>::new();
        let levels: Vec<_> =
            self.tensors().iter().map(|level| tape.constant(&level.cast())).collect();
        match self {
            Self::Plane(_) => {
                Levels::Plane(ops::Texture::from_levels(&levels).expect(CHECKED).constant())
            }
            Self::Cube(_) => Levels::Cube(CubeMap::from_levels(&levels).expect(CHECKED).constant()),
        }
    }

    fn tensors(&self) -> &[Tensor<T>] {
        match self {
            Self::Plane(texture) => texture.levels(),
            Self::Cube(map) => map.levels(),
        }
    }

    fn shapes(&self) -> Vec<&[usize]> {
        self.tensors().iter().map(|level| &level.shape()[..]).collect()
    }

    fn to_arrays<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyAny>>> {
        self.tensors().iter().map(|level| T::to_array(py, level.clone())).collect()
    }

    fn plane(self) -> PyResult<ConstantTexture<T>> {
        match self {
            Self::Plane(texture) => Ok(texture),
            Self::Cube(_) => Err(RenderError::new_err(
                "sample_texture needs a texture of texels [H, W, C], got a cube map",
            )),
        }
    }

    fn cube(self) -> PyResult<ConstantCubeMap<T>> {
        match self {
            Self::Cube(map) => Ok(map),
            Self::Plane(_) => Err(RenderError::new_err(
                "sample_cube_map needs a texture of texels [6, S, S, C], got one of texels [H, W, C]",
            )),
        }
    }

    /// Whether the first levels are these, bit by bit.
    fn hold(&self, py: Python<'_>, levels: &[Array<'_>]) -> bool {
        let (own, views) = (self.tensors(), levels.iter().map(Array::view::<T>));
        let Ok(views) = views.collect::<PyResult<Vec<_>>>() else { return false };
        let is_own = |((shape, entries), own): (View<'_, T>, &Tensor<T>)| {
            *shape == **own.shape() && are_same(&entries, own.data())
        };
        levels.len() <= own.len() && released(py, || views.into_iter().zip(own).all(is_own))
    }
}

/// Whether numbers are the same, bit by bit: zeros have a sign, and NaN is itself.
fn are_same<T: Number>(a: &[T], b: &[T]) -> bool {
    let bits = |number: T| number.to_f64().to_bits();
    // In pieces without a way out, which are compared as vectors.
    let pieces = a.chunks(1024).zip(b.chunks(1024));
    a.len() == b.len()
        && pieces.fold(true, |same, (a, b)| {
            same && a.iter().zip(b).fold(true, |same, (&a, &b)| same & (bits(a) == bits(b)))
        })
}

/// Levels of either type of numbers.
enum Kind {
    Single(Casts<Levels<f32>>),
    Double(Casts<Levels<f64>>),
}

/// Constant texels, `[H, W, C]`, or a cube map's, `[6, S, S, C]`, with their mipmaps.
#[pyclass(frozen, module = "bokashi")]
pub struct Texture(Kind);

impl Texture {
    /// # Errors
    /// `TypeError` for a texture of other numbers, unless they only lack tangents: these are 0.
    fn cast<T: Number>(&self) -> PyResult<Levels<T>> {
        match (&self.0, T::TYPE) {
            (Kind::Single(levels), NumberType::Single | NumberType::Dual) => {
                Ok(levels.get(Levels::cast))
            }
            (Kind::Double(levels), NumberType::Double | NumberType::Dual) => {
                Ok(levels.get(Levels::cast))
            }
            _ => {
                let needed = T::NAME;
                Err(PyTypeError::new_err(format!(
                    "a call needs arrays of one type, got a texture of another beside {needed}"
                )))
            }
        }
    }

    /// The shape of each level.
    fn shapes(&self) -> Vec<&[usize]> {
        match &self.0 {
            Kind::Single(levels) => levels.original().shapes(),
            Kind::Double(levels) => levels.original().shapes(),
        }
    }
}

#[pymethods]
impl Texture {
    /// The coarser levels are `mips`, or they are made of the texels, down to a single texel or level `coarsest`. All is
    /// copied.
    #[new]
    #[pyo3(signature = (texels, *, mips=None, coarsest=None))]
    fn new(
        py: Python<'_>,
        texels: Array<'_>,
        mips: Option<Vec<Array<'_>>>,
        coarsest: Option<usize>,
    ) -> PyResult<Self> {
        let mips = mips.unwrap_or_default();
        if coarsest.is_some() && !mips.is_empty() {
            return Err(RenderError::new_err(
                "a texture has mips of its own, or makes them down to level `coarsest`, got both",
            ));
        }
        Ok(Self(match texels {
            Array::Single(_) => {
                Kind::Single(Casts::new(Levels::new(py, &texels, &mips, coarsest)?))
            }
            Array::Double(_) => {
                Kind::Double(Casts::new(Levels::new(py, &texels, &mips, coarsest)?))
            }
            Array::Dual(_) => {
                return Err(PyTypeError::new_err("a constant texture has no tangent, got one"));
            }
        }))
    }

    /// The texels and the coarser levels, copied.
    #[getter]
    fn levels<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyAny>>> {
        match &self.0 {
            Kind::Single(levels) => levels.original().to_arrays(py),
            Kind::Double(levels) => levels.original().to_arrays(py),
        }
    }

    /// The shape of the texels.
    #[getter]
    fn shape<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyTuple>> {
        PyTuple::new(py, self.shapes()[0])
    }

    /// Whether its first levels are these arrays, bit by bit.
    fn holds(&self, py: Python<'_>, levels: Vec<Array<'_>>) -> bool {
        match &self.0 {
            Kind::Single(own) => own.original().hold(py, &levels),
            Kind::Double(own) => own.original().hold(py, &levels),
        }
    }

    fn __len__(&self) -> usize {
        self.shapes().len()
    }

    fn __repr__(&self) -> String {
        let shapes = self.shapes();
        format!("Texture({:?}, {} levels)", shapes[0], shapes.len())
    }
}
