//! From surfaces to light.

use bokashi_core::Tensor;
use bokashi_fit::FitError;
use bokashi_render_ops::{Environment, Light, Material, Prefilter, Surface, shade};
use glam::DVec3;

use super::looks::Looks;
use crate::description::{Finite, LightEntry, NotNegative, SurfaceModel};
use crate::error::SceneError;
use crate::scene::Scene;
use crate::values::{Recorded, Values, of_object};

/// The coarsest mirror image of an environment is this many halvings smaller.
const ENVIRONMENT_LEVELS: usize = 4;

/// How surfaces reflect, and what an environment needs.
pub(super) struct Lighting {
    pub(super) model: SurfaceModel,
    prefilter: Option<Prefilter<f32>>,
}

impl Lighting {
    pub(super) fn of(scene: &Scene) -> Result<Self, SceneError> {
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
    pub(super) fn of_surface<'t>(
        &self,
        scene: &Scene,
        values: &Values<'t, '_>,
        origin: DVec3,
        surface: &Surface<'t, f32>,
        looks: &Looks<'t>,
    ) -> Recorded<'t> {
        let material = match self.model {
            SurfaceModel::Lambert => Material::Lambert { color: looks.base_color },
            _ => Material::MetallicRoughness {
                base_color: looks.base_color,
                roughness: looks.roughness,
                metallic: looks.metallic,
                conserves_energy: false,
            },
        };
        let lights = lights(scene, values, origin)?;
        let mut light =
            (!lights.is_empty()).then(|| shade(surface, &material, &lights)).transpose()?;
        if let (Some(texels), Some(prefilter)) = (&scene.environment, &self.prefilter) {
            let texels = values.tensor("environment", texels);
            let own = Environment::of_texels(texels, prefilter)?.shade(surface, &material)?;
            light = Some(match light {
                Some(light) => light.try_add(own)?,
                None => own,
            });
        }
        // Without light it is dark.
        Ok(light.unwrap_or(looks.base_color * 0.0))
    }
}

fn lights<'t>(
    scene: &Scene,
    values: &Values<'t, '_>,
    origin: DVec3,
) -> Result<Vec<Light<'t, f32>>, FitError> {
    let lights = scene.description.lights.iter().enumerate().map(|(at, light)| {
        let color = |own: [NotNegative; 3]| {
            values.triple(&of_object("light", &at.to_string()), own.map(|x| x.0 as f32))
        };
        let name = of_object("light_place", &at.to_string());
        let place = |own: [Finite; 3]| values.triple(&name, own.map(|x| x.0 as f32));
        let near = |own: DVec3| Tensor::from(own.as_vec3().to_array());
        Ok(match *light {
            LightEntry::Ambient { color: own } => Light::Ambient { radiance: color(own) },
            LightEntry::Directional { direction, color: own } => {
                Light::Directional { direction: place(direction), irradiance: color(own) }
            }
            LightEntry::Point { position, color: own } => {
                let own_place = DVec3::from(position.map(|x| x.0));
                let position = match values.learnt(&name) {
                    Some(learnt) if origin == DVec3::ZERO => learnt,
                    Some(learnt) => learnt.try_sub(values.tape.constant(&near(origin)))?,
                    None => values.tape.constant(&near(own_place - origin)),
                };
                Light::Point { position, intensity: color(own) }
            }
        })
    });
    lights.collect()
}
