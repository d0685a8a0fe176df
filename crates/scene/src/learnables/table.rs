//! All that a scene can learn, a row for each. Parameters of a fit are in this order.

use bokashi_core::{Tape, Tensor};
use bokashi_fit::Mapping;

use super::exposure::{EXPOSURE, EXPOSURES};
use super::frame::scaled_intrinsics;
use super::learnable::{Entry, Learnable, Moves, Subjects};
use super::lens::{APERTURE, FOCUS, RADIUS};
use crate::cameras::Distortion;
use crate::description::{Finite, Learn, LightEntry, LightPlace, NotNegative, Positive};
use crate::object::{Object, SurfaceMaterial};
use crate::scene::Scene;

/// All rows.
pub(crate) static TABLE: [&Learnable; 19] = [
    &FIELD,
    &VERTICES,
    &COLORS,
    &TEXTURE,
    &ROUGHNESS,
    &METALLIC,
    &POSE,
    &CAMERAS,
    &INTRINSICS,
    &DISTORTION,
    &LIGHT_COLORS,
    &LIGHT_PLACES,
    &ENVIRONMENT,
    &EXPOSURE,
    &EXPOSURES,
    &BLUR,
    &APERTURE,
    &RADIUS,
    &FOCUS,
];

/// A table that a scene has in `[learn]`.
#[derive(Debug, Clone, PartialEq)]
pub struct LearntKey {
    /// The table's name.
    pub key: &'static str,
    /// The rate that it gives.
    pub rate: Option<f64>,
    /// The rate where it gives none.
    pub usual_rate: f64,
    /// The unit of both, in words.
    pub unit: &'static str,
}

/// The tables that a scene has in `[learn]`, in the order of the parameters.
pub fn learnt_keys(learn: &Learn) -> Vec<LearntKey> {
    let keys = TABLE.iter().filter_map(|row| {
        let entry = (row.entry)(learn)?;
        let (usual_rate, unit) = row.usual_rate(&entry);
        Some(LearntKey { key: row.key, rate: entry.rate, usual_rate, unit })
    });
    let mut keys: Vec<_> = keys.collect();
    // The numbers of a lens, and exposures, are in one table.
    keys.dedup();
    keys
}

/// The numbers of a mesh's field, `[nx, ny, nz]`.
pub(crate) static FIELD: Learnable = Learnable {
    entry: |learn| learn.field.as_ref().map(Entry::from),
    moves: Moves::Vertices,
    unit: "cells of the grid",
    start: |scene, mesh| Some(scene.objects[mesh].field.as_ref()?.values.clone()),
    apply: |scene, mesh, values, _| scene.objects[mesh].set_field(values),
    ..Learnable::new("field", Subjects::Meshes, 0.15)
};

/// The places of a mesh's vertices, `[V, 3]`; of a mesh whose field is learnt, they follow from that.
pub(crate) static VERTICES: Learnable = Learnable {
    entry: |learn| learn.vertices.as_ref().map(Entry::from),
    moves: Moves::Vertices,
    unit: "the mesh's radius",
    unit_size: |scene, mesh| scene.objects[mesh].radius(),
    start: |scene, mesh| {
        let object = &scene.objects[mesh];
        object.field.is_none().then(|| object.positions.clone())
    },
    apply: |scene, mesh, positions, _| {
        scene.objects[mesh].positions = positions.clone();
        // Those of the file were of the surface as it was.
        scene.objects[mesh].tangents = None;
        Ok(())
    },
    ..Learnable::new("vertices", Subjects::Meshes, 0.003)
};

/// Colours at a mesh's vertices, `[A, 3]`, or at the points of its field, `[P, 3]`.
pub(crate) static COLORS: Learnable = Learnable {
    entry: |learn| learn.colors.as_ref().map(Entry::from),
    moves: Moves::Creases,
    refusal: |scene, mesh, name| {
        let rule = "a mesh whose `colors` are learnt has colours at vertices";
        let object = &scene.objects[mesh];
        // They may have become a texture.
        let lacks_colors = object.colors.is_none() && !scene.gives_texture(object);
        lacks_colors.then(|| format!("{rule}, and {name:?} has none"))
    },
    start: |scene, mesh| {
        let object = &scene.objects[mesh];
        match &object.field {
            Some(field) => field.colors.clone(),
            None => Some(object.colors.as_ref()?.rows.clone()),
        }
    },
    apply: |scene, mesh, rows, _| {
        if let Some(field) = &mut scene.objects[mesh].field {
            field.colors = Some(rows.clone());
            let values = field.values.clone();
            return scene.objects[mesh].set_field(&values);
        }
        scene.objects[mesh].colors.iter_mut().for_each(|colors| colors.rows = rows.clone());
        Ok(())
    },
    ..share("colors", Subjects::Meshes)
};

