//! What fragments are made of: colours at vertices, maps and numbers of materials.

use std::sync::Arc;

use bokashi_core::{Tensor, TensorError, Var};
use bokashi_fit::FitError;
use bokashi_render_ops::{
    Detail, Fragments, Mesh, Sampler, Texture, TextureFilter, differentials,
    interpolate_differentials_indexed, interpolate_indexed, sample_texture,
};

use super::parts::Parts;
use crate::description::FilterName;
use crate::error::SceneError;
use crate::model::Borders;
use crate::object::{Attribute, Object, SurfaceLook};
use crate::values::{Recorded, Values, of_object};

/// What the fragments of a view are made of.
pub(super) struct Looks<'t> {
    /// `[N, 3]`.
    pub(super) base_color: Var<'t, f32>,
    /// `[N]`; a single number unless reflections are asked for.
    pub(super) roughness: Var<'t, f32>,
    /// As the roughness.
    pub(super) metallic: Var<'t, f32>,
    /// What normal maps say, `[N, 3]`, where normals are asked for and some object has a map.
    pub(super) normals: Option<Var<'t, f32>>,
}

/// Which of an object's looks are asked for.
#[derive(Clone, Copy)]
pub(super) struct Asked {
    /// Roughness and metallic.
    pub(super) reflection: bool,
    /// Normal maps.
    pub(super) normals: bool,
}

/// Where looks are looked up: index buffers of all parts' attributes.
pub(super) struct LookUp {
    colors: Option<Mesh>,
    coordinates: Option<Mesh>,
    filter: FilterName,
}

/// Attributes of all parts, and which of them the corners of each face have.
#[derive(Clone, Copy)]
pub(super) struct Indexed<'t, 'a> {
    pub(super) rows: Var<'t, f32>,
    pub(super) indices: &'a Mesh,
}

/// The attributes that looks are made of.
#[derive(Clone, Copy)]
pub(super) struct LooksAtVertices<'t, 'a> {
    pub(super) colors: Option<Indexed<'t, 'a>>,
    pub(super) coordinates: Option<Indexed<'t, 'a>>,
}

/// Attributes at fragments: of all of them, or of a look's.
#[derive(Clone, Copy)]
struct Attributes<'t> {
    /// How many fragments.
    count: usize,
    /// `[N, 3]`.
    colors: Option<Var<'t, f32>>,
    /// Texture coordinates, `[N, 2]`.
    places: Option<Var<'t, f32>>,
    /// How they change from pixel to pixel.
    slopes: Option<Var<'t, f32>>,
}

impl LookUp {
    pub(super) fn of(
        parts: &Parts,
        objects: &[Object],
        filter: FilterName,
    ) -> Result<Self, SceneError> {
        Ok(Self {
            colors: parts.indices(objects, |object| object.colors.as_ref())?,
            coordinates: parts.indices(objects, Object::coordinates_of_maps)?,
            filter,
        })
    }

