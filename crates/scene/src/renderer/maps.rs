//! The maps of materials as textures: coarser levels are made once.
//!
//! Constant maps keep theirs as long as the renderer lives. Those of a map that is learnt are made once in a step, before
//! its views: there they are variables in the place of the texels.

use std::sync::OnceLock;

use bokashi_core::{Tensor, Var};
use bokashi_fit::{FitError, Variables};
use bokashi_render_ops::{ConstantTexture, RenderError, Texture};

use crate::learnables::{Learnable, METALLIC, ROUGHNESS, TEXTURE, Values};
use crate::object::{Gutters, SurfaceMap, SurfaceMaterial};

/// What a map says of a material.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum MapKind {
    BaseColor,
    Roughness,
    Metallic,
    Normal,
}

impl MapKind {
    const ALL: [Self; 4] = [Self::BaseColor, Self::Roughness, Self::Metallic, Self::Normal];

    /// What a map of this kind is learnt as, if it can be.
    fn learnable(self) -> Option<&'static Learnable> {
        match self {
            Self::BaseColor => Some(&TEXTURE),
            Self::Roughness => Some(&ROUGHNESS),
            Self::Metallic => Some(&METALLIC),
            Self::Normal => None,
        }
    }
}

/// The constant maps of a material that were looked up, by kind.
pub(super) type KeptMaps = [OnceLock<ConstantTexture<f32>>; MapKind::ALL.len()];

/// A map that a material may have.
#[derive(Clone, Copy)]
pub(super) struct MaterialMap<'a> {
    /// What parameters call the material.
    pub(super) name: &'a str,
    pub(super) material: &'a SurfaceMaterial,
    pub(super) kind: MapKind,
    /// Whether coarser levels are looked up.
    pub(super) has_levels: bool,
}

impl<'a> MaterialMap<'a> {
    /// The maps that a material has.
    pub(super) fn all(
        name: &'a str,
        material: &'a SurfaceMaterial,
        has_levels: bool,
    ) -> impl Iterator<Item = Self> {
        let maps = MapKind::ALL.map(|kind| Self { name, material, kind, has_levels });
        maps.into_iter().filter(|map| map.surface_map().texels.is_some())
    }

    /// The map, with the others that its image has.
    pub(super) fn surface_map(&self) -> &'a SurfaceMap {
        let SurfaceMaterial { texture, roughness_metallic, normal_map, .. } = self.material;
        match self.kind {
            MapKind::BaseColor => texture,
            MapKind::Roughness | MapKind::Metallic => roughness_metallic,
            MapKind::Normal => normal_map,
        }
    }

    /// The texels of the scene, `[H, W, C]`.
    fn texels(&self) -> Option<Tensor<f32>> {
        match self.kind {
            MapKind::Roughness => self.material.roughness_metallic_map(0),
            MapKind::Metallic => self.material.roughness_metallic_map(1),
            MapKind::BaseColor | MapKind::Normal => self.surface_map().texels.clone(),
        }
    }

    /// The texels that are learnt.
    fn learnt<'t>(&self, values: &Values<'t, '_>) -> Option<Var<'t, f32>> {
        values.learnt(self.kind.learnable()?, self.name)
    }

    /// What the variable of a level is called.
    fn level_name(&self, level: usize) -> Option<String> {
        let parameter = self.kind.learnable()?.parameter_name(self.name);
        Some(format!("{parameter}/level {level}"))
    }

    /// The coarsest level that is looked up.
    fn coarsest(&self) -> usize {
        match &self.surface_map().gutters {
            _ if !self.has_levels => 0,
            Some(gutters) => gutters.levels,
            None => usize::MAX,
        }
    }

    /// The texture of texels that are learnt.
    fn texture_of<'t>(&self, texels: Var<'t, f32>) -> Result<Texture<'t, f32>, RenderError> {
        let filled = |gutters: &Gutters| gutters.filled(texels);
        let texels = self.surface_map().gutters.as_ref().map_or(Ok(texels), filled)?;
        Texture::with_mipmaps_to(texels, self.coarsest())
    }

    /// The texture in a step; `None` without a map.
    pub(super) fn texture<'t>(
        &self,
        values: &Values<'t, '_>,
        kept: &KeptMaps,
    ) -> Result<Option<Texture<'t, f32>>, RenderError> {
        if self.surface_map().texels.is_none() {
            return Ok(None);
        }
        let level = |level: usize| values.learnt?.get(&self.level_name(level)?).ok();
        let levels: Vec<_> = (0..).map_while(level).collect();
        if !levels.is_empty() {
            return Texture::from_levels(&levels).map(Some);
        }
        if let Some(texels) = self.learnt(values) {
            return self.texture_of(texels).map(Some);
        }
        let kept = &kept[self.kind as usize];
        if let Some(kept) = kept.get() {
            return Ok(Some(kept.on(values.tape)));
        }
        let Some(texels) = self.texels() else { return Ok(None) };
        let texture = Texture::with_mipmaps_to(values.tape.constant(&texels), self.coarsest())?;
        // Whoever comes first: all have the same bits.
        kept.get_or_init(|| texture.constant());
        Ok(Some(texture))
    }

    /// The variables with the levels of this map in the place of its texels, if these are learnt and have coarser levels or
    /// gutters.
    pub(super) fn share_levels<'t>(
        &self,
        variables: &Variables<'t, f32>,
        values: &Values<'t, '_>,
    ) -> Result<Option<Variables<'t, f32>>, FitError> {
        let is_plain = self.coarsest() == 0 && self.surface_map().gutters.is_none();
        // Several materials may have one name: then the first of them has shared the levels.
        let values = Values { learnt: Some(variables), ..*values };
        let texels = self.learnt(&values).filter(|_| !is_plain);
        let (Some(texels), Some(row)) = (texels, self.kind.learnable()) else { return Ok(None) };
        let texture = self.texture_of(texels)?;
        let others = variables.clone().without(&row.parameter_name(self.name));
        let levels = (0..).map_while(|level| self.level_name(level)).zip(texture.levels());
        Ok(Some(levels.fold(others, |others, (name, &level)| others.with(name, level))))
    }
}