/// A material's texture, `[H, W, 3]`, or without one its base colour, `[3]`.
pub(crate) static TEXTURE: Learnable = Learnable {
    entry: |learn| learn.texture.as_ref().map(Entry::from),
    refusal: |scene, index, name| {
        let (_, material) = material(scene, index)?;
        material.texture.is_missing.then(|| missing_image("texture", name))
    },
    start: |scene, index| {
        let (object, material) = material(scene, index)?;
        let base_color = || Tensor::from(material.base_color);
        (!scene.awaits_texture(object))
            .then(|| material.texture.texels.clone().unwrap_or_else(base_color))
    },
    apply: |scene, index, color, _| {
        let mut texels = color.clone();
        let gutters =
            material(scene, index).and_then(|(_, material)| material.texture.gutters.as_ref());
        if let Some(gutters) = gutters {
            let tape = Tape::new();
            texels = gutters.filled(tape.constant(color))?.value();
        }
        set_material(scene, index, |material| match color.shape().len() {
            1 => material.base_color = std::array::from_fn(|k| color.data()[k]),
            _ => material.texture.texels = Some(texels.clone()),
        });
        Ok(())
    },
    ..share("texture", Subjects::Materials)
};

/// A material's map of roughness, `[H, W, 1]`, or without one a number.
pub(crate) static ROUGHNESS: Learnable = Learnable {
    entry: |learn| learn.roughness.as_ref().map(Entry::from),
    ..channel::<0>("roughness")
};

/// A material's map of metallic, `[H, W, 1]`, or without one a number.
pub(crate) static METALLIC: Learnable = Learnable {
    entry: |learn| learn.metallic.as_ref().map(Entry::from),
    ..channel::<1>("metallic")
};

/// A small motion of a mesh about its middle, `[6]`: see [`Pivot::moved`](super::frame::Pivot::moved).
pub(crate) static POSE: Learnable = Learnable {
    entry: |learn| learn.pose.as_ref().map(Entry::from),
    moves: Moves::Vertices,
    unit: MOTION,
    start: |_, _| Some(Tensor::zeros([6])),
    apply: |scene, mesh, increment, frame| {
        let motion = frame.object_pivot(mesh).shifted(frame.origin).motion(increment.data())?;
        scene.objects[mesh]
            .places
            .iter_mut()
            .for_each(|transform| *transform = motion * *transform);
        Ok(())
    },
    ..Learnable::new("pose", Subjects::Meshes, 0.01)
};

/// A small motion of each view's camera about the middle of the scene, along the camera's axes, `[views, 6]`: what
/// moves the picture and what changes its size are then different numbers.
pub(crate) static CAMERAS: Learnable = Learnable {
    entry: |learn| learn.cameras.as_ref().map(Entry::from),
    has_rows_of_views: true,
    moves: Moves::Vertices,
    unit: MOTION,
    start: |scene, _| Some(Tensor::zeros([scene.views.len(), 6])),
    apply: |scene, _, increments, frame| {
        let pivot = frame.scene_pivot().shifted(frame.origin);
        for (view, increment) in scene.views.iter_mut().zip(increments.data().chunks_exact(6)) {
            let motion = pivot.seen_from(&view.camera.view).motion(increment)?;
            view.camera.view = motion * view.camera.view;
        }
        Ok(())
    },
    ..Learnable::new("cameras", Subjects::Scene, 3e-3)
};