    /// What looks are made of, at the vertices.
    pub(super) fn at_vertices<'t, 'a>(
        &'a self,
        parts: &Parts,
        objects: &'a [Object],
        values: &Values<'t, '_>,
    ) -> Result<LooksAtVertices<'t, 'a>, FitError> {
        let tape = values.tape;
        let colors = |indices| {
            let own = |object: &'a Object| {
                let own = object.colors.as_ref()?;
                Some((own, values.tensor(&of_object("colors", &object.name), &own.rows)))
            };
            let rows = parts.rows(objects, own, tape.constant(&Tensor::full([1, 3], 1.0)))?;
            Ok::<_, FitError>(Indexed { rows, indices })
        };
        let coordinates = |indices| {
            let own = |object: &'a Object| {
                let own = object.coordinates_of_maps()?;
                Some((own, tape.constant(&own.rows)))
            };
            let rows = parts.rows(objects, own, tape.constant(&Tensor::zeros([1, 2])))?;
            Ok::<_, FitError>(Indexed { rows, indices })
        };
        Ok(LooksAtVertices {
            colors: self.colors.as_ref().map(colors).transpose()?,
            coordinates: self.coordinates.as_ref().map(coordinates).transpose()?,
        })
    }

    /// What the fragments are made of: each look at its own fragments.
    pub(super) fn at<'t>(
        &self,
        parts: &Parts,
        objects: &[Object],
        values: &Values<'t, '_>,
        at_vertices: LooksAtVertices<'t, '_>,
        fragments: &Fragments<'t, f32>,
        asked: Asked,
    ) -> Result<Looks<'t>, FitError> {
        let all = self.attributes(at_vertices, fragments)?;
        let groups = Groups::of(parts, objects, fragments);
        let made =
            || objects.iter().flat_map(|object| object.looks.iter().map(move |k| (object, k)));
        let with_maps = asked.normals && made().any(|(_, look)| look.normal_map.is_some());
        let asked = Asked { normals: with_maps, ..asked };
        let looks = made().zip(&groups.rows).filter_map(|((object, look), rows)| {
            let is_seen = rows.as_ref().is_none_or(|rows| !rows.is_empty());
            is_seen.then(|| {
                let own = all.of(object, look, rows.as_ref())?;
                Material { object, look, values, own, filter: self.filter }.looks(asked)
            })
        });
        let looks = looks.collect::<Result<Vec<_>, FitError>>()?;
        let Some(first) = looks.first() else {
            let tape = values.tape;
            let [color, number] =
                [tape.constant(&Tensor::zeros([0, 3])), tape.constant(&Tensor::zeros([0]))];
            return Ok(Looks {
                base_color: color,
                roughness: number,
                metallic: number,
                normals: None,
            });
        };
        let joined = |own: &[Var<'t, f32>]| groups.joined(own);
        let each =
            |pick: fn(&Looks<'t>) -> Var<'t, f32>| -> Vec<_> { looks.iter().map(pick).collect() };
        let normals: Vec<_> = looks.iter().filter_map(|look| look.normals).collect();
        let is_plain = !asked.reflection;
        Ok(Looks {
            base_color: joined(&each(|look| look.base_color))?,
            // Nobody asks for the others.
            roughness: if is_plain {
                first.roughness
            } else {
                joined(&each(|look| look.roughness))?
            },
            metallic: if is_plain { first.metallic } else { joined(&each(|look| look.metallic))? },
            normals: with_maps.then(|| joined(&normals)).transpose()?,
        })
    }

    fn attributes<'t>(
        &self,
        LooksAtVertices { colors, coordinates }: LooksAtVertices<'t, '_>,
        fragments: &Fragments<'t, f32>,
    ) -> Result<Attributes<'t>, FitError> {
        let at = |own: Indexed<'t, '_>| interpolate_indexed(own.rows, own.indices, fragments);
        let has_slopes = matches!(self.filter, FilterName::Trilinear | FilterName::Anisotropic);
        let slopes = coordinates.filter(|_| has_slopes).map(|own| {
            let slopes = differentials(fragments)?;
            interpolate_differentials_indexed(own.rows, own.indices, fragments, slopes)
        });
        Ok(Attributes {
            count: fragments.coverage.count(),
            colors: colors.map(at).transpose()?,
            places: coordinates.map(at).transpose()?,
            slopes: slopes.transpose()?,
        })
    }
}

impl<'t> Attributes<'t> {
    /// At the fragments of a look; without what its faces have none of.
    fn of(
        &self,
        object: &Object,
        look: &SurfaceLook,
        rows: Option<&Arc<[u32]>>,
    ) -> Result<Self, TensorError> {
        let own = |all: Option<Var<'t, f32>>, is_there: bool| match (all, rows) {
            (Some(all), Some(rows)) if is_there => Ok(Some(all.gather_rows(rows)?)),
            (all, None) if is_there => Ok(all),
            _ => Ok(None),
        };
        let covers = |own: Option<&Attribute>| own.is_some_and(|own| own.covers(&look.faces));
        let is_placed = covers(object.coordinates_of_maps());
        Ok(Self {
            count: rows.map_or(self.count, |rows| rows.len()),
            colors: own(self.colors, covers(object.colors.as_ref()))?,
            places: own(self.places, is_placed)?,
            slopes: own(self.slopes, is_placed)?,
        })
    }
}

/// A material at its fragments.
struct Material<'t, 'a> {
    object: &'a Object,
    look: &'a SurfaceLook,
    values: &'a Values<'t, 'a>,
    own: Attributes<'t>,
    filter: FilterName,
}

