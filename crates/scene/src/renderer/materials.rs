//! What fragments are made of: colours at vertices, maps and numbers of materials.

use std::sync::Arc;

use bokashi_core::{Tensor, TensorError, Var};
use bokashi_fit::{FitError, Variables};
use bokashi_render_ops::{
    Detail, Fragments, Mesh, Sampler, TextureFilter, differentials,
    interpolate_differentials_indexed, interpolate_indexed, sample_texture,
};

use super::maps::{KeptMaps, MapKind, MaterialMap};
use super::parts::Parts;
use crate::description::FilterName;
use crate::error::SceneError;
use crate::learnables::{COLORS, Learnable, METALLIC, ROUGHNESS, Recorded, TEXTURE, Values};
use crate::object::{Attribute, Object, SurfaceMaterial};

/// Numbers of materials at the fragments of a view.
pub(super) struct MaterialSamples<'t> {
    /// `[N, 3]`.
    pub(super) base_color: Var<'t, f32>,
    /// `[N]`; a single number where [`Wanted`] has no reflection.
    pub(super) roughness: Var<'t, f32>,
    /// As the roughness.
    pub(super) metallic: Var<'t, f32>,
    /// Vectors of normal maps in tangent space, `[N, 3]`, where they are wanted and some object has a map.
    pub(super) normals: Option<Var<'t, f32>>,
}

/// Which samples are wanted besides base colours.
#[derive(Clone, Copy)]
pub(super) struct Wanted {
    /// Roughness and metallic.
    pub(super) reflection: bool,
    /// Normal maps.
    pub(super) normals: bool,
}

/// How materials are sampled: the filter, and index buffers of the attributes of all parts.
pub(super) struct MaterialSampler {
    colors: Option<Mesh>,
    coordinates: Option<Mesh>,
    filter: FilterName,
    /// By material.
    kept: Vec<KeptMaps>,
}

/// Attributes of all parts, and which of them the corners of each face have.
#[derive(Clone, Copy)]
pub(super) struct Indexed<'t, 'a> {
    pub(super) rows: Var<'t, f32>,
    pub(super) indices: &'a Mesh,
}

/// The attributes at vertices that materials are sampled by.
#[derive(Clone, Copy)]
pub(super) struct VertexAttributes<'t, 'a> {
    pub(super) colors: Option<Indexed<'t, 'a>>,
    pub(super) coordinates: Option<Indexed<'t, 'a>>,
}

/// Attributes at fragments: at all of them, or at those of one material.
#[derive(Clone, Copy)]
struct FragmentAttributes<'t> {
    /// How many fragments.
    count: usize,
    /// `[N, 3]`.
    colors: Option<Var<'t, f32>>,
    /// Texture coordinates, `[N, 2]`.
    coordinates: Option<Var<'t, f32>>,
    /// How they change from pixel to pixel.
    slopes: Option<Var<'t, f32>>,
}

impl MaterialSampler {
    pub(super) fn new(
        parts: &Parts,
        objects: &[Object],
        filter: FilterName,
    ) -> Result<Self, SceneError> {
        Ok(Self {
            colors: parts.indices(objects, |object| object.colors.as_ref())?,
            coordinates: parts.indices(objects, Object::coordinates_of_maps)?,
            filter,
            kept: materials(objects).map(|_| KeptMaps::default()).collect(),
        })
    }

    /// Whether coarser levels of maps are looked up.
    fn has_levels(&self) -> bool {
        matches!(self.filter, FilterName::Trilinear | FilterName::Anisotropic)
    }