/// Focal lengths and principal points of all views, `[4]`: see [`scaled_intrinsics`].
pub(crate) static INTRINSICS: Learnable = Learnable {
    entry: |learn| learn.intrinsics.as_ref().map(Entry::from),
    moves: Moves::Vertices,
    unit: "logarithms, and the image's width",
    start: |_, _| Some(Tensor::zeros([4])),
    apply: |scene, _, learnt, _| {
        let tape = Tape::<f64>::new();
        let learnt = tape.constant(&Tensor::from_flat_fn([4], |k| learnt.data()[k].into()));
        for view in &mut scene.views {
            let camera = &mut view.camera;
            let scaled = scaled_intrinsics(camera.intrinsics, camera.size.width, learnt)?.value();
            camera.intrinsics = std::array::from_fn(|k| scaled.data()[k]);
        }
        Ok(())
    },
    ..Learnable::new("intrinsics", Subjects::Scene, 2e-3)
};

/// Coefficients of the lens of all views. It starts from the first view's.
pub(crate) static DISTORTION: Learnable = Learnable {
    entry: |learn| learn.distortion.as_ref().map(Entry::from),
    moves: Moves::Vertices,
    refusal: |scene, _, _| several_lenses(scene),
    start: |scene, _| {
        let first = scene.views.first().map_or(Distortion::NONE, |view| view.camera.distortion);
        let first = first.coefficients();
        Some(Tensor::from_flat_fn([first.len()], |k| first[k] as f32))
    },
    apply: |scene, _, learnt, _| {
        let learnt: Vec<f64> = learnt.data().iter().map(|&x| x.into()).collect();
        for view in &mut scene.views {
            view.camera.distortion = view.camera.distortion.with_coefficients(&learnt);
        }
        Ok(())
    },
    ..Learnable::new("distortion", Subjects::Scene, 2e-3)
};

/// A light's colour, `[3]`.
pub(crate) static LIGHT_COLORS: Learnable = Learnable {
    name: "light",
    entry: |learn| learn.lights.as_ref().map(Entry::from),
    start: |scene, light| {
        let color = scene.description.lights[light].color();
        Some(Tensor::from(color.map(|x| x as f32)))
    },
    apply: |scene, light, learnt, _| {
        let (LightEntry::Ambient { color }
        | LightEntry::Directional { color, .. }
        | LightEntry::Point { color, .. }) = &mut scene.description.lights[light];
        *color = std::array::from_fn(|k| NotNegative(learnt.data()[k].into()));
        Ok(())
    },
    ..light("lights", Subjects::Lights)
};

/// The direction to a light, of length 1 at its start, or the place of a point, `[3]`.
pub(crate) static LIGHT_PLACES: Learnable = Learnable {
    name: "light_place",
    entry: |learn| learn.light_places.as_ref().map(Entry::from),
    unit: "1, and of points the scene's radius",
    unit_size: |scene, light| match scene.description.lights[light].place() {
        Some(LightPlace::Position(_)) => scene.ball().1,
        _ => 1.0,
    },
    start: |scene, light| {
        let vector = match scene.description.lights[light].place()? {
            LightPlace::Direction(direction) => direction.normalize(),
            LightPlace::Position(position) => position,
        };
        Some(Tensor::from(vector.as_vec3().to_array()))
    },
    apply: |scene, light, learnt, _| {
        let learnt = std::array::from_fn(|k| Finite(learnt.data()[k].into()));
        match &mut scene.description.lights[light] {
            LightEntry::Directional { direction: vector, .. }
            | LightEntry::Point { position: vector, .. } => *vector = learnt,
            LightEntry::Ambient { .. } => (),
        }
        Ok(())
    },
    ..Learnable::new("light_places", Subjects::Lights, 0.02)
};

/// The environment's texels, `[6, S, S, 3]`.
pub(crate) static ENVIRONMENT: Learnable = Learnable {
    entry: |learn| learn.environment.as_ref().map(Entry::from),
    refusal: |scene, _, _| {
        let rule = "an environment that is learnt is in the scene";
        scene.environment.is_none().then(|| rule.to_owned())
    },
    start: |scene, _| scene.environment.clone(),
    apply: |scene, _, texels, _| {
        scene.environment = Some(texels.clone());
        Ok(())
    },
    ..light("environment", Subjects::Scene)
};

