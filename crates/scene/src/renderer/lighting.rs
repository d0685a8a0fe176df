//! From surfaces to light.

use bokashi_core::Tensor;
use bokashi_fit::FitError;
use bokashi_render_ops::{Environment, Light, Material, Prefilter, Surface, shade};
use glam::DVec3;

use super::materials::MaterialSamples;
use crate::description::{LightEntry, NotNegative, SurfaceModel};
use crate::error::SceneError;
use crate::learnables::{ENVIRONMENT, LIGHT_COLORS, LIGHT_PLACES, Recorded, Values};
use crate::scene::Scene;

/// The coarsest mirror image of an environment is this many halvings smaller.
const ENVIRONMENT_LEVELS: usize = 4;

/// How surfaces reflect, and what an environment needs.
pub(super) struct Lighting {
    pub(super) model: SurfaceModel,
    prefilter: Option<Prefilter<f32>>,
}

impl Lighting {
    pub(super) fn new(scene: &Scene) -> Result<Self, SceneError> {
        let is_lit = !scene.description.lights.is_empty() || scene.environment.is_some();
        let default = if is_lit { SurfaceModel::MetallicRoughness } else { SurfaceModel::Unlit };
        let side = scene.environment.as_ref().map(|texels| texels.shape()[1]);
        Ok(Self {
            model: scene.description.pipeline.surface.unwrap_or(default),
            prefilter: side.map(|side| Prefilter::new(side, ENVIRONMENT_LEVELS)).transpose()?,
        })
    }

    /// Whether light counts at all.
    pub(super) fn is_lit(&self) -> bool {
        self.model != SurfaceModel::Unlit
    }

    /// What a lit surface sends to the eye, `[N, 3]`. `origin` was taken off places in the world.
    pub(super) fn shade<'t>(
        &self,
        scene: &Scene,
        values: &Values<'t, '_>,
        origin: DVec3,
        surface: &Surface<'t, f32>,
        samples: &MaterialSamples<'t>,
    ) -> Recorded<'t> {
        let material = match self.model {
            SurfaceModel::Lambert => Material::Lambert { color: samples.base_color },
            _ => Material::MetallicRoughness {
                base_color: samples.base_color,
                roughness: samples.roughness,
                metallic: samples.metallic,
                conserves_energy: false,
            },
        };
        let lights = lights(scene, values, origin)?;
        let mut light =
            (!lights.is_empty()).then(|| shade(surface, &material, &lights)).transpose()?;
        if let (Some(texels), Some(prefilter)) = (&scene.environment, &self.prefilter) {
            let texels = values.tensor(&ENVIRONMENT, "", texels);
            let around = Environment::from_texels(texels, prefilter)?.shade(surface, &material)?;
            light = Some(match light {
                Some(light) => light.try_add(around)?,
                None => around,
            });
        }
        // Without light it is dark.
        Ok(light.unwrap_or(samples.base_color * 0.0))
    }
}

fn lights<'t>(
    scene: &Scene,
    values: &Values<'t, '_>,
    origin: DVec3,
) -> Result<Vec<Light<'t, f32>>, FitError> {
    let lights = scene.description.lights.iter().enumerate().map(|(index, light)| {
        let name = index.to_string();
        let color = |fixed: [NotNegative; 3]| {
            values.triple(&LIGHT_COLORS, &name, fixed.map(|x| x.0 as f32))
        };
        let constant =
            |fixed: DVec3| values.tape.constant(&Tensor::from(fixed.as_vec3().to_array()));
        Ok(match *light {
            LightEntry::Ambient { color: fixed } => Light::Ambient { radiance: color(fixed) },
            LightEntry::Directional { direction, color: fixed } => {
                let direction = direction.map(|x| x.0 as f32);
                let direction = values.triple(&LIGHT_PLACES, &name, direction);
                Light::Directional { direction, irradiance: color(fixed) }
            }
            LightEntry::Point { position, color: fixed } => {
                let position = match values.learnt(&LIGHT_PLACES, &name) {
                    Some(learnt) if origin == DVec3::ZERO => learnt,
                    Some(learnt) => learnt.try_sub(constant(origin))?,
                    None => constant(DVec3::from(position.map(|x| x.0)) - origin),
                };
                Light::Point { position, intensity: color(fixed) }
            }
        })
    });
    lights.collect()
}