    /// The variables of a step with all levels of maps in the place of the texels that are learnt, for all of its views;
    /// `None` where they stay as they are.
    pub(super) fn share_levels<'t>(
        &self,
        objects: &[Object],
        values: &Values<'t, '_>,
    ) -> Result<Option<Variables<'t, f32>>, FitError> {
        let Some(learnt) = values.learnt else { return Ok(None) };
        let mut all = None;
        for (object, material) in materials(objects) {
            let name = object.material_name(material);
            for map in MaterialMap::all(&name, material, self.has_levels()) {
                let shared = map.share_levels(all.as_ref().unwrap_or(learnt), values)?;
                all = shared.or(all);
            }
        }
        Ok(all)
    }

    /// What materials are sampled by, at the vertices.
    pub(super) fn vertex_attributes<'t, 'a>(
        &'a self,
        parts: &Parts,
        objects: &'a [Object],
        values: &Values<'t, '_>,
    ) -> Result<VertexAttributes<'t, 'a>, FitError> {
        let tape = values.tape;
        let colors = |indices| {
            let rows = |object: &'a Object| {
                let colors = object.colors.as_ref()?;
                Some((colors, values.tensor(&COLORS, &object.name, &colors.rows)))
            };
            let rows = parts.rows(objects, rows, tape.constant(&Tensor::full([1, 3], 1.0)))?;
            Ok::<_, FitError>(Indexed { rows, indices })
        };
        let coordinates = |indices| {
            let rows = |object: &'a Object| {
                let coordinates = object.coordinates_of_maps()?;
                Some((coordinates, tape.constant(&coordinates.rows)))
            };
            let rows = parts.rows(objects, rows, tape.constant(&Tensor::zeros([1, 2])))?;
            Ok::<_, FitError>(Indexed { rows, indices })
        };
        Ok(VertexAttributes {
            colors: self.colors.as_ref().map(colors).transpose()?,
            coordinates: self.coordinates.as_ref().map(coordinates).transpose()?,
        })
    }

    /// Samples each material at its own fragments.
    pub(super) fn sample<'t>(
        &self,
        parts: &Parts,
        objects: &[Object],
        values: &Values<'t, '_>,
        attributes: VertexAttributes<'t, '_>,
        fragments: &Fragments<'t, f32>,
        wanted: Wanted,
    ) -> Result<MaterialSamples<'t>, FitError> {
        let all = self.fragment_attributes(attributes, fragments)?;
        let groups = Groups::new(parts, objects, fragments);
        let has_map = |(_, material): (_, &SurfaceMaterial)| material.normal_map.texels.is_some();
        let with_maps = wanted.normals && materials(objects).any(has_map);
        let wanted = Wanted { normals: with_maps, ..wanted };
        let of_materials = materials(objects).zip(&groups.rows).zip(&self.kept);
        let samples = of_materials.filter_map(|(((object, material), rows), kept)| {
            let is_seen = rows.as_ref().is_none_or(|rows| !rows.is_empty());
            is_seen.then(|| {
                let attributes = all.for_material(object, material, rows.as_ref())?;
                let name = object.material_name(material);
                let sampler = self;
                let material =
                    SampledMaterial { name, material, values, attributes, sampler, kept };
                material.sample(wanted)
            })
        });
        let samples = samples.collect::<Result<Vec<_>, FitError>>()?;
        let Some(first) = samples.first() else {
            let tape = values.tape;
            let [base_color, number] =
                [tape.constant(&Tensor::zeros([0, 3])), tape.constant(&Tensor::zeros([0]))];
            return Ok(MaterialSamples {
                base_color,
                roughness: number,
                metallic: number,
                normals: None,
            });
        };
        let join = |pick: fn(&MaterialSamples<'t>) -> Var<'t, f32>| {
            groups.join(&samples.iter().map(pick).collect::<Vec<_>>())
        };
        let normals: Vec<_> = samples.iter().filter_map(|material| material.normals).collect();
        // Nobody wants the others.
        let is_plain = !wanted.reflection;
        Ok(MaterialSamples {
            base_color: join(|material| material.base_color)?,
            roughness: if is_plain {
                first.roughness
            } else {
                join(|material| material.roughness)?
            },
            metallic: if is_plain { first.metallic } else { join(|material| material.metallic)? },
            normals: with_maps.then(|| groups.join(&normals)).transpose()?,
        })
    }

    fn fragment_attributes<'t>(
        &self,
        VertexAttributes { colors, coordinates }: VertexAttributes<'t, '_>,
        fragments: &Fragments<'t, f32>,
    ) -> Result<FragmentAttributes<'t>, FitError> {
        let interpolated = |attribute: Indexed<'t, '_>| {
            interpolate_indexed(attribute.rows, attribute.indices, fragments)
        };
        let slopes = coordinates.filter(|_| self.has_levels()).map(|Indexed { rows, indices }| {
            let slopes = differentials(fragments)?;
            interpolate_differentials_indexed(rows, indices, fragments, slopes)
        });
        Ok(FragmentAttributes {
            count: fragments.coverage.count(),
            colors: colors.map(interpolated).transpose()?,
            coordinates: coordinates.map(interpolated).transpose()?,
            slopes: slopes.transpose()?,
        })
    }
}