/// The standard deviation of the blur in pixels, a number.
pub(crate) static BLUR: Learnable = Learnable {
    entry: |learn| learn.blur.as_ref().map(Entry::from),
    mapping: Mapping::Softplus,
    // It is above 0 in any scene.
    margin: 0.0,
    unit: "pixels, before softplus",
    refusal: |scene, _, _| {
        let rule = "a blur that is learnt is in the pipeline";
        scene.description.pipeline.blur.is_none().then(|| rule.to_owned())
    },
    start: |scene, _| number(scene.description.pipeline.blur?.0),
    apply: |scene, _, sigma, _| {
        scene.description.pipeline.blur = Some(Positive(sigma.item().into()));
        Ok(())
    },
    ..Learnable::new("blur", Subjects::Scene, 0.05)
};

/// The unit of motions.
const MOTION: &str = "radians, and the scene's radius";

/// A channel of materials' maps of roughness and metallic.
const fn channel<const CHANNEL: usize>(key: &'static str) -> Learnable {
    Learnable {
        refusal: |scene, index, name| {
            let key = ["roughness", "metallic"][CHANNEL];
            let lacks_map = material(scene, index)?.1.roughness_metallic.is_missing;
            lacks_map.then(|| missing_image(key, name))
        },
        start: |scene, index| {
            let (_, material) = material(scene, index)?;
            let number = [material.roughness, material.metallic][CHANNEL];
            material.roughness_metallic_map(CHANNEL).or(Some(Tensor::scalar(number)))
        },
        apply: |scene, index, map, _| {
            set_material(scene, index, |material| set_channel(material, CHANNEL, map));
            Ok(())
        },
        ..share(key, Subjects::Materials)
    }
}

/// Numbers from 0 to 1.
const fn share(key: &'static str, subjects: Subjects) -> Learnable {
    let row = Learnable::new(key, subjects, 0.05);
    Learnable { mapping: Mapping::Sigmoid, unit: "before the sigmoid", ..row }
}

/// Light, which is above 0.
const fn light(key: &'static str, subjects: Subjects) -> Learnable {
    let row = Learnable::new(key, subjects, 0.03);
    Learnable { mapping: Mapping::Softplus, unit: "before softplus", ..row }
}

fn number(number: f64) -> Option<Tensor<f32>> {
    Some(Tensor::scalar(number as f32))
}

/// The material with this index, and its object.
fn material(scene: &Scene, index: usize) -> Option<(&Object, &SurfaceMaterial)> {
    let mut all = scene
        .objects
        .iter()
        .flat_map(|object| object.materials.iter().map(move |material| (object, material)));
    all.nth(index)
}

fn set_material(scene: &mut Scene, index: usize, set: impl Fn(&mut SurfaceMaterial)) {
    let mut materials = scene.objects.iter_mut().flat_map(|object| &mut object.materials);
    materials.nth(index).into_iter().for_each(set);
}

/// Sets roughness, channel 0, or metallic, channel 1.
fn set_channel(material: &mut SurfaceMaterial, channel: usize, learnt: &Tensor<f32>) {
    let number = match channel {
        0 => &mut material.roughness,
        _ => &mut material.metallic,
    };
    match &material.roughness_metallic.texels {
        Some(maps) => {
            let both = Tensor::from_flat_fn(maps.shape(), |k| {
                if k % 2 == channel { learnt.data()[k / 2] } else { maps.data()[k] }
            });
            material.roughness_metallic.texels = Some(both);
        }
        None => *number = learnt.data()[0],
    }
}

fn missing_image(key: &str, name: &str) -> String {
    let rule = format!("an image that `learn.{key}` learns is there");
    format!("{rule}, and of {name:?} its file names one that is missing or can't be read")
}

/// Why views of several kinds of lens can't learn one.
fn several_lenses(scene: &Scene) -> Option<String> {
    let mut lenses = scene.views.iter().map(|view| view.camera.distortion);
    let first = lenses.next()?;
    if lenses.all(|lens| lens.is_kind_of(&first)) {
        return None;
    }
    let rule = "a `distortion` that is learnt is of one kind of lens";
    let kinds = scene.views.iter().map(|view| view.camera.distortion.kind());
    let kinds: std::collections::BTreeSet<_> = kinds.collect();
    let kinds = kinds.into_iter().collect::<Vec<_>>().join(" and ");
    Some(format!("{rule}, and those of the views are {kinds}"))
}