impl<'t> Material<'t, '_> {
    fn looks(&self, asked: Asked) -> Result<Looks<'t>, FitError> {
        let number = |kind, channel, own| match asked.reflection {
            true => self.number(kind, channel, own),
            false => Ok(self.values.tape.constant_scalar(0.0)),
        };
        let look = self.look;
        Ok(Looks {
            base_color: self.base_color()?,
            roughness: number("roughness", 0, look.roughness)?,
            metallic: number("metallic", 1, look.metallic)?,
            normals: asked.normals.then(|| self.normals()).transpose()?,
        })
    }

    fn base_color(&self) -> Recorded<'t> {
        let look = self.look;
        let texture = self.map("texture", look.texture.as_ref(), look.texture_borders)?;
        let color = || self.values.triple(&self.object.parameter("texture", look), look.base_color);
        Ok(match (texture, self.own.colors) {
            (Some(texture), Some(colors)) => texture.try_mul(colors)?,
            (Some(texture), None) => texture,
            (None, Some(colors)) => colors.try_mul(color())?,
            (None, None) => self.ones().try_mul(color())?,
        })
    }

    /// Roughness or metallic: a channel of their map, or a number.
    fn number(&self, kind: &str, channel: usize, own: f32) -> Recorded<'t> {
        let map = self.look.roughness_metallic_map(channel);
        let borders = self.look.roughness_metallic_borders;
        let count = self.own.count;
        Ok(match self.map(kind, map.as_ref(), borders)? {
            Some(found) => found.reshape([count])?,
            None => {
                let number =
                    self.values.number(&self.object.parameter(kind, self.look), own.into());
                self.ones().try_mul(number)?.reshape([count])?
            }
        })
    }

    /// What the normal map says; straight up without one.
    fn normals(&self) -> Recorded<'t> {
        let up = Tensor::from_flat_fn([1, 3], |k| [0.0, 0.0, 1.0][k]);
        let look = self.look;
        let found = self.map("normal_map", look.normal_map.as_ref(), look.normal_map_borders)?;
        Ok(match found {
            Some(found) => found,
            None => self.ones().try_mul(self.values.tape.constant(&up))?,
        })
    }

    /// What a map says at the fragments.
    fn map(
        &self,
        kind: &str,
        own: Option<&Tensor<f32>>,
        borders: Borders,
    ) -> Result<Option<Var<'t, f32>>, FitError> {
        let (Some(own), Some(places)) = (own, self.own.places) else { return Ok(None) };
        let texels = self.values.tensor(&self.object.parameter(kind, self.look), own);
        let (texture, detail) = match self.own.slopes {
            Some(differentials) => {
                let detail = Detail::Differentials { differentials, bias: None };
                (Texture::with_mipmaps(texels)?, detail)
            }
            None => (Texture::new(texels)?, Detail::Finest),
        };
        let filter = match self.filter {
            FilterName::Nearest => TextureFilter::Nearest,
            FilterName::Bilinear => TextureFilter::Bilinear,
            FilterName::Trilinear => TextureFilter::Trilinear,
            FilterName::Anisotropic => TextureFilter::Anisotropic { probes: 8 },
        };
        let sampler = Sampler::new().filter(filter).borders(borders);
        Ok(Some(sample_texture(&texture, places, detail, sampler)?))
    }

    fn ones(&self) -> Var<'t, f32> {
        self.values.tape.constant_full([self.own.count, 1], 1.0)
    }
}

/// The fragments of each look, all of them where there is one; and where each fragment then is.
struct Groups {
    rows: Vec<Option<Arc<[u32]>>>,
    back: Option<Arc<[u32]>>,
}

impl Groups {
    fn of(parts: &Parts, objects: &[Object], fragments: &Fragments<'_, f32>) -> Self {
        let mut count = 0;
        let mut firsts = Vec::with_capacity(objects.len());
        for object in objects {
            firsts.push(count);
            count += object.looks.len();
        }
        if count <= 1 {
            return Self { rows: vec![None; count], back: None };
        }
        let mut rows = vec![Vec::new(); count];
        for (fragment, face) in fragments.coverage.faces().enumerate() {
            let [object, face] = parts.own_face(face);
            rows[firsts[object] + objects[object].look_of(face)].push(fragment as u32);
        }
        let mut back = vec![0; fragments.coverage.count()];
        for (at, &fragment) in rows.iter().flatten().enumerate() {
            back[fragment as usize] = at as u32;
        }
        let rows = rows.into_iter().map(|rows| Some(rows.into())).collect();
        Self { rows, back: Some(back.into()) }
    }

    /// Rows of the looks that are seen, one after another, as rows of fragments.
    fn joined<'t>(&self, own: &[Var<'t, f32>]) -> Recorded<'t> {
        let all = match own {
            [only] => *only,
            _ => Var::concat(own, 0)?,
        };
        Ok(match &self.back {
            Some(back) => all.gather_rows(back)?,
            None => all,
        })
    }
}