impl<'t> FragmentAttributes<'t> {
    /// At the fragments of a material; without what its faces have none of.
    fn for_material(
        &self,
        object: &Object,
        material: &SurfaceMaterial,
        rows: Option<&Arc<[u32]>>,
    ) -> Result<Self, TensorError> {
        let gather = |all: Option<Var<'t, f32>>, is_there: bool| match (all, rows) {
            (Some(all), Some(rows)) if is_there => Ok(Some(all.gather_rows(rows)?)),
            (all, None) if is_there => Ok(all),
            _ => Ok(None),
        };
        let covers = |attribute: Option<&Attribute>| {
            attribute.is_some_and(|attribute| attribute.covers(&material.faces))
        };
        let is_placed = covers(object.coordinates_of_maps());
        Ok(Self {
            count: rows.map_or(self.count, |rows| rows.len()),
            colors: gather(self.colors, covers(object.colors.as_ref()))?,
            coordinates: gather(self.coordinates, is_placed)?,
            slopes: gather(self.slopes, is_placed)?,
        })
    }
}

/// A material at its fragments.
struct SampledMaterial<'t, 'a> {
    /// What parameters call it.
    name: String,
    material: &'a SurfaceMaterial,
    values: &'a Values<'t, 'a>,
    attributes: FragmentAttributes<'t>,
    sampler: &'a MaterialSampler,
    kept: &'a KeptMaps,
}

/// Each material, with its object.
fn materials(objects: &[Object]) -> impl Iterator<Item = (&Object, &SurfaceMaterial)> {
    objects
        .iter()
        .flat_map(|object| object.materials.iter().map(move |material| (object, material)))
}

impl<'t> SampledMaterial<'t, '_> {
    fn sample(&self, wanted: Wanted) -> Result<MaterialSamples<'t>, FitError> {
        let number = |row, kind, fixed| match wanted.reflection {
            true => self.number(row, kind, fixed),
            false => Ok(self.values.tape.constant_scalar(0.0)),
        };
        let material = self.material;
        Ok(MaterialSamples {
            base_color: self.base_color()?,
            roughness: number(&ROUGHNESS, MapKind::Roughness, material.roughness)?,
            metallic: number(&METALLIC, MapKind::Metallic, material.metallic)?,
            normals: wanted.normals.then(|| self.normals()).transpose()?,
        })
    }

    fn base_color(&self) -> Recorded<'t> {
        let texture = self.sample_map(MapKind::BaseColor)?;
        let color = || self.values.triple(&TEXTURE, &self.name, self.material.base_color);
        Ok(match (texture, self.attributes.colors) {
            (Some(texture), Some(colors)) => texture.try_mul(colors)?,
            (Some(texture), None) => texture,
            (None, Some(colors)) => colors.try_mul(color())?,
            (None, None) => self.ones().try_mul(color())?,
        })
    }

    /// Roughness or metallic: a channel of their map, or a number.
    fn number(&self, row: &Learnable, kind: MapKind, fixed: f32) -> Recorded<'t> {
        let count = self.attributes.count;
        Ok(match self.sample_map(kind)? {
            Some(samples) => samples.reshape([count])?,
            None => {
                let number = self.values.number(row, &self.name, fixed.into());
                self.ones().try_mul(number)?.reshape([count])?
            }
        })
    }

    /// Vectors of the normal map; straight up without one.
    fn normals(&self) -> Recorded<'t> {
        let up = Tensor::from_flat_fn([1, 3], |k| [0.0, 0.0, 1.0][k]);
        Ok(match self.sample_map(MapKind::Normal)? {
            Some(samples) => samples,
            None => self.ones().try_mul(self.values.tape.constant(&up))?,
        })
    }

    /// A map at the fragments, `[N, C]`; `None` without a map or coordinates.
    fn sample_map(&self, kind: MapKind) -> Result<Option<Var<'t, f32>>, FitError> {
        let Some(coordinates) = self.attributes.coordinates else { return Ok(None) };
        let Self { name, material, .. } = self;
        let has_levels = self.sampler.has_levels();
        let map = MaterialMap { name, material, kind, has_levels };
        let Some(texture) = map.texture(self.values, self.kept)? else { return Ok(None) };
        let detail = match self.attributes.slopes {
            Some(differentials) => Detail::Differentials { differentials, bias: None },
            None => Detail::Finest,
        };
        let filter = match self.sampler.filter {
            FilterName::Nearest => TextureFilter::Nearest,
            FilterName::Bilinear => TextureFilter::Bilinear,
            FilterName::Trilinear => TextureFilter::Trilinear,
            // Probes would reach beyond the gutters of its charts.
            FilterName::Anisotropic if map.surface_map().gutters.is_some() => {
                TextureFilter::Trilinear
            }
            FilterName::Anisotropic => TextureFilter::Anisotropic { probes: 8 },
        };
        let sampler = Sampler::new().filter(filter).borders(map.surface_map().borders);
        Ok(Some(sample_texture(&texture, coordinates, detail, sampler)?))
    }

    fn ones(&self) -> Var<'t, f32> {
        self.values.tape.constant_full([self.attributes.count, 1], 1.0)
    }
}

/// The fragments of each material, all of them where there is one; and where each fragment then is.
struct Groups {
    rows: Vec<Option<Arc<[u32]>>>,
    back: Option<Arc<[u32]>>,
}

impl Groups {
    fn new(parts: &Parts, objects: &[Object], fragments: &Fragments<'_, f32>) -> Self {
        let mut count = 0;
        let mut firsts = Vec::with_capacity(objects.len());
        for object in objects {
            firsts.push(count);
            count += object.materials.len();
        }
        if count <= 1 {
            return Self { rows: vec![None; count], back: None };
        }
        let mut rows = vec![Vec::new(); count];
        for (fragment, face) in fragments.coverage.faces().enumerate() {
            let [object, face] = parts.face_of_object(face);
            rows[firsts[object] + objects[object].material_of(face)].push(fragment as u32);
        }
        let mut back = vec![0; fragments.coverage.count()];
        for (row, &fragment) in rows.iter().flatten().enumerate() {
            back[fragment as usize] = row as u32;
        }
        let rows = rows.into_iter().map(|rows| Some(rows.into())).collect();
        Self { rows, back: Some(back.into()) }
    }

    /// Rows of the materials that are seen, one after another, as rows of fragments.
    fn join<'t>(&self, samples: &[Var<'t, f32>]) -> Recorded<'t> {
        let all = match samples {
            [only] => *only,
            _ => Var::concat(samples, 0)?,
        };
        Ok(match &self.back {
            Some(back) => all.gather_rows(back)?,
            None => all,
        })
    }
}
